// main() of a haptic or tactile driver: `run_device<MyGlove>(argc, argv, "haptic-my-glove")`.
#pragma once

#include "device/device_loop.hpp"
#include "scene_file.hpp"
#include "service/service.hpp"

namespace softhand {

/// What a device of each kind receives.
inline constexpr const bus::Topic<BoneWrench>& topic_of(const BoneWrench*) { return bus::topics::bone_wrench; }
inline constexpr const bus::Topic<Contacts>& topic_of(const Contacts*) { return bus::topics::contacts; }
inline constexpr std::uint32_t kind_of(const BoneWrench*) { return 0; }
inline constexpr std::uint32_t kind_of(const Contacts*) { return 1; }

/// `Driver` is a HapticDriver or a TactileDriver that is made from its `Driver::Options`. Its driver.cpp registered
/// DeviceOptions<Driver::Options>. `options_of` names another part of the scene with `.loop` and `.driver`.
template <typename Driver, typename OptionsOf>
int run_device(int argc, char** argv, const std::string& module, OptionsOf options_of) {
  return guarded_main("softhand-" + module, [&] {
    using Input = typename Driver::Input;
    constexpr const Input* kInput = nullptr;
    const char* const role = kind_of(kInput) == 0 ? "haptic" : "tactile";
    const DeviceArguments arguments = parse_device_arguments(argc, argv, role, module);
    const Scene scene = read_scene(arguments.config, arguments.overrides);
    const HandKey hand = hand_key(scene);
    const auto& options = options_of(scene.options);
    Service service(arguments, options.loop.rate_hz, Pacing::real);
    bus::Reader<Input> reader(service.participant(), topic_of(kInput), hand);
    bus::Writer<DeviceState> writer(service.participant(), bus::topics::device_state);
    DeviceLoop<Input> loop(options.loop, std::make_unique<Driver>(options.driver), arguments.device, kind_of(kInput));
    auto input = std::make_unique<Input>();
    const auto publish = [&](DeviceState state) {
      service.stamp(state.stamp);
      state.hand = hand;
      writer.write(state);
    };
    const auto step = [&](Nanoseconds now) {
      const DeviceState& state = loop.step(now, reader.take_latest(*input) ? input.get() : nullptr);
      if (writer.has_readers()) publish(state);
    };
    service.run({step, [&](const Message& message) { return loop.answer(message, arguments.module); },
                 [&](LoopStatus& status, Nanoseconds now) {
                   loop.fill_status(status, now);
                   count_inputs(status, service.participant(), reader);
                 }});
    publish(loop.stop(now()));
  });
}
template <typename Driver>
int run_device(int argc, char** argv, const std::string& module) {
  return run_device<Driver>(argc, argv, module, &driver_options<DeviceOptions<typename Driver::Options>>);
}

}  // namespace softhand
