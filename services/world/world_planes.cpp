// Planes between objects and their neighbours: the world finds them for the hands, and the copies of held objects stop
// at them.
#include <algorithm>
#include <cmath>

#include "messages/convert.hpp"
#include "world/follow.hpp"
#include "world/world_loop.hpp"

namespace softhand {
namespace {

constexpr double kNearestPlane = 0.005;  // m
constexpr double kFarthestPlane = 0.050;
constexpr double kTouching = 0.001;  // m; nearer neighbours take part of the hand's force
// m a step. An object may be pushed this far into a neighbour that stops it, so that the engine detects the contact.
constexpr double kSeating = 0.0001;
constexpr double kCutByPlane = 0.0005;  // m
constexpr double kSamePlane = 0.98;     // cosine of 11 degrees

}  // namespace

void WorldLoop::find_planes(std::size_t slot) {
  Object& object = objects_[slot];
  const double delay = (1 + options_.staleness) * (step_ + (object.owned ? object.owner_step : 1.0 / 90));
  // The corners of a rotating object are faster than its centre.
  const double speed = object.velocity.linear.norm() + object.velocity.angular.norm() * object.solid.radius;
  const double range = std::max(kNearestPlane, std::min(kFarthestPlane, speed * delay));
  for (std::size_t other = 0; other < objects_.size(); ++other) {
    const Object& neighbour = objects_[other];
    if (other == slot || !neighbour.present || are_jointed(slot, other)) continue;
    for (std::size_t piece = 0; piece < object.solid.piece_count(); ++piece) {
      for (std::size_t other_piece = 0; other_piece < neighbour.solid.piece_count(); ++other_piece)
        find_plane(slot, piece, other, other_piece, range);
    }
  }
}

void WorldLoop::find_plane(std::size_t slot, std::size_t piece, std::size_t other, std::size_t other_piece,
                           double range) {
  Object& object = objects_[slot];
  const Object& neighbour = objects_[other];
  Vector3 direction;
  if (!engine_->closest_direction(slot, piece, other, other_piece, range, direction)) return;
  const SeparatingPlane found = separating_plane(object.solid.piece(piece), object.pose,
                                                 neighbour.solid.piece(other_piece), neighbour.pose, direction);
  if (found.gap > range) return;
  // The hand holds the whole object on one side of a plane. So a plane that cuts another piece cannot be used.
  for (const Shape& each : object.solid.pieces) {
    const double height = found.normal.dot(support(each, object.pose, -found.normal) - found.point);
    if (height < std::min(found.gap, 0.0) - kCutByPlane) return;
  }
  NeighbourPlane plane;
  plane.neighbour = static_cast<std::uint32_t>(other + 1);
  plane.kind = neighbour.dynamic ? kNeighbourDynamic : kNeighbourStatic;
  plane.point = to_wire(found.point);
  plane.normal = to_wire(found.normal);
  plane.velocity = to_wire(
      Vector3(neighbour.velocity.linear + neighbour.velocity.angular.cross(found.point - neighbour.pose.position)));
  plane.gap = found.gap;
  plane.friction = std::sqrt(object.options.friction * neighbour.options.friction);
  plane.mass = neighbour.options.mass;
  // Several pairs of pieces have nearly the same plane. The nearest one stays, or the load would count several times.
  for (NeighbourPlane& known : object.planes) {
    if (known.neighbour != plane.neighbour || to_vector(known.normal).dot(found.normal) < kSamePlane) continue;
    if (plane.gap < known.gap) known = plane;
    return;
  }
  if (object.planes.push_back(plane)) return;
  // If there are more neighbours than places in the list, the nearest ones stay.
  auto farthest = std::max_element(object.planes.begin(), object.planes.end(),
                                   [](const NeighbourPlane& a, const NeighbourPlane& b) { return a.gap < b.gap; });
  if (farthest->gap > plane.gap) *farthest = plane;
}

/// In free flight the copy needs the hand's wrench. In contact with a neighbour the twin also feels a reaction that
/// balances the hand's push. The hand does not publish this reaction. With the push alone the copy would be thrown at
/// the neighbour: 5 N on 1 g for one step of 17 ms is 83 m/s. Therefore the push along and into a static neighbour is
/// left out. The part that pushes a movable neighbour stays.
Wrench WorldLoop::without_reaction(const Object& object, const Follower& follower, const Wrench& hand) const {
  const Vector3 net = hand.force + follower.mass * follower.gravity;
  Vector3 into_dynamic = Vector3::Zero();
  bool touches = false, touches_static = false;
  for (const NeighbourPlane& plane : object.planes) {
    if (plane.gap > kTouching) continue;
    touches = true;
    if (plane.kind == kNeighbourStatic) touches_static = true;
    if (plane.kind == kNeighbourDynamic)
      into_dynamic += std::min(0.0, to_vector(plane.normal).dot(net)) * to_vector(plane.normal);
  }
  return {touches_static ? Vector3(into_dynamic - follower.mass * follower.gravity) : hand.force,
          touches ? Vector3(Vector3::Zero()) : hand.torque};
}

/// Prevents the coupling from driving the copy through a neighbour within one step. Engines detect contacts only at the
/// present places of the bodies.
void WorldLoop::stop_at_planes(const Object& object, const Follower& follower, Wrench& wrench) const {
  for (int pass = 0; pass < 3; ++pass) {
    for (const NeighbourPlane& plane : object.planes) {
      if (plane.kind == kNeighbourDynamic && plane.gap <= kSeating) continue;  // a touched neighbour may be pushed
      const Vector3 n = to_vector(plane.normal);
      const Vector3 next = follower.velocity.linear + step_ * (wrench.force / follower.mass + follower.gravity);
      const double closing = n.dot(next - to_vector(plane.velocity));
      const double fastest = -(std::max(plane.gap, 0.0) + kSeating) / step_;
      if (closing < fastest) wrench.force += follower.mass * (fastest - closing) / step_ * n;
    }
  }
  const double cap = kOwnerForceCap + follower.mass * follower.gravity.norm();
  if (wrench.force.norm() > cap) wrench.force *= cap / wrench.force.norm();
}

}  // namespace softhand
