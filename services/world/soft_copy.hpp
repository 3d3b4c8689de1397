// The world's copy of a flexible object (docs/soft-objects.md). It is a moving shape for the engine: objects that no
// hand owns collide with it. It feels nothing of them.
//
// A hand's process simulates the object and publishes its nodes, and the copy follows them. Of a shared object it does
// so only while the hand owns it. Otherwise the world simulates it (free_soft_body.hpp).
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "messages/messages.hpp"
#include "model/soft_object.hpp"
#include "world/free_soft_body.hpp"
#include "world/physics_engine.hpp"

namespace softhand {

class SoftCopy {
 public:
  using Offsets = std::vector<std::array<float, 3>>;  // by node, relative to the centre

  /// A shared object starts at its place in the scene, and touches at most `obstacles` static objects.
  /// `spring`: as `FreeSoftBody`. With a spring no hand owns the object: both sides simulate it all the time.
  SoftCopy(const SoftObject& object, int obstacles, const NodeSpring& spring);

  /// As the engine gets it. Valid as long as this object is.
  EngineCopy engine_copy() const { return {parts_, start_, friction_}; }
  const std::string& name() const { return name_; }
  /// Whether the world simulates the object while no hand owns it.
  bool is_shared() const { return is_shared_; }

  /// Takes a state of the hand's process. Returns false, and takes nothing, if it has another number of nodes, or if a
  /// value is not finite or absurd. Older states than the last one are ignored. Of a shared object that no hand owns,
  /// the hand's state is an echo of this copy.
  /// During the first 0.2 s after a start of a shared object a hand may not know its place, so its states are ignored.
  bool take(const SoftObjectState& state);
  /// A shared object is always there. Another one is there once a state has come, until `leave`.
  bool is_there() const { return known_.is_there; }
  /// The hand's process has stopped, or the world was reset. A shared object stays.
  void leave() { known_.is_there = is_shared_; }
  /// A shared object is back at the place where the scene has it, at rest.
  void restart();

  /// Simulates a shared object that no hand owns for `dt` seconds, until `now`. An owner whose last state is older than
  /// `vanished` (s) is none. An object that hardly moves for half a second rests until `wake`. Returns false if the
  /// step fails. Then the object starts again. With a spring, the hand's state pulls unless it is older than `stall`
  /// (s).
  bool simulate(Nanoseconds now, double dt, double vanished, double stall, std::span<const Obstacle> obstacles);
  /// Whether the last `simulate` made a step.
  bool is_simulated() const { return known_.is_free; }
  void wake() { known_.sleeps = false; }
  enum class Change : std::uint8_t { none, moved, came_to_rest };
  /// Moves the copy to where the object is at `now`. Velocities of the last state predict this, for at most
  /// `most_ahead` seconds. A state that is older than `stall` (s) says nothing about the velocity. The copy rests, and
  /// stays where it is, while no node is farther away from there than a micrometre.
  Change move(Nanoseconds now, double most_ahead, double stall);
  /// Moves the engine's body to the copy.
  void place(PhysicsEngine& engine, std::size_t number) const;
  /// Writes all but the owner, if the state of a shared object is to be published now. The counter of the stamp is not
  /// changed.
  bool write_state(Nanoseconds now, SoftObjectState& out);

  /// The nodes of an object at a time.
  struct Nodes {
    Nanoseconds time = 0;
    Vec3 centre{}, velocity{};    // m, m/s, world
    Offsets offsets, velocities;  // relative to these
  };
  /// All that a step carries to the next one.
  struct Known {
    bool is_there = false;
    bool owned = false;    // by a hand
    bool is_free = false;  // the world simulates it
    bool sleeps = false;   // it would, but it rests
    Nodes last;            // the last state, of the hand or of the world
    Nodes twin;            // with a spring: the last state of the hand
    // The engine's body.
    bool rests = false;
    Vec3 centre{}, velocity{};
    Offsets offsets;
    // Where a free object was when it last moved far.
    Vec3 left_centre{};
    Offsets left;
    Nanoseconds left_at = 0;
    Nanoseconds started_at = 0;  // time of the first step after `restart`; 0: no step yet
    Nanoseconds written_at = 0;
    Vec3 hand_force{};
    std::uint32_t contact_count = 0, inverted_elements = 0;
  };
  template <typename Self, typename Visit>
  static void visit_members(Self& self, Visit&& visit) {
    visit(self.known_);
  }
  /// After its members were loaded, with a new engine, or after the engine has forgotten: drops all that is not in its
  /// members. Throws std::runtime_error if they are of another object.
  void put_into(PhysicsEngine& engine, std::size_t number);

 private:
  void read(const SoftObjectState& state, Nodes& nodes);
  void scatter(const Nodes& nodes);
  void pull(Nanoseconds now, double stall);

  std::string name_;
  bool is_shared_, has_spring_;
  Pose pose_;
  std::vector<std::vector<std::int32_t>> parts_;
  Offsets start_, moved_;
  double friction_;
  std::unique_ptr<FreeSoftBody> body_;       // of a shared object
  Eigen::Matrix3Xd positions_, velocities_;  // scratch
  Known known_;
};

}  // namespace softhand
