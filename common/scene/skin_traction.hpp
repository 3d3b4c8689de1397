// The traction of the contacts on the skin of a hand, as tactile devices need it (docs/topics.md).
//
// A region is the skin around a contact point of the hand. A force elsewhere on the skin goes to the nearest contact
// point on the same part of the skin. So the forces on the regions sum to the forces of all contacts.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "messages/messages.hpp"
#include "model/hand_model.hpp"
#include "model/state.hpp"

namespace softhand {

/// The force of a contact on the skin. World axes.
struct SkinForce {
  Vector3 force = Vector3::Zero();    ///< N
  Vector3 normal = Vector3::UnitY();  ///< unit, outward of the skin
  double slip_speed = 0;              ///< of the skin over the object, m/s
  std::uint32_t object = 0;           ///< id; 0 for the skin of a hand
};

/// Sums the forces of one step by region. Allocates only at construction.
class SkinTractionReport {
 public:
  /// Cutoff of the low-pass filter of area rates, Hz. The area of a region that touches jumps.
  static constexpr double area_cutoff = 5;

  /// The hand must outlive the report. Its node n is node `first_node` + n of the state, and its bone b is body
  /// `first_body` + b.
  explicit SkinTractionReport(const HandModel& hand, int first_node = 0, int first_body = 0);

  /// Starts a message. `state`: of the hand at the end of the step, until `write`.
  void begin(const State& state);
  /// Adds a force at a contact point of the hand.
  void add(std::size_t point, const SkinForce& of);
  /// Adds a force at a place (m, world) on or near a triangle of the hand's surface.
  void add(std::size_t triangle, const Vector3& place, const SkinForce& of);
  /// Does not write key and stamp. `time_step`: s since the last message. If there is no room for all regions, those
  /// with the least force are left out.
  void write(double time_step, SkinTraction& out);
  /// Number of regions that were left out since construction.
  std::uint64_t dropped() const { return dropped_; }

  /// What a message carries to the next one.
  struct Memory {
    bool any = false;                   ///< there was a message
    std::vector<std::uint8_t> touched;  ///< by region, in the last message
    std::vector<float> rates;           ///< by region, m^2/s
  };
  const Memory& save() const { return memory_; }
  /// Throws std::invalid_argument if the memory is that of another hand.
  void load(const Memory& memory);
  /// The next message has no rates of areas: it does not follow the last one.
  void forget() { memory_.any = false; }

 private:
  struct Sum {
    Vector3 force = Vector3::Zero(), normal = Vector3::Zero(), slip = Vector3::Zero();
    double weight = 0;    // of normal and slip, N
    double largest = -1;  // force of `object`, N; < 0: nothing touches
    std::uint32_t object = 0;
  };
  struct Region {
    std::uint8_t body = 0;
    std::array<float, 3> place{};
    double area = 0;
  };
  Vector3 position(std::size_t point) const;
  void list_near_points();
  void select();

  const HandModel* hand_;
  std::int32_t first_node_;
  std::size_t first_body_;
  const State* state_ = nullptr;
  std::vector<Region> regions_;
  std::vector<std::size_t> first_near_;  // by triangle, and the total at the end
  std::vector<std::int32_t> near_;       // contact points near a triangle
  std::vector<Sum> sums_;                // by region
  std::vector<std::int32_t> touched_;    // regions of this message
  std::vector<std::int32_t> listed_;     // the same, with those whose area still changes
  Memory memory_;
  std::uint64_t dropped_ = 0;
};

}  // namespace softhand
