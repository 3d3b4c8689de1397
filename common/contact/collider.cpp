#include "contact/collider.hpp"

#include <algorithm>
#include <cmath>

namespace softhand {
namespace {

constexpr double kTeleport = 0.25;    // m; an object that moved farther than this between two steps was teleported
constexpr double kSamePlace = 1e-9;   // m; an object that moved less than this between two steps has not jumped
constexpr int kArcPoints = 8;         // the arc of a point around a turning object is sampled in this many pieces
constexpr double kSmoothTurn = 0.94;  // cosine of 20 degrees; a normal that turns more in a step has met an edge
// Relative to the slide: heights of the paths on which walls stop an anchor. In a corner, the higher path may start
// inside the wall.
constexpr std::array<double, 2> kLifts{0.1, 0.01};
constexpr double kSweptTurn = 0.996;      // cosine of 5 degrees; a surface that turns farther needs a new plane
constexpr double kSweptHalfTurn = 0.999;  // cosine of half that angle

}  // namespace

PointBlocks::PointBlocks(const ContactPoints& points) : points_(&points), first_node_{0} {
  std::size_t blocks = 0;
  for (int i = 0; i < points.size(); ++i) {
    const std::size_t count = points.nodes(i).size();
    first_node_.push_back(first_node_.back() + count);
    first_block_.push_back(blocks);
    blocks += count * (count + 1) / 2;
  }
  blocks_.resize(blocks);
}

void PointBlocks::add_pattern(BlockPattern& pattern) const {
  for (int i = 0; i < points_->size(); ++i) {
    const auto nodes = points_->nodes(i);
    for (std::size_t a = 1; a < nodes.size(); ++a) {
      for (std::size_t b = 0; b < a; ++b) pattern.add(nodes[a], nodes[b]);
    }
  }
}

void PointBlocks::bind(const BlockMatrix& matrix) {
  auto block = blocks_.begin();
  for (int i = 0; i < points_->size(); ++i) {
    const auto nodes = points_->nodes(i);
    for (std::size_t a = 0; a < nodes.size(); ++a) {
      for (std::size_t b = 0; b <= a; ++b) *block++ = matrix.find(nodes[a], nodes[b]);
    }
  }
}

void PointBlocks::add_hessian(int point, const Matrix3& stiffness, BlockMatrix& hessian) const {
  const ContactPoint& p = (*points_)[point];
  const BlockSlot* block = blocks_.data() + first_block_[static_cast<std::size_t>(point)];
  if (p.node_count == 1) {
    hessian.add(*block, stiffness);
    return;
  }
  for (std::size_t a = 0; a < static_cast<std::size_t>(p.node_count); ++a) {
    for (std::size_t b = 0; b <= a; ++b) hessian.add(*block++, p.weights[a] * p.weights[b] * stiffness);
  }
}

void Collider::set(const ShapeGeometry& geometry, ContactObject kind) {
  geometry_ = &geometry;
  // An object that the hand gives back continues at the pose of the world's copy. It did not move there through the
  // hand, so no path is used.
  if (memory_.kind == ContactObject::moving && kind == ContactObject::fixed) memory_.seen = false;
  memory_.kind = kind;
}

void Collider::clear() {
  geometry_ = nullptr;
  memory_ = {};
}

void Collider::load(const Memory& memory) {
  memory_ = memory;
  end_pose_ = memory.last_pose;
}

bool Collider::begin_step(const State& state, double time_step, const PointGroups& points) {
  start_pose_ = body_pose(state);
  end_pose_ = advanced(start_pose_, state.body_velocities[static_cast<std::size_t>(body_)], time_step);
  const bool teleported = memory_.seen && (start_pose_.position - memory_.last_pose.position).norm() > kTeleport;
  jumped_ = memory_.seen && !teleported && reach(memory_.last_pose, start_pose_, points) > kSamePlace;
  return !teleported;
}

void Collider::end_step(const State& state) {
  moved_ = turned_ = Vector3::Zero();
  if (is_fixed()) return;
  end_pose_ = body_pose(state);
  moved_ = end_pose_.position - start_pose_.position;
  turned_ = rotation_log(end_pose_.orientation * start_pose_.orientation.conjugate());
}

double Collider::reach(const Pose& from, const Pose& to, const PointGroups& points) const {
  const double lever = std::min(geometry_->bounding_radius() + 0.1, points.farthest(from.position));
  return (to.position - from.position).norm() +
         1.01 * rotation_log(to.orientation * from.orientation.conjugate()).norm() * lever;
}

std::optional<SurfacePoint> Collider::closest_on_side(const Vector3& place, const Vector3& normal,
                                                      double distance) const {
  const Vector3 from = place + distance * normal;
  const auto crossing = geometry_->first_crossing(from, place);
  if (!crossing || !(crossing->normal.dot(normal) > 0)) return std::nullopt;
  return SurfacePoint{crossing->normal.dot(place - crossing->point), crossing->point, crossing->normal};
}

SurfacePoint Collider::slid(const Vector3& from, const Vector3& normal, const Vector3& movement) const {
  const Vector3 to = from + movement;
  const SurfacePoint nearest = geometry_->closest(to);
  if (nearest.normal.dot(normal) > kSmoothTurn) return nearest;
  const double length = movement.norm();
  for (const double height : kLifts) {
    const Vector3 lift = height * length * normal;
    if (const auto wall = geometry_->first_crossing(from + lift, to + lift))
      return {-(to - wall->point).norm(), wall->point, wall->normal};
  }
  return closest_on_side(to, normal, length).value_or(nearest);
}

std::optional<Crossing> Collider::crossing(const Vector3& start, const Vector3& end) const {
  std::optional<Crossing> met = geometry_->first_crossing(to_local(start_pose_, start), to_local(end_pose_, end));
  if (!met || start_pose_.orientation.coeffs() == end_pose_.orientation.coeffs()) return met;
  const SurfacePoint there = geometry_->closest(to_local(end_pose_, end));
  if (!same_side(start_pose_, met->normal, end_pose_, there.normal)) return met;
  if (there.distance >= 0) {
    if (only_turns_past(*geometry_, start_pose_, end_pose_, start, end)) met.reset();
  } else if (turns_far() && needs_new_plane(met->normal, there.normal)) {
    met->point = there.point;
    met->normal = there.normal;
  }
  return met;
}

bool Collider::turns_far() const {
  return std::abs(start_pose_.orientation.dot(end_pose_.orientation)) < kSweptHalfTurn;
}

bool Collider::needs_new_plane(const Vector3& before, const Vector3& now) { return !(now.dot(before) > kSweptTurn); }

// Whether a point that moves from `start` to `end` in the world is never inside the object. Both ends are outside.
// Example: a ball that spins beside a point does not touch it.
bool Collider::only_turns_past(const ShapeGeometry& geometry, const Pose& from, const Pose& to, const Vector3& start,
                               const Vector3& end) {
  const Vector3 turn = rotation_log(to.orientation * from.orientation.conjugate());
  if (turn.isZero(0)) return false;
  if (geometry.first_crossing(to_local(from, start), to_local({to.position, from.orientation}, end))) return false;
  for (int k = 1; k < kArcPoints; ++k) {
    const double part = static_cast<double>(k) / kArcPoints;
    const Pose between = increment(from, part * (to.position - from.position), part * turn);
    if (geometry.signed_distance(to_local(between, start + part * (end - start))) < 0) return false;
  }
  return true;
}

void Collider::add_pattern(const ContactPoints& points, BlockPattern& pattern) const {
  if (!can_move_) return;
  pattern.add(block_ + 1, block_);
  for (int i = 0; i < points.size(); ++i) {
    for (const std::int32_t node : points.nodes(i)) {
      pattern.add(block_, node);
      pattern.add(block_ + 1, node);
    }
  }
}

void Collider::bind(const ContactPoints& points, const PointBlocks& blocks, const BlockMatrix& matrix) {
  if (!can_move_) return;
  translation_ = matrix.find(block_, block_);
  rotation_translation_ = matrix.find(block_ + 1, block_);
  rotation_ = matrix.find(block_ + 1, block_ + 1);
  node_blocks_.clear();
  node_blocks_.reserve(blocks.node_count());
  for (int i = 0; i < points.size(); ++i) {
    for (const std::int32_t node : points.nodes(i))
      node_blocks_.push_back({matrix.find(block_, node), matrix.find(block_ + 1, node)});
  }
}

void Collider::scatter_hessian(const ContactPoints& points, const PointBlocks& blocks, int point, const Vector3& lever,
                               const Vector3& y, const Matrix3& stiffness, bool exact, BlockMatrix& hessian) const {
  blocks.add_hessian(point, stiffness, hessian);
  if (is_fixed()) return;
  // R e changes by (point) - (translation) + [lever]x (rotation).
  const Matrix3 turn = skew(lever);
  Matrix3 point_rotation = stiffness * turn;
  Matrix3 rotation = turn.transpose() * point_rotation;
  if (exact) {
    point_rotation -= skew(y);
    rotation += rotated_arm_second_derivative(lever, y);
  }
  const ContactPoint& p = points[point];
  const NodeBlocks* node = node_blocks_.data() + blocks.first_node(point);
  if (p.node_count == 1) {
    hessian.add(node->translation, -stiffness);
    hessian.add(node->rotation, point_rotation.transpose());
  } else {
    for (std::size_t k = 0; k < static_cast<std::size_t>(p.node_count); ++k, ++node) {
      hessian.add(node->translation, -p.weights[k] * stiffness);
      hessian.add(node->rotation, p.weights[k] * point_rotation.transpose());
    }
  }
  hessian.add(translation_, stiffness);
  hessian.add(rotation_translation_, -point_rotation.transpose());
  hessian.add(rotation_, rotation);
}

}  // namespace softhand
