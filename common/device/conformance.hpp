// Checks that every driver must pass (docs/add-a-device.md): "off" is zero force at the device within 50 ms, whatever
// the device does at that time. A test of a driver calls `conformance_faults`. The time is virtual.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "device/device_loop.hpp"
#include "messages/convert.hpp"

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

template <typename Input>
class Bench {
 public:
  explicit Bench(const std::function<std::shared_ptr<DeviceDriver<Input>>()>& make)
      : recorder(std::make_shared<Recorder<Input>>(make(), written)),
        loop(std::make_unique<DeviceLoop<Input>>(DeviceLoopOptions{}, recorder, 1, 0)) {}
  // One step of 1 ms. Inputs come at 90 Hz.
  void step() {
    ++milliseconds;
    const Nanoseconds now = kStart + milliseconds * kMillisecond;
    loop->watch(now);
    if (stands_still) return;
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
  std::unique_ptr<DeviceLoop<Input>> loop;
  std::unique_ptr<Input> input = std::make_unique<Input>();
  std::int64_t milliseconds = 0;
  double newton = 0;
  bool speaks = true, hangs = false, has_hand = true, stands_still = false;
};

}  // namespace conformance_detail

/// Runs the driver in the loop of the SDK, in each state with each way of being switched off. Returns what it found
/// wrong: nothing, if the driver conforms. `make` returns a new driver.
template <typename Input>
std::vector<std::string> conformance_faults(const std::function<std::shared_ptr<DeviceDriver<Input>>()>& make) {
  using Bench = conformance_detail::Bench<Input>;
  struct Action {
    std::string name;
    std::function<void(Bench&)> run;
  };
  constexpr bool is_haptic = std::is_same_v<Input, BoneWrench>;
  const auto press = [](Bench& b) { b.newton = 5, b.run(200); };
  const std::vector<Action> states{
      {"before the first input", [](Bench& b) { b.speaks = false, b.run(10), b.speaks = true; }},
      {"in the air", [](Bench& b) { b.run(100); }},
      {"at the first touch", [](Bench& b) { b.run(100), b.newton = 5, b.run(13); }},
      {"pressing", press},
      {"pressing beyond the limit", [](Bench& b) { b.newton = 1000, b.run(200); }},
      {"letting go", [=](Bench& b) { press(b), b.newton = 0, b.run(3); }},
      {"while commands fade", [=](Bench& b) { press(b), b.speaks = false, b.run(36), b.speaks = true; }},
      {"after a silence", [=](Bench& b) { press(b), b.speaks = false, b.run(300), b.speaks = true, b.run(30); }},
      {"asking for NaN", [=](Bench& b) { press(b), b.recorder->asks_nan = true, b.run(30); }},
      {"switched off and on",
       [=](Bench& b) { press(b), b.say("motors", "off"), b.run(20), b.say("motors", "on"), b.run(50); }},
  };
  std::vector<Action> ways{
      {"motors off", [](Bench& b) { b.say("motors", "off"); }},
      {"gain 0", [](Bench& b) { b.say("gain", "0"); }},
      {"no inputs", [](Bench& b) { b.speaks = false; }},
      {"end of the process", [](Bench& b) { b.speaks = false, b.loop->stop(0); }},
      {"exception", [](Bench& b) { b.speaks = false, b.loop = nullptr; }},
      {"hung loop", [](Bench& b) { b.stands_still = true; }},
  };
  if (is_haptic) {
    ways.push_back({"dead simulation", [](Bench& b) { b.has_hand = false; }});
    ways.push_back({"hung simulation", [](Bench& b) { b.hangs = true; }});
  }
  std::vector<std::string> faults;
  for (const Action& state : states) {
    for (const Action& way : ways) {
      Bench bench(make);
      state.run(bench);
      if (state.name == "pressing" && bench.is_off()) faults.push_back("no command while pressing");
      way.run(bench);
      for (int i = 1; i <= conformance_detail::kOffWithin + conformance_detail::kThenFor; ++i) {
        if (bench.loop) bench.step();
        if (i >= conformance_detail::kOffWithin && !bench.is_off()) {
          faults.push_back(state.name + ", " + way.name + ": a command is not zero after " + std::to_string(i) + " ms");
          break;
        }
      }
    }
  }
  if constexpr (is_haptic) {
    // The local model asks for commands of parts of an input.
    const auto driver = make();
    const std::size_t actuators = driver->limits().actuators;
    std::mt19937_64 random(1);
    std::uniform_real_distribution<double> force(-3, 3);
    std::array<std::vector<double>, 3> commands;
    commands.fill(std::vector<double>(actuators, 0.0));
    std::array<BoneWrench, 3> inputs;
    for (BoneWrench& input : inputs) conformance_detail::push(input, 0, 1);
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

}  // namespace softhand
