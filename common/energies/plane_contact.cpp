#include "energies/plane_contact.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kLeastContactStiffness = 10e3;  // N/m
constexpr double kExtraLoad = 5;                 // N, the extra force of a pressing hand
constexpr double kAllowedSink = 0.5e-3;          // m, penetration under the weight and that load
constexpr double kSharingHeight = 1e-3;          // m
constexpr double kCompliantShare = 0.2;          // of a compliant neighbour's stiffness
constexpr double kSameNormal = 0.9;              // cosine
constexpr std::size_t kPoints = ShapeGeometry::most_resting_points;

}  // namespace

PlaneContact::PlaneContact(DofLayout layout, int first_body, int slots)
    : first_body_(first_body),
      slots_(static_cast<std::size_t>(slots)),
      points_(static_cast<std::size_t>(slots) * kMaxNeighbourPlanes * kPoints),
      saved_points_(kMaxNeighbourPlanes * kPoints),
      resting_(kPoints) {
  saved_.slots.reserve(slots_.size());
  saved_.planes.reserve(slots_.size() * kMaxNeighbourPlanes);
  saved_.points.reserve(points_.size());
  for (int slot = 0; slot < slots; ++slot) {
    at(slot).blocks =
        Clique<2>({layout.body_translation_block(first_body + slot), layout.body_rotation_block(first_body + slot)});
    for (std::size_t p = 0; p < kMaxNeighbourPlanes; ++p) {
      at(slot).planes[p].first_point = (static_cast<std::size_t>(slot) * kMaxNeighbourPlanes + p) * kPoints;
    }
  }
}

void PlaneContact::set_object(int slot, const ShapeGeometry* geometry, double mass, double weight) {
  if (geometry == nullptr) throw std::invalid_argument("plane contact: no shape for slot " + std::to_string(slot));
  if (!std::isfinite(mass) || !(mass > 0))
    throw std::invalid_argument("plane contact: mass is " + std::to_string(mass) + " kg, expected > 0");
  if (!std::isfinite(weight) || !(weight >= 0))
    throw std::invalid_argument("plane contact: weight is " + std::to_string(weight) + " N, expected >= 0");
  clear_object(slot);
  Slot& s = at(slot);
  s.geometry = geometry;
  s.mass = mass;
  s.weight = weight;
}

void PlaneContact::clear_object(int slot) {
  Slot& s = at(slot);
  cleared_ += std::exchange(s.stored, 0.0);
  s.geometry = nullptr;
  s.plane_count = 0;
  s.wrench = {};
  s.count = 0;
}

const PlaneContact::Memory& PlaneContact::save() const {
  saved_.slots.clear();
  saved_.planes.clear();
  saved_.points.clear();
  for (const Slot& s : slots_) {
    saved_.slots.push_back({s.geometry != nullptr, s.plane_count, s.mass, s.weight, s.stored, s.wrench, s.count});
    for (const Plane& plane : planes_of(s)) {
      saved_.planes.push_back(plane);
      for (const Point& point : points_of(plane)) saved_.points.push_back(point);
    }
  }
  saved_.dissipated = dissipated_;
  saved_.cleared = cleared_;
  return saved_;
}

void PlaneContact::load(const Memory& memory) {
  const auto refuse = [](const std::string& reason) { throw std::invalid_argument("plane memory: " + reason); };
  if (memory.slots.size() != slots_.size())
    refuse(std::to_string(memory.slots.size()) + " slots, expected " + std::to_string(slots_.size()));
  std::size_t planes = 0, points = 0;
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    const Memory::Slot& from = memory.slots[i];
    if (from.is_set != (slots_[i].geometry != nullptr)) refuse("slot " + std::to_string(i) + " has another object");
    if (from.plane_count > (from.is_set ? kMaxNeighbourPlanes : 0)) refuse("too many planes");
    if (from.plane_count > memory.planes.size() - planes) refuse("fewer planes than it states");
    for (std::size_t p = 0; p < from.plane_count; ++p) {
      const std::size_t of_plane = memory.planes[planes++].points;
      if (of_plane != slots_[i].geometry->resting_points(Vector3::UnitY(), resting_))
        refuse("slot " + std::to_string(i) + " has another shape");
      points += of_plane;
    }
  }
  if (planes != memory.planes.size() || points != memory.points.size())
    refuse(std::to_string(memory.points.size()) + " points, expected " + std::to_string(points));
  auto plane_from = memory.planes.begin();
  auto point_from = memory.points.begin();
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    const Memory::Slot& from = memory.slots[i];
    Slot& s = slots_[i];
    s.plane_count = from.plane_count;
    s.mass = from.mass;
    s.weight = from.weight;
    s.stored = from.stored;
    s.wrench = from.wrench;
    s.count = from.count;
    for (std::size_t p = 0; p < s.plane_count; ++p) {
      Plane& plane = s.planes[p];
      static_cast<Memory::Plane&>(plane) = *plane_from++;
      plane.end_point = plane.point;
      for (Point& point : points_of(plane)) {
        point = {};
        static_cast<Memory::Point&>(point) = *point_from++;
      }
    }
  }
  dissipated_ = memory.dissipated;
  cleared_ = memory.cleared;
}

void PlaneContact::reset() {
  std::fill(points_.begin(), points_.end(), Point{});
  for (Slot& s : slots_) {
    cleared_ += std::exchange(s.stored, 0.0);
    s.wrench = {};
    s.count = 0;
  }
}

void PlaneContact::set_planes(int slot, std::span<const NeighbourPlane> planes) {
  Slot& s = at(slot);
  if (s.geometry == nullptr) return;
  const std::array<Plane, kMaxNeighbourPlanes> old = s.planes;
  const std::size_t old_count = s.plane_count;
  for (std::size_t p = 0; p < old_count; ++p) {
    std::copy_n(points_.begin() + static_cast<std::ptrdiff_t>(old[p].first_point), old[p].points,
                saved_points_.begin() + static_cast<std::ptrdiff_t>(p * kPoints));
  }
  const double stiffness = std::max(kLeastContactStiffness, (s.weight + kExtraLoad) / kAllowedSink);
  s.plane_count = std::min(planes.size(), kMaxNeighbourPlanes);
  for (std::size_t p = 0; p < s.plane_count; ++p) {
    const NeighbourPlane& given = planes[p];
    Plane& plane = s.planes[p];
    plane.neighbour = given.neighbour;
    plane.point = plane.end_point = to_vector(given.point);
    plane.normal = to_vector(given.normal).normalized();
    plane.velocity = to_vector(given.velocity);
    plane.friction = std::max(0.0, given.friction);
    plane.stiffness =
        given.kind == kNeighbourCompliant ? std::min(stiffness, kCompliantShare * given.stiffness) : stiffness;
    plane.points = s.geometry->resting_points(Vector3::UnitY(), resting_);
    std::size_t same = old_count;
    double closest = kSameNormal;
    for (std::size_t o = 0; o < old_count; ++o) {
      if (old[o].neighbour == given.neighbour && old[o].normal.dot(plane.normal) > closest) {
        closest = old[o].normal.dot(plane.normal);
        same = o;
      }
    }
    for (std::size_t i = 0; i < plane.points; ++i) {
      points_[plane.first_point + i] = same < old_count ? saved_points_[same * kPoints + i] : Point{};
    }
  }
}

void PlaneContact::add_pattern(BlockPattern& pattern) const {
  for (const Slot& slot : slots_) slot.blocks.add_pattern(pattern);
}

void PlaneContact::bind(const BlockMatrix& matrix) {
  for (Slot& slot : slots_) slot.blocks.bind(matrix);
}

void PlaneContact::begin_step(const State& state, double time_step) {
  time_step_ = time_step;
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    Slot& slot = slots_[i];
    const std::size_t body = static_cast<std::size_t>(first_body_) + i;
    slot.start = state.body_poses[body];
    slot.start_energy = 0;
    for (std::size_t p = 0; p < slot.plane_count; ++p)
      begin_plane(slot, slot.planes[p], slot.start, state.body_velocities[body]);
  }
}

void PlaneContact::begin_plane(Slot& slot, Plane& plane, const Pose& body, const Twist& twist) {
  const Vector3 local_normal = body.orientation.conjugate() * plane.normal;
  slot.geometry->resting_points(local_normal, resting_);
  const std::span<Point> points = points_of(plane);
  const auto height = [&plane](const Pose& pose, const RestingPoint& resting) {
    return plane.normal.dot(pose * resting.centre - plane.point) - resting.radius;
  };
  double lowest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < points.size(); ++i) lowest = std::min(lowest, height(body, resting_[i]));
  double sharing = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    sharing += std::max(0.0, 1.0 - (height(body, resting_[i]) - lowest) / kSharingHeight);
  }
  const double k = plane.stiffness / sharing;
  const double damping = 2.0 * std::sqrt(plane.stiffness * slot.mass) / sharing / time_step_;
  const double inertia = slot.mass / sharing / (time_step_ * time_step_);
  const Pose next = increment(body, time_step_ * twist.linear, time_step_ * twist.angular);
  const Vector3 plane_motion = time_step_ * plane.velocity;
  for (std::size_t i = 0; i < points.size(); ++i) {
    Point& point = points[i];
    const double start = height(body, resting_[i]);
    const double predicted = height(next, resting_[i]) - plane.normal.dot(plane_motion);
    point.resting = resting_[i];
    point.material = resting_[i].centre - resting_[i].radius * local_normal;
    point.material_start = body * point.material;
    point.stiffness = k + damping;
    point.spring = k;
    point.start_height = std::min(start, 0.0);
    point.target = point.stiffness > 0 ? damping / point.stiffness * point.start_height : 0;
    point.fresh = start - plane.normal.dot(plane_motion) >= point.target && predicted < point.target;
    point.stretch_start = point.stretch - plane.normal.dot(point.stretch) * plane.normal;
    const Vector3 movement = next * point.material - point.material_start - plane_motion;
    const Vector3 along = movement - plane.normal.dot(movement) * plane.normal;
    double pressure = point.normal_force;
    if (point.fresh && !(pressure > 0))
      pressure = point.stiffness * (point.target - predicted) * inertia / (inertia + point.stiffness);
    point.friction = {friction_stiffness(k, plane.friction), plane.friction * pressure};
    slot.start_energy += stored(point, point.stretch_start, point.start_height);
    point.predicted_secant =
        point.friction.bound > 0 ? point.friction.secant((point.stretch_start + along).norm()) : 0.0;
    point.slides_on = point.sliding && point.stretch_start.dot(along) > 0;
  }
  plane.end_point = plane.point + plane_motion;
}

double PlaneContact::stored(const Point& point, const Vector3& stretch, double height) {
  const double depth = std::min(height, 0.0);
  return 0.5 * point.spring * depth * depth + 0.5 * point.friction.stiffness * stretch.squaredNorm();
}

PlaneContact::Response PlaneContact::respond(const Plane& plane, const Point& point, const Pose& body) const {
  Response result;
  result.normal_arm = body.orientation * point.resting.centre;
  result.friction_arm = body.orientation * point.material;
  result.height = plane.normal.dot(body.position + result.normal_arm - plane.end_point) - point.resting.radius;
  const double depth = result.height - point.target;
  result.pushes = point.fresh || depth < 0;
  if (result.pushes) {
    result.energy = 0.5 * point.stiffness * depth * depth;
    result.pressure = -point.stiffness * depth;
    result.normal_force = -result.pressure * plane.normal;
  }
  const Vector3 movement = body.position + result.friction_arm - point.material_start - time_step_ * plane.velocity;
  result.stretch = point.stretch_start + movement - plane.normal.dot(movement) * plane.normal;
  if (point.friction.bound > 0) {
    const double length = result.stretch.norm();
    result.energy += point.friction.energy(length);
    result.friction_force = point.friction.secant(length) * result.stretch;
  }
  return result;
}

bool PlaneContact::revise(const State& state) {
  bool changed = false;
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    const Pose& body = state.body_poses[static_cast<std::size_t>(first_body_) + i];
    for (const Plane& plane : planes_of(slots_[i])) {
      for (Point& point : points_of(plane)) {
        if (!point.fresh) continue;
        point.fresh = false;
        if (respond(plane, point, body).pushes) continue;
        point.friction.bound = 0;
        changed = true;
      }
    }
  }
  return changed;
}

double PlaneContact::value(const State& state) const {
  double energy = 0;
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    const Pose& body = state.body_poses[static_cast<std::size_t>(first_body_) + i];
    for (const Plane& plane : planes_of(slots_[i])) {
      for (const Point& point : points_of(plane)) energy += respond(plane, point, body).energy;
    }
  }
  return energy;
}

double PlaneContact::add_gradient(const State& state, VectorX& gradient) const {
  double energy = 0;
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    const Pose& body = state.body_poses[static_cast<std::size_t>(first_body_) + i];
    Clique<2>::Gradient local = Clique<2>::Gradient::Zero();
    for (const Plane& plane : planes_of(slots_[i])) {
      for (const Point& point : points_of(plane)) {
        const Response r = respond(plane, point, body);
        energy += r.energy;
        local.head<3>() += r.normal_force + r.friction_force;
        local.tail<3>() += r.normal_arm.cross(r.normal_force) + r.friction_arm.cross(r.friction_force);
      }
    }
    if (slots_[i].plane_count > 0) slots_[i].blocks.add(gradient, local);
  }
  return energy;
}

void PlaneContact::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    if (slots_[i].plane_count == 0) continue;
    const Pose& body = state.body_poses[static_cast<std::size_t>(first_body_) + i];
    Clique<2>::Hessian local = Clique<2>::Hessian::Zero();
    const auto add = [&local, curvature](const Vector3& arm, const Vector3& y, const Matrix3& stiffness) {
      const Matrix3 turn = -skew(arm);  // d(point)/d(rotation)
      local.topLeftCorner<3, 3>() += stiffness;
      local.bottomLeftCorner<3, 3>() += turn.transpose() * stiffness;
      local.bottomRightCorner<3, 3>() += turn.transpose() * stiffness * turn;
      if (curvature == Curvature::exact) local.bottomRightCorner<3, 3>() += rotated_arm_second_derivative(arm, y);
    };
    for (const Plane& plane : planes_of(slots_[i])) {
      for (const Point& point : points_of(plane)) {
        const Response r = respond(plane, point, body);
        if (r.pushes) add(r.normal_arm, r.normal_force, point.stiffness * plane.normal * plane.normal.transpose());
        if (!(point.friction.bound > 0)) continue;
        // At the step's start the kink between sticking and sliding is resolved by the predicted motion of the point
        // (friction.hpp).
        const bool at_start =
            (r.stretch + time_step_ * (plane.velocity - plane.normal.dot(plane.velocity) * plane.normal) -
             point.stretch_start)
                .norm() < 1e-12;
        Matrix3 tangent = point.friction.tangent(r.stretch, plane.normal);
        if (curvature == Curvature::projected && at_start) {
          tangent =
              point.fresh
                  ? Matrix3(point.predicted_secant * (Matrix3::Identity() - plane.normal * plane.normal.transpose()))
                  : point.friction.tangent(r.stretch, plane.normal, point.slides_on);
        }
        add(r.friction_arm, r.friction_force, tangent);
      }
    }
    slots_[i].blocks.add(hessian, local);
  }
}

void PlaneContact::end_step(State& state) {
  flow_ = {.work = -std::exchange(cleared_, 0.0)};
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    Slot& slot = slots_[i];
    const Pose& body = state.body_poses[static_cast<std::size_t>(first_body_) + i];
    slot.wrench = {};
    slot.count = 0;
    flow_.anchoring += slot.start_energy - slot.stored;
    slot.stored = 0;
    const Vector3 moved = body.position - slot.start.position;
    const Vector3 turned = slot.plane_count > 0 ? rotation_log(body.orientation * slot.start.orientation.conjugate())
                                                : Vector3(Vector3::Zero());
    for (std::size_t p = 0; p < slot.plane_count; ++p) {
      Plane& plane = slot.planes[p];
      plane.point = plane.end_point;
      const Vector3 plane_motion = time_step_ * plane.velocity;
      for (Point& point : points_of(plane)) {
        const Response r = respond(plane, point, body);
        slot.wrench.force -= r.normal_force + r.friction_force;
        slot.wrench.torque -= r.normal_arm.cross(r.normal_force) + r.friction_arm.cross(r.friction_force);
        point.normal_force = std::max(0.0, r.pressure);
        point.fresh = false;
        const double before = stored(point, point.stretch_start, point.start_height);
        const double limit = plane.friction * point.normal_force;
        const double length = r.stretch.norm();
        // A point that does not press stores no friction energy.
        const double distance = point.normal_force > 0 ? point.friction.slide(length, limit) : length;
        point.sliding = point.normal_force > 0 && distance > 0;
        point.stretch = r.stretch;
        if (distance > 0) point.stretch *= (length - distance) / length;
        if (point.normal_force > 0) ++slot.count;

        const double after = stored(point, point.stretch, r.height);
        const Vector3 spring = point.spring * std::min(r.height, 0.0) * plane.normal;
        const Vector3 damper = r.normal_force - spring;
        // Motion relative to the plane, as the solver sees it.
        const Vector3 normal_moved = moved + turned.cross(r.normal_arm) - plane_motion;
        const Vector3 friction_moved = moved + turned.cross(r.friction_arm) - plane_motion;
        const double heat = r.friction_force.norm() * distance;
        slot.stored += after;
        flow_.stored += after;
        flow_.work -= (r.normal_force + r.friction_force).dot(plane_motion);
        flow_.damping += damper.dot(normal_moved);
        flow_.friction += heat;
        flow_.integrator += before - after + spring.dot(normal_moved) + r.friction_force.dot(friction_moved) - heat;
      }
    }
  }
  dissipated_ += flow_.friction;
}

}  // namespace softhand
