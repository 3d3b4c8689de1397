#include "hand/object_mirror.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "math/rotation.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "messages/newest_couplings.hpp"

namespace softhand {
namespace {

bool is_unit(double norm) { return std::abs(norm - 1.0) < 0.01; }

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
bool usable(const ContactPatch& patch) {
  const auto between = [](double x, double least, double most) { return x >= least && x <= most; };
  return moderate(patch.point) && is_unit(to_vector(patch.normal).norm()) && moderate(patch.force) &&
         moderate(patch.torque) && moderate(patch.linear_velocity) && moderate(patch.angular_velocity) &&
         between(patch.stiffness, 0, 1e9) && between(patch.radius, 0, 1) && between(patch.friction, 0, 1e9);
}
bool usable(const ObjectTwin& twin) {
  return moderate(twin.position) && is_unit(to_quaternion(twin.orientation).norm()) && moderate(twin.linear_velocity) &&
         moderate(twin.angular_velocity);
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
  if (description.object == 0 || description.object >= kFirstSoftObject)
    throw std::invalid_argument("the id is " + std::to_string(description.object) + ", expected 1 to " +
                                std::to_string(kFirstSoftObject - 1));
  constexpr double kMost = 1e9;  // kg, kg m^2, 1: far above the range of a scene file, far below overflow
  demand("friction", description.friction, description.friction >= 0 && description.friction <= kMost, "0 to 1e9");
  if (description.is_static != 0) return;
  demand("mass", description.mass, description.mass > 0 && description.mass <= kMost,
         "above 0 and at most 1e9 kg if the object can move");
  for (const double inertia : description.inertia)
    demand("inertia", inertia, inertia > 0 && inertia <= kMost,
           "above 0 and at most 1e9 kg m^2 if the object can move");
}

Pose extrapolated(const Pose& pose, const Twist& velocity, double seconds) {
  return increment(pose, seconds * velocity.linear, seconds * velocity.angular);
}

Twist twist_of(const ObjectState& object) {
  return {to_vector(object.linear_velocity), to_vector(object.angular_velocity)};
}

// Whether an object that does not move is no longer where it was.
bool is_elsewhere(const ObjectState& before, const ObjectState& now) {
  constexpr double kMetres = 1e-4, kRadians = 1e-3;
  const double turned = to_quaternion(before.orientation).angularDistance(to_quaternion(now.orientation));
  return (to_vector(now.position) - to_vector(before.position)).norm() > kMetres || turned > kRadians;
}

constexpr double kHandStale = 0.1;     // s; contacts of another hand that are older do not act
constexpr double kFarthestStep = 0.1;  // m; an object that moves farther in a step was put elsewhere

}  // namespace

ObjectMirror::ObjectMirror(HandSimulation& simulation, const HandOptions& options, HandKey hand, bool symmetric)
    : simulation_(simulation),
      options_(options),
      hand_(hand),
      symmetric_(symmetric),
      time_step_(1.0 / options.rate_hz),
      slot_object_(static_cast<std::size_t>(simulation.slot_count()), -1) {
  objects_.reserve(kMaxObjects);
  joints_.reserve(kMaxObjectJoints);
  waiting_.reserve(kMaxObjects);
}

void ObjectMirror::describe_object(const ObjectDescription& description,
                                   std::shared_ptr<const ShapeGeometry> file_shape) {
  auto known = std::find_if(objects_.begin(), objects_.end(),
                            [&description](const KnownObject& o) { return o.id == description.object; });
  // A new process of the world describes its table again. What lies on it must not fall before the first sample.
  const bool stays = known != objects_.end() && known->seen && description.removed == 0 && description.is_static != 0 &&
                     known->description.is_static != 0 && known->description.friction == description.friction &&
                     is_same(known->description.shape, description.shape);
  std::shared_ptr<const ShapeGeometry> shape;
  if (description.removed == 0) {  // all that may be refused, before anything changes
    check(description);
    if (known == objects_.end() && objects_.size() == kMaxObjects)
      throw std::invalid_argument("objects: at most " + std::to_string(kMaxObjects));
    // Loading a large hull takes longer than a step may take, so an unchanged shape is kept.
    const bool has_shape = known != objects_.end() && is_same(known->description.shape, description.shape);
    if (!has_shape && file_shape == nullptr && load_shape_ && !description.shape.file.empty())
      file_shape = load_shape_(description.shape.file[0]);
    shape = has_shape               ? known->shape
            : file_shape != nullptr ? std::move(file_shape)
                                    : std::make_shared<const ShapeGeometry>(description.shape);
  }
  if (known != objects_.end() && !stays) release(known->assembly);
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
  if (known == objects_.end()) known = objects_.emplace(objects_.end());
  known->id = description.object;
  known->description = description;
  if (stays) return;
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

void ObjectMirror::describe_joint(const ObjectJointDescription& description) {
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

void ObjectMirror::take_world(const WorldObjects& world) {
  for (KnownObject& object : objects_) object.listed = false;
  knows_world_ = true;
  auto next = objects_.begin();  // worlds list their objects in the order in which they announced them
  for (const ObjectState& state : world.objects) {
    const auto is_it = [&state](const KnownObject& o) { return o.id == state.object; };
    const auto known =
        next != objects_.end() && is_it(*next) ? next : std::find_if(objects_.begin(), objects_.end(), is_it);
    if (known == objects_.end()) {
      knows_world_ = false;
      continue;
    }
    known->listed = true;
    if (world.stamp.sample_time < known->description.stamp.sample_time) continue;
    if (!usable(state)) {
      ++counters_.refused_nonfinite;
      continue;
    }
    // An object that does not move can be described at another place.
    const bool is_first = world_time_ < known->description.stamp.sample_time;
    if (is_first && known->seen && known->description.is_static != 0 && is_elsewhere(known->state, state))
      release(known->assembly);
    known->state = state;
    known->seen = true;
    next = std::next(known);
  }
  // Another world may have taken over with fewer objects. The previous world did not announce their removal.
  for (KnownObject& object : objects_) {
    if (object.listed && !object.seen) knows_world_ = false;
    if (object.listed || !object.seen) continue;
    release(object.assembly);
    object.seen = object.owned = false;
  }
  world_time_ = world.stamp.sample_time;
}

void ObjectMirror::begin_step(Nanoseconds now, bool settles, std::span<const ObjectCoupling> other_hands) {
  other_hands_ = other_hands;
  simulation_.clear_other_hands();
  if (objects_.empty()) return;
  measure_distances();
  give_slots(now);
  // A touch of one object counts for all that joints connect to it.
  for (const int o : slot_object_) {
    if (o < 0 || !simulation_.touched(objects_[static_cast<std::size_t>(o)].slot)) continue;
    const std::uint32_t assembly = objects_[static_cast<std::size_t>(o)].assembly;
    for (KnownObject& object : objects_)
      if (object.assembly == assembly && object.slot >= 0) object.last_touch = now;
  }
  if (!settles && !symmetric_) simulation_.look_ahead(time_step_);
  for (const int o : slot_object_) {
    if (o >= 0) follow_or_own(objects_[static_cast<std::size_t>(o)], now, settles);
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

/// Ends the joints of an assembly and gives up its slots. The world moves its objects again.
void ObjectMirror::release(std::uint32_t assembly) {
  for (KnownObject& object : objects_) {
    if (object.assembly != assembly) continue;
    for (KnownJoint& joint : joints_) {
      if (joint.place < 0 || (joint.parent != object.id && joint.child != object.id)) continue;
      simulation_.clear_joint(joint.place);
      joint.place = -1;
    }
    clear_slot(object);
    object.owned = false;
    object.last_touch = 0;
  }
}

void ObjectMirror::find_assemblies() {
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

ObjectMirror::KnownObject* ObjectMirror::find_object(std::uint32_t id) {
  const auto known = std::find_if(objects_.begin(), objects_.end(), [id](const KnownObject& o) { return o.id == id; });
  return known == objects_.end() ? nullptr : &*known;
}

double ObjectMirror::extrapolation(Nanoseconds sample_time, Nanoseconds time) const {
  const double limit = options_.extrapolation_limit;
  return std::clamp((static_cast<double>(time) - static_cast<double>(sample_time)) * 1e-9, -limit, limit);
}

ObjectMirror::SampleStep ObjectMirror::sample_step(Nanoseconds sample_time, Nanoseconds now) const {
  const double to_start = extrapolation(sample_time, now - static_cast<Nanoseconds>(time_step_ * 1e9));
  return {to_start, (extrapolation(sample_time, now) - to_start) / time_step_};
}

// Moves the twin in this step like the sampled body: from its pose at the start of the step to its pose now.
void ObjectMirror::follow(const KnownObject& object, Nanoseconds now, Nanoseconds sample_time, const Pose& pose,
                          const Twist& velocity) {
  const SampleStep step = sample_step(sample_time, now);
  simulation_.set_slot_motion(object.slot, extrapolated(pose, velocity, step.to_start),
                              {step.moving_part * velocity.linear, step.moving_part * velocity.angular});
}

void ObjectMirror::follow_world(const KnownObject& object, Nanoseconds now) {
  follow(object, now, world_time_, to_pose(object.state.position, object.state.orientation), twist_of(object.state));
}

/// A joint acts while the hand owns its objects.
void ObjectMirror::move_joints() {
  for (KnownJoint& joint : joints_) {
    const KnownObject* child = find_object(joint.child);
    const KnownObject* parent = find_object(joint.parent);
    const bool acts = child != nullptr && child->is_free && parent != nullptr &&
                      (parent->description.is_static != 0 ? parent->seen : parent->is_free);
    if (!acts && joint.place >= 0) {
      simulation_.clear_joint(joint.place);
      joint.place = -1;
    }
    if (!acts || joint.place >= 0) continue;
    for (int place = 0; place < simulation_.joint_count() && joint.place < 0; ++place) {
      if (std::none_of(joints_.begin(), joints_.end(), [place](const KnownJoint& j) { return j.place == place; }))
        joint.place = place;
    }
    if (joint.place < 0) continue;
    set_joint(joint, *parent, *child);
  }
}

void ObjectMirror::set_joint(const KnownJoint& joint, const KnownObject& parent, const KnownObject& child) {
  MirroredJoint mirrored;
  mirrored.law = joint.law;
  mirrored.child_slot = child.slot;
  mirrored.parent_slot = parent.description.is_static != 0 ? -1 : parent.slot;
  mirrored.parent_pose = to_pose(parent.state.position, parent.state.orientation);
  mirrored.parent_from_joint = joint.parent_from_joint;
  mirrored.child_from_joint = joint.child_from_joint;
  simulation_.set_joint(joint.place, mirrored);
}

// Decides who owns the object. An object that the hand does not own follows the world.
void ObjectMirror::follow_or_own(KnownObject& object, Nanoseconds now, bool settles) {
  const bool was_free = object.is_free;
  object.is_free = false;
  if (object.description.is_static != 0) {
    follow_world(object, now);
    return;
  }
  if (symmetric_) {
    const Pose pose = to_pose(object.state.position, object.state.orientation);
    const Twist velocity = twist_of(object.state);
    simulation_.set_object_target(object.slot, extrapolated(pose, velocity, extrapolation(world_time_, now)), velocity);
    return;
  }
  if (is_guest(object, now)) {
    follow_owner(object, now);
    object.owned = false;
    return;
  }
  const std::optional<double> untouched = object.last_touch == 0 ? std::nullopt : age_of(object.last_touch, now);
  const bool touched_lately = untouched && *untouched <= options_.release_time;
  // The world does not know of the impulse of a first touch.
  if (!touched_lately || !(object.owned || was_free)) follow_world(object, now);
  object.owned = touched_lately;
  object.is_free = object.owned || (!settles && simulation_.may_touch(object.slot));
}

// The coupling of the hand that owns the object for the world, if it is another hand and its coupling is fresh.
const ObjectCoupling* ObjectMirror::owner_of(const KnownObject& object, Nanoseconds now) const {
  const HandKey owner{object.state.owner_user, object.state.owner_side};
  for (const ObjectCoupling& other : other_hands_) {
    const std::optional<double> age = age_of(other.stamp.sample_time, now);
    if (other.hand == owner && age && *age <= kHandStale) return &other;
  }
  return nullptr;
}

// Whether another hand owns the object. This hand gives it up when that hand claims it, not before, so that the object
// is never without an owner.
bool ObjectMirror::is_guest(const KnownObject& object, Nanoseconds now) const {
  if (object.state.owned == 0 || HandKey{object.state.owner_user, object.state.owner_side} == hand_) return false;
  const ObjectCoupling* owner = owner_of(object, now);
  if (!object.owned || owner == nullptr) return true;
  const ObjectTwin* twin = twin_of(*owner, object.id);
  return twin != nullptr && twin->owned != 0;
}

// The owner's twin is where the forces of both hands act. The world's copy follows it later.
void ObjectMirror::follow_owner(const KnownObject& object, Nanoseconds now) {
  const ObjectCoupling* owner = owner_of(object, now);
  const ObjectTwin* twin = owner == nullptr ? nullptr : twin_of(*owner, object.id);
  if (twin == nullptr || twin->owned == 0 || !usable(*twin)) {
    follow_world(object, now);
    return;
  }
  const Pose pose = to_pose(twin->position, twin->orientation);
  // A touched object is extrapolated as if it moved with this hand. Its own velocity answers to this hand's forces, and
  // extrapolation would amplify the answer.
  const bool touches = simulation_.touched(object.slot);
  const Twist velocity = touches ? simulation_.carrying_velocity(pose.position)
                                 : Twist{to_vector(twin->linear_velocity), to_vector(twin->angular_velocity)};
  // A touched object moves on from where the last step left it. The pressure at the start of a step bounds its
  // friction. A jump to the extrapolated start would change this pressure by the error of the extrapolation, and the
  // grip would slip.
  const Pose last = simulation_.slot_pose(object.slot);
  const Pose next = extrapolated(pose, velocity, extrapolation(owner->stamp.sample_time, now));
  if (touches && (next.position - last.position).norm() < kFarthestStep) {
    const Vector3 moved = next.position - last.position,
                  turned = rotation_log(next.orientation * last.orientation.conjugate());
    simulation_.set_slot_motion(object.slot, last, {moved / time_step_, turned / time_step_});
    return;
  }
  follow(object, now, owner->stamp.sample_time, pose, velocity);
}

// The contacts of the other hands act on an object that this hand owns.
void ObjectMirror::take_patches(const KnownObject& object, Nanoseconds now) {
  for (const ObjectCoupling& other : other_hands_) {
    const std::optional<double> age = age_of(other.stamp.sample_time, now);
    const ObjectTwin* twin = twin_of(other, object.id);
    if (!age || *age > kHandStale || twin == nullptr) continue;
    const Pose pose = to_pose(twin->position, twin->orientation);
    const bool is_pose = usable(*twin);
    for (const ContactPatch& patch : other.patches) {
      if (patch.object != object.id) continue;
      if (is_pose && usable(patch)) {
        simulation_.add_other_hand(object.slot, patch, pose, std::clamp(*age, 0.0, options_.extrapolation_limit));
      } else {
        ++counters_.refused_nonfinite;
      }
    }
  }
}

// A free body has mass, inertia and gravity, and planes stop it. Otherwise its motion is prescribed. An object that the
// hand may touch is free already in the step of the first touch. So it takes up the impulse of the touch.
void ObjectMirror::set_body(KnownObject& object, Nanoseconds now) {
  if (object.description.is_static != 0 || symmetric_) return;
  if (!object.is_free) {
    if (simulation_.slot_mode(object.slot) == SlotMode::dynamic) simulation_.make_kinematic(object.slot);
    return;
  }
  simulation_.make_dynamic(object.slot, to_vector(object.state.gravity));
  // The planes are extrapolated to the start of the step, like the copies: one sample may be used in several steps.
  const SampleStep step = sample_step(world_time_, now);
  auto planes = object.state.planes;
  for (NeighbourPlane& plane : planes) {
    const Vector3 velocity = to_vector(plane.velocity);
    plane.point = to_wire(Vector3(to_vector(plane.point) + step.to_start * velocity));
    plane.velocity = to_wire(Vector3(step.moving_part * velocity));
  }
  simulation_.set_planes(object.slot, std::span(planes.items.data(), planes.size()));
  take_patches(object, now);
}

void ObjectMirror::release_all() {
  for (KnownObject& object : objects_) {
    release(object.assembly);
    object.seen = false;
  }
  knows_world_ = false;
}

void ObjectMirror::write_twins(ObjectCoupling& out) const {
  out.twins.clear();
  out.patches.clear();
  for (const KnownObject& object : objects_) {
    if (object.slot < 0 || object.description.is_static != 0) continue;
    const Pose pose = simulation_.slot_pose(object.slot);
    const Twist velocity = simulation_.slot_velocity(object.slot);
    const Wrench contact = simulation_.contact_wrench(object.slot);
    Wrench spring =
        symmetric_ ? simulation_.object_coupling_wrench(object.slot) : simulation_.joint_wrench(object.slot);
    const Wrench others = simulation_.other_hands_wrench(object.slot);
    spring.force += others.force;
    spring.torque += others.torque;
    out.twins.push_back({object.id, object.owned ? 1u : 0u, to_wire(pose.position), to_wire(pose.orientation),
                         to_wire(velocity.linear), to_wire(velocity.angular), to_wire(contact.force),
                         to_wire(contact.torque), to_wire(spring.force), to_wire(spring.torque)});
    const auto has_it = [&object](const ObjectCoupling& other) { return twin_of(other, object.id) != nullptr; };
    if (!symmetric_ && std::any_of(other_hands_.begin(), other_hands_.end(), has_it))
      simulation_.write_patches(object.slot, out.patches);
  }
}

void ObjectMirror::take_state(const ObjectMirror& other) {
  objects_ = other.objects_;
  joints_ = other.joints_;
  slot_object_ = other.slot_object_;
  world_time_ = other.world_time_;
  knows_world_ = other.knows_world_;
  counters_ = other.counters_;
}

template <typename Object, typename Visit>
void ObjectMirror::visit_state(Object& object, Visit&& visit) {
  visit(object.state);
  visit(object.seen);
  visit(object.listed);
  visit(object.distance);
  visit(object.near);
  visit(object.slot);
  visit(object.owned);
  visit(object.is_free);
  visit(object.last_touch);
}

void ObjectMirror::save(ByteWriter& out) const {
  out.write(static_cast<std::uint32_t>(objects_.size()));
  for (const KnownObject& object : objects_) {
    out.write(object.description);
    visit_state(object, [&out](const auto& value) { out.write(value); });
  }
  out.write(joints_);
  out.write(slot_object_);
  out.write(world_time_);
  out.write(knows_world_);
  out.write(counters_);
}

void ObjectMirror::load(ByteReader& in) {
  if (!objects_.empty() || !joints_.empty()) throw std::logic_error("ObjectMirror: `load` is for a new mirror");
  const auto count = in.take<std::uint32_t>();
  for (std::uint32_t n = 0; n < count; ++n) {
    describe_object(in.take<ObjectDescription>(), nullptr);
    KnownObject& object = objects_.back();
    visit_state(object, [&in](auto& value) { in.read(value); });
    if (object.slot >= simulation_.slot_count()) throw std::runtime_error("the saved state has more slots");
  }
  in.read(joints_);
  in.read(slot_object_);
  in.read(world_time_);
  in.read(knows_world_);
  in.read(counters_);
  find_assemblies();
  for (const KnownObject& object : objects_) {
    if (object.slot < 0) continue;
    simulation_.set_slot(object.slot, object.mirrored);
    if (object.is_free || (symmetric_ && object.description.is_static == 0))
      simulation_.make_dynamic(object.slot, symmetric_ ? Vector3(Vector3::Zero()) : to_vector(object.state.gravity));
  }
  for (const KnownJoint& joint : joints_) {
    const KnownObject* parent = find_object(joint.parent);
    const KnownObject* child = find_object(joint.child);
    if (joint.place >= 0 && parent != nullptr && child != nullptr) set_joint(joint, *parent, *child);
  }
}

}  // namespace softhand
