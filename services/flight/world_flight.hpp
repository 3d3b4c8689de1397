// The records of the world's loop.
#pragma once

#include "flight/flight.hpp"
#include "world/world_loop.hpp"

namespace softhand {

template <>
struct FlightTraits<WorldLoop> {
  struct Input {
    const WorldInput& input;
    bool is_new = true;  ///< a coupling has changed since the last step
  };
  static void write_input(ByteWriter& out, const Input& from, bool is_first_of_segment) {
    const auto write_all = [&out](const auto& list) {
      out.write(static_cast<std::uint32_t>(list.size()));
      for (const auto& each : list) out.write(each);
    };
    const bool writes = from.is_new || is_first_of_segment;
    out.write(writes);
    if (writes) write_all(from.input.couplings);
    write_all(from.input.soft_objects);
  }
  class Repeater {
   public:
    /// Valid until the next call.
    WorldInput read(ByteReader& in) {
      if (in.take<bool>()) in.read(couplings_);
      in.read(soft_objects_);
      return {couplings_, soft_objects_};
    }
    void step(WorldLoop& loop, Nanoseconds now, ByteReader& in) { loop.step(now, read(in)); }
    void describe(WorldLoop& loop, std::uint8_t kind, ByteReader& in) {
      if (kind == kFlightSoftObject) loop.describe_soft_object(in.take<SoftObjectDescription>());
    }

   private:
    std::vector<ObjectCoupling> couplings_;
    std::vector<SoftObjectState> soft_objects_;
  };

  static std::uint32_t status(const WorldLoop&) { return 0; }
  static const char* status_text(std::uint32_t) { return "done"; }
  /// Of the last object.
  static constexpr std::array<const char*, 4> kFigures{"object x", "object y", "object z", "none"};
  static constexpr std::array<double, 4> kTolerances{1e-3, 1e-3, 1e-3, 0.1};
  static std::array<double, 4> figures(const WorldLoop& loop) {
    const auto& objects = loop.objects().objects;
    const Vec3 place = objects.empty() ? Vec3{} : objects[objects.size() - 1].position;
    return {place[0], place[1], place[2], 0};
  }
  static void save(const WorldLoop& loop, ByteWriter& out) { loop.save(out); }
  static void load(WorldLoop& loop, ByteReader& in) { loop.load(in); }
  static void forget(WorldLoop& loop) { loop.forget(); }
};

}  // namespace softhand
