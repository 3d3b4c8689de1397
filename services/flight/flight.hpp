// The flight recorder beside a loop (docs/flight-recorder.md). `Flight` has the functions of a loop that have inputs.
// Each of them records its input and then calls the loop.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "device/answer.hpp"
#include "flight/flight_header.hpp"
#include "messages/convert.hpp"
#include "messages/plain_bytes.hpp"
#include "runtime/flight_recorder.hpp"
#include "scene_file.hpp"

namespace softhand {

/// Kinds of inputs.
inline constexpr std::uint8_t kFlightMessage = kFlightInput;
inline constexpr std::uint8_t kFlightReset = kFlightInput + 1;
inline constexpr std::uint8_t kFlightStep = kFlightInput + 2;
inline constexpr std::uint8_t kFlightObject = kFlightInput + 3;
inline constexpr std::uint8_t kFlightJoint = kFlightInput + 4;
inline constexpr std::uint8_t kFlightSoftObject = kFlightInput + 5;

/// Hash of the libraries that compute bits.
extern const char* const kFlightBuild;

/// The header of a process that runs now. `scenes`: of its hands, or one scene. `hands`: empty for a loop without a
/// hand.
FlightHeader flight_header(std::string loop, std::string module, std::span<const Scene> scenes,
                           std::vector<std::string> overrides, std::span<const HandModel> hands);
/// The scenes of a file, one by one as in `flight_header`. Files that they name are read as they are now, except the
/// calibration.
std::vector<Scene> scenes_of(const FlightHeader& header);
std::string hash_text(const HandModel& hand);

/// The recorder of a process, or null if the scene wants none. `folder` may be empty: then files for faults and on
/// request go to a folder of the system's temporary files.
std::unique_ptr<FlightRecorder> make_flight_recorder(const FlightOptions& options, const FlightHeader& header,
                                                     const std::string& folder);

/// The result of a step.
struct FlightResult {
  std::uint32_t status = 0;                ///< of the loop; 0 if it has none
  std::array<std::uint64_t, 12> hashes{};  ///< by part of the state (`for_each_part`)
  std::array<double, 4> figures{};         ///< for a comparison within a tolerance
};

/// What differs from loop to loop. Specialised in hand_flight.hpp, tracking_flight.hpp and world_flight.hpp:
///   Input, write_input(out, input), step(loop, now, in), figures(loop), status(loop), save, load, forget.
template <typename Loop>
struct FlightTraits;

/// Reads a sample that may be absent. Returns null if it is absent, otherwise `sample`.
template <typename T>
const T* read_optional(ByteReader& in, T& sample) {
  if (!in.take<bool>()) return nullptr;
  in.read(sample);
  return &sample;
}

template <typename Loop>
FlightResult flight_result(const Loop& loop) {
  FlightResult result;
  result.status = FlightTraits<Loop>::status(loop);
  std::size_t part = 0;
  loop.for_each_part([&](const char*, const auto& value) { result.hashes.at(part++) = plain_hash(value); });
  result.figures = FlightTraits<Loop>::figures(loop);
  return result;
}

template <typename Loop>
class Flight {
 public:
  using Traits = FlightTraits<Loop>;
  /// `recorder` may be null. Both must outlive this object.
  Flight(Loop& loop, FlightRecorder* recorder) : loop_(loop), recorder_(recorder) {}

  /// Calls `step()` between the records of its input and its result. Returns what `step` returns.
  template <typename Step>
  decltype(auto) step(Nanoseconds now, const typename Traits::Input& input, Step&& step) {
    if (recorder_ == nullptr) return step();
    now_ = now;
    begin(now);
    recorder_->add(kFlightStep, now, [&](ByteWriter& out) { Traits::write_input(out, input, is_first_of_segment_); });
    is_first_of_segment_ = false;
    decltype(auto) output = step();
    recorder_->add(kFlightResult, now, [&](ByteWriter& out) { out.write(flight_result(loop_)); });
    return output;
  }
  /// Records a description and calls `take()`.
  template <typename Description, typename Take>
  void describe(std::uint8_t kind, const Description& description, Take&& take) {
    if (recorder_ != nullptr) recorder_->add(kind, now_, [&](ByteWriter& out) { out.write(description); });
    take();
  }
  /// Answers `flight.write`, and passes other messages on to the loop.
  MessageReply answer(const Message& message, const std::string& module) {
    if (get_text(message.key) == "flight.write" && is_addressed(message, module)) return write(message, module);
    if (recorder_ != nullptr) {
      recorder_->add(kFlightMessage, now_, [&](ByteWriter& out) {
        out.write(message);
        out.write(module);
      });
    }
    MessageReply reply = loop_.answer(message, module);
    // The loop does not know the key of the recorder beside it.
    const bool is_unknown_key = reply.result == kReplyIgnored && is_addressed(message, module);
    if (is_unknown_key) set_text(reply.text, std::string(get_text(reply.text)) + ", flight.write");
    return reply;
  }
  void reset(Nanoseconds time) {
    if (recorder_ != nullptr) recorder_->add(kFlightReset, now_, [&](ByteWriter& out) { out.write(time); });
    loop_.reset(time);
  }
  /// A file is written for a fault.
  void report(std::string_view reason) {
    if (recorder_ != nullptr) recorder_->report(reason, now_);
  }

 private:
  // The live loop drops what a snapshot does not contain. So it goes on with the bits of a loop that loads the
  // snapshot.
  void begin(Nanoseconds now) {
    if (!recorder_->is_due(now)) return;
    recorder_->begin_segment(now, [this](ByteWriter& out) { Traits::save(loop_, out); });
    Traits::forget(loop_);
    is_first_of_segment_ = true;
  }

  MessageReply write(const Message& message, const std::string& module) {
    if (recorder_ == nullptr) return reply_to(message, module, kReplyRefused, "flight.seconds is 0: no recorder");
    if (!recorder_->request(get_text(message.value)))
      return reply_to(message, module, kReplyRefused, "a file is being written, or nothing is recorded yet");
    return reply_to(message, module, kReplyApplied, "writing a file to " + recorder_->folder());
  }

  Loop& loop_;
  FlightRecorder* recorder_;
  Nanoseconds now_ = 0;
  bool is_first_of_segment_ = false;
};

}  // namespace softhand
