// The world's copy of a flexible object (docs/soft-objects.md). A hand's process simulates the object and publishes its
// nodes. The copy is a moving shape for the engine: objects that no hand owns collide with it. It feels nothing of
// them.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "messages/messages.hpp"
#include "model/soft_object.hpp"
#include "world/physics_engine.hpp"

namespace softhand {

/// Nodes of parts of the body, by part. The convex hulls of all parts together are larger than the body by at most 5 %
/// of its volume, unless 64 parts are not enough for this.
std::vector<std::vector<std::int32_t>> convex_parts(const SoftBody& body);

class SoftCopy {
 public:
  using Offsets = std::vector<std::array<float, 3>>;  // by node, relative to the centre

  explicit SoftCopy(const SoftObject& object);

  /// As the engine gets it. Valid as long as this object is.
  EngineCopy engine_copy() const { return {parts_, start_, friction_}; }

  /// Takes a state of the hand's process. Returns false, and takes nothing, if it has another number of nodes, or if a
  /// value is not finite or absurd. Older states than the last one are ignored.
  bool take(const SoftObjectState& state);
  /// The object is there once a state has come, until `leave`.
  bool is_there() const { return known_.is_there; }
  /// The hand's process has stopped, or the world was reset.
  void leave() { known_.is_there = false; }

  enum class Change : std::uint8_t { none, moved, came_to_rest };
  /// Moves the copy to where the object is at `now`. Velocities of the last state predict this, for at most
  /// `most_ahead` seconds. A state that is older than `stall` (s) says nothing about the velocity. The copy rests, and
  /// stays where it is, while no node is farther away from there than a micrometre.
  Change move(Nanoseconds now, double most_ahead, double stall);
  /// Moves the engine's body to the copy.
  void place(PhysicsEngine& engine, std::size_t number) const;

  /// All that a step carries to the next one.
  struct Known {
    bool is_there = false;
    // The last state.
    Nanoseconds time = 0;
    Vec3 state_centre{}, state_velocity{};
    Offsets state_offsets, state_velocities;
    // The engine's body.
    bool rests = false;
    Vec3 centre{}, velocity{};
    Offsets offsets;
  };
  Known& known() { return known_; }
  const Known& known() const { return known_; }
  /// After `known` was loaded. Throws std::runtime_error if it is of another object.
  void check() const;

 private:
  std::vector<std::vector<std::int32_t>> parts_;
  Offsets start_, moved_;
  double friction_;
  Known known_;
};

}  // namespace softhand
