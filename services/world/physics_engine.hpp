// What the world asks of a physics engine. One folder an engine in engines/, one line in engines/engines.cpp.
#pragma once

#include <cstddef>
#include <memory>
#include <string_view>
#include <vector>

#include "math/types.hpp"
#include "messages/messages.hpp"

namespace softhand {

/// A rigid body, its frame at the centre of mass along the principal axes.
struct EngineObject {
  Shape shape;
  double mass = 0;                    ///< kg; 0 = static
  Vector3 inertia = Vector3::Zero();  ///< principal, kg m^2
  double friction = 0;                ///< a pair has the geometric mean
  Pose pose;
};

/// Solid of unit density inside the hull of some points.
struct HullSolid {
  double volume = 0;  ///< m^3; 0 when the points span none
  Vector3 centre = Vector3::Zero();
  Matrix3 inertia = Matrix3::Zero();  ///< about the centre, for unit density, m^5
};

class PhysicsEngine {
 public:
  virtual ~PhysicsEngine() = default;

  /// Objects are named by slot, 0..127; a slot that is in use must be removed first.
  virtual void add(std::size_t slot, const EngineObject& object) = 0;
  virtual void remove(std::size_t slot) = 0;
  /// Puts the body somewhere with a velocity; what touched it there is forgotten.
  virtual void place(std::size_t slot, const Pose& pose, const Twist& velocity) = 0;
  /// Acceleration of gravity on one body, m/s^2.
  virtual void set_gravity(std::size_t slot, const Vector3& gravity) = 0;
  /// Adds a force (N) and a torque about the centre of mass (N m), world axes, for the next step.
  virtual void apply(std::size_t slot, const Wrench& wrench) = 0;
  /// One step of `dt` seconds, no sub-steps.
  virtual void step(double dt) = 0;
  /// True while the engine leaves the body out of its steps, since it rests. It must not leave out what creeps at 0.1
  /// mm/s, and must wake a body in the step in which `apply` pushes it, something hits it or what carries it goes away.
  virtual bool asleep(std::size_t slot) const = 0;
  virtual Pose pose(std::size_t slot) const = 0;
  virtual Twist velocity(std::size_t slot) const = 0;
  /// Unit direction from body `other` to body `slot` between their closest points, or along which they part soonest
  /// when they overlap. False when they are farther apart than `range` metres. The direction may carry single-precision
  /// noise: `separation` (solid.hpp) measures along it.
  virtual bool closest_direction(std::size_t slot, std::size_t other, double range, Vector3& direction) const = 0;
};

/// The engine of that name; throws std::invalid_argument for an unknown one.
std::unique_ptr<PhysicsEngine> make_physics_engine(std::string_view name);

/// Mass properties of the hull of `points`.
HullSolid hull_solid(const std::vector<Vector3>& points);

}  // namespace softhand
