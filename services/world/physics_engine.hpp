// Interface of a physics engine for the world. To add an engine, add a folder in engines/ and a line in
// engines/engines.cpp.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "math/types.hpp"
#include "messages/messages.hpp"
#include "model/joint_law.hpp"

namespace softhand {

/// A rigid body. Its frame has its origin at the centre of mass and its axes along the principal axes.
struct EngineObject {
  Shape shape;
  double mass = 0;                    ///< kg; 0 = static
  Vector3 inertia = Vector3::Zero();  ///< principal, kg m^2
  double friction = 0;                ///< a pair uses the geometric mean
  Pose pose;
  /// Convex hulls in the body frame whose union is the body. Empty: `shape` is convex and is the body itself.
  std::span<const Shape> pieces = {};
};

/// A joint between two bodies. `child` can move. Jointed bodies do not collide with each other.
struct EngineJoint {
  JointLaw law;
  std::size_t parent = 0;  ///< slot
  std::size_t child = 0;   ///< slot
  Pose parent_from_joint;  ///< the joint's frame in the parent's body frame
  Pose child_from_joint;
  double reaction = 0;    ///< N, `reaction` of an earlier step, if the joint continues from one
  double coordinate = 0;  ///< q at the bodies' poses, or in a step before: the turn of a screw is the one nearest to it
};

/// A body that its caller moves and deforms. It pushes bodies, and nothing pushes it.
struct EngineCopy {
  std::span<const std::vector<std::int32_t>> pieces;  ///< the body is the union of the convex hulls of these vertices
  std::span<const std::array<float, 3>> vertices;     ///< at the start, m, relative to the centre, world axes
  double friction = 0;                                ///< a pair uses the geometric mean
};

/// Uniform solid of unit density: the convex hull of some points.
struct HullSolid {
  double volume = 0;  ///< m^3; 0 if the points span no volume
  Vector3 centre = Vector3::Zero();
  Matrix3 inertia = Matrix3::Zero();  ///< about the centre, for unit density, m^5
};

class PhysicsEngine {
 public:
  virtual ~PhysicsEngine() = default;

  /// Slots 0..127 identify the objects. A slot in use must be removed before it is added again.
  virtual void add(std::size_t slot, const EngineObject& object) = 0;
  virtual void remove(std::size_t slot) = 0;
  /// Moves the body to a pose with a velocity. Its cached contacts are dropped.
  virtual void place(std::size_t slot, const Pose& pose, const Twist& velocity) = 0;
  /// Acceleration of gravity on one body, m/s^2.
  virtual void set_gravity(std::size_t slot, const Vector3& gravity) = 0;
  /// Adds a force (N) and a torque about the centre of mass (N m), world axes, for the next step.
  virtual void apply(std::size_t slot, const Wrench& wrench) = 0;
  /// Joints have numbers 0..127. Both bodies must exist as long as the joint exists.
  virtual void add_joint(std::size_t number, const EngineJoint& joint) = 0;
  virtual void remove_joint(std::size_t number) = 0;
  /// A passive joint holds its bodies together and keeps its limits, but has no friction, spring, damping and detents.
  virtual void set_passive(std::size_t number, bool passive) = 0;
  /// Force (N) with which the joint held its bodies together in the last step or its last part, across a slider's axis.
  virtual double reaction(std::size_t number) const = 0;
  /// Coordinate of the joint (`joint_coordinate`) at the start of the last step, or of its last part.
  virtual double coordinate(std::size_t number) const = 0;
  /// Copies of flexible objects have numbers 0..kMaxSoftObjects - 1. A new one is hidden: bodies pass through it until
  /// `move_copy`.
  virtual void add_copy(std::size_t number, const EngineCopy& copy) = 0;
  /// Where it is at the end of the next step: its centre (m), and its vertices relative to the centre. The velocity
  /// (m/s) is that of the centre. It stays there until the next call. `rests`: the bodies on it may sleep.
  virtual void move_copy(std::size_t number, const Vector3& centre, const Vector3& velocity,
                         std::span<const std::array<float, 3>> vertices, bool rests) = 0;
  virtual void hide_copy(std::size_t number) = 0;
  /// Whether the body passes through all copies of flexible objects. `add` sets it to false.
  virtual void set_passing(std::size_t slot, bool passes) = 0;
  /// Puts a body to sleep that rests, as if the engine had done so itself.
  virtual void put_to_sleep(std::size_t slot) = 0;
  /// Forgets everything that it carries from step to step: contacts, impulses, sleep, and the order in which objects
  /// came. Only the reactions and coordinates of joints stay. Then it equals a new engine with these objects, joints
  /// and copies of flexible objects, in the order of slots and numbers, at rest. The copies are hidden. Allocates
  /// nothing.
  virtual void forget() = 0;
  /// Makes one step of `dt` seconds. Forces act during all of it. The engine may divide it into parts, but their number
  /// must follow from its state alone.
  virtual void step(double dt) = 0;
  /// True while the engine skips the body in its steps because it rests. The engine must not skip a body that creeps at
  /// 0.1 mm/s. It must wake a body in the same step if `apply` pushes it, if something hits it, or if its support goes
  /// away.
  virtual bool asleep(std::size_t slot) const = 0;
  virtual Pose pose(std::size_t slot) const = 0;
  virtual Twist velocity(std::size_t slot) const = 0;
  /// Finds the unit direction from body `other` to body `slot` between their closest points. If they overlap, it is the
  /// direction of the shortest separation. Returns false if they are farther apart than `range` (m). The direction may
  /// have single-precision noise: `separating_plane` (solid.hpp) measures along it.
  virtual bool closest_direction(std::size_t slot, std::size_t other, double range, Vector3& direction) const {
    return closest_direction(slot, 0, other, 0, range, direction);
  }
  /// The same between a piece of `slot` and a piece of `other`. A convex body has one piece.
  virtual bool closest_direction(std::size_t slot, std::size_t piece, std::size_t other, std::size_t other_piece,
                                 double range, Vector3& direction) const = 0;
};

/// Creates the engine with this name. Throws std::invalid_argument for an unknown name.
std::unique_ptr<PhysicsEngine> make_physics_engine(std::string_view name);

/// Mass properties of the hull of `points`.
HullSolid hull_solid(const std::vector<Vector3>& points);

}  // namespace softhand
