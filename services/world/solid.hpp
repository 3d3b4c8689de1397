// Geometry of the world's shapes in double precision: mass properties, and planes that separate two shapes.
#pragma once

#include <utility>
#include <vector>

#include "math/types.hpp"
#include "messages/messages.hpp"
#include "world/world_options.hpp"

namespace softhand {

/// The shape of an object in its body frame (centre of mass, principal axes). Includes the pose of this frame in the
/// shape's frame of the scene file.
struct Solid {
  Shape shape;
  Vector3 inertia = Vector3::Zero();  ///< principal, kg m^2; 0 when static
  Pose body_frame;                    ///< pose of the body frame in the scene shape
  double radius = 0;                  ///< m, bounding sphere about the centre of mass; 0 for a plane
  std::vector<Shape> pieces;          ///< convex hulls in the body frame; empty if the shape is convex

  std::size_t piece_count() const { return pieces.empty() ? 1 : pieces.size(); }
  const Shape& piece(std::size_t i) const { return pieces.empty() ? shape : pieces[i]; }
};

/// Takes a link of an object file from `object.model`, with the file's mass properties.
/// Throws std::invalid_argument if the shape spans no volume or has a wrong number of vertices.
Solid make_solid(const ObjectOptions& object);

/// The frame of a joint in the body frames of its parent and its child. An object file gives both frames. Otherwise the
/// child's frame lies where the parent's frame is at the start.
std::pair<Pose, Pose> joint_frames(const JointOptions& joint, const ObjectOptions& parent, const Solid& parent_solid,
                                   const ObjectOptions& child, const Solid& child_solid);

/// The point of the shape at `pose` that is farthest along `direction` (unit, world). Not for planes.
Vector3 support(const Shape& shape, const Pose& pose, const Vector3& direction);

/// A half-space that contains all of `neighbour`, with `object` outside it as far as possible.
struct SeparatingPlane {
  Vector3 point;   ///< point of the plane nearest to the object, world
  Vector3 normal;  ///< unit, towards the object
  double gap = 0;  ///< m, negative when overlapping
};

/// Returns the best plane among these candidates: the one along `direction`, and the flat faces of both shapes. If all
/// of them overlap, a search around the best one follows. `direction` is a unit vector from neighbour to object, with
/// the single-precision noise of the engine. It is sometimes completely wrong. The gap is measured on the true shapes,
/// without an engine's margins. For convex shapes no plane has a larger gap than their distance.
SeparatingPlane separating_plane(const Shape& object, const Pose& object_pose, const Shape& neighbour,
                                 const Pose& neighbour_pose, const Vector3& direction);

}  // namespace softhand
