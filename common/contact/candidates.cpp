#include "contact/candidates.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "geometry/triangle.hpp"

namespace softhand {
namespace {

constexpr double kDeepest = 4e-3;  // m; a sharp point that starts deeper in the skin stays unseen
// Directions in which a bone's skin may leave an object. Directions within 25 degrees of each other count as the same,
// and directions that differ by more than 120 degrees as opposite.
constexpr std::size_t kMostExits = 12;
constexpr double kSameExit = 0.9, kOpposite = -0.5;
constexpr double kShortestStep = 1e-4;  // m, of the search for a place outside

// Groups of the points first ... last - 1.
PointGroups groups_of(const ContactPoints& points, int first, int last) {
  std::vector<std::uint8_t> bodies;
  for (int i = first; i < last; ++i) bodies.push_back(points[i].body);
  return PointGroups(bodies, [&points, first](std::int32_t point) { return points.nodes(first + point); });
}

}  // namespace

Candidates::Candidates(const ContactPoints& points, int slots)
    : points_(&points),
      groups_(groups_of(points, 0, points.count())),
      triangles_(groups_of(points, points.count(), points.size())),
      clearances_(static_cast<std::size_t>(slots) * static_cast<std::size_t>(points.count()), 0.0) {
  starts_ = velocities_ = ends_ = displacements_ = Eigen::Matrix3Xd::Zero(3, points.node_count());
  met_.reserve(static_cast<std::size_t>(points.count()));
  exits_.reserve(kMostExits);
}

void Candidates::begin_step(const State& state, double time_step) {
  time_step_ = time_step;
  starts_ = state.node_positions.leftCols(starts_.cols());
  velocities_ = state.node_velocities.leftCols(velocities_.cols());
  groups_.update(starts_, velocities_, time_step);
  displacements_ = time_step * velocities_;
  ends_ = starts_ + displacements_;
  triangles_are_old_ = true;
}

void Candidates::set_ends(const State& state) {
  ends_ = state.node_positions.leftCols(ends_.cols());
  displacements_ = ends_ - starts_;
  groups_.update(starts_, displacements_, 1.0);
  triangles_are_old_ = true;
}

void Candidates::update_triangles() {
  if (!std::exchange(triangles_are_old_, false)) return;
  triangles_.update(starts_, displacements_, 1.0);
  longest_path_ = displacements_.cols() > 0 ? std::sqrt(displacements_.colwise().squaredNorm().maxCoeff()) : 0.0;
}

bool Candidates::may_reach(const Collider& collider, const State& state, double margin) {
  const Pose& from = collider.body_pose(state);
  const Pose to = collider.predicted_pose(state, time_step_);
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

bool Candidates::predicted(const Collider& collider, int point, double margin, double& clearance,
                           ContactCandidate& candidate) {
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
  candidate.point = point;
  if (collider.jumped()) {
    if (const auto crossing = collider.geometry()->first_crossing(before, now)) {
      // If the object turned under a point that stays outside, only the chord of the point's path crosses the surface.
      // A point that is now behind the object was passed by the surface.
      if (nearest.distance < 0 ||
          !Collider::same_side(collider.last_pose(), crossing->normal, collider.start_pose(), nearest.normal)) {
        candidate.place = crossing->point;
        candidate.normal = crossing->normal;
        return true;
      }
    }
  }
  if (nearest.distance < 0) {
    SurfacePoint surface = nearest;
    candidate.place = now;
    if (collider.turns_far()) {
      const SurfacePoint there = collider.closest(next);
      if (there.distance < 0 &&
          Collider::same_side(collider.start_pose(), nearest.normal, collider.end_pose(), there.normal)) {
        surface = there;
        candidate.place = next;
      }
    }
    candidate.normal = surface.normal;
    candidate.recess = -surface.distance;
    return true;
  }
  const auto met = collider.crossing(position, position + movement);
  if (!met) return false;
  candidate.place = met->point;
  candidate.normal = met->normal;
  candidate.predicted = true;
  return true;
}

// Each point knows the side where it is least far inside. A finger deep inside an object has points on both sides of
// the object's middle. If each of them left on its own side, they would pull the finger apart and hold it inside.
void Candidates::choose_exits(const ShapeGeometry& geometry) {
  for (std::size_t first = 0, last = 0; first < met_.size(); first = last) {
    const std::uint8_t bone = (*points_)[met_[first].point].body;
    exits_.clear();
    bool opposite = false;
    for (; last < met_.size() && (*points_)[met_[last].point].body == bone; ++last) {
      const Vector3& normal = met_[last].normal;
      if (met_[last].recess <= 0 || exits_.size() == kMostExits) continue;
      const auto has = [&](const auto& test) {
        return std::any_of(exits_.begin(), exits_.end(), [&](const Vector3& exit) { return test(exit.dot(normal)); });
      };
      opposite = opposite || has([](double cosine) { return cosine < kOpposite; });
      if (!has([](double cosine) { return cosine > kSameExit; })) exits_.push_back(normal);
    }
    if (opposite) choose_exit(geometry, std::span(met_).subspan(first, last - first));
  }
}

// Takes the exit along which the last point leaves after the shortest way.
void Candidates::choose_exit(const ShapeGeometry& geometry, std::span<ContactCandidate> of_bone) {
  const double longest = 2 * geometry.bounding_radius();
  const auto way_out = [&](const Vector3& place, const Vector3& direction) {
    double way = 0;
    while (way < longest) {
      ++queries_;
      const double distance = geometry.closest(place + way * direction).distance;
      if (distance >= 0) return way;
      way += std::max(-distance, kShortestStep);
    }
    return longest;
  };
  Vector3 best = Vector3::Zero();
  double shortest = longest;
  for (const Vector3& exit : exits_) {
    double way = 0;
    for (const ContactCandidate& candidate : of_bone) {
      if (candidate.recess > 0 && way < shortest) way = std::max(way, way_out(candidate.place, exit));
    }
    if (way >= shortest) continue;
    shortest = way;
    best = exit;
  }
  if (shortest == longest) return;
  for (ContactCandidate& candidate : of_bone) {
    if (candidate.recess <= 0) continue;
    candidate.recess = std::max(way_out(candidate.place, best), kShortestStep);
    candidate.normal = best;
  }
}

bool Candidates::crossed(const Collider& collider, int point, ContactCandidate& candidate) {
  const Vector3 start = points_->at(point, starts_), end = points_->at(point, ends_);
  const Vector3 from = to_local(collider.start_pose(), start), to = to_local(collider.end_pose(), end);
  ++queries_;
  if (collider.closest(to).distance > (to - from).norm()) return false;
  const auto met = collider.crossing(start, end);
  if (!met) return false;
  candidate.point = point;
  candidate.place = met->point;
  candidate.normal = met->normal;
  return true;
}

Candidates::SkinPlace Candidates::nearest_on_skin(const Vector3& place, double distance,
                                                  const Eigen::Matrix3Xd& node_positions) const {
  SkinPlace best;
  triangles_.for_each_near(place, distance, [&](std::int32_t triangle) {
    const int point = points_->count() + triangle;
    const auto nodes = points_->nodes(point);
    const auto corner = [&](std::size_t k) { return Vector3(node_positions.col(nodes[k])); };
    const Vector3 a = corner(0), b = corner(1), c = corner(2);
    const double edge = std::sqrt(std::max((b - a).squaredNorm(), (c - a).squaredNorm()));
    if ((place - a).squaredNorm() > (distance + edge) * (distance + edge)) return;
    const TrianglePoint nearest = nearest_on_triangle(place, a, b, c);
    const double away = (place - nearest.point).norm();
    if (away >= distance) return;
    distance = away;
    best = {point, nearest.weights, nearest.point, (b - a).cross(c - a).normalized()};
  });
  return best;
}

// The ball `sharp` must be outside at the step's start, or at most kDeepest inside, and inside at its end.
bool Candidates::enters(const Collider& collider, const RestingPoint& sharp, bool predicted,
                        ContactCandidate& candidate) const {
  const Vector3 from = (collider.jumped() ? collider.last_pose() : collider.start_pose()) * sharp.centre;
  const Vector3 to = collider.end_pose() * sharp.centre;
  const SkinPlace end = nearest_on_skin(to, sharp.radius + (to - from).norm() + longest_path_ + kDeepest, ends_);
  if (end.point < 0 || end.normal.dot(to - end.position) >= sharp.radius) return false;
  const auto nodes = points_->nodes(end.point);
  const auto corner = [&](std::size_t k) { return Vector3(starts_.col(nodes[k])); };
  const Vector3 place = end.weights[0] * corner(0) + end.weights[1] * corner(1) + end.weights[2] * corner(2);
  const Vector3 outward = (corner(1) - corner(0)).cross(corner(2) - corner(0)).normalized();
  const double height = outward.dot(from - place) - sharp.radius;
  if (height < -kDeepest) return false;
  candidate.point = end.point;
  candidate.weights = end.weights;
  candidate.normal = collider.end_pose().orientation.conjugate() * -end.normal;
  candidate.recess = std::max(0.0, -height);
  candidate.place = sharp.centre + (sharp.radius - candidate.recess) * candidate.normal;
  candidate.predicted = predicted && height >= 0;
  return true;
}

}  // namespace softhand
