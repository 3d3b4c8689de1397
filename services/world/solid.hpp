// Geometry of the world's shapes in double precision: what they weigh and how two of them are separated.
#pragma once

#include <vector>

#include "math/types.hpp"
#include "messages/messages.hpp"
#include "world/world_options.hpp"

namespace softhand {

/// An object's shape in its body frame (centre of mass, principal axes), and where that frame stands in the shape's
/// frame of the scene file.
struct Solid {
  Shape shape;
  Vector3 inertia = Vector3::Zero();  ///< principal, kg m^2; 0 when static
  Pose body_frame;                    ///< body to scene shape
  double radius = 0;                  ///< of the bounding sphere about the centre of mass, m; 0 for a plane
};

/// Throws std::invalid_argument where the shape spans no volume or has too many vertices.
Solid make_solid(const ObjectOptions& object);

/// The point of the shape at `pose` that lies farthest along `direction` (unit, world). Not for planes.
Vector3 support(const Shape& shape, const Pose& pose, const Vector3& direction);

/// A half-space that holds all of `neighbour`, with `object` outside as far as it goes.
struct SeparatingPlane {
  Vector3 point;   ///< on the plane, where the object is nearest, world
  Vector3 normal;  ///< unit, towards the object
  double gap = 0;  ///< m, negative when overlapping
};

/// The best of: `direction` (unit, from neighbour to object, with the engine's single-precision noise, or now and then
/// none at all), and the flat faces of either shape; where all of them overlap, what a search from the best finds. The
/// gap is measured on the true shapes, without an engine's margins. For convex shapes no plane has a larger gap than
/// their distance.
SeparatingPlane separating_plane(const Shape& object, const Pose& object_pose, const Shape& neighbour,
                                 const Pose& neighbour_pose, const Vector3& direction);

}  // namespace softhand
