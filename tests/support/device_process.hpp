// A haptic or tactile driver as a process: its input, its motors, and its status.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "device/health.hpp"
#include "support/hung_loop.hpp"
#include "support/tracker_process.hpp"

namespace softhand::testing {

inline void stamp_input(Stamp& stamp) {
  stamp.clock_id = clock_id();
  stamp.epoch = 7;
  ++stamp.sequence;
  stamp.sample_time = stamp.publish_time = now();
}

/// `Input` is BoneWrench or SkinTraction, of the hand of the scene.
template <typename Input>
class DeviceProcess : public ::testing::Test {
 protected:
  explicit DeviceProcess(std::string module) : module_(std::move(module)) { listener_.module = module_; }
  static void SetUpTestSuite() { use_own_domain(); }

  /// `settings`: keys and values of the section of the driver. `reads_line`: it prints a line at its start.
  void start(const std::vector<std::string>& settings, bool reads_line = true) {
    std::string section = module_;
    section[section.find('-')] = '_';
    std::vector<std::string> arguments{"--config", std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml",
                                       "--device", "3"};
    for (const std::string& setting : settings) {
      arguments.emplace_back("--set");
      arguments.push_back(section + "." + setting);
    }
    driver_.emplace("softhand-" + module_, arguments, reads_line);
  }
  bool health(Health of) {
    return listener_.until([] {}, [&] { return listener_.counter("health") == static_cast<double>(of); });
  }
  bool counts(const std::string& counter, double value) {
    return listener_.until([] {}, [&] { return listener_.counter(counter) == value; });
  }
  void write() {
    stamp_input(input_.stamp);
    writer_.write(input_);
  }
  /// Writes the input at 200 Hz until `done`. Returns false after ten seconds.
  template <typename Done>
  bool push(const Done& done) {
    for (int i = 0; i < 2000; ++i) {
      write();
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      if (done()) return true;
    }
    return false;
  }
  void motors(const char* value) {
    Message message;
    message.id = static_cast<std::uint64_t>(now());
    set_text(message.module, module_);
    set_text(message.key, "motors");
    set_text(message.value, value);
    message.stamp.publish_time = now();
    messages_.write(message);
  }
  /// Milliseconds from `since` until `is_off`; 1000 if it does not come.
  template <typename IsOff>
  static double milliseconds_until(const IsOff& is_off, Nanoseconds since) {
    while (!is_off() && now() - since < 1'000'000'000) std::this_thread::yield();
    return static_cast<double>(now() - since) * 1e-6;
  }
  /// Checks and prints how soon the device is off: motors off, a silent simulation, a loop that hangs, SIGTERM.
  /// `pushes`: the device renders the input. The process ends.
  template <typename Pushes, typename IsOff>
  void check_every_end(const Pushes& pushes, const IsOff& is_off) {
    ASSERT_TRUE(push(pushes));
    const Nanoseconds sent = now();
    motors("off");
    EXPECT_TRUE(push(is_off));
    std::printf("%s, motors off: zero after %.1f ms\n", module_.c_str(), static_cast<double>(now() - sent) * 1e-6);
    EXPECT_LT(now() - sent, 100'000'000);  // 50 ms; the machine may be busy
    motors("on");
    ASSERT_TRUE(push(pushes));
    const double silence = milliseconds_until(is_off, now());
    std::printf("%s, silence: zero after %.1f ms\n", module_.c_str(), silence);
    EXPECT_LT(silence, 100);
    ASSERT_TRUE(push(pushes));
    {
      const Nanoseconds hung = now();
      const HungLoop loop(driver_->id());
      const double released = milliseconds_until(is_off, hung);
      std::printf("%s, hung loop: zero after %.1f ms\n", module_.c_str(), released);
      EXPECT_LT(released, 200);  // 50 ms; the machine may be busy
    }
    ASSERT_TRUE(push(pushes));  // the loop goes on
    const Nanoseconds stopped = now();
    kill(driver_->id(), SIGTERM);
    std::printf("%s, SIGTERM: zero after %.1f ms\n", module_.c_str(), milliseconds_until(is_off, stopped));
    EXPECT_TRUE(is_off());
    EXPECT_EQ(driver_->end(SIGTERM), 0);
  }
  /// Kills the driver while the device renders the input, and calls `restart`, as `softhand up` does. Without an input
  /// the device must then be off. Prints the time from the kill.
  template <typename Pushes, typename IsOff, typename Restart>
  void check_restart_after_kill(const Pushes& pushes, const IsOff& is_off, const Restart& restart) {
    ASSERT_TRUE(push(pushes));
    driver_->end(SIGKILL);
    EXPECT_TRUE(pushes()) << "the device keeps the force of a killed driver";
    const Nanoseconds killed = now();
    restart();
    const double time = milliseconds_until(is_off, killed);
    std::printf("%s, SIGKILL and restart: zero after %.1f ms\n", module_.c_str(), time);
    EXPECT_TRUE(is_off());
  }

  const std::string module_;
  TrackerListener listener_;
  bus::Writer<Input> writer_{listener_.participant, topic()};
  bus::Writer<Message> messages_{listener_.participant, bus::topics::message};
  Input input_;
  std::optional<Process> driver_;

 private:
  static const bus::Topic<Input>& topic() {
    if constexpr (std::is_same_v<Input, BoneWrench>) {
      return bus::topics::bone_wrench;
    } else {
      return bus::topics::skin_traction;
    }
  }
};

/// A grounded device that holds a bone.
class GroundedProcess : public DeviceProcess<BoneWrench> {
 protected:
  using DeviceProcess::DeviceProcess;
  BoneSample& bone(Body body = Body::index_distal) { return input_.bones[static_cast<std::size_t>(index_of(body))]; }
  /// On the bone that is held without other settings, in the world, N.
  void set_force(double x, double y, double z) {
    input_.simulated_valid = 1;
    bone().coupling_force = {x, y, z};
  }
};

}  // namespace softhand::testing
