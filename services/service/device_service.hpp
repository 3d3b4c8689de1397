// main() of a haptic or tactile driver: `run_device<Driver>(argc, argv, topic, kind, name, options)`.
#pragma once

#include "device/device_loop.hpp"
#include "scene_file.hpp"
#include "service/service.hpp"

namespace softhand {

/// `kind`: 0 = haptic, 1 = tactile. `options` returns a part of the scene with `.loop` (the safety around the driver)
/// and `.driver` (the device).
template <typename Driver, typename Input, typename OptionsOf>
int run_device(int argc, char** argv, const bus::Topic<Input>& topic, std::uint32_t kind, const std::string& module,
               OptionsOf options_of) {
  return guarded_main("softhand-" + module, [&] {
    const DeviceArguments arguments = parse_device_arguments(argc, argv, module);
    const Scene scene = read_scene(arguments.config, arguments.overrides);
    const HandKey hand = hand_key(scene);
    const auto& options = options_of(scene.options);
    Service service(arguments, options.loop.rate_hz, Pacing::real);
    bus::Reader<Input> reader(service.participant(), topic, hand);
    bus::Writer<DeviceState> writer(service.participant(), bus::topics::device_state);
    DeviceLoop<Input> loop(options.loop, std::make_unique<Driver>(options.driver), arguments.device, kind);
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

}  // namespace softhand
