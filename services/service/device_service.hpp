// main() of a haptic or tactile driver: `run_device<Driver>(argc, argv, topic, kind, name)`.
#pragma once

#include <CLI/CLI.hpp>

#include "device/device_loop.hpp"
#include "service/service.hpp"

namespace softhand {

template <typename Driver>
struct DeviceConfiguration {
  DeviceLoopOptions loop;
  typename Driver::Options driver;
};
template <typename Driver>
void describe(OptionVisitor& v, DeviceConfiguration<Driver>& o) {
  describe_section(v, "loop", "The safety around the driver.", o.loop);
  describe_section(v, "driver", "The device.", o.driver);
}

/// `kind` 0 haptic, 1 tactile. Configuration: sections [loop] and [driver].
template <typename Driver, typename Input>
int run_device(int argc, char** argv, const bus::Topic<Input>& topic, std::uint32_t kind, const std::string& module) {
  return guarded_main("softhand-" + module, [&] {
    std::uint32_t device = 0;
    const ServiceArguments arguments = parse_arguments(argc, argv, module, "Drives a device", [&](CLI::App& app) {
      app.add_option("--device", device, "Id of this device, the key of device_state");
    });
    DeviceConfiguration<Driver> configuration;
    configure(configuration, arguments, other_sections({"loop", "driver"}));
    // Before the service raises this thread's priority, which a driver's own threads (a log writer) must not inherit.
    DeviceLoop<Input> loop(configuration.loop, std::make_unique<Driver>(configuration.driver), device, kind);
    Service service(arguments);
    bus::Reader<Input> reader(service.participant(), topic, arguments.hand);
    bus::Writer<DeviceState> writer(service.participant(), bus::topics::device_state);
    auto input = std::make_unique<Input>();
    const auto publish = [&](DeviceState state) {
      service.stamp(state.stamp);
      state.hand = arguments.hand;
      writer.write(state);
    };
    const auto step = [&](Nanoseconds now) {
      const DeviceState& state = loop.step(now, reader.take_latest(*input) ? input.get() : nullptr);
      if (writer.has_readers()) publish(state);
    };
    service.run(configuration.loop.rate_hz, {step, [&](const Message& message) { return loop.answer(message, arguments.module); },
                                             [&](LoopStatus& status, Nanoseconds now) { loop.fill_status(status, now); }});
    publish(loop.stop(monotonic_now()));
  });
}

}  // namespace softhand
