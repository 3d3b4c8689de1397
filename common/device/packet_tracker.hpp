// A tracker whose samples come as packets: an intake receives them, and a decoder makes hands of them.
#pragma once

#include <cstddef>
#include <utility>

#include "device/intake.hpp"
#include "device/tracker_source.hpp"

namespace softhand {

/// `Decoder` has take(const Arrival&, TrackerSink&) and refusals(). A driver's constructor opens the ports of `intake_`
/// and starts it.
template <typename Decoder>
class PacketTracker : public TrackerSource {
 public:
  void poll(Nanoseconds, TrackerSink& out) final {
    intake_.take([&](const Arrival& packet) { decoder_.take(packet, out); });
  }
  SourceState state() const final {
    return {intake_.connected(), decoder_.refusals().total() + intake_.counters().refused()};
  }
  void fill_status(LoopStatus& status) const final {
    intake_.fill_status(status);
    decoder_.refusals().fill_status(status, intake_.counters().refused_size);
  }

 protected:
  /// `largest` and `slots` as those of an intake.
  PacketTracker(std::size_t largest, Decoder decoder, std::size_t slots = Intake::kDefaultSlots)
      : intake_(largest, slots), decoder_(std::move(decoder)) {}
  Intake intake_;

 private:
  Decoder decoder_;
};

}  // namespace softhand
