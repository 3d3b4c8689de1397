#include "hand/hand_loop.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "device/answer.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

std::size_t index(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }

bool is_unit(double norm) { return std::abs(norm - 1.0) < 0.01; }

// s after a reposition. The hand was placed in its rest pose, so its fingers move fast. They must not hit objects away.
constexpr double kSettlingTime = 0.1;

bool usable(const JointSample& joint) {
  return (joint.flags & kJointValid) != 0 && all_finite(joint.position) && all_finite(joint.orientation) &&
         all_finite(joint.linear_velocity) && all_finite(joint.angular_velocity) &&
         is_unit(to_quaternion(joint.orientation).norm());
}

// Upper bound for positions, velocities and accelerations in SI units. No scene has larger values, and they would
// overflow in the step in which the hand first touches the object.
bool moderate(const Vec3& values) {
  return std::all_of(values.begin(), values.end(), [](double x) { return std::abs(x) <= 1e4; });
}
bool usable(const NeighbourPlane& plane) {
  const auto not_negative = [](double x) { return x >= 0 && std::isfinite(x); };
  return moderate(plane.point) && moderate(plane.velocity) && is_unit(to_vector(plane.normal).norm()) &&
         not_negative(plane.friction) && not_negative(plane.stiffness);
}
bool usable(const ObjectState& object) {
  return moderate(object.position) && is_unit(to_quaternion(object.orientation).norm()) &&
         moderate(object.linear_velocity) && moderate(object.angular_velocity) && moderate(object.gravity) &&
         std::all_of(object.planes.begin(), object.planes.end(), [](const NeighbourPlane& p) { return usable(p); });
}

// Throws std::invalid_argument if a step that touches the object would fail or throw.
void check(const ObjectDescription& description) {
  const auto demand = [](const char* what, double value, bool in_range, const char* expected) {
    if (!in_range)
      throw std::invalid_argument(std::string(what) + " is " + std::to_string(value) + ", expected " + expected);
  };
  constexpr double kMost = 1e9;  // kg, kg m^2, 1: far above the range of a scene file, far below overflow
  demand("friction", description.friction, description.friction >= 0 && description.friction <= kMost, "0 to 1e9");
  if (description.is_static != 0) return;
  demand("mass", description.mass, description.mass > 0 && description.mass <= kMost,
         "above 0 and at most 1e9 kg if the object can move");
  for (const double inertia : description.inertia)
    demand("inertia", inertia, inertia > 0 && inertia <= kMost,
           "above 0 and at most 1e9 kg m^2 if the object can move");
}

bool is_same(const Shape& a, const Shape& b) {
  const auto is_same_file = [](const ShapeFile& x, const ShapeFile& y) {
    return get_text(x.name) == get_text(y.name) && get_text(x.sha256) == get_text(y.sha256) && x.link == y.link &&
           x.position == y.position && x.orientation == y.orientation;
  };
  return a.kind == b.kind && a.size == b.size &&
         std::equal(a.vertices.begin(), a.vertices.end(), b.vertices.begin(), b.vertices.end()) &&
         std::equal(a.file.begin(), a.file.end(), b.file.begin(), b.file.end(), is_same_file);
}

Pose extrapolated(const Pose& pose, const Twist& velocity, double seconds) {
  return increment(pose, seconds * velocity.linear, seconds * velocity.angular);
}

Twist twist_of(const JointSample& joint) {
  return {to_vector(joint.linear_velocity), to_vector(joint.angular_velocity)};
}
Twist twist_of(const ObjectState& object) {
  return {to_vector(object.linear_velocity), to_vector(object.angular_velocity)};
}

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

HandLoop::HandLoop(const HandModel& hand, const HandOptions& options, HandKey key, const ObjectSpring& object_spring)
    : options_(options),
      key_(key),
      symmetric_(object_spring.linear_stiffness > 0),
      time_step_(1.0 / options.rate_hz),
      simulation_(std::make_unique<HandSimulation>(hand, options.simulation, static_cast<int>(options.mirrored_objects),
                                                   static_cast<int>(options.static_objects), object_spring,
                                                   static_cast<int>(options.object_joints))),
      tracked_(options.tracked_input) {
  slot_object_.assign(static_cast<std::size_t>(simulation_->slot_count()), -1);
  objects_.reserve(kMaxObjects);
  joints_.reserve(kMaxObjectJoints);
  waiting_.reserve(kMaxObjects);
  output_.simulated.hand = output_.coupling.hand = output_.contacts.hand = output_.bone_wrench.hand =
      output_.surface.hand = key_;
}

HandLoop::~HandLoop() = default;

void HandLoop::describe_object(const ObjectDescription& description, std::shared_ptr<const ShapeGeometry> file_shape) {
  auto known = std::find_if(objects_.begin(), objects_.end(),
                            [&description](const KnownObject& o) { return o.id == description.object; });
  if (known != objects_.end()) release(known->assembly);
  if (description.removed != 0) {
    if (known == objects_.end()) return;
    objects_.erase(known);
    find_assemblies();
    // The indices of the objects after the erased one have changed.
    for (std::size_t o = 0; o < objects_.size(); ++o) {
      if (objects_[o].slot >= 0) slot_object_[static_cast<std::size_t>(objects_[o].slot)] = static_cast<int>(o);
    }
    return;
  }
  check(description);
  // Loading a large hull takes longer than a step may take, so an unchanged shape is kept.
  const bool has_shape = known != objects_.end() && is_same(known->description.shape, description.shape);
  if (!has_shape && file_shape == nullptr && load_shape_ && !description.shape.file.empty())
    file_shape = load_shape_(description.shape.file[0]);
  auto shape = has_shape               ? known->shape
               : file_shape != nullptr ? std::move(file_shape)
                                       : std::make_shared<const ShapeGeometry>(description.shape);
  if (known == objects_.end()) {
    if (objects_.size() == kMaxObjects) throw std::invalid_argument("objects: at most " + std::to_string(kMaxObjects));
    known = objects_.emplace(objects_.end());
  }
  known->id = description.object;
  known->description = description;
  known->shape = std::move(shape);
  known->bounding_radius = known->shape->bounding_radius();
  // A world that moves an object to another place describes it again. The earlier state says nothing about the new
  // place.
  known->owned = known->seen = false;
  known->last_touch = 0;
  known->mirrored = {
      description.object, known->shape.get(), description.is_static != 0 ? 1.0 : description.mass,
      description.is_static != 0 ? Matrix3(Matrix3::Identity()) : Matrix3(to_vector(description.inertia).asDiagonal()),
      description.friction};
  find_assemblies();
}

void HandLoop::describe_joint(const ObjectJointDescription& description) {
  auto known = std::find_if(joints_.begin(), joints_.end(),
                            [&description](const KnownJoint& j) { return j.id == description.joint; });
  KnownJoint joint;
  joint.id = description.joint;
  joint.parent = description.parent;
  joint.child = description.child;
  joint.law = to_law(description);
  joint.parent_from_joint = to_pose(description.parent_position, description.parent_orientation);
  joint.child_from_joint = to_pose(description.child_position, description.child_orientation);
  if (description.removed == 0) {
    check_joint_law(joint.law);
    const auto is_frame = [](const Vec3& position, const Vec4& orientation) {
      return moderate(position) && is_unit(to_quaternion(orientation).norm());
    };
    if (!is_frame(description.parent_position, description.parent_orientation) ||
        !is_frame(description.child_position, description.child_orientation))
      throw std::invalid_argument("a frame of the joint is not a pose, expected finite metres and unit quaternions");
    if (description.parent == description.child)
      throw std::invalid_argument("parent and child are object " + std::to_string(description.child) +
                                  ", expected two objects");
    joint.parent_from_joint.orientation.normalize();
    joint.child_from_joint.orientation.normalize();
    if (known == joints_.end() && joints_.size() == kMaxObjectJoints)
      throw std::invalid_argument("joints: at most " + std::to_string(kMaxObjectJoints));
  }
  if (known != joints_.end()) {
    for (const std::uint32_t id : {known->parent, known->child})
      if (const KnownObject* object = find_object(id)) release(object->assembly);
    joints_.erase(known);
  }
  if (description.removed == 0) {
    for (const std::uint32_t id : {joint.parent, joint.child})
      if (const KnownObject* object = find_object(id)) release(object->assembly);
    joints_.push_back(joint);
  }
  find_assemblies();
}

HandLoop::KnownObject* HandLoop::find_object(std::uint32_t id) {
  const auto known = std::find_if(objects_.begin(), objects_.end(), [id](const KnownObject& o) { return o.id == id; });
  return known == objects_.end() ? nullptr : &*known;
}

/// Ends the joints of an assembly and gives up its slots. The world moves its objects again.
void HandLoop::release(std::uint32_t assembly) {
  for (KnownObject& object : objects_) {
    if (object.assembly != assembly) continue;
    for (KnownJoint& joint : joints_) {
      if (joint.place < 0 || (joint.parent != object.id && joint.child != object.id)) continue;
      simulation_->clear_joint(joint.place);
      joint.place = -1;
    }
    clear_slot(object);
    object.owned = false;
    object.last_touch = 0;
  }
}

void HandLoop::find_assemblies() {
  for (KnownObject& object : objects_) {
    object.assembly = object.id;
    object.jointed = false;
  }
  for (bool changed = true; changed;) {
    changed = false;
    for (const KnownJoint& joint : joints_) {
      KnownObject* parent = find_object(joint.parent);
      KnownObject* child = find_object(joint.child);
      if (parent == nullptr || child == nullptr || child->description.is_static != 0) continue;
      child->jointed = true;
      if (parent->description.is_static != 0) continue;
      parent->jointed = true;
      if (parent->assembly == child->assembly) continue;
      parent->assembly = child->assembly = std::min(parent->assembly, child->assembly);
      changed = true;
    }
  }
}

void HandLoop::take_state(const HandLoop& other) {
  simulation_->take_state(*other.simulation_);
  tracked_ = other.tracked_;
  objects_ = other.objects_;
  joints_ = other.joints_;
  slot_object_ = other.slot_object_;
  skeleton_ = other.skeleton_;
  any_skeleton_ = other.any_skeleton_;
  reposition_asked_ = other.reposition_asked_;
  settling_time_ = other.settling_time_;
  world_time_ = other.world_time_;
  reset_time_ = other.reset_time_;
  counters_ = other.counters_;
  output_ = other.output_;
}

void HandLoop::clear_slot(KnownObject& object) {
  if (object.slot < 0) return;
  simulation_->clear_slot(object.slot);
  slot_object_[static_cast<std::size_t>(object.slot)] = -1;
  object.slot = -1;
}

void HandLoop::reset(Nanoseconds time) {
  reset_time_ = time;
  tracked_ = TrackedInput(options_.tracked_input);
  // The last valid joint poses say nothing about the place of the hand after the reset.
  skeleton_ = {};
  simulation_->clear_targets();
  any_skeleton_ = reposition_asked_ = false;
  for (KnownObject& object : objects_) {
    release(object.assembly);
    object.seen = false;
  }
}

void HandLoop::take_skeleton(Nanoseconds now, const Skeleton& skeleton) {
  // The stamp of a tracker with another clock does not say whether a sample was taken before the reset.
  const bool timed = !options_.direct || is_plausible(skeleton.stamp.sample_time, now);
  if (timed && skeleton.stamp.sample_time <= reset_time_) return;
  if (options_.direct) {
    tracked_.add_sample(skeleton, now);
    return;
  }
  const bool newer =
      skeleton.stamp.epoch != skeleton_.stamp.epoch || skeleton.stamp.sequence > skeleton_.stamp.sequence;
  if (any_skeleton_ && !newer) {
    ++counters_.refused_order;
    return;
  }
  const Skeleton before = skeleton_;
  skeleton_ = skeleton;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    if (usable(skeleton.joints[j])) continue;
    if ((skeleton.joints[j].flags & kJointValid) != 0) ++counters_.refused_nonfinite;
    skeleton_.joints[j] = before.joints[j];  // keeps its last valid pose
  }
  const JointSample& wrist = skeleton_.joints[index(Joint::wrist)];
  if ((wrist.flags & kJointValid) == 0) return;
  const double jump = (to_vector(wrist.position) - simulation_->joint_pose(Joint::wrist).position).norm();
  if (!any_skeleton_ || jump > options_.reposition_distance || reposition_asked_) {
    simulation_->reposition(to_pose(wrist));
    settling_time_ = kSettlingTime;
    if (any_skeleton_) ++counters_.repositioned;
    reposition_asked_ = false;
    // Joints without a valid sample move rigidly with the wrist.
    const JointSample& wrist_before = before.joints[index(Joint::wrist)];
    const Pose displacement =
        (wrist_before.flags & kJointValid) != 0 ? to_pose(wrist) * to_pose(wrist_before).inverse() : Pose{};
    for (std::size_t j = 0; j < kJointCount; ++j) {
      if (usable(skeleton.joints[j])) continue;
      JointSample& joint = skeleton_.joints[j];
      const Pose moved = displacement * to_pose(joint);
      joint.position = to_wire(moved.position);
      joint.orientation = to_wire(moved.orientation);
      joint.linear_velocity = joint.angular_velocity = {};
    }
  }
  any_skeleton_ = true;
}

void HandLoop::set_targets(Nanoseconds now) {
  if (options_.direct) {
    const auto& targets = tracked_.targets(now);
    if ((tracked_.take_repositioned() || reposition_asked_) &&
        targets[static_cast<std::size_t>(index_of(Body::carpus))].valid) {
      if (any_skeleton_) ++counters_.repositioned;
      reposition_asked_ = false;
      simulation_->reposition(targets[static_cast<std::size_t>(index_of(Body::carpus))].pose);
      settling_time_ = kSettlingTime;
      any_skeleton_ = true;
    }
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      if (targets[b].valid) simulation_->set_target(static_cast<Body>(b), targets[b].pose, targets[b].velocity);
    }
    return;
  }
  if (!any_skeleton_) return;
  const double age = static_cast<double>(now - skeleton_.stamp.sample_time) * 1e-9;
  const double ahead = std::clamp(age, 0.0, options_.extrapolation_limit);
  const bool moving = age <= options_.extrapolation_limit;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const JointSample& joint = skeleton_.joints[index(joint_of(static_cast<Body>(b)))];
    if ((joint.flags & kJointValid) == 0) continue;
    const Twist velocity = twist_of(joint);
    simulation_->set_target(static_cast<Body>(b), extrapolated(to_pose(joint), velocity, ahead),
                            moving ? velocity : Twist{});
  }
}

void HandLoop::take_world(const WorldObjects& world) {
  if (world.stamp.sample_time <= reset_time_) return;
  for (KnownObject& object : objects_) object.listed = false;
  auto next = objects_.begin();  // worlds list their objects in the order in which they announced them
  for (const ObjectState& state : world.objects) {
    const auto is_it = [&state](const KnownObject& o) { return o.id == state.object; };
    const auto known =
        next != objects_.end() && is_it(*next) ? next : std::find_if(objects_.begin(), objects_.end(), is_it);
    if (known == objects_.end()) continue;
    known->listed = true;
    if (world.stamp.sample_time < known->description.stamp.sample_time) continue;
    if (!usable(state)) {
      ++counters_.refused_nonfinite;
      continue;
    }
    known->state = state;
    known->seen = true;
    next = std::next(known);
  }
  // Another world may have taken over with fewer objects. The previous world did not announce their removal.
  for (KnownObject& object : objects_) {
    if (object.listed || !object.seen) continue;
    release(object.assembly);
    object.seen = object.owned = false;
  }
  world_time_ = world.stamp.sample_time;
}

double HandLoop::extrapolation_of_world(Nanoseconds time) const {
  const double limit = options_.extrapolation_limit;
  return std::clamp(static_cast<double>(time - world_time_) * 1e-9, -limit, limit);
}

HandLoop::WorldStep HandLoop::world_step(Nanoseconds now) const {
  const double to_start = extrapolation_of_world(now - static_cast<Nanoseconds>(time_step_ * 1e9));
  return {to_start, (extrapolation_of_world(now) - to_start) / time_step_};
}

// Moves the twin in this step like the world's copy: from the copy's pose at the start of the step to its pose now.
void HandLoop::follow_world(const KnownObject& object, Nanoseconds now) {
  const WorldStep step = world_step(now);
  const Pose pose = to_pose(object.state.position, object.state.orientation);
  const Twist velocity = twist_of(object.state);
  simulation_->set_slot_motion(object.slot, extrapolated(pose, velocity, step.to_start),
                               {step.moving_part * velocity.linear, step.moving_part * velocity.angular});
}

void HandLoop::measure_distances() {
  BoneSegments bones;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    const Vector3 start = simulation_->joint_pose(joint_of(body)).position;
    bones.set(b, start, body == Body::forearm ? start : simulation_->joint_pose(end_joint_of(body)).position);
  }
  const Vector3 middle = simulation_->joint_pose(Joint::palm).position;
  const double reach = bones.reach(middle);
  double fastest = 0;  // m/s, of a bone
  for (std::size_t b = 0; b < kBodyCount; ++b)
    fastest = std::max(fastest, simulation_->joint_velocity(joint_of(static_cast<Body>(b))).linear.norm());
  for (KnownObject& object : objects_) {
    if (!object.seen) continue;
    const Vector3 position = to_vector(object.state.position);
    // Contact detection sweeps an object from its previous pose in the slot. Therefore an object needs a slot one step
    // before it can touch the skin.
    const double spin = to_vector(object.state.angular_velocity).norm();
    const double speed = fastest + to_vector(object.state.linear_velocity).norm() +
                         (spin > 0 ? spin * std::min(object.bounding_radius, (position - middle).norm() + reach) : 0);
    object.near = std::max(options_.near_distance, kSkinDistance + time_step_ * speed);
    // This cheap lower bound already excludes most objects.
    if ((position - middle).norm() - object.bounding_radius - reach > kForgetDistance * object.near) {
      object.distance = std::numeric_limits<double>::infinity();
    } else if (object.bounding_radius < 0.5) {
      object.distance = bones.distance(position) - object.bounding_radius;
    } else {  // the bounding sphere of a table would be near everything
      object.distance = bones.distance(to_pose(object.state.position, object.state.orientation), *object.shape);
    }
  }
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

// The nearest objects get the slots. An object gives up its slot to another one only if that one is nearer by more than
// kSlotPreference. Objects that the hand owns or touches keep their slots.
void HandLoop::give_slots(Nanoseconds now) {
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
      if (!get_slots_for_assembly(object, now)) ++counters_.objects_without_slot;
      continue;
    }
    const bool is_static = object.description.is_static != 0;
    int farthest = -1;
    for (int slot = 0; slot < simulation_->slot_count() && object.slot < 0; ++slot) {
      if (simulation_->slot_is_static(slot) != is_static) continue;
      const int holder = slot_object_[static_cast<std::size_t>(slot)];
      if (holder < 0) {
        object.slot = slot;
      } else if (!at(holder).owned && !simulation_->touched(slot) &&
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
      ++counters_.objects_without_slot;
      continue;
    }
    give_slot(static_cast<std::size_t>(o), object.slot, now);
  }
}

void HandLoop::give_slot(std::size_t o, int slot, Nanoseconds now) {
  KnownObject& object = objects_[o];
  object.slot = slot;
  slot_object_[static_cast<std::size_t>(slot)] = static_cast<int>(o);
  simulation_->set_slot(slot, object.mirrored);
  follow_world(object, now);
  object.owned = false;
  if (symmetric_ && object.description.is_static == 0) simulation_->make_dynamic(slot, Vector3::Zero());
}

/// All objects of an assembly get slots, or none does. Farther objects make room if that is enough for all.
bool HandLoop::get_slots_for_assembly(KnownObject& object, Nanoseconds now) {
  const std::uint32_t assembly = object.assembly;
  int needed = 0, joints = 0, free = 0;
  for (const KnownObject& each : objects_) {
    if (each.assembly != assembly) continue;
    if (!each.seen) return false;
    ++needed;
  }
  int places = simulation_->joint_count();
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
      return each.assembly == holder.assembly && each.slot >= 0 && (each.owned || simulation_->touched(each.slot));
    });
  };
  const auto gives_way = [&](const KnownObject& holder) {
    return !is_held(holder) && holder.distance > object.distance + kSlotPreference;
  };
  int possible = 0;
  for (int slot = 0; slot < simulation_->slot_count(); ++slot) {
    if (simulation_->slot_is_static(slot)) continue;
    const KnownObject* holder = holder_of(slot);
    if (holder == nullptr) ++free;
    if (holder == nullptr || gives_way(*holder)) ++possible;
  }
  if (possible < needed) return false;
  while (free < needed) {
    KnownObject* farthest = nullptr;
    for (int slot = 0; slot < simulation_->slot_count(); ++slot) {
      KnownObject* holder = simulation_->slot_is_static(slot) ? nullptr : holder_of(slot);
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
    while (simulation_->slot_is_static(slot) || holder_of(slot) != nullptr) ++slot;
    give_slot(o, slot, now);
  }
  return true;
}

/// A joint acts while the hand owns its objects.
void HandLoop::move_joints() {
  for (KnownJoint& joint : joints_) {
    const KnownObject* child = find_object(joint.child);
    const KnownObject* parent = find_object(joint.parent);
    const bool acts = child != nullptr && child->is_free && parent != nullptr &&
                      (parent->description.is_static != 0 ? parent->seen : parent->is_free);
    if (!acts && joint.place >= 0) {
      simulation_->clear_joint(joint.place);
      joint.place = -1;
    }
    if (!acts || joint.place >= 0) continue;
    for (int place = 0; place < simulation_->joint_count() && joint.place < 0; ++place) {
      if (std::none_of(joints_.begin(), joints_.end(), [place](const KnownJoint& j) { return j.place == place; }))
        joint.place = place;
    }
    if (joint.place < 0) continue;
    set_joint(joint, *parent, *child);
  }
}

void HandLoop::set_joint(const KnownJoint& joint, const KnownObject& parent, const KnownObject& child) {
  MirroredJoint mirrored;
  mirrored.law = joint.law;
  mirrored.child_slot = child.slot;
  mirrored.parent_slot = parent.description.is_static != 0 ? -1 : parent.slot;
  mirrored.parent_pose = to_pose(parent.state.position, parent.state.orientation);
  mirrored.parent_from_joint = joint.parent_from_joint;
  mirrored.child_from_joint = joint.child_from_joint;
  simulation_->set_joint(joint.place, mirrored);
}

void HandLoop::mirror_objects(Nanoseconds now) {
  if (objects_.empty()) return;
  measure_distances();
  give_slots(now);
  // A touch of one object counts for all that joints connect to it.
  for (const int o : slot_object_) {
    if (o < 0 || !simulation_->touched(objects_[static_cast<std::size_t>(o)].slot)) continue;
    const std::uint32_t assembly = objects_[static_cast<std::size_t>(o)].assembly;
    for (KnownObject& object : objects_)
      if (object.assembly == assembly && object.slot >= 0) object.last_touch = now;
  }
  for (const int o : slot_object_) {
    if (o >= 0) follow_or_own(objects_[static_cast<std::size_t>(o)], now);
  }
  for (const KnownObject& object : objects_) {
    if (!object.jointed || !object.is_free) continue;
    for (KnownObject& other : objects_) other.is_free |= other.assembly == object.assembly && other.slot >= 0;
  }
  for (const int o : slot_object_) {
    if (o >= 0) set_body(objects_[static_cast<std::size_t>(o)], now);
  }
  if (!joints_.empty() && !symmetric_) move_joints();
}

// Decides who owns the object. An object that the hand does not own follows the world.
void HandLoop::follow_or_own(KnownObject& object, Nanoseconds now) {
  const bool was_free = object.is_free;
  object.is_free = false;
  if (object.description.is_static != 0) {
    follow_world(object, now);
    return;
  }
  if (symmetric_) {
    const Pose pose = to_pose(object.state.position, object.state.orientation);
    const Twist velocity = twist_of(object.state);
    simulation_->set_object_target(object.slot, extrapolated(pose, velocity, extrapolation_of_world(now)), velocity);
    return;
  }
  const bool touched_lately =
      object.last_touch != 0 && static_cast<double>(now - object.last_touch) * 1e-9 <= options_.release_time;
  // The world does not know of the impulse of a first touch.
  if (!touched_lately || !(object.owned || was_free)) follow_world(object, now);
  object.owned = touched_lately;
  object.is_free = object.owned || (settling_time_ <= 0 && simulation_->may_touch(object.slot, time_step_));
}

// A free body has mass, inertia and gravity, and planes stop it. Otherwise its motion is prescribed. An object that the
// hand may touch is free already in the step of the first touch. So it takes up the impulse of the touch.
void HandLoop::set_body(KnownObject& object, Nanoseconds now) {
  if (object.description.is_static != 0 || symmetric_) return;
  if (!object.is_free) {
    if (simulation_->slot_mode(object.slot) == SlotMode::dynamic) simulation_->make_kinematic(object.slot);
    return;
  }
  simulation_->make_dynamic(object.slot, to_vector(object.state.gravity));
  // The planes are extrapolated to the start of the step, like the copies: one sample may be used in several steps.
  const WorldStep step = world_step(now);
  auto planes = object.state.planes;
  for (NeighbourPlane& plane : planes) {
    const Vector3 velocity = to_vector(plane.velocity);
    plane.point = to_wire(Vector3(to_vector(plane.point) + step.to_start * velocity));
    plane.velocity = to_wire(Vector3(step.moving_part * velocity));
  }
  simulation_->set_planes(object.slot, std::span(planes.items.data(), planes.size()));
}

HandOutput& HandLoop::step(Nanoseconds now, const HandInput& input, const RequestedOutputs& requested) {
  if (input.head != nullptr && options_.direct) tracked_.add_head_pose(*input.head);
  if (input.skeleton != nullptr) take_skeleton(now, *input.skeleton);
  if (input.world != nullptr) take_world(*input.world);
  set_targets(now);
  output_.valid = any_skeleton_;
  if (!any_skeleton_) return output_;
  mirror_objects(now);
  const double age = input_age_ms(now);
  if (age < 0 || age > options_.stale_after * 1e3) ++counters_.stale_steps;
  simulation_->enable_ledger(requested.ledger);
  output_.report = simulation_->step(time_step_);
  settling_time_ = std::max(0.0, settling_time_ - time_step_);
  if (!output_.report.state_changed) ++counters_.failed_steps;
  if (output_.report.status == StepStatus::budget_spent) ++counters_.budget_steps;
  if (output_.report.chord) ++counters_.chord_steps;
  write_outputs(now, requested);
  return output_;
}

double HandLoop::input_age_ms(Nanoseconds now) const {
  if (options_.direct) {
    const double age = tracked_.age(now);
    return age < 0 ? -1.0 : age * 1e3;
  }
  return any_skeleton_ ? static_cast<double>(now - skeleton_.stamp.sample_time) * 1e-6 : -1.0;
}

void HandLoop::write_outputs(Nanoseconds now, const RequestedOutputs& requested) {
  Stamp stamp;
  stamp.sequence = output_.simulated.stamp.sequence + 1;
  stamp.sample_time = now;
  stamp.chain = skeleton_.stamp.chain;
  if (options_.direct) {
    const Stamp& tracked = tracked_.stamp();
    stamp.chain = tracked.chain;
    if (stamp.chain.tracker_sample == 0) stamp.chain.tracker_sample = tracked.sample_time;
    stamp.chain.tracked_published = tracked.publish_time;
  }

  Skeleton& simulated = output_.simulated;
  simulated.stamp = stamp;
  simulated.source = skeleton_.source;
  simulated.confidence = options_.direct ? tracked_.confidence() : skeleton_.confidence;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Joint joint = static_cast<Joint>(j);
    const Pose pose = simulation_->joint_pose(joint);
    const Twist velocity = simulation_->joint_velocity(joint);
    simulated.joints[j] = {to_wire(pose.position),
                           to_wire(pose.orientation),
                           to_wire(velocity.linear),
                           to_wire(velocity.angular),
                           simulation_->hand().joint_radii[j],
                           kJointValid,
                           1};
  }

  ObjectCoupling& coupling = output_.coupling;
  coupling.stamp = stamp;
  coupling.mode = symmetric_ ? 1 : 0;
  coupling.step_period = time_step_;
  coupling.twins.clear();
  for (const KnownObject& object : objects_) {
    if (object.slot < 0 || object.description.is_static != 0) continue;
    const Pose pose = simulation_->slot_pose(object.slot);
    const Twist velocity = simulation_->slot_velocity(object.slot);
    const Wrench contact = simulation_->contact_wrench(object.slot);
    const Wrench spring =
        symmetric_ ? simulation_->object_coupling_wrench(object.slot) : simulation_->joint_wrench(object.slot);
    coupling.twins.push_back({object.id, object.owned ? 1u : 0u, to_wire(pose.position), to_wire(pose.orientation),
                              to_wire(velocity.linear), to_wire(velocity.angular), to_wire(contact.force),
                              to_wire(contact.torque), to_wire(spring.force), to_wire(spring.torque)});
  }

  if (requested.contacts) {
    output_.contacts.stamp = stamp;
    simulation_->write_contacts(output_.contacts);
  }
  if (requested.surface) {
    TissueSurface& surface = output_.surface;
    surface.stamp = stamp;
    const Vector3 wrist = simulation_->joint_pose(Joint::wrist).position;
    surface.wrist_position = to_wire(wrist);
    const auto& nodes = simulation_->state().node_positions;
    surface.nodes.clear();
    for (Eigen::Index n = 0; n < nodes.cols(); ++n) {
      const Eigen::Vector3f relative = (nodes.col(n) - wrist).cast<float>();
      surface.nodes.push_back({relative.x(), relative.y(), relative.z()});
    }
  }
  if (requested.bone_wrench && options_.direct) {
    BoneWrench& wrench = output_.bone_wrench;
    wrench.stamp = stamp;
    wrench.stamp.chain.simulated_published = wrench.stamp.chain.wrench_published = now;
    wrench.simulated_valid = 1;
    const auto& targets = tracked_.targets(now);
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const Body body = static_cast<Body>(b);
      const Pose pose = simulation_->joint_pose(joint_of(body));
      const Wrench coupled = simulation_->coupling_wrench(body);
      // The coupling acts on the user's bone with the opposite sign of its action on the simulated bone.
      wrench.bones[b] = {to_wire(targets[b].pose.position),
                         to_wire(targets[b].pose.orientation),
                         to_wire(targets[b].pose.position),
                         to_wire(targets[b].pose.orientation),
                         to_wire(pose.position),
                         to_wire(pose.orientation),
                         to_wire(Vector3(-coupled.force)),
                         to_wire(Vector3(-coupled.torque)),
                         to_wire(simulation_->bone_contact_forces()[b])};
    }
  }
}

MessageReply HandLoop::answer(const Message& message, const std::string& module) {
  if (!is_addressed(message, module)) return reply_to(message, module, kReplyIgnored, "not for this module");
  if (get_text(message.key) == "reposition") {
    reposition_asked_ = true;
    return reply_to(message, module, kReplyApplied, "the hand goes to its target at once");
  }
  return reply_to(message, module, kReplyIgnored, "unknown key; known: reposition");
}

void HandLoop::fill_status(LoopStatus& status, Nanoseconds now) const {
  const StepReport& report = output_.report;
  status.input_age_ms = input_age_ms(now);
  status.residual = report.residual;
  status.iterations = static_cast<std::uint32_t>(report.iterations);
  status.solver_status = static_cast<std::uint32_t>(report.status);
  status.contact_count = static_cast<std::uint32_t>(simulation_->contact_count());
  status.inverted_elements = static_cast<std::uint32_t>(simulation_->inverted_elements());
  status.penetration = simulation_->deepest_penetration();
  status.coupling_stretch = simulation_->largest_coupling_stretch();
  simulation_->for_each_stored(
      [&status](std::string_view name, double joules) { add_named(status.energies, name, joules); });
  if (simulation_->ledger().started()) {
    simulation_->ledger().for_each_row(
        [&status](std::string_view name, double joules) { add_named(status.ledger, name, joules); });
  }
  add_counter(status, "refused_nonfinite",
              static_cast<double>(counters_.refused_nonfinite + tracked_.counters().refused_nonfinite));
  add_counter(status, "refused_order",
              static_cast<double>(counters_.refused_order + tracked_.counters().refused_order));
  add_counter(status, "repositioned", static_cast<double>(counters_.repositioned));
  add_counter(status, "stale_steps", static_cast<double>(counters_.stale_steps));
  add_counter(status, "failed_steps", static_cast<double>(counters_.failed_steps));
  add_counter(status, "budget_steps", static_cast<double>(counters_.budget_steps));
  const WorkCounters work = simulation_->work();
  add_counter(status, "tissue_elements", static_cast<double>(work.tissue_elements));
  add_counter(status, "contact_queries", static_cast<double>(work.contact_queries));
  add_counter(status, "factorised_steps", static_cast<double>(work.factorised_steps));
  add_counter(status, "chord_steps", static_cast<double>(counters_.chord_steps));
  add_counter(status, "objects_without_slot", static_cast<double>(counters_.objects_without_slot));
  add_counter(status, "untangled_nodes", static_cast<double>(simulation_->untangled_nodes()));
}

HandDescription HandLoop::description() const {
  const HandModel& hand = simulation_->hand();
  HandDescription out;
  out.hand = key_;
  out.node_count = static_cast<std::uint32_t>(hand.node_count());
  for (const SkinVertex& vertex : hand.skin_vertices) {
    const auto& nodes = hand.tetrahedra[static_cast<std::size_t>(vertex.tetrahedron)];
    std::array<std::uint32_t, 4> carriers{};
    for (std::size_t k = 0; k < 4; ++k) carriers[k] = static_cast<std::uint32_t>(nodes[k]);
    out.vertex_nodes.push_back(carriers);
    out.vertex_weights.push_back(vertex.weights);
  }
  for (const auto& triangle : hand.skin_triangles) {
    out.triangles.push_back({static_cast<std::uint32_t>(triangle[0]), static_cast<std::uint32_t>(triangle[1]),
                             static_cast<std::uint32_t>(triangle[2])});
  }
  return out;
}

}  // namespace softhand
