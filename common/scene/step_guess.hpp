// A guess of where a step ends. The iterations of a step in contact begin there (NewtonSolver::use_linkage).
//
// At the start of a step the hand is where the last step left it. If it moves fast, the first iterations only carry it
// along, and their factor is of the wrong place. Velocities predict badly. A tracker delivers its samples at uneven
// times, so a hand moves 3 mm in one step and 12 mm in the next. But the targets at the end of the step are known.
//
// Bones. Each bone turns as the target of its coupling has turned since the last step (BodyCoupling::followed). The
// carpus also moves with its target. Joints stay as they are. Bones that touch something, and their ancestors, do not
// turn relative to their parents, because the object holds them.
//
// Tissue. It moves rigidly with its nearest bone.
//
// Objects. A free object moves with the bones that touch it, in the mean over its contacts. Other objects, objects with
// joints and flexible objects keep their velocity.
#pragma once

#include <cstdint>
#include <vector>

#include "energies/body_coupling.hpp"
#include "model/state.hpp"
#include "solver/linkage.hpp"

namespace softhand {

class StepGuess {
 public:
  StepGuess() = default;
  /// As for Linkage. `node_bodies`: also of the nodes of flexible objects, -1.
  StepGuess(std::vector<Linkage::Link> links, std::vector<std::int32_t> node_bodies);

  /// Begins the guess of a step that starts with `state`.
  void begin(const State& state);
  /// Moves the bones of one hand. Its couplings have the sites of its bones, in order. Does nothing if the target of
  /// the carpus is new. `linkage` says which bones touch.
  void move_bones(const BodyCoupling& coupling, int first_body, const Linkage& linkage, State& state);
  /// Largest movement of a bone so far, m.
  double farthest() const { return farthest_; }
  /// Moves all nodes. Call after the bones of all hands have moved.
  void move_nodes(State& state, double time_step) const;

  // The object that moves next. Call `touch` with each touching node, and then `move_object`.
  void begin_object();
  void touch(std::int32_t node, const State& state, int object);
  void move_object(State& state, int object, double time_step) const;

 private:
  /// Where the bone takes a point that was at `point` at the start of the step.
  Vector3 moved(std::size_t bone, const Vector3& point, const State& state) const {
    return state.body_poses[bone].position + turns_[bone] * Vector3(point - from_[bone]);
  }

  std::vector<Linkage::Link> links_;
  std::vector<std::int32_t> node_bodies_;
  std::vector<Vector3> from_;      // by bone, position at the start of the step
  std::vector<Quaternion> turns_;  // by bone
  double farthest_ = 0;
  // Sums over the contacts of an object.
  Vector3 translation_ = Vector3::Zero(), rotation_ = Vector3::Zero();
  int contacts_ = 0;
};

}  // namespace softhand
