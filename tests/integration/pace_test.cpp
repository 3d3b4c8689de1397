// The rig's simulated clock. Every process follows it, also one that is started later. Devices do not.
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "integration/rig_harness.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "service/time_control.hpp"
#include "support/own_domain.hpp"

namespace softhand::rig::pace_test {
namespace {

using namespace std::chrono_literals;

constexpr const char* kDemo = "config/rigs/demo.toml";
constexpr const char* kTouch = "tests/integration/rig_touch.toml";  // two fingers stay on a fixed post
constexpr std::uint32_t kHaptic = 1, kTactile = 2;                  // device ids of both
constexpr std::uint32_t kCube = 2;                                  // of the demo's objects
constexpr Nanoseconds kLate = 150'000'000;  // from sampling to publishing, on a machine with other load
constexpr const char* kModules[] = {"world", "hand", "tracking", "haptic", "tactile", "tracker"};

template <typename T>
bus::Topic<T> deep(bus::Topic<T> topic) {
  topic.depth = 512;  // no sample may be dropped
  return topic;
}

/// Commands a rig, and records on which clock its simulation is published.
class Pacer {
 public:
  Pacer()
      : commands_(participant_, bus::topics::message),
        replies_(participant_, bus::topics::message_reply),
        tracked_(participant_, deep(bus::topics::tracked_skeleton)),
        intermediate_(participant_, deep(bus::topics::intermediate_skeleton)),
        simulated_(participant_, deep(bus::topics::simulated_skeleton)),
        objects_(participant_, deep(bus::topics::objects)) {}

  struct Times {
    Nanoseconds sampled;
    Nanoseconds published;
  };
  std::map<std::string, std::vector<Times>> heard;
  std::map<std::string, std::uint32_t> answers;  // to the last command

  /// Sends a command to the rig as if it had been under way for `delay`. This process's own clock, `control`, gets the
  /// same command for comparison.
  void command(const std::string& key, const std::string& value, Nanoseconds delay = 0) {
    Message message;
    message.id = ++id_;
    message.stamp.sequence = id_;
    set_text(message.module, "*");
    set_text(message.key, key);
    set_text(message.value, value);
    message.stamp.sample_time = message.stamp.publish_time = now() - delay;
    answers.clear();
    commands_.write(message);
    control.answer(message, "test", now());
  }
  TimeControl control;

  void poll() {
    take(tracked_, "tracker"), take(intermediate_, "tracking"), take(simulated_, "hand"), take(objects_, "world");
    replies_.take_all([this](const MessageReply& reply) {
      if (reply.id == id_) answers[std::string(get_text(reply.module))] = reply.result;
    });
  }

  /// Clears `heard`, then listens.
  void listen(RigListener& listener, std::chrono::milliseconds duration) {
    poll();
    heard.clear();
    listener.wait(duration, [this] {
      poll();
      return false;
    });
  }

  /// Every sample of these processes must have the simulated time at which it was published, apart from a delay up to
  /// `kLate`.
  void expect_on_clock(std::initializer_list<const char*> processes) {
    for (const char* process : processes) {
      EXPECT_GT(heard[process].size(), 3u) << process;
      for (const Times& times : heard[process]) {
        const Nanoseconds age = control.clock().at(times.published) - times.sampled;
        EXPECT_GE(age, -10) << process;
        EXPECT_LE(age, kLate) << process;
      }
    }
  }

 private:
  template <typename T>
  void take(bus::Reader<T>& reader, const char* process) {
    reader.take_all([&](const T& message) {
      heard[process].push_back({message.stamp.sample_time, message.stamp.publish_time});
    });
  }
  bus::Participant participant_{"pacer"};
  bus::Writer<Message> commands_;
  bus::Reader<MessageReply> replies_;
  bus::Reader<Skeleton> tracked_, intermediate_, simulated_;
  bus::Reader<WorldObjects> objects_;
  std::uint64_t id_ = 0;
};

class Pace : public ::testing::Test {
 protected:
  Pace() { testing::use_own_domain(); }
  static bool all_present(const RigListener& listener) {
    return std::all_of(std::begin(kModules), std::end(kModules),
                       [&](const char* module) { return listener.process_id(module) > 0; });
  }
};

TEST_F(Pace, AllLoopsSlowDownTogetherAndARestartedOneToo) {
  RigListener listener;
  Pacer pacer;
  Up up(kTouch, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  ASSERT_TRUE(listener.wait(20s, [&] { return listener.device_is_on(kHaptic) && listener.device_is_on(kTactile); }));
  pacer.listen(listener, 1000ms);
  const auto steps_at_full_pace = pacer.heard["world"].size();
  pacer.expect_on_clock({"tracker", "tracking", "hand", "world"});

  pacer.command("pace", "0.25");
  EXPECT_TRUE(listener.wait(2s, [&] {
    pacer.poll();
    return std::all_of(std::begin(kModules), std::end(kModules),
                       [&](const char* module) { return pacer.answers.count(module) > 0; });
  }));
  for (const char* module : kModules) EXPECT_EQ(pacer.answers[module], kReplyApplied) << module;
  listener.listen(300ms);
  pacer.listen(listener, 2000ms);
  pacer.expect_on_clock({"tracker", "tracking", "hand", "world"});
  // At a quarter of the pace, twice the time gives half as many samples.
  EXPECT_LT(static_cast<double>(pacer.heard["world"].size()), 0.8 * static_cast<double>(steps_at_full_pace));
  for (const auto& [process, samples] : pacer.heard) {
    const double pace = static_cast<double>(samples.back().sampled - samples.front().sampled) /
                        static_cast<double>(samples.back().published - samples.front().published);
    EXPECT_NEAR(pace, 0.25, 0.05) << process;
  }
  EXPECT_EQ(listener.counter("hand", "pace"), 0.25);

  const std::int64_t killed = listener.process_id("hand");
  kill(static_cast<pid_t>(killed), SIGKILL);
  ASSERT_TRUE(listener.wait(20s, [&] { return listener.process_id("hand") != killed; })) << up.output();
  listener.listen(500ms);
  pacer.listen(listener, 1500ms);
  pacer.expect_on_clock({"tracker", "tracking", "hand", "world"});

  pacer.command("pace", "1");
  listener.listen(500ms);
  pacer.listen(listener, 1000ms);
  pacer.expect_on_clock({"tracker", "tracking", "hand", "world"});
  EXPECT_GT(static_cast<double>(pacer.heard["world"].size()), 0.5 * static_cast<double>(steps_at_full_pace));
  EXPECT_TRUE(listener.wait(10s, [&] { return listener.device_is_on(kHaptic) && listener.device_is_on(kTactile); }))
      << "the devices must come back";
}

// The user halts the rig for a while and then starts another tracker by hand.
TEST_F(Pace, AProcessThatStartsByHandLaterTakesOverTheClock) {
  RigListener listener;
  Pacer pacer;
  Up up(kTouch, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  pacer.command("pace", "0");
  listener.listen(1500ms);
  pacer.command("pace", "1");
  listener.listen(500ms);
  const Program tracker({SOFTHAND_PROGRAMS "/softhand-tracker-replay", "--config",
                         SOFTHAND_SOURCE_DIR "/tests/integration/rig_touch_scene.toml", "--module", "second",
                         "--strength", "200", "--source", "7"});
  ASSERT_TRUE(listener.wait(10s, [&] { return !listener.tracked.empty() && listener.tracked.back().source == 7; }))
      << tracker.output();
  pacer.listen(listener, 1000ms);
  pacer.expect_on_clock({"tracker", "tracking", "hand", "world"});
  EXPECT_EQ(listener.counter("second", "behind_s"), listener.counter("tracker", "behind_s"));
  EXPECT_EQ(listener.counter("tracking", "refused_stamp"), 0);
}

TEST_F(Pace, PausesWithDevicesAtZeroAndAdvancesInSteps) {
  RigListener listener;
  Pacer pacer;
  Up up(kTouch, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  ASSERT_TRUE(listener.wait(20s, [&] { return listener.device_is_on(kHaptic) && listener.device_is_on(kTactile); }));
  pacer.command("pace", "0");
  listener.listen(500ms);
  pacer.listen(listener, 500ms);
  for (const auto& [process, samples] : pacer.heard) EXPECT_EQ(samples.size(), 0u) << process;
  // Devices are still written to in real time, with zero commands.
  for (const std::uint32_t device : {kHaptic, kTactile}) {
    const Nanoseconds since = now() - 400'000'000;
    ASSERT_GT(listener.devices[device].back().time, since) << device;
    for (auto sample = listener.devices[device].rbegin();
         sample != listener.devices[device].rend() && sample->time > since; ++sample) {
      EXPECT_FALSE(sample->live) << device;
      EXPECT_EQ(sample->largest_command, 0) << device;
    }
  }

  const Nanoseconds before = pacer.control.clock().at(now());
  pacer.listen(listener, 0ms);
  pacer.command("advance", "0.1");
  listener.wait(1s, [&] {
    pacer.poll();
    return false;
  });
  EXPECT_EQ(pacer.control.clock().at(now()) - before, 100'000'000);
  pacer.expect_on_clock({"tracker", "tracking", "hand", "world"});
  EXPECT_LE(pacer.heard["hand"].size(), 10u);  // 9 on the grid
  EXPECT_LE(pacer.heard["world"].size(), 26u);
  for (const auto& [process, samples] : pacer.heard) EXPECT_LE(samples.back().sampled, before + 100'000'000) << process;

  pacer.command("pace", "2");
  listener.wait(500ms, [&] {
    pacer.poll();
    return false;
  });
  EXPECT_EQ(pacer.answers["hand"], kReplyRefused);
  EXPECT_EQ(pacer.answers["haptic"], kReplyRefused);
}

TEST_F(Pace, ResetStartsOver) {
  RigListener listener;
  Pacer pacer;
  Up up(kDemo, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  const auto height = [&] { return listener.objects.count(kCube) != 0 ? listener.objects.at(kCube)[1] : 0.0; };
  for (int round = 0; round < 2; ++round) {
    ASSERT_TRUE(listener.wait(20s, [&] { return height() > 0.05; })) << "never lifted in round " << round;
    pacer.command("reset", "now");
    ASSERT_TRUE(listener.wait(1s, [&] { return height() < 0.03; }));
    const double motion_start = listener.counter("tracker", "motion_start_s");
    listener.listen(500ms);
    EXPECT_GT(listener.counter("tracker", "motion_start_s"), motion_start);
    // The cube is at its start and at rest. No hand drags it away.
    const Vec3& cube = listener.objects.at(kCube);
    EXPECT_NEAR(cube[0], 0, 0.002);
    EXPECT_NEAR(cube[1], 0.02, 0.002);
    EXPECT_NEAR(cube[2], 0, 0.002);
  }
  EXPECT_TRUE(listener.wait(20s, [&] { return height() > 0.05; })) << "the cube must be lifted again";
}

// A process that is discovered late gets a reset late. Two trackers must play their motions together nevertheless.
TEST_F(Pace, AMotionBeginsAtTheTimeOfTheResetAlsoWhenTheMessageIsLate) {
  RigListener listener;
  Pacer pacer;
  const Program tracker(
      {SOFTHAND_PROGRAMS "/softhand-tracker-replay", "--config", SOFTHAND_SOURCE_DIR "/config/scenes/pinch.toml"});
  ASSERT_TRUE(listener.wait(10s, [&] { return listener.counter("tracker", "motion_start_s") > 0; }));
  const Nanoseconds sent = now() - 900'000'000;
  pacer.command("reset", "now", 900'000'000);
  const double begin = static_cast<double>(sent + TimeControl::kNotice) * 1e-9;
  EXPECT_TRUE(listener.wait(5s, [&] { return std::abs(listener.counter("tracker", "motion_start_s") - begin) < 0.01; }))
      << "the motion began " << listener.counter("tracker", "motion_start_s") - begin << " s late";
}

}  // namespace
}  // namespace softhand::rig::pace_test
