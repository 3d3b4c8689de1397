// The header and the records of a flight file. The first byte chooses what the rest is.
#include "fuzz/flight_fuzzer.hpp"

#include <memory>
#include <vector>

#include "flight/flight_header.hpp"
#include "flight/hand_flight.hpp"
#include "flight/world_flight.hpp"
#include "model/state.hpp"

namespace softhand::fuzz {
namespace {

// Calls `write(ByteWriter&)` for what was read. It gives the bytes that were read.
template <typename Write>
void expect_same(std::span<const std::byte> bytes, const ByteReader& rest, Write&& write) {
  const std::span<const std::byte> read = bytes.first(bytes.size() - rest.rest().size());
  static std::vector<std::byte> memory;
  memory.resize(read.size());
  ByteWriter out(memory);
  write(out);
  expect(!out.overflowed() && std::ranges::equal(out.written(), read), "what was read is written as the same bytes");
}

void read_header(const std::string& text) {
  FlightHeader header;
  if (!accepts([&] { header = flight_header_from_json(text); })) return;
  expect(header.calibrations.size() == header.hands.size(), "each hand has a calibration");
  expect(flight_header_from_json(to_json(header)) == header, "the text of an accepted header says the same");
}

void read_tracking_step(std::span<const std::byte> bytes) {
  FlightTraits<TrackingLoop>::Repeater repeater;
  ByteReader in(bytes);
  TrackingInput input;
  if (accepts([&] { input = repeater.read(in); }))
    expect_same(bytes, in, [&](ByteWriter& out) { FlightTraits<TrackingLoop>::write_input(out, input, false); });
}

void read_hand_step(std::span<const std::byte> bytes) {
  FlightTraits<HandLoop>::Repeater repeater;
  ByteReader in(bytes);
  FlightTraits<HandLoop>::Repeater::Step step;
  if (!accepts([&] { step = repeater.read(in); })) return;
  expect_same(bytes, in, [&](ByteWriter& out) {
    FlightTraits<HandLoop>::write_input(out, {step.input, step.requested}, false);
  });
}

void read_world_step(std::span<const std::byte> bytes) {
  FlightTraits<WorldLoop>::Repeater repeater;
  ByteReader in(bytes);
  WorldInput input;
  if (!accepts([&] { input = repeater.read(in); })) return;
  expect_same(bytes, in, [&](ByteWriter& out) {
    FlightTraits<WorldLoop>::write_input(out, {input, bytes[0] == std::byte{1}}, false);
  });
}

void read_tracking_snapshot(std::span<const std::byte> bytes) {
  TrackingLoop& loop = flight_loop();
  ByteReader in(bytes);
  if (accepts([&] { FlightTraits<TrackingLoop>::load(loop, in); }))
    expect_same(bytes, in, [&](ByteWriter& out) { FlightTraits<TrackingLoop>::save(loop, out); });
}

template <typename T>
void read_value(std::span<const std::byte> bytes) {
  const auto value = std::make_unique<T>();
  ByteReader in(bytes);
  if (accepts([&] { in.read(*value); })) expect_same(bytes, in, [&](ByteWriter& out) { out.write(*value); });
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::span bytes(reinterpret_cast<const std::byte*>(data) + 1, size - 1);
  switch (static_cast<FlightPart>(data[0])) {
    case FlightPart::header:
      return read_header({reinterpret_cast<const char*>(bytes.data()), bytes.size()}), 0;
    case FlightPart::tracking_step:
      return read_tracking_step(bytes), 0;
    case FlightPart::hand_step:
      return read_hand_step(bytes), 0;
    case FlightPart::world_step:
      return read_world_step(bytes), 0;
    case FlightPart::tracking_snapshot:
      return read_tracking_snapshot(bytes), 0;
    case FlightPart::hand_state:
      return read_value<State>(bytes), 0;
    case FlightPart::message:
      return read_value<Message>(bytes), 0;
    case FlightPart::object:
      return read_value<ObjectDescription>(bytes), 0;
    case FlightPart::joint:
      return read_value<ObjectJointDescription>(bytes), 0;
    case FlightPart::result:
      return read_value<FlightResult>(bytes), 0;
  }
  return 0;
}

}  // namespace softhand::fuzz
