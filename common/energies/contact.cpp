#include "energies/contact.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kSmoothTurn = 0.94;     // cosine of 20 degrees; a normal that turns more in a step has met an edge
constexpr std::size_t kMostSharp = 256;  // contacts of sharp points
constexpr double kSharpReach = 5e-3;     // m; a sharp point farther than this from the skin does not touch it
constexpr double kLookAhead = 2;         // steps
constexpr double kTouchMargin = 5e-4;    // m
constexpr double kOffSurface = 1e-12;    // m; an anchor nearer to the surface than this lies on it
// Cosine. A contact hooks if it pushes a point away from its bone at a smaller angle than this. At an edge, the
// contacts of a finger push sideways.
constexpr double kAwayFromBone = 0.8;

}  // namespace

ContactSet::ContactSet(const TissueModel& hand, const std::vector<double>& node_masses, double stiffness,
                       int first_body, int moving_slots, int slots)
    : ContactSet(ContactPoints(hand, node_masses), hand.node_count(), stiffness, first_body, moving_slots, slots) {}

// A point between two objects has two anchors. A hand does not fit between more objects than that.
ContactSet::ContactSet(ContactPoints points, int node_count, double stiffness, int first_body, int moving_slots,
                       int slots)
    : stiffness_(stiffness),
      moving_slots_(moving_slots),
      points_(std::move(points)),
      blocks_(points_),
      candidates_(points_, slots),
      has_anchor_(static_cast<std::size_t>(slots) * static_cast<std::size_t>(points_.size()), 0) {
  if (!std::isfinite(stiffness) || !(stiffness > 0)) {
    throw std::invalid_argument("contact stiffness is " + std::to_string(stiffness) +
                                " N/m^3, expected a finite number > 0");
  }
  if (moving_slots < 0 || moving_slots > slots) throw std::invalid_argument("contact: more moving slots than slots");
  for (int slot = 0; slot < slots; ++slot) {
    const int body = first_body + slot;
    slots_.emplace_back(Collider(body, node_count + 2 * body, slot < moving_slots));
  }
  anchors_.reserve(2 * static_cast<std::size_t>(points_.count()) + kMostSharp);
  anchors_before_.reserve(anchors_.capacity());
  saved_.anchors.reserve(anchors_.capacity());
  depths_.reserve(anchors_.capacity());
  saved_.slots.reserve(slots_.size());
}

template <typename Ends>
void ContactSet::remove_if(Ends&& ends) {
  std::size_t retained = 0;
  for (std::size_t i = 0; i < anchors_.size(); ++i) {
    if (ends(anchors_[i])) {
      has_anchor(anchors_[i].slot, anchors_[i].point) = 0;
      continue;
    }
    if (retained != i) anchors_[retained] = anchors_[i];
    ++retained;
  }
  anchors_.erase(anchors_.begin() + static_cast<std::ptrdiff_t>(retained), anchors_.end());
}

void ContactSet::mark_anchors() {
  std::fill(has_anchor_.begin(), has_anchor_.end(), std::uint8_t{0});
  for (const Anchor& anchor : anchors_) {
    has_anchor(anchor.slot, anchor.point) = 1;
    if (anchor.sharp >= 0) points_.place(anchor.point, anchor.weights);
  }
}

// A triangle of the skin has one point of its own.
bool ContactSet::is_taken(int triangle_point) const {
  return std::any_of(anchors_.begin(), anchors_.end(),
                     [triangle_point](const Anchor& anchor) { return anchor.point == triangle_point; });
}

bool ContactSet::has_entered(int slot, int sharp) const {
  return std::any_of(anchors_.begin(), anchors_.end(),
                     [slot, sharp](const Anchor& anchor) { return anchor.slot == slot && anchor.sharp == sharp; });
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
  cancel_step();
  Slot& s = at(slot);
  if (s.collider.geometry() != geometry || s.id != id) clear_object(slot);
  s.collider.set(*geometry, kind);
  s.friction = friction;
  s.id = id;
  for (Anchor& anchor : anchors_) {
    if (anchor.slot == slot) anchor.set_friction(friction);
  }
}

void ContactSet::clear_object(int slot) {
  cancel_step();
  remove_if([this, slot](const Anchor& anchor) { return anchor.slot == slot && clear(anchor); });
  Slot& s = at(slot);
  s.collider.clear();
  s.id = 0;
  s.friction = 0;
  s.wrench = {};
  s.count = 0;
}

void ContactSet::reset() {
  cancel_step();
  remove_if([this](const Anchor& anchor) { return clear(anchor); });
  for (Slot& s : slots_) {
    s.collider.forget_motion();
    s.wrench = {};
    s.count = 0;
  }
}

const ContactSet::Memory& ContactSet::save() const {
  const std::vector<Anchor>& anchors = in_step_ ? anchors_before_ : anchors_;
  saved_.anchors.assign(anchors.begin(), anchors.end());
  saved_.slots.clear();
  for (const Slot& s : slots_)
    saved_.slots.push_back({s.collider.is_set(), s.id, s.friction, s.collider.memory(), s.wrench, s.count});
  saved_.dissipated = dissipated_;
  saved_.cleared_normal = in_step_ ? cleared_normal_before_ : cleared_normal_;
  saved_.cleared_friction = in_step_ ? cleared_friction_before_ : cleared_friction_;
  return saved_;
}

void ContactSet::load(const Memory& memory) {
  const auto refuse = [](const std::string& reason) { throw std::invalid_argument("contact memory: " + reason); };
  if (memory.slots.size() != slots_.size())
    refuse(std::to_string(memory.slots.size()) + " slots, expected " + std::to_string(slots_.size()));
  if (memory.anchors.size() > anchors_.capacity())
    refuse(std::to_string(memory.anchors.size()) + " contacts, expected at most " +
           std::to_string(anchors_.capacity()));
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    const Memory::Slot& from = memory.slots[i];
    const bool is_set = slots_[i].collider.is_set();
    if (from.is_set != is_set || (is_set && from.id != slots_[i].id))
      refuse("slot " + std::to_string(i) + " has another object");
    const ContactObject kind = from.collider.kind;
    if (kind > ContactObject::fixed || (is_set && kind == ContactObject::moving && !slots_[i].collider.can_move()))
      refuse("slot " + std::to_string(i) + " cannot move");
  }
  for (const AnchorMemory& from : memory.anchors) {
    if (from.point < 0 || from.point >= points_.size()) refuse("no point " + std::to_string(from.point));
    if (from.slot < 0 || from.slot >= static_cast<std::int32_t>(slots_.size()) || !at(from.slot).collider.is_set())
      refuse("no object in slot " + std::to_string(from.slot));
    const auto sharp_points = static_cast<int>(at(from.slot).collider.geometry()->sharp_points().size());
    if ((from.sharp >= 0) != (from.point >= points_.count()) || from.sharp >= sharp_points)
      refuse("no sharp point " + std::to_string(from.sharp));
  }
  in_step_ = false;
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    const Memory::Slot& from = memory.slots[i];
    Slot& s = slots_[i];
    s.friction = from.friction;
    s.collider.load(from.collider);
    s.wrench = from.wrench;
    s.count = from.count;
  }
  anchors_.clear();
  for (const AnchorMemory& from : memory.anchors) {
    Anchor anchor{from};
    anchor.known = true;
    anchor.stiffness = stiffness_of(from.point);
    anchor.set_friction(at(from.slot).friction);
    anchors_.push_back(anchor);
  }
  mark_anchors();
  dissipated_ = memory.dissipated;
  cleared_normal_ = memory.cleared_normal;
  cleared_friction_ = memory.cleared_friction;
}

bool ContactSet::hooks(const Anchor& anchor, const State& state, const Eigen::Matrix3Xd& bones) const {
  const Vector3 bone = to_local(at(anchor.slot).collider.pose(state), points_.at(anchor.point, bones));
  return anchor.normal.dot(bone - anchor.anchor) < 0;
}

void ContactSet::mark_hooked(const State& state, const Eigen::Matrix3Xd& bones, std::span<std::uint8_t> hooked) const {
  std::fill(hooked.begin(), hooked.end(), std::uint8_t{0});
  for (const Anchor& anchor : anchors_) {
    if (anchor.recess > 0) continue;  // the point started inside and moves out
    const Collider& collider = at(anchor.slot).collider;
    const Vector3 bone = to_local(collider.pose(state), points_.at(anchor.point, bones));
    const Vector3 way = bone - anchor.anchor;
    if (anchor.normal.dot(way) > -kAwayFromBone * way.norm() || collider.closest(bone).distance < 0) continue;
    for (const std::int32_t node : points_.nodes(anchor.point)) hooked[static_cast<std::size_t>(node)] = 1;
  }
}

Vector3 ContactSet::stopped(const State& state, std::int32_t node, const Vector3& bone, const Vector3& to) const {
  Vector3 end = to;
  if (!points_.has_node(node)) return end;
  for (const Slot& s : slots_) {
    if (!s.collider.is_set()) continue;
    const ShapeGeometry& geometry = *s.collider.geometry();
    const Pose& pose = s.collider.body_pose(state);
    if ((end - pose.position).norm() > geometry.bounding_radius() + (end - bone).norm()) continue;
    if (const auto crossing = geometry.first_crossing(to_local(pose, bone), to_local(pose, end)))
      end = pose * crossing->point;
  }
  return end;
}

void ContactSet::look_ahead(const State& state, double time_step) {
  candidates_.begin_step(state, kLookAhead * time_step);
}

bool ContactSet::may_touch(int slot, const State& state) {
  const Collider& collider = at(slot).collider;
  return collider.is_set() && candidates_.may_reach(collider, state, kTouchMargin);
}

double ContactSet::stored_energy(std::span<const std::uint8_t> nodes) const {
  double energy = 0;
  for (const Anchor& anchor : anchors_) {
    if (points_.is_marked(anchor.point, nodes)) energy += anchor.normal_energy + anchor.friction_energy;
  }
  return energy;
}

double ContactSet::stored_energy_at(const State& state, std::span<const std::uint8_t> nodes,
                                    const Eigen::Matrix3Xd& bones) const {
  double energy = 0;
  for (const Anchor& anchor : anchors_) {
    if (!points_.is_marked(anchor.point, nodes) || hooks(anchor, state, bones)) continue;
    const Offset o = offset(anchor, state);
    energy +=
        anchor_law::stored_normal_energy(anchor, o.depth) + 0.5 * anchor.friction_stiffness * o.stretch.squaredNorm();
  }
  for (const Slot& s : slots_) {
    if (!s.collider.is_set()) continue;
    const Pose& pose = s.collider.body_pose(state);
    const double radius = s.collider.geometry()->bounding_radius();
    for (int i = 0; i < points_.count(); ++i) {
      if (!points_.is_marked(i, nodes)) continue;
      const Vector3 point = points_.at(i, state.node_positions), bone = points_.at(i, bones);
      // If a bone is inside an object, its tissue belongs outside, but no side of the object is the right one.
      if ((bone - pose.position).norm() <= radius && s.collider.closest(to_local(pose, bone)).distance < 0)
        return std::numeric_limits<double>::infinity();
      if ((point - pose.position).norm() > radius) continue;
      const double sunk = std::min(0.0, s.collider.closest(to_local(pose, point)).distance);
      energy += 0.5 * stiffness_ * points_[i].area * sunk * sunk;
    }
  }
  return energy;
}

void ContactSet::release(std::span<const std::uint8_t> nodes) {
  cancel_step();
  remove_if([this, nodes](const Anchor& anchor) { return points_.is_marked(anchor.point, nodes) && clear(anchor); });
}

ContactSet::Anchor* ContactSet::create(int slot, const ContactCandidate& candidate) {
  if (anchors_.size() == anchors_.capacity()) {
    ++dropped_;
    return nullptr;
  }
  if (candidate.sharp >= 0) {
    if (has_entered(slot, candidate.sharp) || is_taken(candidate.point)) return nullptr;
    points_.place(candidate.point, candidate.weights);
  }
  Anchor anchor;
  anchor.point = candidate.point;
  anchor.sharp = candidate.sharp;
  anchor.weights = candidate.weights;
  anchor.slot = slot;
  anchor.anchor = candidate.place;
  anchor.normal = candidate.normal;
  anchor.recess = candidate.recess;
  anchor.fresh = anchor.two_sided = candidate.predicted;
  anchor.stiffness = stiffness_of(candidate.point);
  anchor.set_friction(at(slot).friction);
  has_anchor(slot, candidate.point) = 1;
  anchors_.push_back(anchor);
  return &anchors_.back();
}

void ContactSet::cancel_step() {
  if (!std::exchange(in_step_, false)) return;
  anchors_.swap(anchors_before_);
  mark_anchors();
  cleared_normal_ = cleared_normal_before_;
  cleared_friction_ = cleared_friction_before_;
  for (Slot& s : slots_) s.collider.load(Collider::Memory(s.collider.memory()));
}

void ContactSet::begin_step(const State& state, double time_step) {
  cancel_step();
  in_step_ = true;
  anchors_before_ = anchors_;
  cleared_normal_before_ = cleared_normal_;
  cleared_friction_before_ = cleared_friction_;
  time_step_ = time_step;
  bool any = false;
  for (int slot = 0; slot < static_cast<int>(slots_.size()); ++slot) {
    Collider& collider = at(slot).collider;
    if (!collider.is_set()) continue;
    if (!std::exchange(any, true)) candidates_.begin_step(state, time_step);
    if (!collider.begin_step(state, time_step, candidates_.groups()))
      remove_if([this, slot](const Anchor& anchor) { return anchor.slot == slot && clear(anchor); });
    candidates_.for_each_predicted(
        slot, collider, [this, slot](int point) { return has_anchor(slot, point) != 0; },
        [this, slot](const ContactCandidate& candidate) { create(slot, candidate); });
    candidates_.for_each_entering(collider, true,
                                  [this, slot](const ContactCandidate& candidate) { create(slot, candidate); });
  }
  for (Anchor& anchor : anchors_)
    begin_anchor(anchor, candidates_.start(anchor.point), candidates_.predicted_end(anchor.point));
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
    begin_anchor(anchor, candidates_.start(anchor.point), position(anchor, state));
    changed = true;
  });
  return changed;
}

// Creates an anchor for each point that crossed an object's surface between the step's start and `state`, and calls
// found(anchor).
template <typename Found>
void ContactSet::find_crossed(const State& state, Found&& found) {
  bool any = false;
  for (int slot = 0; slot < static_cast<int>(slots_.size()); ++slot) {
    Collider& collider = at(slot).collider;
    if (!collider.is_set()) continue;
    if (!std::exchange(any, true)) candidates_.set_ends(state);
    collider.set_end(state);
    const auto begin = [&](const ContactCandidate& candidate) {
      if (Anchor* anchor = create(slot, candidate)) found(*anchor);
    };
    candidates_.for_each_crossed(
        slot, collider, [this, slot](int point) { return has_anchor(slot, point) != 0; }, begin);
    candidates_.for_each_entering(collider, false, begin);
  }
}

// The pose from which the motion of the anchor's object counts. For a known anchor this includes the motion between the
// steps.
const Pose& ContactSet::pose_before(const Anchor& anchor) const {
  const Collider& collider = at(anchor.slot).collider;
  return anchor.known && collider.jumped() ? collider.last_pose() : collider.start_pose();
}

// `start`: of the point's path in this step, world. `end`: its predicted end.
void ContactSet::begin_anchor(Anchor& anchor, const Vector3& start, const Vector3& end) {
  anchor_law::move_out(anchor, time_step_);
  const Collider& collider = at(anchor.slot).collider;
  const AnchorPath path{to_local(pose_before(anchor), start), to_local(collider.start_pose(), start),
                        to_local(collider.is_fixed() ? collider.end_pose() : collider.start_pose(), start),
                        to_local(collider.end_pose(), end)};
  const double depth_before = anchor.normal.dot(path.before - anchor.anchor);
  const double pressure_before = anchor_law::pressure_at(anchor, path.before);
  const bool swept = sweep(anchor, path, anchor.friction * pressure_before);
  anchor_law::Ahead ahead =
      anchor_law::begin(anchor, path, pressure_before, swept, points_.mass(anchor.point), time_step_);
  if (anchor.sliding && !(anchor.recess > 0) && anchor.sharp < 0) {
    ++queries_;
    const SurfacePoint there = collider.closest(anchor.anchor + ahead.movement);
    if (std::abs(there.distance) > kOffSurface && there.normal.dot(anchor.normal) > kSmoothTurn)
      anchor_law::move_ahead(anchor, ahead, there);
  }
  anchor_law::finish_begin(anchor, path, ahead, depth_before, swept);
}

// An object with prescribed motion may move anchor and plane away from under the point. Example: a drum that turns by
// 64 degrees in a step. Such a contact slides. It continues in the plane of the surface at the point's predicted
// position. `limit`: mu f_n, N. Returns false if the contact sticks or keeps its plane.
bool ContactSet::sweep(Anchor& anchor, const AnchorPath& path, double limit) {
  const Collider& collider = at(anchor.slot).collider;
  if (!(collider.jumped() || collider.is_turned()) || anchor.fresh || anchor.recess > 0 || anchor.sharp >= 0)
    return false;
  ++queries_;
  const SurfacePoint nearest = collider.closest(path.end);
  if (!Collider::needs_new_plane(anchor.normal, nearest.normal)) return false;
  if (!Collider::same_side(pose_before(anchor), anchor.normal, collider.end_pose(), nearest.normal)) return false;
  if (anchor_law::sticks(anchor, nearest, limit)) return false;
  anchor_law::sweep(anchor, path, nearest);
  return true;
}

void ContactSet::end_step(const State& state) {
  in_step_ = false;
  normal_flow_ = {.work = -std::exchange(cleared_normal_, 0.0)};
  friction_flow_ = {.work = -std::exchange(cleared_friction_, 0.0)};
  for (Slot& s : slots_) {
    s.wrench = {};
    s.count = 0;
    if (s.collider.is_set()) s.collider.end_step(state);
  }
  for (Anchor& anchor : anchors_) {
    const Offset o = offset(anchor, state);
    const Vector3 push = anchor_law::push(anchor, o);
    const Vector3 drag = anchor_law::drag(anchor, o);
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
    return anchor_law::ends(anchor, o.depth) || (anchor.sharp >= 0 && has_left(anchor, state));
  });
  find_crossed(state, [&](Anchor& anchor) {
    anchor.missed = true;
    settle(anchor, offset(anchor, state));
  });
  for (Slot& s : slots_) {
    if (s.collider.is_set()) s.collider.remember();
  }
  for (Anchor& anchor : anchors_) {
    anchor.known = true;
    normal_flow_.stored += anchor.normal_energy;
    friction_flow_.stored += anchor.friction_energy;
    ++at(anchor.slot).count;
  }
}

// Whether the skin is no longer above a sharp point, although the contact's point is still behind its plane. Example: a
// finger that leaves an edge sideways. Counts the energy that such a contact loses.
bool ContactSet::has_left(const Anchor& anchor, const State& state) {
  const Collider& collider = at(anchor.slot).collider;
  const RestingPoint& sharp = collider.geometry()->sharp_points()[static_cast<std::size_t>(anchor.sharp)];
  const Vector3 centre = collider.pose(state) * sharp.centre;
  const Candidates::SkinPlace skin = candidates_.nearest_on_skin(centre, kSharpReach, state.node_positions);
  if (skin.point >= 0 && skin.normal.dot(centre - skin.position) < sharp.radius) return false;
  normal_flow_.anchoring -= anchor.normal_energy;
  friction_flow_.anchoring -= anchor.friction_energy;
  return true;
}

// Counts the energy of a contact that is removed. Always returns true.
bool ContactSet::clear(const Anchor& anchor) {
  cleared_normal_ += anchor.normal_energy;
  cleared_friction_ += anchor.friction_energy;
  return true;
}

// Adds the contact to the energy ledger, without the effect of sliding. `push` and `drag` act on the point at the
// step's end.
void ContactSet::account(Anchor& anchor, const Offset& end, const Vector3& push, const Vector3& drag,
                         const State& state) {
  const Collider& collider = at(anchor.slot).collider;
  const Vector3 point_moved = position(anchor, state) - candidates_.start(anchor.point);
  // Motion from outside: between the steps, and within this step if the motion is prescribed.
  const bool fixed = collider.is_fixed();
  const Vector3 point = collider.end_pose().orientation.conjugate() * end.lever;
  const Vector3 external_motion =
      (fixed ? collider.end_pose() : collider.start_pose()) * point - pose_before(anchor) * point;
  normal_flow_.work += push.dot(external_motion);
  friction_flow_.work += drag.dot(external_motion);
  Vector3 object_moved = external_motion;
  // To first order, as in the solver's increment.
  if (!fixed) object_moved += collider.moved() + collider.turned().cross(end.lever);
  const Vector3 moved = point_moved - object_moved;
  const double energy = anchor_law::stored_normal_energy(anchor, end.depth);
  normal_flow_.anchoring += anchor.start_energy - anchor.normal_energy;
  normal_flow_.integrator += anchor.start_energy - energy - push.dot(moved);
  friction_flow_.integrator += anchor.friction_energy - drag.dot(moved);
  anchor.normal_energy = energy;
}

// Computes the energy of the contact with the anchor and plane that it has between steps. The difference to the energy
// before is the effect of moving the anchor and plane.
void ContactSet::settle(Anchor& anchor, const Offset& offset) {
  const anchor_law::Stored stored = anchor_law::stored(anchor, offset);
  normal_flow_.anchoring += stored.normal - anchor.normal_energy;
  friction_flow_.anchoring += stored.friction - anchor.friction_energy;
  anchor.normal_energy = stored.normal;
  anchor.friction_energy = stored.friction;
}

void ContactSet::slide(Anchor& anchor, double drag, const State& state) {
  const Collider& collider = at(anchor.slot).collider;
  const anchor_law::Slide slide =
      anchor_law::slide(anchor, drag, collider.pose(state), position(anchor, state), time_step_);
  friction_flow_.friction += slide.heat;
  friction_flow_.integrator -= anchor.friction_energy + slide.heat;
  dissipated_ += slide.heat;
  if (!slide.moves) return;
  if (anchor.sharp >= 0) {
    slide_on_skin(anchor, slide.movement, state);
    return;
  }
  ++queries_;
  const SurfacePoint nearest = collider.slid(anchor_law::surface_point(anchor), anchor.normal, slide.movement);
  if (std::abs(nearest.distance) > kOffSurface) {  // curved, or past an edge
    anchor_law::place(anchor, nearest);
  } else {
    anchor.anchor += slide.movement;
  }
}

// The anchor stays at its sharp point, and the skin slides below it. `movement` is that of an anchor on the surface.
void ContactSet::slide_on_skin(Anchor& anchor, const Vector3& movement, const State& state) {
  constexpr double kAround = 1e-3;  // m
  const Collider& collider = at(anchor.slot).collider;
  const Quaternion& turn = collider.pose(state).orientation;
  const Candidates::SkinPlace there = candidates_.nearest_on_skin(position(anchor, state) - turn * movement,
                                                                  movement.norm() + kAround, state.node_positions);
  if (there.point < 0 || (there.point != anchor.point && is_taken(there.point))) return;
  has_anchor(anchor.slot, anchor.point) = 0;
  anchor.point = there.point;
  anchor.weights = there.weights;
  has_anchor(anchor.slot, anchor.point) = 1;
  points_.place(anchor.point, anchor.weights);
  const RestingPoint& sharp = collider.geometry()->sharp_points()[static_cast<std::size_t>(anchor.sharp)];
  anchor.normal = turn.conjugate() * -there.normal;
  anchor.anchor = sharp.centre + (sharp.radius - anchor.recess) * anchor.normal;
}

void ContactSet::add_pattern(BlockPattern& pattern) const {
  blocks_.add_pattern(pattern);
  for (const Slot& s : slots_) s.collider.add_pattern(points_, pattern);
}

void ContactSet::bind(const BlockMatrix& matrix) {
  blocks_.bind(matrix);
  for (Slot& s : slots_) s.collider.bind(points_, blocks_, matrix);
}

double ContactSet::penetration_quantile(const State& state, double fraction) {
  if (anchors_.empty()) return 0;
  depths_.clear();
  for (const Anchor& anchor : anchors_) depths_.push_back(std::max(0.0, -offset(anchor, state).depth));
  const auto nth = depths_.begin() + static_cast<std::ptrdiff_t>(std::clamp(fraction, 0.0, 1.0) *
                                                                 static_cast<double>(depths_.size() - 1));
  std::nth_element(depths_.begin(), nth, depths_.end());
  return *nth;
}

void ContactSet::write(const State& state, ContactReport& report, Contacts& out) const {
  for (const Anchor& anchor : anchors_) {
    const Vector3 place = position(anchor, state);
    const Offset o = offset(anchor, state);
    const Slot& slot = at(anchor.slot);
    const Vector3 velocity = slot.collider.velocity_at(state, place - o.offset);
    report.add(contact_row(points_, anchor, o, place, slot.id, velocity), place, anchor.slot, out);
  }
}

void ContactSet::write_near(const State& state, Contacts& out) const {
  std::array<NearContact, kBodyCount> nearest;
  for (NearContact& each : nearest) each.gap = near_gap;
  for (const Contact& contact : out.contacts) nearest[contact.body].gap = 0;
  for (const Slot& slot : slots_) {
    if (!slot.collider.is_set()) continue;
    const Pose pose = slot.collider.body_pose(state), back = pose.inverse();
    candidates_.groups().for_each_near(*slot.collider.geometry(), pose, near_gap, [&](std::int32_t point) {
      if (point >= points_.count()) return;
      const std::uint32_t bone = points_[point].body % kBodyCount;
      NearContact& near = nearest[bone];
      if (near.gap == 0) return;
      const Vector3 place = points_.at(point, state.node_positions);
      const double reach = slot.collider.geometry()->bounding_radius() + near.gap;
      if ((place - pose.position).squaredNorm() > reach * reach) return;
      const SurfacePoint surface = slot.collider.closest(back * place);
      if (!(surface.distance > 0) || surface.distance >= near.gap) return;
      const Vector3 normal = pose.orientation * surface.normal;
      const Vector3 touched = place - surface.distance * normal;
      near = {bone,
              slot.id,
              to_wire(touched),
              to_wire(normal),
              surface.distance,
              to_wire(slot.collider.velocity_at(state, touched))};
    });
  }
  out.near.clear();
  for (const NearContact& each : nearest)
    if (each.gap > 0 && each.gap < near_gap) out.near.push_back(each);
}

double ContactEnergy::value(const State& state) const {
  double energy = 0;
  for (const ContactSet::Anchor& anchor : contacts_.anchors()) {
    const double depth = contacts_.offset(anchor, state).depth;
    if (anchor_law::pushes(anchor, depth)) energy += anchor_law::energy(anchor, depth);
  }
  return energy;
}

double ContactEnergy::add_gradient(const State& state, VectorX& gradient) const {
  double energy = 0;
  for (const ContactSet::Anchor& anchor : contacts_.anchors()) {
    const ContactSet::Offset o = contacts_.offset(anchor, state);
    if (!anchor_law::pushes(anchor, o.depth)) continue;
    energy += anchor_law::energy(anchor, o.depth);
    contacts_.scatter_gradient(anchor, o.lever, anchor.stiffness * o.depth * o.normal, gradient);
  }
  return energy;
}

void ContactEnergy::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  for (const ContactSet::Anchor& anchor : contacts_.anchors()) {
    const ContactSet::Offset o = contacts_.offset(anchor, state);
    if (!anchor_law::pushes(anchor, o.depth)) continue;
    const Matrix3 stiffness = anchor.stiffness * o.normal * o.normal.transpose();
    contacts_.scatter_hessian(anchor, o.lever, anchor.stiffness * o.depth * o.normal, stiffness, hessian, curvature);
  }
}

}  // namespace softhand
