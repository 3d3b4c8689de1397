// Messages to modules: one line for each, with its key, a blank and its value. All modules here get all of them.
#include <array>

#include "device/answer.hpp"
#include "device/device_loop.hpp"
#include "fuzz/tracker_fuzzer.hpp"
#include "runtime/clock.hpp"
#include "service/time_control.hpp"
#include "tracking/tracking_loop.hpp"
#include "viewer/frames.hpp"

namespace softhand::fuzz {
namespace {

constexpr DeviceLimits kLimits{.actuators = 2, .minimum_command = -2, .maximum_command = 3, .slew = 100};

void check(const MessageReply& reply, const Message& message) {
  expect(reply.id == message.id, "a reply names its message");
  expect(reply.result <= kReplyRefused && !get_text(reply.text).empty(), "a reply has a result and a text");
}

void check_clock(const SimulatedClock& clock, Nanoseconds from) {
  for (Nanoseconds t = from - 1'000'000'000, last = clock.at(t); t < from + 5'000'000'000; t += 50'000'000) {
    const Nanoseconds time = clock.at(t);
    expect(time >= last, "the simulated clock does not run backwards");
    last = time;
  }
  expect(SimulatedClock::from_text(clock.text()).text() == clock.text(), "another process can read the clock");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static TrackingLoop tracking(TrackingOptions{}, 90, shipped_hand(), HandKey{0, 1});
  static const std::uint32_t own_clock = clock_id();
  DeviceGuard device({}, kLimits, 0, 0);
  TimeControl time_control;
  Nanoseconds now = kArrival;
  for_each_line({reinterpret_cast<const char*>(data), size}, [&](const Arrival& line) {
    const std::size_t blank = std::min(line.bytes.find(' '), line.bytes.size());
    Message message;
    message.id = 5;
    message.stamp.clock_id = own_clock;
    message.stamp.sample_time = message.stamp.publish_time = now;
    set_text(message.module, "*");
    set_text(message.key, line.bytes.substr(0, blank));
    if (blank < line.bytes.size()) set_text(message.value, line.bytes.substr(blank + 1));
    const std::string_view value = get_text(message.value);

    check(tracking.answer(message, "tracking"), message);
    check(device.answer(message, "device"), message);
    device.accept(now, {}, message.stamp);
    for (const double command : device.limit(now, std::array<double, 2>{1, -1}, true).commands)
      expect(command >= -1 && command <= 1, "a gain does not amplify commands");
    if (const auto reply = time_control.answer(message, "module", now)) check(*reply, message);
    check_clock(time_control.clock(), now);
    if (const auto prompt = viewer::read_prompt(value))
      expect(prompt->seconds >= 0 && prompt->seconds <= 600, "a prompt is shown for at most 600 s");
    if (const auto vector = parse_vector(value)) expect(vector->allFinite(), "an accepted place is finite");
    now += 30'000'000;
  });
  return 0;
}

}  // namespace softhand::fuzz
