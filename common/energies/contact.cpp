#include "energies/contact.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "energies/coulomb.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kExitSpeed = 1.0;      // m/s, of the anchor of a node that started inside
constexpr double kTeleport = 0.25;      // m; an object that moved farther than this between two steps was teleported
constexpr double kSmoothTurn = 0.94;    // cosine of 20 degrees; a normal that turns more in a step has met an edge
constexpr double kOffSurface = 1e-12;   // m; an anchor nearer to the surface than this lies on it
constexpr double kSamePlace = 1e-9;     // m; an object that moved less than this between two steps has not jumped
constexpr double kLittleMotion = 1e-6;  // m per step; less than the stretch of the friction springs
constexpr double kLookAhead = 2;        // steps
constexpr double kTouchMargin = 5e-4;   // m
constexpr int kArcPoints = 8;           // the arc of a node around a turning object is sampled in this many pieces
// Cosine. A contact hooks if it pushes a node away from its bone at a smaller angle than this. At an edge, the contacts
// of a finger push sideways.
constexpr double kAwayFromBone = 0.8;
constexpr double kSweptTurn = 0.996;      // cosine of 5 degrees; a surface that turns farther needs a new plane
constexpr double kSweptHalfTurn = 0.999;  // cosine of half that angle

std::vector<std::int32_t> skin_of(const HandModel& hand) {
  std::vector<std::int32_t> nodes;
  for (const auto& triangle : hand.surface) nodes.insert(nodes.end(), triangle.begin(), triangle.end());
  std::sort(nodes.begin(), nodes.end());
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  return nodes;
}

std::vector<std::uint8_t> bodies_of(const HandModel& hand, const std::vector<std::int32_t>& nodes) {
  std::vector<std::uint8_t> bodies;
  bodies.reserve(nodes.size());
  for (const std::int32_t node : nodes) bodies.push_back(hand.node_body[static_cast<std::size_t>(node)]);
  return bodies;
}

Vector3 to_local(const Pose& pose, const Vector3& point) {
  return pose.orientation.conjugate() * (point - pose.position);
}

CoulombSpring friction_of(const ContactSet::Anchor& anchor) {
  return {anchor.friction_stiffness, anchor.friction_bound};
}

}  // namespace

ContactSet::ContactSet(const HandModel& hand, std::vector<double> node_masses, double stiffness, int first_body,
                       int moving_slots, int slots)
    : stiffness_(stiffness),
      first_body_(first_body),
      moving_slots_(moving_slots),
      node_count_(hand.node_count()),
      node_masses_(std::move(node_masses)),
      skin_nodes_(skin_of(hand)),
      skin_index_(hand.nodes.size(), -1),
      areas_(skin_nodes_.size(), 0.0),
      bodies_(bodies_of(hand, skin_nodes_)),
      groups_(skin_nodes_, bodies_),
      slots_(static_cast<std::size_t>(slots)),
      has_anchor_(static_cast<std::size_t>(slots) * skin_nodes_.size(), 0),
      node_slots_(static_cast<std::size_t>(moving_slots) * skin_nodes_.size()),
      node_diagonal_(skin_nodes_.size()),
      finger_forces_(6 * static_cast<std::size_t>(slots), 0.0),
      start_positions_(Eigen::Matrix3Xd::Zero(3, hand.node_count())),
      displacements_(Eigen::Matrix3Xd::Zero(3, hand.node_count())) {
  if (!std::isfinite(stiffness) || !(stiffness > 0)) {
    throw std::invalid_argument("contact stiffness is " + std::to_string(stiffness) +
                                " N/m, expected a finite number > 0");
  }
  if (node_masses_.size() != hand.nodes.size()) {
    throw std::invalid_argument("contact: " + std::to_string(node_masses_.size()) + " node masses for " +
                                std::to_string(hand.nodes.size()) + " nodes");
  }
  if (moving_slots < 0 || moving_slots > slots) throw std::invalid_argument("contact: more moving slots than slots");
  for (std::size_t i = 0; i < skin_nodes_.size(); ++i)
    skin_index_[static_cast<std::size_t>(skin_nodes_[i])] = static_cast<std::int32_t>(i);
  double total = 0;
  for (const auto& triangle : hand.surface) {
    const auto corner = [&](std::size_t k) { return hand.nodes[static_cast<std::size_t>(triangle[k])]; };
    const double area = 0.5 * (corner(1) - corner(0)).cross(corner(2) - corner(0)).norm();
    total += area;
    for (const std::int32_t node : triangle)
      areas_[static_cast<std::size_t>(skin_index_[static_cast<std::size_t>(node)])] += area / 3.0;
  }
  const double mean = total / static_cast<double>(std::max<std::size_t>(1, skin_nodes_.size()));
  for (const double area : areas_) weights_.push_back(area / mean);
  // A node between two objects has two anchors. A hand does not fit between more objects than that.
  anchors_.reserve(2 * skin_nodes_.size());
  sorted_.reserve(2 * skin_nodes_.size());
}

std::size_t ContactSet::pair(int slot, std::int32_t node) const {
  return static_cast<std::size_t>(slot) * skin_nodes_.size() +
         static_cast<std::size_t>(skin_index_[static_cast<std::size_t>(node)]);
}

Pose ContactSet::body_pose(int slot, const State& state) const {
  if (at(slot).kind == ContactObject::fixed) return at(slot).end_pose;
  return state.body_poses[static_cast<std::size_t>(first_body_ + slot)];
}

template <typename Ends>
void ContactSet::remove_if(Ends&& ends) {
  std::size_t retained = 0;
  for (std::size_t i = 0; i < anchors_.size(); ++i) {
    if (ends(anchors_[i])) {
      has_anchor_[pair(anchors_[i].slot, anchors_[i].node)] = 0;
      continue;
    }
    if (retained != i) anchors_[retained] = anchors_[i];
    ++retained;
  }
  anchors_.erase(anchors_.begin() + static_cast<std::ptrdiff_t>(retained), anchors_.end());
}

void ContactSet::set_object(int slot, const ShapeGeometry* geometry, double friction, std::uint32_t id,
                            ContactObject kind) {
  if (geometry == nullptr) throw std::invalid_argument("contact: no shape for object " + std::to_string(id));
  if (!std::isfinite(friction) || !(friction >= 0)) {
    throw std::invalid_argument("contact: friction of object " + std::to_string(id) + " is " +
                                std::to_string(friction) + ", expected a finite number >= 0");
  }
  if (kind == ContactObject::moving && slot >= moving_slots_)
    throw std::invalid_argument("contact: slot " + std::to_string(slot) + " cannot move");
  Slot& s = at(slot);
  if (s.geometry != geometry || s.id != id) clear_object(slot);
  s.geometry = geometry;
  s.friction = friction;
  s.id = id;
  // An object that the hand gives back continues at the pose of the world's copy. It did not move there through the
  // hand, so no path is used.
  if (s.kind == ContactObject::moving && kind == ContactObject::fixed) s.seen = false;
  s.kind = kind;
  for (Anchor& anchor : anchors_) {
    if (anchor.slot != slot) continue;
    anchor.friction = friction;
    anchor.friction_stiffness = friction_stiffness(anchor.stiffness, friction);
  }
}

void ContactSet::clear_object(int slot) {
  remove_if([this, slot](const Anchor& anchor) { return anchor.slot == slot && clear(anchor); });
  Slot& s = at(slot);
  s.geometry = nullptr;
  s.seen = false;
  s.wrench = {};
  s.count = 0;
}

void ContactSet::reset() {
  remove_if([this](const Anchor& anchor) { return clear(anchor); });
  for (Slot& s : slots_) {
    s.seen = false;
    s.wrench = {};
    s.count = 0;
  }
}

bool ContactSet::hooks(const Anchor& anchor, const State& state, const Eigen::Matrix3Xd& bones) const {
  return anchor.normal.dot(to_local(body_pose(anchor.slot, state), bones.col(anchor.node)) - anchor.anchor) < 0;
}

void ContactSet::mark_hooked(const State& state, const Eigen::Matrix3Xd& bones, std::span<std::uint8_t> hooked) const {
  std::fill(hooked.begin(), hooked.end(), std::uint8_t{0});
  for (const Anchor& anchor : anchors_) {
    if (anchor.saved_recess > 0) continue;  // the node started inside and moves out
    const Vector3 bone = to_local(body_pose(anchor.slot, state), bones.col(anchor.node));
    const Vector3 way = bone - anchor.anchor;
    if (anchor.normal.dot(way) > -kAwayFromBone * way.norm() || at(anchor.slot).geometry->signed_distance(bone) < 0)
      continue;
    hooked[static_cast<std::size_t>(anchor.node)] = 1;
  }
}

Vector3 ContactSet::stopped(const State& state, std::int32_t node, const Vector3& bone, const Vector3& to) const {
  Vector3 end = to;
  if (skin_index_[static_cast<std::size_t>(node)] < 0) return end;
  for (int slot = 0; slot < static_cast<int>(slots_.size()); ++slot) {
    const Slot& s = at(slot);
    if (s.geometry == nullptr) continue;
    const Pose& pose = state.body_poses[static_cast<std::size_t>(first_body_ + slot)];
    if ((end - pose.position).norm() > s.geometry->bounding_radius() + (end - bone).norm()) continue;
    if (const auto crossing = s.geometry->first_crossing(to_local(pose, bone), to_local(pose, end)))
      end = pose * crossing->point;
  }
  return end;
}

bool ContactSet::may_touch(int slot, const State& state, double time_step) {
  const Slot& s = at(slot);
  if (s.geometry == nullptr) return false;
  const std::size_t body = static_cast<std::size_t>(first_body_ + slot);
  const Pose& start = state.body_poses[body];
  const Pose end = advanced(start, state.body_velocities[body], kLookAhead * time_step);
  groups_.update(state.node_positions, state.node_velocities, kLookAhead * time_step);
  bool may = false;
  groups_.for_each_near(*s.geometry, start, reach(s, start, end) + kTouchMargin, [&](std::int32_t node) {
    if (may) return;
    const Vector3 position = state.node_positions.col(node);
    const Vector3 now = to_local(start, position);
    const Vector3 next = to_local(end, position + kLookAhead * time_step * state.node_velocities.col(node));
    ++queries_;
    may = s.geometry->signed_distance(now) <= (next - now).norm() + kTouchMargin;
  });
  return may;
}

double ContactSet::stored_energy(std::span<const std::uint8_t> nodes) const {
  double energy = 0;
  for (const Anchor& anchor : anchors_) {
    if (nodes[static_cast<std::size_t>(anchor.node)] != 0) energy += anchor.normal_energy + anchor.friction_energy;
  }
  return energy;
}

double ContactSet::stored_energy_at(const State& state, std::span<const std::uint8_t> nodes,
                                    const Eigen::Matrix3Xd& bones) const {
  double energy = 0;
  for (const Anchor& anchor : anchors_) {
    if (nodes[static_cast<std::size_t>(anchor.node)] == 0 || hooks(anchor, state, bones)) continue;
    const Offset o = offset(anchor, state);
    energy += normal_energy(anchor, o.depth) + 0.5 * anchor.friction_stiffness * o.stretch.squaredNorm();
  }
  for (int slot = 0; slot < static_cast<int>(slots_.size()); ++slot) {
    const Slot& s = at(slot);
    if (s.geometry == nullptr) continue;
    const Pose& pose = state.body_poses[static_cast<std::size_t>(first_body_ + slot)];
    for (std::size_t i = 0; i < skin_nodes_.size(); ++i) {
      if (nodes[static_cast<std::size_t>(skin_nodes_[i])] == 0) continue;
      const Vector3 point = state.node_positions.col(skin_nodes_[i]), bone = bones.col(skin_nodes_[i]);
      const double radius = s.geometry->bounding_radius();
      // If a bone is inside an object, its tissue belongs outside, but no side of the object is the right one.
      if ((bone - pose.position).norm() <= radius && s.geometry->signed_distance(to_local(pose, bone)) < 0)
        return std::numeric_limits<double>::infinity();
      if ((point - pose.position).norm() > radius) continue;
      const double sunk = std::min(0.0, s.geometry->signed_distance(to_local(pose, point)));
      energy += 0.5 * stiffness_ * weights_[i] * sunk * sunk;
    }
  }
  return energy;
}

void ContactSet::release(std::span<const std::uint8_t> nodes) {
  remove_if([this, nodes](const Anchor& anchor) {
    return nodes[static_cast<std::size_t>(anchor.node)] != 0 && clear(anchor);
  });
}

ContactSet::Anchor* ContactSet::create(int slot, std::int32_t node, const Vector3& point, const Vector3& normal) {
  if (anchors_.size() == anchors_.capacity()) {
    ++dropped_;
    return nullptr;
  }
  Anchor anchor;
  anchor.node = node;
  anchor.slot = slot;
  anchor.anchor = anchor.saved_anchor = point;
  anchor.normal = anchor.saved_normal = normal;
  anchor.stiffness = stiffness_ * weights_[static_cast<std::size_t>(skin_index_[static_cast<std::size_t>(node)])];
  anchor.friction = at(slot).friction;
  anchor.friction_stiffness = friction_stiffness(anchor.stiffness, anchor.friction);
  has_anchor_[pair(slot, node)] = 1;
  anchors_.push_back(anchor);
  return &anchors_.back();
}

// Upper bound of the movement of any point of the object near the hand between two poses.
double ContactSet::reach(const Slot& slot, const Pose& from, const Pose& to) const {
  const double lever = std::min(slot.geometry->bounding_radius() + 0.1, groups_.farthest(from.position));
  return (to.position - from.position).norm() +
         1.01 * rotation_log(to.orientation * from.orientation.conjugate()).norm() * lever;
}

void ContactSet::begin_step(const State& state, double time_step) {
  if (std::exchange(in_step_, true)) remove_if([](const Anchor& anchor) { return !anchor.known; });
  time_step_ = time_step;
  start_positions_ = state.node_positions;
  bool any = false;
  for (int slot = 0; slot < static_cast<int>(slots_.size()); ++slot) {
    Slot& s = at(slot);
    if (s.geometry == nullptr) continue;
    if (!any) groups_.update(state.node_positions, state.node_velocities, time_step);
    any = true;
    const std::size_t body = static_cast<std::size_t>(first_body_ + slot);
    s.start_pose = state.body_poses[body];
    s.end_pose = advanced(s.start_pose, state.body_velocities[body], time_step);
    if (s.seen && (s.start_pose.position - s.last_pose.position).norm() > kTeleport) {
      remove_if([this, slot](const Anchor& anchor) { return anchor.slot == slot && clear(anchor); });
      s.seen = false;
    }
    s.jumped = s.seen && reach(s, s.last_pose, s.start_pose) > kSamePlace;
    find_candidates(slot, state);
  }
  for (Anchor& anchor : anchors_) {
    const Vector3 position = state.node_positions.col(anchor.node);
    begin_anchor(anchor, position, position + time_step * state.node_velocities.col(anchor.node));
  }
}

bool ContactSet::revise(const State& state) {
  bool changed = false;
  for (Anchor& anchor : anchors_) {
    if (!anchor.two_sided) continue;
    anchor.two_sided = false;
    if (!(offset(anchor, state).depth > 0)) continue;
    anchor.friction_bound = 0;
    changed = true;
  }
  find_crossed(state, [&](Anchor& anchor) {
    anchor.fresh = true;
    begin_anchor(anchor, start_positions_.col(anchor.node), state.node_positions.col(anchor.node));
    changed = true;
  });
  return changed;
}

void ContactSet::find_candidates(int slot, const State& state) {
  const Slot& s = at(slot);
  const double margin = reach(s, s.start_pose, s.end_pose) + (s.jumped ? reach(s, s.last_pose, s.start_pose) : 0.0);
  groups_.for_each_near(*s.geometry, s.start_pose, margin, [&](std::int32_t node) {
    if (has_anchor_[pair(slot, node)]) return;
    const Vector3 position = state.node_positions.col(node);
    const Vector3 now = to_local(s.start_pose, position);
    const Vector3 next = to_local(s.end_pose, position + time_step_ * state.node_velocities.col(node));
    const Vector3 before = s.jumped ? to_local(s.last_pose, position) : now;
    ++queries_;
    const SurfacePoint nearest = s.geometry->closest(now);
    if (nearest.distance > std::max((next - now).norm(), (now - before).norm())) return;
    if (s.jumped) {
      if (const auto crossing = s.geometry->first_crossing(before, now)) {
        // If the object turned under a node that stays outside, only the chord of the node's path crosses the surface.
        // A node that is now behind the object was passed by the surface.
        if (nearest.distance < 0 || !same_side(s.last_pose, crossing->normal, s.start_pose, nearest.normal)) {
          create(slot, node, crossing->point, crossing->normal);
          return;
        }
      }
    }
    if (nearest.distance < 0) {
      SurfacePoint surface = nearest;
      Vector3 inside = now;
      if (turns_far(s.start_pose, s.end_pose)) {
        const SurfacePoint there = s.geometry->closest(next);
        if (there.distance < 0 && same_side(s.start_pose, nearest.normal, s.end_pose, there.normal)) {
          surface = there;
          inside = next;
        }
      }
      if (Anchor* anchor = create(slot, node, inside, surface.normal)) anchor->saved_recess = -surface.distance;
    } else if (const auto met = meeting(s, position, position + time_step_ * state.node_velocities.col(node))) {
      if (Anchor* anchor = create(slot, node, met->point, met->normal)) anchor->fresh = anchor->two_sided = true;
    }
  });
}

// `start`: of the node's path in this step, world. `end`: its predicted end.
void ContactSet::begin_anchor(Anchor& anchor, const Vector3& start, const Vector3& end) {
  anchor.anchor = anchor.saved_anchor;
  anchor.normal = anchor.saved_normal;
  anchor.recess = anchor.saved_recess;
  anchor.sliding = anchor.saved_sliding;
  anchor.ahead = false;
  const double out = std::min(anchor.recess, kExitSpeed * time_step_);
  anchor.anchor += out * anchor.normal;
  anchor.recess -= out;

  const Slot& s = at(anchor.slot);
  const Vector3 before = to_local(pose_before(anchor), start);
  const double depth_before = anchor.normal.dot(before - anchor.anchor);
  const double force_before = anchor.stiffness * std::max(0.0, -depth_before);
  const bool swept = sweep(anchor, start, end, anchor.friction * force_before);
  const auto tangential = [&anchor](const Vector3& v) { return Vector3(v - anchor.normal.dot(v) * anchor.normal); };
  const Vector3 next = to_local(s.end_pose, end) - anchor.anchor;
  // A swept plane is at the predicted end of the node's path, so it gives no stretch at the start.
  const Vector3 now = swept ? next : Vector3(to_local(s.start_pose, start) - anchor.anchor);
  Vector3 stretch = tangential(now);
  const Vector3 movement = tangential(next - now);
  if (anchor.fresh || anchor.missed) {
    const double depth = std::max(0.0, -anchor.normal.dot(next));
    const double inertia = node_masses_[static_cast<std::size_t>(anchor.node)] / (time_step_ * time_step_);
    anchor.friction_bound = anchor.friction * anchor.stiffness * depth * inertia / (inertia + anchor.stiffness);
    anchor.predicted_secant = anchor.friction_bound > 0 ? friction_of(anchor).secant(movement.norm()) : 0.0;
    anchor.stretch_origin = anchor.fresh ? stretch : Vector3(Vector3::Zero());
  } else {
    const double force = swept ? force_before : anchor.stiffness * std::max(0.0, -anchor.normal.dot(now));
    anchor.friction_bound = anchor.friction * force;
    anchor.stretch_origin.setZero();
  }
  anchor.sliding = anchor.sliding && stretch.dot(movement) > 0;
  if (anchor.sliding && !(anchor.recess > 0)) {
    ++queries_;
    const SurfacePoint there = s.geometry->closest(anchor.anchor + movement);
    if (std::abs(there.distance) > kOffSurface && there.normal.dot(anchor.normal) > kSmoothTurn) {
      // The stretch follows the surface: it keeps its length and is rotated into the new plane.
      const Vector3 turned = Quaternion::FromTwoVectors(anchor.normal, there.normal) * stretch;
      const Vector3 from_there = now + anchor.anchor - there.point;
      anchor.anchor = there.point;
      anchor.normal = there.normal;
      anchor.stretch_origin = tangential(from_there) - turned;
      anchor.ahead = true;
      stretch = tangential(from_there);
    }
  }
  // A minimiser begins with the node at its start pose and a fixed object at its end pose. The Hessian of friction
  // there is a choice. If the object moves little, the choice uses the predicted path of the node. If it moves far, the
  // choice uses the actual stretch.
  anchor.stretch_start = stretch - anchor.stretch_origin;
  const Pose& pose = s.kind == ContactObject::fixed ? s.end_pose : s.start_pose;
  const Vector3 first = tangential(to_local(pose, start) - anchor.anchor) - anchor.stretch_origin;
  if ((first - anchor.stretch_start).norm() < kLittleMotion) anchor.stretch_start = first;
  const Vector3 from_anchor = before - anchor.anchor;
  anchor.start_energy = normal_energy(anchor, swept ? depth_before : anchor.normal.dot(from_anchor));
  const double elastic_stretch =
      anchor.friction_stiffness > 0 ? std::sqrt(2.0 * anchor.friction_energy / anchor.friction_stiffness) : 0.0;
  anchor.start_excess =
      swept ? 0.0 : std::max(0.0, (tangential(from_anchor) - anchor.stretch_origin).norm() - elastic_stretch);
}

// The object moved from pose `from` to pose `to`. Returns whether the normal `now` points to the same side in the world
// as the normal `before` did. Otherwise `now` belongs to the far side of the object. Normals are in the object's frame.
bool ContactSet::same_side(const Pose& from, const Vector3& before, const Pose& to, const Vector3& now) {
  return (from.orientation * before).dot(to.orientation * now) > 0;
}

// Whether an object turns so far that a plane that rotates with it is no longer the surface under a node.
bool ContactSet::turns_far(const Pose& from, const Pose& to) {
  return std::abs(from.orientation.dot(to.orientation)) < kSweptHalfTurn;
}

// The point where the object's surface meets a node that moves from `start` to `end` in the world during this step. If
// the object turns, the node's path in the object's frame is an arc, and the crossing is that of its chord.
std::optional<Crossing> ContactSet::meeting(const Slot& s, const Vector3& start, const Vector3& end) {
  std::optional<Crossing> met = s.geometry->first_crossing(to_local(s.start_pose, start), to_local(s.end_pose, end));
  if (!met || s.start_pose.orientation.coeffs() == s.end_pose.orientation.coeffs()) return met;
  const SurfacePoint there = s.geometry->closest(to_local(s.end_pose, end));
  if (!same_side(s.start_pose, met->normal, s.end_pose, there.normal)) return met;
  if (there.distance >= 0) {
    if (only_turns_past(*s.geometry, s.start_pose, s.end_pose, start, end)) met.reset();
  } else if (turns_far(s.start_pose, s.end_pose) && there.normal.dot(met->normal) < kSweptTurn) {
    met->point = there.point;
    met->normal = there.normal;
  }
  return met;
}

// Whether a node that moves from `start` to `end` in the world is never inside the object. Both ends are outside.
// Example: a ball that spins beside a node does not touch it.
bool ContactSet::only_turns_past(const ShapeGeometry& geometry, const Pose& from, const Pose& to, const Vector3& start,
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

// The pose from which the motion of the anchor's object counts. For a known anchor this includes the motion between the
// steps.
const Pose& ContactSet::pose_before(const Anchor& anchor) const {
  const Slot& s = at(anchor.slot);
  return anchor.known && s.jumped ? s.last_pose : s.start_pose;
}

// An object with prescribed motion may move anchor and plane away from under the node. Example: a drum that turns by 64
// degrees in a step. Such a contact slides. It continues in the plane of the surface at the node's predicted position.
// Its stretch is the length of surface that passes the node. `start`, `end`: of the node, world. `limit`: mu f_n, N.
// Returns false if the contact sticks or keeps its plane.
bool ContactSet::sweep(Anchor& anchor, const Vector3& start, const Vector3& end, double limit) {
  const Slot& s = at(anchor.slot);
  const bool turns =
      s.kind == ContactObject::fixed && s.start_pose.orientation.coeffs() != s.end_pose.orientation.coeffs();
  if (!(s.jumped || turns) || anchor.fresh || anchor.recess > 0) return false;
  const Pose& before = pose_before(anchor);
  const Vector3 there = to_local(s.end_pose, end);
  ++queries_;
  const SurfacePoint nearest = s.geometry->closest(there);
  if (nearest.normal.dot(anchor.normal) > kSweptTurn) return false;
  if (!same_side(before, anchor.normal, s.end_pose, nearest.normal)) return false;
  if (limit > 0 && anchor.friction_stiffness * (nearest.point - anchor.anchor).norm() <= limit) return false;
  const Vector3 moved = there - to_local(before, start);
  anchor.anchor = nearest.point - (moved - nearest.normal.dot(moved) * nearest.normal);
  anchor.normal = nearest.normal;
  return true;
}

void ContactSet::end_step(const State& state) {
  in_step_ = false;
  normal_flow_ = {.work = -std::exchange(cleared_normal_, 0.0)};
  friction_flow_ = {.work = -std::exchange(cleared_friction_, 0.0)};
  for (int slot = 0; slot < static_cast<int>(slots_.size()); ++slot) {
    Slot& s = at(slot);
    s.wrench = {};
    s.count = 0;
    if (s.geometry == nullptr) continue;
    if (s.kind == ContactObject::fixed) continue;
    s.end_pose = body_pose(slot, state);
    s.moved = s.end_pose.position - s.start_pose.position;
    s.turned = rotation_log(s.end_pose.orientation * s.start_pose.orientation.conjugate());
  }
  for (Anchor& anchor : anchors_) {
    const Offset o = offset(anchor, state);
    const double pressure = anchor.two_sided || o.depth < 0 ? -anchor.stiffness * o.depth : 0.0;
    const Vector3 push = pressure * o.normal;
    const Vector3 drag = -friction_of(anchor).secant(o.stretch.norm()) * o.stretch;
    anchor.force = push + drag;
    Slot& s = at(anchor.slot);
    s.wrench.force -= anchor.force;
    s.wrench.torque -= o.lever.cross(anchor.force);
    account(anchor, o, push, drag, state);
    slide(anchor, drag.norm(), state);
  }
  remove_if([this, &state](Anchor& anchor) {
    const Offset o = offset(anchor, state);
    settle(anchor, o);
    const double depth = o.depth;
    if (depth > 0 && anchor.recess > 0) {  // the node moves out faster than the anchor: the anchor follows
      const double out = std::min(depth, anchor.recess);
      anchor.anchor += out * anchor.normal;
      anchor.recess -= out;
      return depth > out;
    }
    return depth >= 0 && !(anchor.recess > 0);
  });

  find_crossed(state, [&](Anchor& anchor) {
    anchor.missed = true;
    settle(anchor, offset(anchor, state));
  });
  for (Slot& s : slots_) {
    if (s.geometry == nullptr) continue;
    s.last_pose = s.end_pose;
    s.seen = true;
  }
  for (Anchor& anchor : anchors_) {
    anchor.saved_anchor = anchor.anchor;
    anchor.saved_normal = anchor.normal;
    anchor.saved_recess = anchor.recess;
    anchor.saved_sliding = anchor.sliding;
    anchor.known = true;
    normal_flow_.stored += anchor.normal_energy;
    friction_flow_.stored += anchor.friction_energy;
    ++at(anchor.slot).count;
  }
}

// Creates an anchor for each node that crossed an object's surface between the step's start and `state`, and calls
// found(anchor).
template <typename Found>
void ContactSet::find_crossed(const State& state, Found&& found) {
  bool any = false;
  for (int slot = 0; slot < static_cast<int>(slots_.size()); ++slot) {
    Slot& s = at(slot);
    if (s.geometry == nullptr) continue;
    if (!std::exchange(any, true)) {
      displacements_ = state.node_positions - start_positions_;
      groups_.update(start_positions_, displacements_, 1.0);
    }
    s.end_pose = body_pose(slot, state);
    groups_.for_each_near(*s.geometry, s.end_pose, reach(s, s.start_pose, s.end_pose), [&](std::int32_t node) {
      if (has_anchor_[pair(slot, node)]) return;
      const Vector3 start = to_local(s.start_pose, start_positions_.col(node));
      const Vector3 end = to_local(s.end_pose, state.node_positions.col(node));
      ++queries_;
      if (s.geometry->signed_distance(end) > (end - start).norm()) return;
      if (const auto met = meeting(s, start_positions_.col(node), state.node_positions.col(node))) {
        if (Anchor* anchor = create(slot, node, met->point, met->normal)) found(*anchor);
      }
    });
  }
}

double ContactSet::normal_energy(const Anchor& anchor, double depth) const {
  const double sunk = std::min(depth, 0.0);
  return 0.5 * anchor.stiffness * sunk * sunk;
}

// Counts the energy of a contact that is removed. Always returns true.
bool ContactSet::clear(const Anchor& anchor) {
  cleared_normal_ += anchor.normal_energy;
  cleared_friction_ += anchor.friction_energy;
  return true;
}

// Adds the contact to the energy ledger, without the effect of sliding. `push` and `drag` act on the node at the step's
// end.
void ContactSet::account(Anchor& anchor, const Offset& end, const Vector3& push, const Vector3& drag,
                         const State& state) {
  const Slot& s = at(anchor.slot);
  const Vector3 node_moved = state.node_positions.col(anchor.node) - start_positions_.col(anchor.node);
  // Motion from outside: between the steps, and within this step if the motion is prescribed.
  const bool fixed = s.kind == ContactObject::fixed;
  const Vector3 point = s.end_pose.orientation.conjugate() * end.lever;
  const Vector3 external_motion = (fixed ? s.end_pose : s.start_pose) * point - pose_before(anchor) * point;
  normal_flow_.work += push.dot(external_motion);
  friction_flow_.work += drag.dot(external_motion);
  Vector3 object_moved = external_motion;
  if (!fixed) object_moved += s.moved + s.turned.cross(end.lever);  // to first order, as in the solver's increment
  const Vector3 moved = node_moved - object_moved;
  const double energy = normal_energy(anchor, end.depth);
  normal_flow_.anchoring += anchor.start_energy - anchor.normal_energy;
  normal_flow_.integrator += anchor.start_energy - energy - push.dot(moved);
  friction_flow_.integrator += anchor.friction_energy - drag.dot(moved);
  anchor.normal_energy = energy;
}

// Computes the energy of the contact with the anchor and plane that it has between steps. The difference to the energy
// before is the effect of moving the anchor and plane.
void ContactSet::settle(Anchor& anchor, const Offset& offset) {
  const double normal = normal_energy(anchor, offset.depth);
  double friction = 0;
  if (anchor.friction_stiffness > 0) {
    const double limit = anchor.friction * anchor.stiffness * std::max(0.0, -offset.depth);
    const double elastic_stretch = std::min(offset.stretch.norm(), limit / anchor.friction_stiffness);
    friction = 0.5 * anchor.friction_stiffness * elastic_stretch * elastic_stretch;
  }
  normal_flow_.anchoring += normal - anchor.normal_energy;
  friction_flow_.anchoring += friction - anchor.friction_energy;
  anchor.normal_energy = normal;
  anchor.friction_energy = friction;
}

// A sliding anchor follows the node over the surface until |f_t| = mu |f_n|. A sticking anchor does not move. `drag`:
// |f_t| of the step, N. Its work over the sliding distance is heat.
void ContactSet::slide(Anchor& anchor, double drag, const State& state) {
  // The true stretch of a fresh anchor starts at the crossing. For an anchor ahead, it is the stretch of the energy.
  const bool ahead = std::exchange(anchor.ahead, false);
  if (!ahead) anchor.stretch_origin.setZero();
  anchor.fresh = anchor.two_sided = anchor.missed = false;
  const Offset o = offset(anchor, state);
  const double limit = anchor.friction * anchor.stiffness * std::max(0.0, -o.depth);
  const double stretch = o.stretch.norm();
  const double distance = o.depth < 0 ? friction_of(anchor).slide(stretch, limit) : 0.0;
  // A contact that ends stores no energy.
  const double elastic_stretch =
      anchor.friction_stiffness > 0 ? std::min(stretch - distance, limit / anchor.friction_stiffness) : 0.0;
  const double heat = drag * std::max(0.0, stretch - elastic_stretch - anchor.start_excess);
  anchor.friction_energy = 0.5 * anchor.friction_stiffness * elastic_stretch * elastic_stretch;
  friction_flow_.friction += heat;
  friction_flow_.integrator -= anchor.friction_energy + heat;
  dissipated_ += heat;
  anchor.sliding = distance > 0;
  anchor.slip_speed = distance / time_step_;
  const Vector3 origin = std::exchange(anchor.stretch_origin, Vector3::Zero());
  if (!anchor.sliding && !ahead) return;
  const Pose pose = body_pose(anchor.slot, state);
  Vector3 movement = origin;
  if (anchor.sliding) movement += distance / stretch * (pose.orientation.conjugate() * o.stretch);
  ++queries_;
  const SurfacePoint nearest =
      at(anchor.slot).geometry->closest(anchor.anchor + anchor.recess * anchor.normal + movement);
  if (std::abs(nearest.distance) > kOffSurface) {  // curved, or past an edge
    anchor.normal = nearest.normal;
    anchor.anchor = nearest.point - anchor.recess * anchor.normal;
  } else {
    anchor.anchor += movement;
  }
}

ContactSet::Offset ContactSet::offset(const Anchor& anchor, const State& state) const {
  const Pose pose = body_pose(anchor.slot, state);
  Offset result;
  result.lever = state.node_positions.col(anchor.node) - pose.position;
  const Vector3 e = pose.orientation.conjugate() * result.lever - anchor.anchor;
  result.depth = anchor.normal.dot(e);
  const Vector3 stretch = e - result.depth * anchor.normal - anchor.stretch_origin;
  result.moved = (stretch - anchor.stretch_start).norm();
  result.offset = pose.orientation * e;
  result.normal = pose.orientation * anchor.normal;
  result.stretch = pose.orientation * stretch;
  return result;
}

void ContactSet::add_pattern(BlockPattern& pattern) const {
  const int bodies = node_count_ + 2 * first_body_;
  for (int slot = 0; slot < moving_slots_; ++slot) {
    const int translation = bodies + 2 * slot;
    pattern.add(translation + 1, translation);
    for (const std::int32_t node : skin_nodes_) {
      pattern.add(translation, node);
      pattern.add(translation + 1, node);
    }
  }
}

void ContactSet::bind(const BlockMatrix& matrix) {
  const int bodies = node_count_ + 2 * first_body_;
  for (std::size_t i = 0; i < skin_nodes_.size(); ++i) node_diagonal_[i] = matrix.find(skin_nodes_[i], skin_nodes_[i]);
  for (int slot = 0; slot < moving_slots_; ++slot) {
    const int translation = bodies + 2 * slot;
    Slot& s = at(slot);
    s.translation = matrix.find(translation, translation);
    s.rotation_translation = matrix.find(translation + 1, translation);
    s.rotation = matrix.find(translation + 1, translation + 1);
    for (const std::int32_t node : skin_nodes_) {
      node_slots_[pair(slot, node)] = {matrix.find(translation, node), matrix.find(translation + 1, node)};
    }
  }
}

void ContactSet::scatter_gradient(const Anchor& anchor, const Vector3& lever, const Vector3& y,
                                  VectorX& gradient) const {
  gradient.segment<3>(3 * anchor.node) += y;
  if (at(anchor.slot).kind == ContactObject::fixed) return;
  const int translation = node_count_ + 2 * (first_body_ + anchor.slot);
  gradient.segment<3>(3 * translation) -= y;
  gradient.segment<3>(3 * translation + 3) -= lever.cross(y);
}

void ContactSet::scatter_hessian(const Anchor& anchor, const Vector3& lever, const Vector3& y, const Matrix3& stiffness,
                                 BlockMatrix& hessian, Curvature curvature) const {
  hessian.add(node_diagonal_[static_cast<std::size_t>(skin_index_[static_cast<std::size_t>(anchor.node)])], stiffness);
  const Slot& s = at(anchor.slot);
  if (s.kind == ContactObject::fixed) return;
  // R e changes by (node) - (translation) + [lever]x (rotation).
  const Matrix3 turn = skew(lever);
  Matrix3 node_rotation = stiffness * turn;
  Matrix3 rotation = turn.transpose() * node_rotation;
  if (curvature == Curvature::exact) {
    node_rotation -= skew(y);
    rotation += rotated_arm_second_derivative(lever, y);
  }
  const NodeSlots& node = node_slots_[pair(anchor.slot, anchor.node)];
  hessian.add(node.translation, -stiffness);
  hessian.add(node.rotation, node_rotation.transpose());
  hessian.add(s.translation, stiffness);
  hessian.add(s.rotation_translation, -node_rotation.transpose());
  hessian.add(s.rotation, rotation);
}

double ContactSet::penetration_quantile(const State& state, double fraction) {
  if (anchors_.empty()) return 0;
  sorted_.clear();
  for (const Anchor& anchor : anchors_) sorted_.push_back(std::max(0.0, -offset(anchor, state).depth));
  const auto nth = sorted_.begin() + static_cast<std::ptrdiff_t>(std::clamp(fraction, 0.0, 1.0) *
                                                                 static_cast<double>(sorted_.size() - 1));
  std::nth_element(sorted_.begin(), nth, sorted_.end());
  return *nth;
}

void ContactSet::write(const State& state, Contacts& out) {
  struct Sums {
    Vector3 force = Vector3::Zero(), centre = Vector3::Zero(), normal = Vector3::Zero();
    double pressure = 0, slip = 0, area = 0;
    std::uint32_t count = 0;
  };
  std::array<Sums, 6> sums;
  std::fill(finger_forces_.begin(), finger_forces_.end(), 0.0);
  out.contacts.clear();
  out.dropped = 0;
  for (const Anchor& anchor : anchors_) {
    const Offset o = offset(anchor, state);
    const std::size_t skin = static_cast<std::size_t>(skin_index_[static_cast<std::size_t>(anchor.node)]);
    const Finger finger = finger_of(static_cast<Body>(bodies_[skin]));
    const Vector3 position = state.node_positions.col(anchor.node);
    Contact contact;
    contact.node = static_cast<std::uint32_t>(anchor.node);
    contact.body = bodies_[skin];
    contact.finger = static_cast<std::uint32_t>(finger);
    contact.object = at(anchor.slot).id;
    contact.flags = anchor.sliding ? 0u : kContactSticking;
    contact.point = to_wire(Vector3(position - o.offset));
    contact.normal = to_wire(o.normal);
    contact.force = to_wire(anchor.force);
    contact.penetration = std::max(0.0, -o.depth);
    contact.area = areas_[skin];
    contact.slip_speed = anchor.slip_speed;
    if (!out.contacts.push_back(contact)) ++out.dropped;

    const double pressure = std::max(0.0, o.normal.dot(anchor.force));
    Sums& sum = sums[static_cast<std::size_t>(finger)];
    sum.force += anchor.force;
    sum.centre += pressure * position;
    sum.normal += pressure * o.normal;
    sum.pressure += pressure;
    sum.slip += pressure * anchor.slip_speed;
    sum.area += areas_[skin];
    ++sum.count;
    // Slightly more than zero, so that an object touched without pressure comes before an object that is not touched.
    finger_forces_[static_cast<std::size_t>(finger) * slots_.size() + static_cast<std::size_t>(anchor.slot)] +=
        pressure + std::numeric_limits<double>::min();
  }
  for (std::size_t f = 0; f < sums.size(); ++f) {
    const Sums& sum = sums[f];
    FingerContact& finger = out.fingers[f];
    finger = {};
    if (sum.count == 0) continue;
    finger.force = to_wire(sum.force);
    finger.area = sum.area;
    finger.contact_count = sum.count;
    if (sum.pressure > 0) {
      finger.centre = to_wire(Vector3(sum.centre / sum.pressure));
      finger.normal = to_wire(Vector3(sum.normal / std::max(sum.normal.norm(), std::numeric_limits<double>::min())));
      finger.slip_speed = sum.slip / sum.pressure;
    }
    const auto first = finger_forces_.begin() + static_cast<std::ptrdiff_t>(f * slots_.size());
    const auto most = std::max_element(first, first + static_cast<std::ptrdiff_t>(slots_.size()));
    finger.object = slots_[static_cast<std::size_t>(most - first)].id;
  }
}

double ContactEnergy::value(const State& state) const {
  double energy = 0;
  for (const ContactSet::Anchor& anchor : contacts_.anchors()) {
    const double depth = contacts_.offset(anchor, state).depth;
    if (anchor.two_sided || depth < 0) energy += 0.5 * anchor.stiffness * depth * depth;
  }
  return energy;
}

double ContactEnergy::add_gradient(const State& state, VectorX& gradient) const {
  double energy = 0;
  for (const ContactSet::Anchor& anchor : contacts_.anchors()) {
    const ContactSet::Offset o = contacts_.offset(anchor, state);
    if (!anchor.two_sided && !(o.depth < 0)) continue;
    energy += 0.5 * anchor.stiffness * o.depth * o.depth;
    contacts_.scatter_gradient(anchor, o.lever, anchor.stiffness * o.depth * o.normal, gradient);
  }
  return energy;
}

void ContactEnergy::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  for (const ContactSet::Anchor& anchor : contacts_.anchors()) {
    const ContactSet::Offset o = contacts_.offset(anchor, state);
    if (!anchor.two_sided && !(o.depth < 0)) continue;
    const Matrix3 stiffness = anchor.stiffness * o.normal * o.normal.transpose();
    contacts_.scatter_hessian(anchor, o.lever, anchor.stiffness * o.depth * o.normal, stiffness, hessian, curvature);
  }
}

}  // namespace softhand
