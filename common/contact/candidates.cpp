#include "contact/candidates.hpp"

namespace softhand {
namespace {

PointGroups groups_of(const ContactPoints& points) {
  std::vector<std::uint8_t> bodies;
  for (int i = 0; i < points.count(); ++i) bodies.push_back(points[i].body);
  return PointGroups(bodies, [&points](std::int32_t point) { return points.nodes(point); });
}

}  // namespace

Candidates::Candidates(const ContactPoints& points, int slots)
    : points_(&points),
      groups_(groups_of(points)),
      clearances_(static_cast<std::size_t>(slots) * static_cast<std::size_t>(points.count()), 0.0) {
  starts_ = velocities_ = ends_ = displacements_ = Eigen::Matrix3Xd::Zero(3, points.node_count());
}

void Candidates::begin_step(const State& state, double time_step) {
  time_step_ = time_step;
  starts_ = state.node_positions;
  velocities_ = state.node_velocities;
  groups_.update(starts_, velocities_, time_step);
}

void Candidates::set_ends(const State& state) {
  ends_ = state.node_positions;
  displacements_ = ends_ - starts_;
  groups_.update(starts_, displacements_, 1.0);
}

bool Candidates::may_reach(const Collider& collider, const State& state, double seconds, double margin) {
  const Pose& from = collider.body_pose(state);
  const Pose to = collider.predicted_pose(state, seconds);
  begin_step(state, seconds);
  bool may = false;
  groups_.for_each_near(*collider.geometry(), from, collider.reach(from, to, groups_) + margin,
                        [&](std::int32_t point) {
                          if (may) return;
                          const Vector3 now = to_local(from, start(point));
                          const Vector3 next = to_local(to, predicted_end(point));
                          ++queries_;
                          may = collider.closest(now).distance <= (next - now).norm() + margin;
                        });
  return may;
}

bool Candidates::predicted(const Collider& collider, int point, double margin, double& clearance, Meeting& meeting) {
  const Vector3 position = start(point);
  const Vector3 movement = time_step_ * points_->at(point, velocities_);
  clearance = (position - collider.start_pose().position).norm() - collider.geometry()->bounding_radius();
  if (clearance > margin + movement.norm()) return false;
  const Vector3 now = to_local(collider.start_pose(), position);
  const Vector3 next = to_local(collider.end_pose(), position + movement);
  const Vector3 before = collider.jumped() ? to_local(collider.last_pose(), position) : now;
  ++queries_;
  const SurfacePoint nearest = collider.closest(now);
  clearance = nearest.distance;
  if (nearest.distance > std::max((next - now).norm(), (now - before).norm())) return false;
  meeting.point = point;
  if (collider.jumped()) {
    if (const auto crossing = collider.geometry()->first_crossing(before, now)) {
      // If the object turned under a point that stays outside, only the chord of the point's path crosses the surface.
      // A point that is now behind the object was passed by the surface.
      if (nearest.distance < 0 ||
          !Collider::same_side(collider.last_pose(), crossing->normal, collider.start_pose(), nearest.normal)) {
        meeting.place = crossing->point;
        meeting.normal = crossing->normal;
        return true;
      }
    }
  }
  if (nearest.distance < 0) {
    SurfacePoint surface = nearest;
    meeting.place = now;
    if (collider.turns_far()) {
      const SurfacePoint there = collider.closest(next);
      if (there.distance < 0 &&
          Collider::same_side(collider.start_pose(), nearest.normal, collider.end_pose(), there.normal)) {
        surface = there;
        meeting.place = next;
      }
    }
    meeting.normal = surface.normal;
    meeting.recess = -surface.distance;
    return true;
  }
  const auto met = collider.meeting(position, position + movement);
  if (!met) return false;
  meeting.place = met->point;
  meeting.normal = met->normal;
  meeting.predicted = true;
  return true;
}

bool Candidates::crossed(const Collider& collider, int point, Meeting& meeting) {
  const Vector3 start = points_->at(point, starts_), end = points_->at(point, ends_);
  const Vector3 from = to_local(collider.start_pose(), start), to = to_local(collider.end_pose(), end);
  ++queries_;
  if (collider.closest(to).distance > (to - from).norm()) return false;
  const auto met = collider.meeting(start, end);
  if (!met) return false;
  meeting.point = point;
  meeting.place = met->point;
  meeting.normal = met->normal;
  return true;
}

}  // namespace softhand
