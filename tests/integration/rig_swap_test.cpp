// Two trackers of one hand in a rig of real processes: which one owns the hand, and a held cube while the owner
// changes.
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <functional>
#include <optional>

#include "integration/rig_fixture.hpp"
#include "runtime/clock.hpp"

namespace softhand::rig::rig_swap_test {
namespace {

std::vector<std::string> as_arguments(const std::vector<std::string>& settings) {
  std::vector<std::string> arguments;
  for (const std::string& setting : settings) arguments.insert(arguments.end(), {"--set", setting});
  return arguments;
}

// The command of a tracker with source 2. It is not part of the rig, so nobody restarts it. A restarted tracker would
// begin its motion again and own the hand.
std::vector<std::string> stronger_tracker(const std::string& strength, const std::vector<std::string>& settings) {
  std::vector<std::string> command{SOFTHAND_PROGRAMS "/softhand-tracker-replay",
                                   "--config",
                                   SOFTHAND_SOURCE_DIR "/config/scenes/pinch.toml",
                                   "--module",
                                   "strong",
                                   "--strength",
                                   strength,
                                   "--source",
                                   "2"};
  const std::vector<std::string> arguments = as_arguments(settings);
  command.insert(command.end(), arguments.begin(), arguments.end());
  return command;
}

TEST_F(Rig, StrongerTrackerOwnsTheHandUntilItDies) {
  RigListener listener;
  Up up("tests/integration/rig_two_trackers.toml", {});
  const auto owner = [&] { return listener.tracked.empty() ? 0u : listener.tracked.back().source; };
  ASSERT_TRUE(listener.wait(20s, [&] {
    return listener.process_id("weak") > 0 && listener.process_id("strong") > 0 && owner() == 2;
  })) << up.output();
  listener.listen(500ms);  // the change itself is not tested
  const Nanoseconds settled = now();
  listener.listen(2s);
  const auto since = [&](Nanoseconds time, std::uint32_t source) {
    return std::count_if(listener.tracked.begin(), listener.tracked.end(),
                         [&](const auto& s) { return s.published > time && s.source == source; });
  };
  EXPECT_GT(since(settled, 2), 100);
  EXPECT_EQ(since(settled, 1), 0) << "the weaker tracker was heard although the stronger one lives";
  EXPECT_GT(listener.counter("weak", "published"), 100)
      << "the weaker tracker did not publish: this test shows nothing";

  const Nanoseconds killed = now();
  ASSERT_EQ(kill(static_cast<pid_t>(listener.process_id("strong")), SIGKILL), 0);
  ASSERT_TRUE(listener.wait(5s, [&] { return since(killed, 1) > 0; })) << "no tracker took the hand over";
  const auto taken = std::find_if(listener.tracked.begin(), listener.tracked.end(),
                                  [&](const auto& s) { return s.published > killed && s.source == 1; });
  std::printf("handed over after %.1f ms\n", milliseconds_between(killed, taken->published));
  EXPECT_LT(milliseconds_between(killed, taken->published), 300);
  EXPECT_TRUE(listener.wait(5s, [&] { return follows(listener, killed); }));
  EXPECT_TRUE(listener.wait(10s, [&] { return owner() == 2; })) << "the restarted tracker did not get the hand back";
}

TEST_F(Rig, HeldCubeSurvivesTheHandoverBetweenTrackers) {
  constexpr std::uint32_t kCube = 2;
  constexpr double kHoldBegins = 3.3;  // s of the motion
  const std::vector<std::string> hold{"generator.hold_time=60"};
  RigListener listener;
  Program strong(stronger_tracker("5", hold));
  Up up(kDemo, as_arguments(hold));
  const auto owner = [&] { return listener.tracked.empty() ? 0u : listener.tracked.back().source; };
  ASSERT_TRUE(listener.wait(30s, [&] { return all_present(listener) && listener.process_id("strong") > 0; }))
      << up.output();
  // All begin again together. A hand that starts late would find the fingers closed in the cube.
  const double reset = static_cast<double>(now()) * 1e-9;
  ASSERT_EQ(run_program({SOFTHAND_PROGRAMS "/softhand", "send", "*", "reset", "now"}).exit_code, 0);
  const auto holds = [&](const char* module) {
    const double start = listener.counter(module, "motion_start_s");  // NaN before it is known
    return start > reset && static_cast<double>(now()) * 1e-9 > start + kHoldBegins + 1;
  };
  ASSERT_TRUE(listener.wait(30s, [&] { return holds("tracker") && holds("strong"); })) << up.output();
  ASSERT_EQ(owner(), 2u);
  ASSERT_GT(listener.objects[kCube][1], 0.14) << "the cube was not lifted: this test shows nothing";

  strong.send_signal(SIGKILL);
  ASSERT_TRUE(listener.wait(5s, [&] { return owner() != 2; }));
  double lowest = listener.objects[kCube][1], highest = lowest;
  listener.wait(3s, [&] {
    lowest = std::min(lowest, listener.objects[kCube][1]);
    highest = std::max(highest, listener.objects[kCube][1]);
    return false;
  });
  std::printf("the cube moved by %.2f mm in height during the handover and 3 s after it\n", (highest - lowest) * 1e3);
  EXPECT_GT(lowest, 0.14);
  EXPECT_LT(highest - lowest, 3e-3);
}

// Steps that the loops of the held cube did not make in time.
std::uint64_t missed_deadlines(const RigListener& listener) {
  return listener.modules.at("hand").deadline_misses + listener.modules.at("tracking").deadline_misses;
}

// A held cube while its hand goes from one tracker to another and back: by hand, by silence, by doubt, by SIGTERM and
// by SIGKILL. The trackers differ by 2 mm, as trackers do.
TEST_F(Rig, HeldCubeSurvivesEverySwapOfTrackers) {
  constexpr std::uint32_t kCube = 2, kOther = 0, kStrong = 2;  // kOther, kStrong: sources
  const std::vector<std::string> hold{"generator.hold_time=600", "generator.approach_time=8",
                                      "hand.model=right_400.hand.json"};
  RigListener listener;
  std::optional<Program> strong;
  const auto start_strong = [&](const char* strength, std::vector<std::string> settings) {
    settings.insert(settings.end(),
                    {"tracker.teleport_at=12", "tracker.teleport_time=3600", "tracker.teleport_offset=[0.002,0,0]"});
    settings.insert(settings.end(), hold.begin(), hold.end());
    strong.emplace(stronger_tracker(strength, settings));
  };
  start_strong("5", {"tracker.freeze_at=34", "tracker.freeze_time=2", "tracker.doubt_at=42", "tracker.doubt_time=2"});
  Up up(kDemo, as_arguments(hold));
  const auto motion_time = [&](const char* module) {
    const double start = listener.counter(module, "motion_start_s");
    return start > 0 ? static_cast<double>(now()) * 1e-9 - start : -1.0;
  };
  const auto owner = [&] { return listener.tracked.empty() ? 99u : listener.tracked.back().source; };
  ASSERT_TRUE(listener.wait(40s, [&] {
    return all_present(listener) && motion_time("tracker") > 14 && motion_time("strong") > 14 && owner() == kStrong;
  })) << up.output();
  ASSERT_GT(listener.objects[kCube][1], 0.14) << "the cube was not lifted: this test shows nothing";

  // Waits for the owner. Measures how far the cube moves from where it was 0.2 s before the swap, until 1 s after it.
  const auto swap = [&](const char* way, std::uint32_t to, const std::function<void()>& cause) {
    std::deque<std::pair<Nanoseconds, Vec3>> path;
    const auto follow = [&] {
      path.emplace_back(now(), listener.objects[kCube]);
      return false;
    };
    listener.wait(500ms, follow);
    const double swapped = listener.counter("tracking", "swapped");
    const std::uint64_t missed = missed_deadlines(listener);
    cause();
    EXPECT_TRUE(listener.wait(20s, [&] { return follow() || owner() == to; })) << way;
    const Nanoseconds since = now() - 200'000'000;
    listener.wait(1s, follow);
    while (path.front().first < since && path.size() > 1) path.pop_front();
    const Vec3 before = path.front().second;
    double farthest = 0;
    for (const auto& [time, at] : path)
      farthest = std::max(farthest, std::hypot(at[0] - before[0], at[1] - before[1], at[2] - before[2]));
    const std::uint64_t missed_here = missed_deadlines(listener) - missed;
    std::printf("%s to %s: the cube moved by %.2f mm, %.0f swaps, %llu deadlines missed\n", way,
                to == kStrong ? "strong" : "other", farthest * 1e3, listener.counter("tracking", "swapped") - swapped,
                static_cast<unsigned long long>(missed_here));
    EXPECT_LT(farthest, 5e-3) << way;
    EXPECT_GT(listener.objects[kCube][1], 0.14) << way << ": dropped";
  };
  for (const auto& [module, to] : {std::pair("tracker", kOther), std::pair("strong", kStrong)}) {
    std::optional<Program> command;
    swap("by hand", to, [&, name = module] {
      command.emplace(std::vector<std::string>{SOFTHAND_PROGRAMS "/softhand", "trackers", "use", name});
    });
    EXPECT_EQ(command->wait(10s), 0) << command->output();
  }
  swap("silence", kOther, [] {});
  swap("silence", kStrong, [] {});
  swap("doubt", kOther, [] {});
  swap("doubt", kStrong, [] {});
  for (const auto& [way, signal] : {std::pair("SIGTERM", SIGTERM), std::pair("SIGKILL", SIGKILL)}) {
    swap(way, kOther, [&, number = signal] { strong->send_signal(number); });
    swap(way, kStrong, [&] { start_strong("50", {"tracker.start_time=20"}); });
  }
}

}  // namespace
}  // namespace softhand::rig::rig_swap_test
