// Checks that every driver must pass (docs/add-a-device.md): "off" is zero force at the device within 50 ms, whatever
// the device does at that time. A test of a driver calls `conformance_faults`, and with a device or its simulator
// `conformance_faults_at_device`.
#pragma once

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "device/device_loop.hpp"
#include "device/tracker_source.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"

namespace softhand {
namespace conformance_detail {

inline constexpr Nanoseconds kMillisecond = 1'000'000, kStart = 5'000'000'000;
inline constexpr int kOffWithin = 50, kThenFor = 100;  // ms

// Passes everything on, and remembers what the device got.
template <typename Input>
class Recorder final : public DeviceDriver<Input> {
 public:
  explicit Recorder(std::shared_ptr<DeviceDriver<Input>> driver, std::vector<double>& written)
      : driver_(std::move(driver)), written_(written) {}
  DeviceLimits limits() const override { return driver_->limits(); }
  void command(const Input& input, std::span<double> requested) override {
    driver_->command(input, requested);
    if (asks_nan) requested[0] = std::numeric_limits<double>::quiet_NaN();
  }
  bool measure(Nanoseconds now, std::span<double> positions) override { return driver_->measure(now, positions); }
  bool measure_velocities(std::span<double> velocities) override { return driver_->measure_velocities(velocities); }
  bool measure_commands(std::span<double> commands) override { return driver_->measure_commands(commands); }
  void write(Nanoseconds now, std::span<const double> commands) override {
    written_.assign(commands.begin(), commands.end());
    driver_->write(now, commands);
  }
  bool release() override {
    if (!driver_->release()) return false;
    std::fill(written_.begin(), written_.end(), 0.0);
    return true;
  }

  bool asks_nan = false;

 private:
  std::shared_ptr<DeviceDriver<Input>> driver_;
  std::vector<double>& written_;
};

// Every finger is pushed open by `newton`, through a contact at its distal bone that moves to and fro.
inline void push(BoneWrench& input, double newton, double phase) {
  input.simulated_valid = 1;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    BoneSample& bone = input.bones[b];
    bone.coupling_force = {0.1 * newton, newton, -0.1 * newton};
    bone.tracked_position = {0.01 * static_cast<double>(b), 0.01 * std::sin(phase), 0};
    bone.contact_point = bone.tracked_position;
    bone.contact_normal = {0, 1, 0};
    bone.contact_stiffness = newton > 0 ? 800 : 0;
    bone.contact_damping = 2;
  }
}
// The palmar skin of every bone is pressed with `newton` from all sides, and slips.
inline void push(SkinTraction& input, double newton, double) {
  constexpr std::uint32_t rows = 4, columns = 6;
  constexpr float spacing = 0.006f, radius = 0.009f, area = 1e-5f;
  input.regions.clear();
  if (newton == 0) return;
  for (std::uint32_t i = 0; i < kBodyCount * rows * columns; ++i) {
    SkinRegion region;
    region.region = i;
    region.body = i / (rows * columns);
    const double around = M_PI * (static_cast<double>(i % columns) / (columns - 1) - 0.5);
    region.normal = {static_cast<float>(std::sin(around)), static_cast<float>(-std::cos(around)), 0};
    region.place = {radius * region.normal[0], radius * region.normal[1],
                    -spacing * static_cast<float>(i / columns % rows)};
    region.area = area;
    region.pressure = static_cast<float>(newton) / (rows * columns * area);
    region.slip_velocity = {0, 0, 0.05f};
    region.object = 1;
    input.regions.push_back(region);
  }
}

// The samples of a device that also tracks go nowhere.
class NoSink final : public TrackerSink {
 public:
  void hand(const Skeleton&) override {}
  void head(const HeadPose&) override {}
};

// Waits for the next millisecond and returns its time.
using NextMillisecond = std::function<Nanoseconds()>;
inline NextMillisecond virtual_time() {
  return [now = kStart]() mutable { return now += kMillisecond; };
}

// A driver in the loop of the SDK.
template <typename Input>
class Bench {
 public:
  Bench(const std::shared_ptr<DeviceDriver<Input>>& driver, NextMillisecond next)
      : recorder(std::make_shared<Recorder<Input>>(driver, written)),
        source(dynamic_cast<TrackerSource*>(driver.get())),
        loop(std::make_unique<DeviceLoop<Input>>(DeviceLoopOptions{}, recorder, 1, 0)),
        next_millisecond(std::move(next)) {}
  // One step of 1 ms. Inputs come at 90 Hz.
  void step() {
    ++milliseconds;
    const Nanoseconds now = next_millisecond();
    if (!loop) return;
    loop->watch(now);
    if (stands_still) return;
    NoSink sink;
    if (source != nullptr) source->poll(now, sink);
    const bool is_due = speaks && milliseconds * 90 / 1000 != (milliseconds - 1) * 90 / 1000;
    if (is_due) {
      ++input->stamp.sequence;
      input->stamp.epoch = 1;
      input->stamp.sample_time = input->stamp.publish_time = now;
      if (!hangs) input->stamp.chain.simulated_published = now;
      push(*input, newton, 0.02 * static_cast<double>(milliseconds));
      if constexpr (std::is_same_v<Input, BoneWrench>) input->simulated_valid = has_hand ? 1 : 0;
    }
    loop->step(now, is_due ? input.get() : nullptr);
  }
  void run(int steps) {
    for (int i = 0; i < steps; ++i) step();
  }
  void say(std::string_view key, std::string_view value) {
    Message message;
    set_text(message.module, "device");
    set_text(message.key, key);
    set_text(message.value, value);
    loop->answer(message, "device");
  }
  bool is_off() const {
    return std::all_of(written.begin(), written.end(), [](double command) { return command == 0; });
  }

  std::vector<double> written;
  std::shared_ptr<Recorder<Input>> recorder;
  TrackerSource* source;
  std::unique_ptr<DeviceLoop<Input>> loop;
  NextMillisecond next_millisecond;
  std::unique_ptr<Input> input = std::make_unique<Input>();
  std::int64_t milliseconds = 0;
  double newton = 0;
  bool speaks = true, hangs = false, has_hand = true, stands_still = false;
};

template <typename Input>
struct Action {
  std::string name;
  std::function<void(Bench<Input>&)> run;
};
inline constexpr const char* kPressing = "pressing";

template <typename Input>
std::vector<Action<Input>> states() {
  using B = Bench<Input>;
  const auto press = [](B& b) { b.newton = 5, b.run(200); };
  return {
      {"before the first input", [](B& b) { b.speaks = false, b.run(10), b.speaks = true; }},
      {"in the air", [](B& b) { b.run(100); }},
      {"at the first touch", [](B& b) { b.run(100), b.newton = 5, b.run(13); }},
      {kPressing, press},
      {"pressing beyond the limit", [](B& b) { b.newton = 1000, b.run(200); }},
      {"letting go", [=](B& b) { press(b), b.newton = 0, b.run(3); }},
      {"while commands fade", [=](B& b) { press(b), b.speaks = false, b.run(36), b.speaks = true; }},
      {"after a silence", [=](B& b) { press(b), b.speaks = false, b.run(300), b.speaks = true, b.run(30); }},
      {"asking for NaN", [=](B& b) { press(b), b.recorder->asks_nan = true, b.run(30); }},
      {"switched off and on",
       [=](B& b) { press(b), b.say("motors", "off"), b.run(20), b.say("motors", "on"), b.run(50); }},
  };
}

template <typename Input>
std::vector<Action<Input>> ways_off() {
  using B = Bench<Input>;
  std::vector<Action<Input>> ways{
      {"motors off", [](B& b) { b.say("motors", "off"); }},
      {"gain 0", [](B& b) { b.say("gain", "0"); }},
      {"no inputs", [](B& b) { b.speaks = false; }},
      {"end of the process", [](B& b) { b.loop->stop(now()), b.loop = nullptr; }},
      {"exception", [](B& b) { b.loop = nullptr; }},
      {"hung loop", [](B& b) { b.stands_still = true; }},
  };
  if constexpr (std::is_same_v<Input, BoneWrench>) {
    ways.push_back({"dead simulation", [](B& b) { b.has_hand = false; }});
    ways.push_back({"hung simulation", [](B& b) { b.hangs = true; }});
  }
  return ways;
}

inline std::string not_zero(const std::string& state, const std::string& way, int milliseconds) {
  return state + ", " + way + ": a command is not zero after " + std::to_string(milliseconds) + " ms";
}

}  // namespace conformance_detail

/// Runs the driver in the loop of the SDK, in each state with each way of being switched off. Looks at what the loop
/// writes to the driver. The time is virtual. Returns what it found wrong: nothing, if the driver conforms. `make`
/// returns a new driver.
template <typename Input>
std::vector<std::string> conformance_faults(const std::function<std::shared_ptr<DeviceDriver<Input>>()>& make) {
  using namespace conformance_detail;
  std::vector<std::string> faults;
  for (const Action<Input>& state : states<Input>()) {
    for (const Action<Input>& way : ways_off<Input>()) {
      Bench<Input> bench(make(), virtual_time());
      state.run(bench);
      if (state.name == kPressing && bench.is_off()) faults.push_back("no command while pressing");
      way.run(bench);
      for (int i = 1; i <= kOffWithin + kThenFor; ++i) {
        bench.step();
        if (i >= kOffWithin && !bench.is_off()) {
          faults.push_back(not_zero(state.name, way.name, i));
          break;
        }
      }
    }
  }
  if constexpr (std::is_same_v<Input, BoneWrench>) {
    // The local model asks for commands of parts of an input.
    const auto driver = make();
    const std::size_t actuators = driver->limits().actuators;
    std::mt19937_64 random(1);
    std::uniform_real_distribution<double> force(-3, 3);
    std::array<std::vector<double>, 3> commands;
    commands.fill(std::vector<double>(actuators, 0.0));
    std::array<BoneWrench, 3> inputs;
    for (BoneWrench& input : inputs) push(input, 0, 1);
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      for (std::size_t i = 0; i < 3; ++i) {
        for (auto part : {&BoneSample::coupling_force, &BoneSample::coupling_torque}) {
          (inputs[0].bones[b].*part)[i] = force(random);
          (inputs[1].bones[b].*part)[i] = force(random);
          (inputs[2].bones[b].*part)[i] = (inputs[0].bones[b].*part)[i] + (inputs[1].bones[b].*part)[i];
        }
      }
    }
    for (std::size_t i = 0; i < 3; ++i) driver->command(inputs[i], commands[i]);
    for (std::size_t a = 0; a < actuators; ++a) {
      if (!(std::abs(commands[0][a] + commands[1][a] - commands[2][a]) <= 1e-6))
        faults.push_back("command of actuator " + std::to_string(a) + " is not linear in the forces");
    }
  }
  return faults;
}

/// A driver that is connected to its device or to a simulator of it.
template <typename Input>
struct DriverAtDevice {
  std::shared_ptr<DeviceDriver<Input>> driver;
  std::function<bool()> is_at_zero;  ///< whether the device exerts nothing now. Called every millisecond
  /// True after the machine held back the bytes to or from the device, so that the measurement is worth nothing and is
  /// repeated. Null: never.
  std::function<bool()> stood_still = nullptr;
};

namespace conformance_detail {

// Real time. Remembers whether this process stood still for so long that its own measurement is worth nothing.
class RealTime {
 public:
  Nanoseconds next() {
    due_ += std::chrono::milliseconds(1);
    std::this_thread::sleep_until(due_);
    const auto late = std::chrono::steady_clock::now() - due_;
    if (late > kStall) stalled_ = true;
    if (late > std::chrono::milliseconds(1)) due_ += late;
    return now();
  }
  bool stalled() const { return stalled_; }

 private:
  static constexpr std::chrono::milliseconds kStall{4};
  std::chrono::steady_clock::time_point due_ = std::chrono::steady_clock::now();
  bool stalled_ = false;
};

enum class AtDevice { good, not_zero, no_push, stalled, exception };

template <typename Input>
AtDevice run_at_device(const Action<Input>& state, const Action<Input>& way,
                       const std::function<DriverAtDevice<Input>()>& make) {
  RealTime time;
  DriverAtDevice<Input> device = make();
  bool is_at_zero = true;
  Bench<Input> bench(device.driver, [&] {
    is_at_zero = device.is_at_zero();
    return time.next();
  });
  time = {};
  state.run(bench);
  const auto unless_stalled = [&](AtDevice fault) {
    return time.stalled() || (device.stood_still && device.stood_still()) ? AtDevice::stalled : fault;
  };
  if (state.name == kPressing && is_at_zero) return unless_stalled(AtDevice::no_push);
  way.run(bench);
  const Nanoseconds off = now();
  if (!bench.loop) {
    bench.source = nullptr;
    bench.recorder = nullptr;
    device.driver = nullptr;
  }
  for (Nanoseconds passed = 0; passed < (kOffWithin + kThenFor) * kMillisecond; passed = now() - off) {
    bench.step();
    if (now() - off < kOffWithin * kMillisecond || is_at_zero) continue;
    return unless_stalled(AtDevice::not_zero);
  }
  return AtDevice::good;
}

}  // namespace conformance_detail

/// The same at the device: each state with each way of being switched off, in real time. Each of these cases has a
/// process of its own, so `make` may use a library that knows one device only. Call it before the process starts
/// threads.
template <typename Input>
std::vector<std::string> conformance_faults_at_device(const std::function<DriverAtDevice<Input>()>& make) {
  using namespace conformance_detail;
  constexpr std::size_t kAtOnce = 4;
  constexpr int kAttempts = 5;
  struct Case {
    Action<Input> state, way;
    int attempts = 0;
  };
  std::vector<Case> waiting;
  for (const Action<Input>& state : states<Input>())
    for (const Action<Input>& way : ways_off<Input>()) waiting.push_back({state, way});
  std::map<pid_t, Case> running;
  std::vector<std::string> faults;
  while (!waiting.empty() || !running.empty()) {
    while (!waiting.empty() && running.size() < kAtOnce) {
      Case next = std::move(waiting.back());
      waiting.pop_back();
      ++next.attempts;
      std::fflush(nullptr);
      const pid_t child = fork();
      if (child == 0) {
        AtDevice result = AtDevice::exception;
        try {
          if (std::freopen("/dev/null", "w", stdout) != nullptr) result = run_at_device(next.state, next.way, make);
        } catch (const std::exception& error) {
          std::fprintf(stderr, "%s\n", error.what());
        }
        _exit(static_cast<int>(result));
      }
      if (child < 0) return {"cannot start a process"};
      running.emplace(child, std::move(next));
    }
    int status = 0;
    const auto ended = running.find(waitpid(-1, &status, 0));
    if (ended == running.end()) continue;
    Case done = std::move(ended->second);
    running.erase(ended);
    const auto result = WIFEXITED(status) ? static_cast<AtDevice>(WEXITSTATUS(status)) : AtDevice::exception;
    if (result == AtDevice::stalled && done.attempts < kAttempts) {
      waiting.push_back(std::move(done));
    } else if (result == AtDevice::not_zero) {
      faults.push_back(done.state.name + ", " + done.way.name + ": the device is not at zero after 50 ms");
    } else if (result == AtDevice::stalled) {
      faults.push_back(done.state.name + ", " + done.way.name + ": this machine stands still too often to measure");
    } else if (result == AtDevice::no_push) {
      faults.push_back(done.way.name + ": the device does nothing while pressing");
    } else if (result == AtDevice::exception) {
      faults.push_back(done.state.name + ", " + done.way.name + ": the process died");
    }
  }
  return faults;
}

}  // namespace softhand
