// Which objects get a slot in the hand's simulation: the nearest ones.
#include <algorithm>
#include <cmath>
#include <limits>

#include "hand/object_mirror.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kForgetDistance = 1.5;    // times `near`; an object loses its slot at this distance
constexpr double kSkinDistance = 0.02;     // m, assumed distance of the skin from the bones
constexpr double kSlotPreference = 0.005;  // m; an object takes another's slot only if nearer by more than this

// The bones as line segments from joint to joint, stored in arrays: up to a hundred objects query distances in each
// step.
class BoneSegments {
 public:
  void set(std::size_t bone, const Vector3& start, const Vector3& end) {
    const Vector3 along = end - start;
    const double square = along.squaredNorm();
    // An even number of rows fills the SIMD vectors. The last row repeats the last bone.
    for (auto row = static_cast<Eigen::Index>(bone);
         row < (bone + 1 < kBodyCount ? static_cast<Eigen::Index>(bone) + 1 : kRows); ++row) {
      start_.row(row) = start.transpose().array();
      along_.row(row) = along.transpose().array();
      inverse_square_[row] = square > 0 ? 1 / square : 0;
    }
  }
  double distance(const Vector3& p) const {
    const Coordinates x = p.x() - start_.col(0), y = p.y() - start_.col(1), z = p.z() - start_.col(2);
    const Coordinates part =
        ((x * along_.col(0) + y * along_.col(1) + z * along_.col(2)) * inverse_square_).max(0.0).min(1.0);
    return std::sqrt(((x - part * along_.col(0)).square() + (y - part * along_.col(1)).square() +
                      (z - part * along_.col(2)).square())
                         .minCoeff());
  }
  /// Smallest distance between a shape and the ends of the segments.
  double distance(const Pose& pose, const ShapeGeometry& shape) const {
    const Pose back = pose.inverse();
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t b = 0; b < kBodyCount; ++b)
      nearest = std::min({nearest, shape.signed_distance(back * start(b)), shape.signed_distance(back * end(b))});
    return nearest;
  }
  /// Largest distance between `middle` and an end of a segment.
  double reach(const Vector3& middle) const {
    double farthest = 0;
    for (std::size_t b = 0; b < kBodyCount; ++b)
      farthest = std::max({farthest, (start(b) - middle).squaredNorm(), (end(b) - middle).squaredNorm()});
    return std::sqrt(farthest);
  }

 private:
  static constexpr int kRows = static_cast<int>(kBodyCount + kBodyCount % 2);
  using Coordinates = Eigen::Array<double, kRows, 1>;

  Vector3 start(std::size_t b) const { return start_.row(static_cast<Eigen::Index>(b)).transpose(); }
  Vector3 end(std::size_t b) const { return start(b) + Vector3(along_.row(static_cast<Eigen::Index>(b)).transpose()); }

  Eigen::Array<double, kRows, 3> start_, along_;
  Coordinates inverse_square_;
};

}  // namespace

void ObjectMirror::clear_slot(KnownObject& object) {
  object.is_free = false;  // its joints end with it (`move_joints`)
  if (object.slot < 0) return;
  simulation_.clear_slot(object.slot);
  slot_object_[static_cast<std::size_t>(object.slot)] = -1;
  object.slot = -1;
}

void ObjectMirror::measure_distances() {
  for (KnownObject& object : objects_) {
    if (!object.seen) continue;
    object.distance = std::numeric_limits<double>::infinity();
    object.near = 0;
  }
  for (int hand = 0; hand < simulation_.hand_count(); ++hand) measure_distances_of(hand);
  for (KnownObject& object : objects_)
    if (object.seen && simulation_.soft() != nullptr) measure_soft_distance(object);
  // All objects of an assembly are as near as its nearest one.
  for (const KnownObject& object : objects_) {
    if (!object.jointed || !object.seen) continue;
    for (KnownObject& other : objects_) {
      if (other.assembly != object.assembly) continue;
      other.distance = std::min(other.distance, object.distance);
      other.near = std::max(other.near, object.near);
    }
  }
}

// An object is as near as to the nearest hand.
void ObjectMirror::measure_distances_of(int hand) {
  BoneSegments bones;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    const Vector3 start = simulation_.joint_pose(joint_of(body), hand).position;
    bones.set(b, start, body == Body::forearm ? start : simulation_.joint_pose(end_joint_of(body), hand).position);
  }
  const Vector3 middle = simulation_.joint_pose(Joint::palm, hand).position;
  const double reach = bones.reach(middle);
  double fastest = 0;  // m/s, of a bone
  for (std::size_t b = 0; b < kBodyCount; ++b)
    fastest = std::max(fastest, simulation_.joint_velocity(joint_of(static_cast<Body>(b)), hand).linear.norm());
  for (KnownObject& object : objects_) {
    if (!object.seen) continue;
    const Vector3 position = to_vector(object.state.position);
    // Contact detection sweeps an object from its previous pose in the slot. Therefore an object needs a slot one step
    // before it can touch the skin.
    const double spin = to_vector(object.state.angular_velocity).norm();
    const double speed = fastest + to_vector(object.state.linear_velocity).norm() +
                         (spin > 0 ? spin * std::min(object.bounding_radius, (position - middle).norm() + reach) : 0);
    const double near = std::max(options_.near_distance, kSkinDistance + time_step_ * speed);
    object.near = std::max(object.near, near);
    // This cheap lower bound already excludes most objects.
    if ((position - middle).norm() - object.bounding_radius - reach > kForgetDistance * near) continue;
    const double distance =
        object.bounding_radius < 0.5
            ? bones.distance(position) - object.bounding_radius
            // The bounding sphere of a table would be near everything.
            : bones.distance(to_pose(object.state.position, object.state.orientation), *object.shape);
    object.distance = std::min(object.distance, distance);
  }
}

// A flexible object needs the objects around it as the hand does.
void ObjectMirror::measure_soft_distance(KnownObject& object) const {
  const SoftObjects& soft = *simulation_.soft();
  const State& state = simulation_.state();
  const Pose pose = to_pose(object.state.position, object.state.orientation);
  for (int i = 0; i < soft.count(); ++i) {
    const SoftObjects::Ball ball = soft.ball(i, state);
    const Vector3 centre = pose.inverse() * ball.centre;
    if (centre.norm() - object.bounding_radius - ball.radius > kForgetDistance * object.near) continue;
    const double speed = soft.fastest(i, state) + to_vector(object.state.linear_velocity).norm();
    object.near = std::max(object.near, time_step_ * speed);
    object.distance = std::min(object.distance, object.shape->signed_distance(centre) - ball.radius);
  }
}

// The nearest objects get the slots. An object gives up its slot to another one only if that one is nearer by more than
// kSlotPreference. Objects that the hand owns or touches keep their slots.
void ObjectMirror::give_slots(Nanoseconds now) {
  waiting_.clear();
  for (std::size_t o = 0; o < objects_.size(); ++o) {
    KnownObject& object = objects_[o];
    if (!object.seen) continue;
    if (object.slot >= 0 && object.distance > kForgetDistance * object.near && !object.owned) clear_slot(object);
    if (object.slot < 0 && object.distance <= object.near) waiting_.push_back(static_cast<int>(o));
  }
  const auto at = [this](int o) -> KnownObject& { return objects_[static_cast<std::size_t>(o)]; };
  std::sort(waiting_.begin(), waiting_.end(),
            [&at](int a, int b) { return at(a).distance != at(b).distance ? at(a).distance < at(b).distance : a < b; });
  for (const int o : waiting_) {
    KnownObject& object = at(o);
    if (object.slot >= 0) continue;  // it got its slot with its assembly
    if (object.jointed && !symmetric_) {
      if (!get_slots_for_assembly(object, now)) ++counters_.without_slot;
      continue;
    }
    const bool is_static = object.description.is_static != 0;
    int farthest = -1;
    for (int slot = 0; slot < simulation_.slot_count() && object.slot < 0; ++slot) {
      if (simulation_.slot_is_static(slot) != is_static) continue;
      const int holder = slot_object_[static_cast<std::size_t>(slot)];
      if (holder < 0) {
        object.slot = slot;
      } else if (!at(holder).owned && !simulation_.touched(slot) &&
                 (farthest < 0 || at(holder).distance > at(farthest).distance)) {
        farthest = holder;
      }
    }
    if (object.slot < 0 && farthest >= 0 && at(farthest).distance > object.distance + kSlotPreference) {
      object.slot = at(farthest).slot;
      if (at(farthest).jointed) {
        release(at(farthest).assembly);
      } else {
        clear_slot(at(farthest));
      }
    }
    if (object.slot < 0) {
      ++counters_.without_slot;
      continue;
    }
    give_slot(static_cast<std::size_t>(o), object.slot, now);
  }
}

void ObjectMirror::give_slot(std::size_t o, int slot, Nanoseconds now) {
  KnownObject& object = objects_[o];
  object.slot = slot;
  slot_object_[static_cast<std::size_t>(slot)] = static_cast<int>(o);
  simulation_.set_slot(slot, object.mirrored);
  follow_world(object, now);
  object.owned = false;
  if (symmetric_ && object.description.is_static == 0) simulation_.make_dynamic(slot, Vector3::Zero());
}

/// All objects of an assembly get slots, or none does. Farther objects make room if that is enough for all.
bool ObjectMirror::get_slots_for_assembly(KnownObject& object, Nanoseconds now) {
  const std::uint32_t assembly = object.assembly;
  int needed = 0, joints = 0, free = 0;
  for (const KnownObject& each : objects_) {
    if (each.assembly != assembly) continue;
    if (!each.seen) return false;
    ++needed;
  }
  int places = simulation_.joint_count();
  for (const KnownJoint& joint : joints_) {
    const KnownObject* child = find_object(joint.child);
    const KnownObject* parent = find_object(joint.parent);
    if (child == nullptr || parent == nullptr) continue;
    if (child->assembly == assembly) ++joints;
    if (child->assembly != assembly && child->slot >= 0) --places;  // reserved for another assembly
  }
  if (joints > places) return false;
  const auto holder_of = [this](int slot) -> KnownObject* {
    const int holder = slot_object_[static_cast<std::size_t>(slot)];
    return holder < 0 ? nullptr : &objects_[static_cast<std::size_t>(holder)];
  };
  const auto is_held = [&](const KnownObject& holder) {  // by a touch of any object of its assembly
    return std::any_of(objects_.begin(), objects_.end(), [&](const KnownObject& each) {
      return each.assembly == holder.assembly && each.slot >= 0 && (each.owned || simulation_.touched(each.slot));
    });
  };
  const auto gives_way = [&](const KnownObject& holder) {
    return !is_held(holder) && holder.distance > object.distance + kSlotPreference;
  };
  int possible = 0;
  for (int slot = 0; slot < simulation_.slot_count(); ++slot) {
    if (simulation_.slot_is_static(slot)) continue;
    const KnownObject* holder = holder_of(slot);
    if (holder == nullptr) ++free;
    if (holder == nullptr || gives_way(*holder)) ++possible;
  }
  if (possible < needed) return false;
  while (free < needed) {
    KnownObject* farthest = nullptr;
    for (int slot = 0; slot < simulation_.slot_count(); ++slot) {
      KnownObject* holder = simulation_.slot_is_static(slot) ? nullptr : holder_of(slot);
      if (holder != nullptr && gives_way(*holder) && (farthest == nullptr || holder->distance > farthest->distance))
        farthest = holder;
    }
    const std::uint32_t leaving = farthest->assembly;
    for (const KnownObject& each : objects_)
      if (each.assembly == leaving && each.slot >= 0) ++free;
    release(leaving);
  }
  int slot = 0;
  for (std::size_t o = 0; o < objects_.size(); ++o) {
    if (objects_[o].assembly != assembly) continue;
    while (simulation_.slot_is_static(slot) || holder_of(slot) != nullptr) ++slot;
    give_slot(o, slot, now);
  }
  return true;
}

}  // namespace softhand
