// The safety layer around every device driver.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <vector>

#include "device/device_loop.hpp"
#include "device/record_log.hpp"
#include "haptics/log/haptic_log_driver.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "support/block_hand.hpp"
#include "support/counters.hpp"
#include "support/press.hpp"
#include "tactile/log/tactile_log_driver.hpp"

namespace softhand::device_test {
namespace {

constexpr Nanoseconds kMillisecond = 1'000'000;
constexpr Nanoseconds kStart = 5'000 * kMillisecond;

struct Written {
  std::vector<std::vector<double>> commands;
  int releases = 0;
};

// Wants to render the x-force of the first two bones.
class FakeDriver : public HapticDriver {
 public:
  explicit FakeDriver(Written& written) : written_(written) {}
  DeviceLimits limits() const override { return {2, -3, 3, 500}; }
  void command(const BoneWrench& input, std::span<double> requested) override {
    requested[0] = input.bones[0].coupling_force[0];
    requested[1] = input.bones[1].coupling_force[0];
  }
  void write(Nanoseconds, std::span<const double> commands) override {
    written_.commands.emplace_back(commands.begin(), commands.end());
  }
  bool release() override {
    ++written_.releases;
    return true;
  }

 private:
  Written& written_;
};

BoneWrench wrench(double first, double second, std::uint64_t sequence, Nanoseconds time) {
  BoneWrench w;
  w.simulated_valid = 1;
  w.stamp.sequence = sequence;
  w.stamp.epoch = 1;
  w.stamp.publish_time = time;
  w.bones[0].coupling_force[0] = first;
  w.bones[1].coupling_force[0] = second;
  return w;
}

class Device : public ::testing::Test {
 protected:
  Written written;
  DeviceLoop<BoneWrench> loop{DeviceLoopOptions{}, std::make_unique<FakeDriver>(written), 3, 0};
  Nanoseconds now = kStart;
  std::uint64_t sequence = 0;

  const DeviceState& feed(double first, double second, int steps = 1) {
    const DeviceState* state = nullptr;
    for (int i = 0; i < steps; ++i) {
      now += kMillisecond;
      const BoneWrench w = wrench(first, second, ++sequence, now);
      state = &loop.step(now, &w);
    }
    return *state;
  }
};

TEST_F(Device, CommandsAreClampedAndSlewed) {
  const DeviceState first = feed(10, -10);
  EXPECT_NEAR(first.commands[0], 0.5, 1e-9);  // 500 N/s for 1 ms
  EXPECT_NEAR(first.commands[1], -0.5, 1e-9);
  EXPECT_EQ(first.slewed, 1u);
  const DeviceState later = feed(10, -10, 100);
  EXPECT_EQ(later.commands[0], 3);
  EXPECT_EQ(later.commands[1], -3);
  EXPECT_EQ(later.clamped, 101u);
  for (std::size_t i = 1; i < written.commands.size(); ++i) {
    EXPECT_LE(std::abs(written.commands[i][0] - written.commands[i - 1][0]), 0.5 + 1e-9);
  }
  EXPECT_EQ(later.live, 1u);
}

// A force that lingers would push a user who lets go.
TEST_F(Device, CommandsReturnToZeroWithoutSlew) {
  feed(2, 2, 50);
  EXPECT_EQ(feed(0.5, -1).commands[0], 0.5);
  EXPECT_NEAR(loop.step(now, nullptr).commands[1], -0.5, 1e-9);  // to zero at once, and from there by the slew limit
}

TEST_F(Device, CommandsFadeOverTheLastFifthOfTheirTime) {
  feed(2, 2, 50);
  const Nanoseconds died = now;
  for (int i = 1; i <= 60; ++i) {
    const double command = loop.step(now += kMillisecond, nullptr).commands[0];
    EXPECT_NEAR(command, 2 * std::clamp((40 - i) / 8.0, 0.0, 1.0), 1e-9) << (now - died) / kMillisecond;
  }
}

// A thread beside the loop watches it.
TEST_F(Device, HungLoopIsReleasedAndBeginsAgainFromZero) {
  feed(2, 2, 50);
  for (int i = 0; i < 1000; ++i) {
    loop.watch(now += kMillisecond);
    EXPECT_EQ(written.releases, i < 25 ? 0 : 1 + (i - 25) / 25) << i;  // again, but not in each turn
  }
  LoopStatus status;
  loop.fill_status(status, now);
  EXPECT_EQ(testing::counter_of(status, "released"), 1);
  EXPECT_EQ(feed(2, 2).commands[0], 0);
  EXPECT_NEAR(feed(2, 2).commands[0], 0.5, 1e-9);  // by the slew limit
  feed(2, 2, 50);
  loop.watch(now + 10 * kMillisecond);
  const int before = written.releases;
  loop.stop(now);
  loop.watch(now + 100 * kMillisecond);
  EXPECT_EQ(written.releases, before);
}

// Nobody watched, or the driver has no `release`.
TEST_F(Device, LoopThatHungBeginsAgainFromZero) {
  feed(2, 2, 50);
  now += 30 * kMillisecond;
  EXPECT_EQ(feed(2, 2).commands[0], 0);
  EXPECT_NEAR(feed(2, 2).commands[0], 0.5, 1e-9);
}

// The tracking loop goes on while the simulation of the hand hangs. At a slow pace it notices this late, because its
// clock is slow too (`tracking.simulated_stale_after`): 4 s later at a pace of 0.01. The device does not wait.
TEST_F(Device, HungSimulationZeroesAtAnyPace) {
  feed(2, 2, 50);
  const Nanoseconds hung = now;
  for (int i = 1; i <= 100; ++i) {
    BoneWrench w = wrench(2, 2, ++sequence, now += kMillisecond);
    w.stamp.chain.simulated_published = hung;
    const double command = loop.step(now, &w).commands[0];
    EXPECT_EQ(command == 0, i >= 40) << i;
  }
}

TEST_F(Device, StaleInputZeroesWithin50MillisecondsUntilNewInputArrives) {
  feed(2, 2, 50);
  const Nanoseconds died = now;
  bool zero_in_time = false;
  for (int i = 0; i < 100; ++i) {
    now += kMillisecond;
    const DeviceState& state = loop.step(now, nullptr);
    if (now - died <= 50 * kMillisecond && state.commands[0] == 0) zero_in_time = true;
    if (now - died > 50 * kMillisecond) {
      EXPECT_EQ(state.commands[0], 0);
    }
  }
  EXPECT_TRUE(zero_in_time);
  EXPECT_EQ(loop.step(now, nullptr).stale, 1u);
  EXPECT_EQ(loop.step(now, nullptr).live, 0u);
  EXPECT_NEAR(feed(2, 2).commands[0], 0.5, 1e-9);  // from zero, by the slew limit
}

TEST_F(Device, RepeatedAndBackloggedInputDoesNotKeepItAlive) {
  feed(2, 2, 50);
  const BoneWrench same = wrench(2, 2, sequence, now);
  for (int i = 0; i < 60; ++i) {
    now += kMillisecond;
    loop.step(now, &same);
  }
  EXPECT_EQ(written.commands.back()[0], 0);
  EXPECT_EQ(loop.counters().repeated, 60u);
  const BoneWrench backlog = wrench(2, 2, sequence + 1, now - 60 * kMillisecond);
  EXPECT_EQ(loop.step(now += kMillisecond, &backlog).commands[0], 0);
}

// A stopped process (SIGSTOP, a debugger) later finds old messages in its sockets.
TEST_F(Device, BacklogIsStaleAfterAnyTime) {
  for (const double seconds : {0.06, 9.9, 12.0, 3600.0}) {
    BoneWrench backlog = wrench(2, 2, ++sequence, now - static_cast<Nanoseconds>(seconds * 1e9));
    backlog.stamp.clock_id = clock_id();
    EXPECT_EQ(loop.step(now += kMillisecond, &backlog).commands[0], 0) << seconds;
  }
  const BoneWrench unstamped = wrench(2, 2, ++sequence, 0);  // 0: unknown
  EXPECT_GT(loop.step(now += kMillisecond, &unstamped).commands[0], 0);
}

TEST_F(Device, StampsOfTheFutureAndOfOtherHostsAreRefused) {
  BoneWrench ahead = wrench(2, 2, ++sequence, now + static_cast<Nanoseconds>(3600e9));
  EXPECT_EQ(loop.step(now += kMillisecond, &ahead).commands[0], 0);
  BoneWrench foreign = wrench(2, 2, ++sequence, now);
  foreign.stamp.clock_id = clock_id() + 1;
  EXPECT_EQ(loop.step(now += kMillisecond, &foreign).commands[0], 0) << "the offset of its clock is not known";
  EXPECT_EQ(loop.counters().refused_stamp, 2u);
  BoneWrench own = wrench(2, 2, ++sequence, now);
  own.stamp.clock_id = clock_id();
  EXPECT_GT(loop.step(now += kMillisecond, &own).commands[0], 0);
}

TEST_F(Device, NeverFollowsTwoWritersInTurn) {
  const auto from = [&](std::uint64_t epoch, double force) {
    BoneWrench w = wrench(force, 0, ++sequence, now += kMillisecond);
    w.stamp.epoch = epoch;
    return loop.step(now, &w).commands[0];
  };
  for (int i = 0; i < 50; ++i) {
    EXPECT_GE(from(1, 2), 0);
    EXPECT_GE(from(2, -2), 0) << "the force of a second writer reached the device";
  }
  EXPECT_EQ(loop.counters().second_writer, 50u);
  for (int i = 0; i < 250; ++i) from(2, -2);
  EXPECT_LT(from(2, -2), 0) << "the place of a dead writer is free";
}

TEST_F(Device, DeadSimulationZeroes) {
  feed(2, 2, 50);
  BoneWrench dead = wrench(2, 2, ++sequence, now += kMillisecond);
  dead.simulated_valid = 0;
  EXPECT_EQ(loop.step(now, &dead).commands[0], 0);
}

TEST_F(Device, NonFiniteIsZeroAndCounted) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    const DeviceState& state = feed(bad, 1, 20);
    EXPECT_EQ(state.commands[0], 0);
    EXPECT_EQ(state.commands[1], 1);
  }
  EXPECT_EQ(loop.counters().nonfinite, 40u);
}

TEST_F(Device, StopWritesZeroes) {
  feed(2, 2, 50);
  loop.stop(now);
  EXPECT_EQ(written.commands.back(), (std::vector<double>{0, 0}));
}

TEST(DeviceExit, DestructorWritesZeroes) {
  Written written;
  {
    DeviceLoop<BoneWrench> loop({}, std::make_unique<FakeDriver>(written), 3, 0);
    for (int i = 1; i < 20; ++i) {
      const BoneWrench w = wrench(2, 2, static_cast<std::uint64_t>(i), kStart + i * kMillisecond);
      loop.step(kStart + i * kMillisecond, &w);
    }
    ASSERT_GT(written.commands.back()[0], 0);
  }
  EXPECT_EQ(written.commands.back()[0], 0);
}

TEST_F(Device, MessagesSwitchMotorsAndGain) {
  Message message;
  set_text(message.module, "glove");
  set_text(message.key, "motors");
  set_text(message.value, "off");
  EXPECT_EQ(loop.answer(message, "other").result, kReplyIgnored);
  EXPECT_EQ(loop.answer(message, "glove").result, kReplyApplied);
  EXPECT_EQ(feed(2, 2, 20).commands[0], 0);
  set_text(message.value, "on");
  loop.answer(message, "glove");
  set_text(message.key, "gain");
  set_text(message.value, "0.5");
  EXPECT_EQ(loop.answer(message, "glove").result, kReplyApplied);
  EXPECT_EQ(feed(2, 2, 20).commands[0], 1);
  set_text(message.value, "1.5");
  EXPECT_EQ(loop.answer(message, "glove").result, kReplyRefused);
}

TEST(DeviceLimitsCheck, InvalidLimitsAreRefused) {
  EXPECT_THROW(DeviceGuard({}, {0, 0, 1, 1}, 0, 0), std::invalid_argument);
  EXPECT_THROW(DeviceGuard({}, {33, 0, 1, 1}, 0, 0), std::invalid_argument);
  EXPECT_THROW(DeviceGuard({}, {1, 1, 2, 1}, 0, 0), std::invalid_argument);
  EXPECT_THROW(DeviceGuard({}, {1, 0, 1, 0}, 0, 0), std::invalid_argument);
}

TEST(RecordLog, WritesEveryRecordOnceInOrder) {
  const std::string path = ::testing::TempDir() + "softhand_record_log.csv";
  {
    RecordLog<int> log(path, 1024, "value\n",
                       [](const int& value, std::string& text) { text += std::to_string(value) + "\n"; });
    for (int i = 0; i < 1000; ++i) ASSERT_TRUE(log.push(i));
    EXPECT_EQ(log.dropped(), 0u);
  }
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  EXPECT_EQ(line, "value");
  for (int i = 0; i < 1000; ++i) {
    ASSERT_TRUE(std::getline(in, line));
    ASSERT_EQ(line, std::to_string(i));
  }
  EXPECT_THROW(RecordLog<int>("/nonexistent/log", 8, "", [](const int&, std::string&) {}), std::runtime_error);
}

std::string read_all(const std::string& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), {}};
}

TEST(HapticLog, RendersAndLogsTheForceAgainstClosingAFinger) {
  HapticLogOptions options;
  options.file = ::testing::TempDir() + "softhand_haptic_log.jsonl";
  options.log_rate_hz = 1000;
  double commanded = 0;
  {
    DeviceLoop<BoneWrench> loop({}, std::make_unique<HapticLogDriver>(options), 1, 0);
    BoneWrench w = wrench(0, 0, 0, 0);
    // Index finger: 1 N and 2 N along the dorsal axis of the distal bone, which is turned so that this axis is +x. Ring
    // finger: a pull towards the palm.
    const std::size_t distal = static_cast<std::size_t>(index_of(distal_of(Finger::index)));
    w.bones[distal].intermediate_orientation = to_wire(Quaternion(Eigen::AngleAxisd(-M_PI / 2, Vector3::UnitZ())));
    w.bones[distal].coupling_force = {2, 5, 0};
    w.bones[distal - 1].coupling_force = {1, 0, 7};
    w.bones[static_cast<std::size_t>(index_of(distal_of(Finger::ring)))].coupling_force = {0, -4, 0};
    for (int i = 1; i <= 30; ++i) {
      w.stamp.sequence = static_cast<std::uint64_t>(i);
      w.stamp.publish_time = kStart + i * kMillisecond;
      const DeviceState& state = loop.step(kStart + i * kMillisecond, &w);
      commanded = state.commands[1];
      EXPECT_EQ(state.commands[3], 0);
      EXPECT_EQ(state.commands[0], 0);
    }
    EXPECT_NEAR(commanded, 3, 1e-9);
  }
  std::istringstream lines(read_all(options.file));
  std::string line;
  int count = 0;
  nlohmann::json last;
  while (std::getline(lines, line)) {
    last = nlohmann::json::parse(line);
    ++count;
    if (count == 30) {
      EXPECT_NEAR(last["commands_N"][1].get<double>(), commanded, 1e-8);
      EXPECT_EQ(last["bones"]["index_distal"]["coupling_force_N"][1], 5);
    }
  }
  EXPECT_GE(count, 30);
}

TEST(HapticLog, LogsTheFinalZeroCommands) {
  HapticLogOptions options;
  options.file = ::testing::TempDir() + "softhand_haptic_log_end.jsonl";
  {
    DeviceLoop<BoneWrench> loop({}, std::make_unique<HapticLogDriver>(options), 1, 0);
    BoneWrench w = wrench(0, 0, 0, 0);
    w.bones[static_cast<std::size_t>(index_of(distal_of(Finger::index)))].coupling_force = {0, 3, 0};
    for (int i = 1; i <= 33; ++i) {
      w.stamp.sequence = static_cast<std::uint64_t>(i);
      w.stamp.publish_time = kStart + i * kMillisecond;
      loop.step(kStart + i * kMillisecond, &w);
    }
    loop.stop(kStart + 34 * kMillisecond);
  }
  std::istringstream lines(read_all(options.file));
  std::string line, last;
  while (std::getline(lines, line)) last = line;
  EXPECT_EQ(nlohmann::json::parse(last)["commands_N"][1], 0) << last.substr(0, 200);
  EXPECT_EQ(nlohmann::json::parse(last)["time_ns"], kStart + 34 * kMillisecond);
}

TEST(TactileLog, EventsBeginAndEnd) {
  TactileLogOptions options;
  options.file = ::testing::TempDir() + "softhand_tactile_log.csv";
  {
    DeviceLoop<SkinTraction> loop({}, std::make_unique<TactileLogDriver>(options, testing::block_hand(1)), 2, 1);
    SkinTraction t;
    for (int i = 1; i <= 60; ++i) {
      const Nanoseconds now = kStart + i * 10 * kMillisecond;
      t.stamp.sequence = static_cast<std::uint64_t>(i);
      t.stamp.sample_time = t.stamp.publish_time = now;
      testing::press(t, Finger::index, i >= 20 && i < 40 ? 2.5 : 0.0, 0.25);
      const DeviceState& state = loop.step(now, &t);
      if (i < 20 || (i >= 22 && i < 40)) {
        EXPECT_NEAR(state.commands[1], i < 20 ? 0 : 0.5, 1e-6) << i;
      }
      EXPECT_EQ(state.commands[0], 0);
    }
  }
  const std::string text = read_all(options.file);
  const auto count = [&text](const std::string& word) {
    int n = 0;
    for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++n;
    return n;
  };
  EXPECT_EQ(count("index,begin,2.5,-1.25,0,-2.5,0.25,0,1e-05,0,7,"), 1);
  EXPECT_EQ(count("index,end"), 1);
  EXPECT_GE(count("index,update"), 5);
  EXPECT_EQ(count("thumb"), 0);
}

}  // namespace
}  // namespace softhand::device_test
