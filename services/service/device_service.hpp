// main() of a haptic or tactile driver: `run_device<MyGlove>(argc, argv, "haptic-my-glove")`. main() of a device that
// also tracks: `run_tracking_device<MyGlove>(argc, argv, "haptic-my-glove")`.
#pragma once

#include <chrono>
#include <thread>

#include "device/device_loop.hpp"
#include "device/health.hpp"
#include "runtime/clock.hpp"
#include "runtime/scheduling.hpp"
#include "scene_file.hpp"
#include "service/service.hpp"
#include "service/tracker_service.hpp"

namespace softhand {

/// What a device of each kind receives.
inline constexpr const bus::Topic<BoneWrench>& topic_of(const BoneWrench*) { return bus::topics::bone_wrench; }
inline constexpr const bus::Topic<SkinTraction>& topic_of(const SkinTraction*) { return bus::topics::skin_traction; }
inline constexpr std::uint32_t kind_of(const BoneWrench*) { return 0; }
inline constexpr std::uint32_t kind_of(const SkinTraction*) { return 1; }

/// The side of a device that pushes or touches: subscribes to its input, runs the safety loop around the driver, and
/// publishes its commands. A thread of its own lets the device go while this loop hangs.
template <typename Input>
class DeviceFace {
 public:
  DeviceFace(const Service& service, const DeviceLoopOptions& options, std::shared_ptr<DeviceDriver<Input>> driver,
             const HandKey& hand, std::uint32_t device)
      : service_(service),
        hand_(hand),
        reader_(service.participant(), topic_of(kInput), hand),
        writer_(service.participant(), bus::topics::device_state),
        loop_(options, std::move(driver), device, kind_of(kInput)),
        watch_([this](const std::stop_token& stop) {
          become_ordinary();
          for (; !stop.stop_requested(); std::this_thread::sleep_for(kWatchPeriod)) loop_.watch(softhand::now());
        }) {}

  void step(Nanoseconds now) {
    const DeviceState& state = loop_.step(now, reader_.take_latest(*input_) ? input_.get() : nullptr);
    if (writer_.has_readers()) publish(state);
  }
  MessageReply answer(const Message& message, const std::string& module) { return loop_.answer(message, module); }
  void fill_status(LoopStatus& status, Nanoseconds now) const {
    loop_.fill_status(status, now);
    count_inputs(status, service_.participant(), reader_);
  }
  /// Sets the commands to zero at the end of the process.
  void stop() { publish(loop_.stop(now())); }

 private:
  static constexpr const Input* kInput = nullptr;
  static constexpr std::chrono::milliseconds kWatchPeriod{5};
  void publish(DeviceState state) {
    service_.stamp(state.stamp);
    state.hand = hand_;
    writer_.write(state);
  }

  const Service& service_;
  HandKey hand_;
  bus::Reader<Input> reader_;
  bus::Writer<DeviceState> writer_;
  DeviceLoop<Input> loop_;
  std::unique_ptr<Input> input_ = std::make_unique<Input>();
  std::jthread watch_;  // last: it uses loop_
};

/// The driver is made from its options, and from the hand of the scene if it takes one.
template <typename Driver>
std::shared_ptr<Driver> make_driver(const typename Driver::Options& options, const Scene& scene) {
  if constexpr (std::is_constructible_v<Driver, const typename Driver::Options&, const HandModel&>) {
    return std::make_shared<Driver>(options, load_scene_hand(scene));
  } else {
    return std::make_shared<Driver>(options);
  }
}

/// `Driver` is a HapticDriver or a TactileDriver (`make_driver`). Its driver.cpp registered
/// DeviceOptions<Driver::Options>. `options_of` names another part of the scene with `.loop` and `.driver`.
template <typename Driver, typename OptionsOf>
int run_device(int argc, char** argv, const std::string& module, OptionsOf options_of) {
  return guarded_main("softhand-" + module, [&] {
    using Input = typename Driver::Input;
    constexpr const Input* kInput = nullptr;
    const char* const role = kind_of(kInput) == 0 ? "haptic" : "tactile";
    const DeviceArguments arguments = parse_device_arguments(argc, argv, role, module);
    const Scene scene = read_own_scene(arguments.config, arguments.overrides);
    const auto& options = options_of(scene.options);
    Service service(arguments, options.loop.rate_hz, Pacing::real);
    const auto driver = make_driver<Driver>(options.driver, scene);
    DeviceFace<Input> device(service, options.loop, driver, hand_key(scene), arguments.device);
    ConnectionHealth health;
    service.run({[&](Nanoseconds now) { device.step(now); },
                 [&](const Message& message) { return device.answer(message, arguments.module); },
                 [&](LoopStatus& status, Nanoseconds now) {
                   device.fill_status(status, now);
                   add_counter(status, "health", static_cast<double>(health.update(driver->connected())));
                   driver->fill_status(status);
                 }});
    device.stop();
  });
}
template <typename Driver>
int run_device(int argc, char** argv, const std::string& module) {
  return run_device<Driver>(argc, argv, module, &driver_options<DeviceOptions<typename Driver::Options>>);
}

/// A device with both faces in one process. `Device` is a TrackerSource and a HapticDriver or TactileDriver
/// (`make_driver`). One loop, at `rate_hz` of the device, polls it and then
/// lets it write.
template <typename Device>
int run_tracking_device(int argc, char** argv, const std::string& module) {
  return guarded_main("softhand-" + module, [&] {
    const TrackingDeviceArguments arguments = parse_tracking_device_arguments(argc, argv, module);
    const Scene scene = read_own_scene(arguments.config, arguments.overrides);
    const HandKey hand = hand_key(scene);
    const auto& options = driver_options<DeviceOptions<typename Device::Options>>(scene.options);
    Service service(arguments, options.loop.rate_hz, Pacing::real);
    const auto device = make_driver<Device>(options.driver, scene);
    TrackerFace tracker(service, Pacing::real, arguments, hand.user);
    DeviceFace<typename Device::Input> back(service, options.loop, device, hand, arguments.device);
    service.run({[&](Nanoseconds now) {
                   tracker.poll(*device, now);
                   back.step(now);
                 },
                 [&](const Message& message) {
                   const auto reply = tracker.answer(message, arguments.module);
                   return reply ? *reply : back.answer(message, arguments.module);
                 },
                 [&](LoopStatus& status, Nanoseconds now) {
                   back.fill_status(status, now);
                   tracker.fill_status(*device, status, now);
                 }});
    back.stop();
  });
}

}  // namespace softhand
