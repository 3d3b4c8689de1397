// The records of the tracking loop.
#pragma once

#include "flight/flight.hpp"
#include "tracking/tracking_loop.hpp"

namespace softhand {

template <>
struct FlightTraits<TrackingLoop> {
  using Input = TrackingInput;
  static void write_input(ByteWriter& out, const TrackingInput& from, bool) {
    const auto write = [&out](const auto* sample) {
      out.write(sample != nullptr);
      if (sample != nullptr) out.write(*sample);
    };
    out.write(from.wrench_requested);
    out.write(from.ledger_requested);
    write(from.tracked);
    write(from.simulated);
    write(from.head);
    write(from.contacts);
  }
  class Repeater {
   public:
    /// Valid until the next call.
    TrackingInput read(ByteReader& in) {
      TrackingInput input;
      in.read(input.wrench_requested);
      in.read(input.ledger_requested);
      input.tracked = read_optional(in, samples_->tracked);
      input.simulated = read_optional(in, samples_->simulated);
      input.head = read_optional(in, samples_->head);
      input.contacts = read_optional(in, samples_->contacts);
      return input;
    }
    void step(TrackingLoop& loop, Nanoseconds now, ByteReader& in) { loop.step(now, read(in)); }
    void describe(TrackingLoop&, std::uint8_t, ByteReader&) {}

   private:
    struct Samples {
      Skeleton tracked, simulated;
      HeadPose head;
      Contacts contacts;
    };
    std::unique_ptr<Samples> samples_ = std::make_unique<Samples>();
  };

  static std::uint32_t status(const TrackingLoop&) { return 0; }
  static const char* status_text(std::uint32_t) { return "done"; }
  static constexpr std::array<const char*, 4> kFigures{"wrist x", "wrist y", "wrist z", "stretch"};
  static constexpr std::array<double, 4> kTolerances{1e-6, 1e-6, 1e-6, 1e-6};
  static std::array<double, 4> figures(const TrackingLoop& loop) {
    const Vec3& wrist = loop.output().intermediate.joints[static_cast<std::size_t>(index_of(Joint::wrist))].position;
    return {wrist[0], wrist[1], wrist[2], loop.coupling_stretch()};
  }
  static void save(const TrackingLoop& loop, ByteWriter& out) { out.write(loop); }
  static void load(TrackingLoop& loop, ByteReader& in) { in.read(loop); }
  static void forget(TrackingLoop&) {}
};

}  // namespace softhand
