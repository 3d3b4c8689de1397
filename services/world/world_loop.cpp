#include "world/world_loop.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <tuple>

#include "device/answer.hpp"
#include "math/rotation.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "messages/newest_couplings.hpp"
#include "world/follow.hpp"

namespace softhand {
namespace {

constexpr double kForceStall = 0.030;  // s; older contact forces are ignored
constexpr double kHandOver = 0.200;    // s; a hand that does not claim the object until then does not become its owner
// s after a move, and after the first coupling of a hand. Until then, claims by hands that may not know the place are
// ignored.
constexpr double kClaimHoldoff = 0.200;
constexpr std::size_t kMostHands = 64;  // as many as a reader of couplings follows
constexpr double kAbsurd = 1e4;         // m, m/s, rad/s; larger values are refused
constexpr double kAbsurdForce = 1e6;    // N, N m

bool is_plausible(const ObjectTwin& twin) {
  const auto within = [](const Vec3& values, double limit) {  // false for NaN
    return std::all_of(values.begin(), values.end(), [limit](double x) { return std::abs(x) < limit; });
  };
  const double norm = to_quaternion(twin.orientation).norm();
  return within(twin.position, kAbsurd) && within(twin.linear_velocity, kAbsurd) &&
         within(twin.angular_velocity, kAbsurd) && within(twin.contact_force, kAbsurdForce) &&
         within(twin.contact_torque, kAbsurdForce) && within(twin.coupling_force, kAbsurdForce) &&
         within(twin.coupling_torque, kAbsurdForce) && norm > 0.5 && norm < 2;
}

bool before(const HandKey& a, const HandKey& b) { return a.user != b.user ? a.user < b.user : a.side < b.side; }

}  // namespace

WorldLoop::WorldLoop(const WorldOptions& options, const std::vector<ObjectOptions>& objects, double hand_step,
                     const std::vector<JointOptions>& joints, const std::vector<SoftObject>& soft_objects)
    : options_(options),
      step_(1 / options.rate_hz),
      gravity_(options.gravity[0], options.gravity[1], options.gravity[2]),
      engine_(make_physics_engine(options.engine)),
      hand_step_(hand_step),
      output_(std::make_unique<WorldOutput>()) {
  std::string wrong;
  std::vector<std::string> reasons = check_world(options, objects, hand_step, joints);
  for (const std::string& text : check_soft_objects(options, soft_objects, hand_step)) reasons.push_back(text);
  for (const std::string& text : reasons) wrong += (wrong.empty() ? "" : "\n") + text;
  if (!wrong.empty()) throw std::invalid_argument(wrong);
  hands_.reserve(kMostHands);
  objects_.reserve(objects.size());
  for (const ObjectOptions& from : objects) {
    Object& object = objects_.emplace_back();
    object.options = from;
    object.solid = make_solid(from);
    object.start =
        Pose{to_vector(from.position), to_quaternion(from.orientation).normalized()} * object.solid.body_frame;
    object.dynamic = from.mass > 0;
    ObjectDescription& description = descriptions_.emplace_back();
    description.object = static_cast<std::uint32_t>(objects_.size());
    set_text(description.name, from.name);
    description.is_static = object.dynamic ? 0 : 1;
    description.mass = from.mass;
    description.inertia = to_wire(object.solid.inertia);
    description.friction = from.friction;
    description.shape = object.solid.shape;
    description.stamp.sequence = ++descriptions_version_;
    insert(objects_.size() - 1);
  }
  make_joints(joints);
  add_copies(soft_objects);
}

WorldLoop::~WorldLoop() = default;

Vector3 WorldLoop::gravity_of(const Object& object) const {
  return object.weightless || !object.dynamic ? Vector3(Vector3::Zero()) : gravity_;
}

void WorldLoop::make_joints(const std::vector<JointOptions>& joints) {
  joints_.reserve(joints.size());
  for (const JointOptions& from : joints) {
    Joint& joint = joints_.emplace_back();
    joint.options = from;
    joint.engine.law = joint_law(from);
    joint.engine.parent = static_cast<std::size_t>(find(from.parent) - objects_.data());
    joint.engine.child = static_cast<std::size_t>(find(from.child) - objects_.data());
    const Object& parent = objects_[joint.engine.parent];
    const Object& child = objects_[joint.engine.child];
    std::tie(joint.engine.parent_from_joint, joint.engine.child_from_joint) =
        joint_frames(from, parent.options, parent.solid, child.options, child.solid);
    ObjectJointDescription& description = joint_descriptions_.emplace_back();
    description.joint = static_cast<std::uint32_t>(joints_.size());
    set_text(description.name, from.name);
    description.parent = static_cast<std::uint32_t>(joint.engine.parent + 1);
    description.child = static_cast<std::uint32_t>(joint.engine.child + 1);
    description.parent_position = to_wire(joint.engine.parent_from_joint.position);
    description.parent_orientation = to_wire(joint.engine.parent_from_joint.orientation);
    description.child_position = to_wire(joint.engine.child_from_joint.position);
    description.child_orientation = to_wire(joint.engine.child_from_joint.orientation);
    set_law(description, joint.engine.law);
    description.stamp.sequence = ++descriptions_version_;
  }
  for (std::size_t slot = 0; slot < objects_.size(); ++slot) attach(slot);
  find_assemblies();
}

/// `returning`: an object that was removed and counts as present.
void WorldLoop::find_assemblies(std::optional<std::size_t> returning) {
  const auto is_there = [&](std::size_t slot) { return objects_[slot].present || slot == returning; };
  for (std::size_t slot = 0; slot < objects_.size(); ++slot) objects_[slot].assembly = slot;
  for (bool changed = true; changed;) {
    changed = false;
    for (const Joint& joint : joints_) {
      Object& parent = objects_[joint.engine.parent];
      Object& child = objects_[joint.engine.child];
      if (!parent.dynamic || parent.assembly == child.assembly) continue;
      if (!is_there(joint.engine.parent) || !is_there(joint.engine.child)) continue;
      parent.assembly = child.assembly = std::min(parent.assembly, child.assembly);
      changed = true;
    }
  }
}

/// Adds the joints of an object whose other object is present too. Describes those that were removed.
void WorldLoop::attach(std::size_t slot) {
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    Joint& joint = joints_[j];
    if (joint.present || (joint.engine.parent != slot && joint.engine.child != slot) ||
        !objects_[joint.engine.parent].present || !objects_[joint.engine.child].present)
      continue;
    joint.engine.coordinate = softhand::joint_coordinate(joint.engine.law, pose_of(joint));
    engine_->add_joint(j, joint.engine);
    joint.present = true;
    if (joint_descriptions_[j].removed == 0) continue;
    joint_descriptions_[j].removed = 0;
    joint_descriptions_[j].stamp.sequence = ++descriptions_version_;
  }
}

void WorldLoop::detach(std::size_t slot) {
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    Joint& joint = joints_[j];
    if (!joint.present || (joint.engine.parent != slot && joint.engine.child != slot)) continue;
    engine_->remove_joint(j);
    joint.present = false;
    joint.engine.reaction = 0;
  }
}

bool WorldLoop::are_jointed(std::size_t one, std::size_t other) const {
  return std::any_of(joints_.begin(), joints_.end(), [one, other](const Joint& joint) {
    return joint.present && ((joint.engine.parent == one && joint.engine.child == other) ||
                             (joint.engine.parent == other && joint.engine.child == one));
  });
}

JointPose WorldLoop::pose_of(const Joint& joint) const {
  return {objects_[joint.engine.parent].pose, objects_[joint.engine.child].pose, joint.engine.parent_from_joint,
          joint.engine.child_from_joint};
}

const WorldLoop::Joint& WorldLoop::find_joint(std::string_view name) const {
  for (const Joint& joint : joints_)
    if (joint.options.name == name) return joint;
  throw std::invalid_argument("no joint has the name '" + std::string(name) + "'");
}

double WorldLoop::coordinate_of(const Joint& joint) const {
  return softhand::joint_coordinate(joint.engine.law, pose_of(joint), joint.engine.coordinate);
}

double WorldLoop::joint_coordinate(std::string_view name) const { return coordinate_of(find_joint(name)); }

double WorldLoop::joint_gap(std::string_view name) const {
  const Joint& joint = find_joint(name);
  return held_gap(joint.engine.law, pose_of(joint), coordinate_of(joint));
}

/// Adds an object to the engine at its start pose, at rest.
void WorldLoop::insert(std::size_t slot) {
  Object& object = objects_[slot];
  object.weightless = object.options.floating;
  object.owned = object.near_hand = object.stalled = false;
  object.handed_at = 0;
  object.pose = object.start;
  object.velocity = object.previous_velocity = {};
  object.present = true;
  object.planes.clear();
  add_to_engine(slot);
}

/// Adds an object to the engine at its present pose, at rest.
void WorldLoop::add_to_engine(std::size_t slot) {
  const Object& object = objects_[slot];
  engine_->add(slot, {object.solid.shape, object.options.mass, object.solid.inertia, object.options.friction,
                      object.pose, object.solid.pieces});
  if (object.dynamic) engine_->set_gravity(slot, gravity_of(object));
}

/// Removes an assembly in its present state and inserts it at its start pose. An object that was removed returns.
void WorldLoop::restore(std::size_t first) {
  find_assemblies(first);
  const std::size_t assembly = objects_[first].assembly;
  for (std::size_t slot = 0; slot < objects_.size(); ++slot) {
    if (objects_[slot].assembly != assembly || (slot != first && !objects_[slot].present)) continue;
    detach(slot);
    engine_->remove(slot);
    insert(slot);
    describe(slot, false);
    take_from_hands(objects_[slot]);
  }
  for (std::size_t slot = 0; slot < objects_.size(); ++slot)
    if (objects_[slot].assembly == assembly && objects_[slot].present) attach(slot);
}

void WorldLoop::describe(std::size_t slot, bool removed) {
  descriptions_[slot].removed = removed ? 1 : 0;
  descriptions_[slot].stamp.sequence = ++descriptions_version_;
}

void WorldLoop::take_from_hands(Object& object) {
  object.owned = object.near_hand = object.stalled = false;
  object.handed_at = 0;
  object.put = true;
  object.put_at = 0;
  object.restarted = false;
}

void WorldLoop::reset(Nanoseconds time) {
  reset_time_ = time;
  restore_all();
  for (Object& object : objects_) object.restarted = true;
  for (std::size_t number = 0; number < copies_.size(); ++number) restart_copy(number);
}

void WorldLoop::restore_all() {
  for (std::size_t slot = 0; slot < objects_.size(); ++slot) detach(slot);
  for (std::size_t slot = 0; slot < objects_.size(); ++slot) {
    engine_->remove(slot);
    insert(slot);
    describe(slot, false);
    take_from_hands(objects_[slot]);
  }
  for (std::size_t slot = 0; slot < objects_.size(); ++slot) attach(slot);
}

void WorldLoop::meet_hands(Nanoseconds now, const WorldInput& input) {
  const auto is_in = [](const auto& list, const HandKey& key, auto key_of) {
    return std::any_of(list.begin(), list.end(), [&](const auto& each) { return each.*key_of == key; });
  };
  for (const ObjectCoupling& coupling : input.couplings) {
    if (is_in(hands_, coupling.hand, &KnownHand::key)) continue;
    if (hands_.size() == kMostHands) {
      std::erase_if(hands_,
                    [&](const KnownHand& each) { return !is_in(input.couplings, each.key, &ObjectCoupling::hand); });
    }
    if (hands_.size() < kMostHands) hands_.push_back({coupling.hand, now});
  }
}

/// A hand that the world hears for the first time may not know this world yet. It may hold an object where an earlier
/// world had it.
bool WorldLoop::is_new(const HandKey& hand, Nanoseconds now) const {
  return std::none_of(hands_.begin(), hands_.end(), [&](const KnownHand& each) {
    return each.key == hand && age_of(each.since, now).value_or(0) >= kClaimHoldoff;
  });
}

void WorldLoop::follow(std::size_t slot, Nanoseconds now, const WorldInput& input) {
  Object& object = objects_[slot];
  const auto id = static_cast<std::uint32_t>(slot + 1);
  const bool symmetric = options_.mode == "symmetric";
  object.near_hand = false;
  bool still_held = false;  // by a hand that has not received the new place
  if (object.put && object.put_at == 0) object.put_at = now;
  const ObjectCoupling* leading = nullptr;  // its twin leads the copy
  const ObjectTwin* leading_twin = nullptr;
  const ObjectCoupling* guest = nullptr;  // of a hand that touches the object without owning it
  bool owner_touches = false;
  Wrench wrench;
  bool pulled = false;
  Follower follower{object.options.mass, Matrix3::Zero(), object.pose, object.velocity, gravity_of(object)};
  const Matrix3 axes = object.pose.orientation.toRotationMatrix();
  follower.inertia = axes * object.solid.inertia.asDiagonal() * axes.transpose();

  // Process the hands in the order of their keys, so that the sum of two springs does not depend on the order of
  // samples.
  const HandKey* last = nullptr;
  for (std::size_t n = 0; n < input.couplings.size(); ++n) {
    const ObjectCoupling* coupling = nullptr;
    for (const ObjectCoupling& candidate : input.couplings) {
      if (last != nullptr && !before(*last, candidate.hand)) continue;
      if (coupling == nullptr || before(candidate.hand, coupling->hand)) coupling = &candidate;
    }
    if (coupling == nullptr) break;
    last = &coupling->hand;
    const ObjectTwin* twin = twin_of(*coupling, id);
    if (twin == nullptr || coupling->stamp.sample_time <= reset_time_) continue;
    const std::optional<double> age = age_of(coupling->stamp.sample_time, now);
    if (!age) {
      ++counters_.refused_future;
      continue;
    }
    if (*age > kVanished) continue;
    if ((coupling->mode == 1) != symmetric) {
      ++counters_.refused_mode;
      continue;
    }
    if (!is_plausible(*twin) || !std::isfinite(coupling->step_period)) {
      ++counters_.refused_nonfinite;
      continue;
    }
    if ((object.put || is_new(coupling->hand, now)) && (symmetric || twin->owned != 0)) {
      still_held = true;
      continue;
    }
    object.near_hand = true;
    if (!symmetric) {
      // The present owner keeps the object until it no longer touches it. A free object goes to the first key that
      // claims it.
      const bool present_owner = object.owned && object.owner == coupling->hand;
      const bool touches = touches_assembly(*coupling, object.assembly);
      if (twin->owned != 0 && (present_owner || leading == nullptr)) leading = coupling, leading_twin = twin;
      if (!present_owner && touches && guest == nullptr) guest = coupling;
      if (present_owner) owner_touches = touches;
      continue;
    }
    if (*age > kMotionStall) continue;  // the pose is too old for a spring
    const Leader leader{{to_vector(twin->position), to_quaternion(twin->orientation).normalized()},
                        {to_vector(twin->linear_velocity), to_vector(twin->angular_velocity)},
                        {}};
    // A contact force shows that the object is touched: mode symmetric has no owned flag.
    if (to_vector(twin->contact_force).norm() > 0 && object.weightless) {
      object.weightless = false;
      engine_->set_gravity(slot, gravity_of(object));
      follower.gravity = gravity_of(object);
    }
    const Wrench one = symmetric_wrench(follower, leader, options_.stiffness, options_.angular_stiffness,
                                        options_.damping_ratio, step_);
    wrench.force += one.force;
    wrench.torque += one.torque;
    pulled = true;
  }
  object.put = object.put && (still_held || object.restarted) && age_of(object.put_at, now).value_or(0) < kClaimHoldoff;
  if (symmetric) {
    if (pulled) engine_->apply(slot, wrench);
    return;
  }

  choose_owner(object, now, input, leading == nullptr ? nullptr : &leading->hand, owner_touches,
               guest == nullptr ? nullptr : &guest->hand);
  if (!object.owned) {
    object.stalled = false;
    return;
  }
  if (object.weightless) {
    object.weightless = false;
    engine_->set_gravity(slot, gravity_of(object));
    follower.gravity = gravity_of(object);
  }
  if (leading == nullptr) {
    // The next owner has not heard yet that it is the owner. Meanwhile the copy keeps its velocity and its weight is
    // carried.
    engine_->apply(slot, {-follower.mass * follower.gravity, Vector3::Zero()});
    return;
  }
  object.owner_step = std::clamp(leading->step_period, 1e-4, 0.1);
  const double age = age_of(leading->stamp.sample_time, now).value_or(0);
  const double delay = (1 + options_.staleness) * (step_ + object.owner_step);
  Leader leader{{to_vector(leading_twin->position), to_quaternion(leading_twin->orientation).normalized()},
                {to_vector(leading_twin->linear_velocity), to_vector(leading_twin->angular_velocity)},
                {to_vector(leading_twin->contact_force) + to_vector(leading_twin->coupling_force),
                 to_vector(leading_twin->contact_torque) + to_vector(leading_twin->coupling_torque)}};
  // `age` is that at `now`, the end of this step. Staleness is judged by the age at the start of the step.
  const bool force_stale = age - step_ > std::max(3 * object.owner_step + 1.5 * step_, kForceStall);
  if (force_stale) leader.wrench = {-follower.mass * follower.gravity, Vector3::Zero()};
  if (age - step_ > kMotionStall) leader.velocity = {};
  if (force_stale && !object.stalled) ++counters_.stalls;
  object.stalled = force_stale;
  const double ahead = std::min(age, delay);
  leader.pose = increment(leader.pose, ahead * leader.velocity.linear, ahead * leader.velocity.angular);
  leader.wrench = without_reaction(object, follower, leader.wrench);
  Wrench follow_wrench = owner_wrench(follower, leader, options_.follow_stiffness, step_);
  stop_at_planes(object, follower, follow_wrench);
  engine_->apply(slot, follow_wrench);
}

/// Whether the hand touches an object of the assembly. All objects of an assembly have the same owner.
bool WorldLoop::touches_assembly(const ObjectCoupling& hand, std::size_t assembly) const {
  return std::any_of(hand.twins.begin(), hand.twins.end(), [&](const ObjectTwin& twin) {
    return twin.object >= 1 && twin.object <= objects_.size() && objects_[twin.object - 1].assembly == assembly &&
           to_vector(twin.contact_force).norm() > 0;
  });
}

/// Decides which hand owns the object from now on. `claims`: the hand whose twin leads. `guest`: another hand that
/// touches the object. Null: none.
void WorldLoop::choose_owner(Object& object, Nanoseconds now, const WorldInput& input, const HandKey* claims,
                             bool owner_touches, const HandKey* guest) {
  const bool kept = object.owned && claims != nullptr && *claims == object.owner;
  if (object.owned && !kept && object.handed_at == 0) {
    for (const ObjectCoupling& coupling : input.couplings)
      if (coupling.hand == object.owner && age_of(coupling.stamp.sample_time, now).value_or(0) > kVanished)
        ++counters_.vanished;
    object.stalled = false;
  }
  if (kept) object.handed_at = 0;
  // When the owner no longer touches the object, it goes to a hand that does. It is not free between.
  const bool ends = kept ? !owner_touches : claims == nullptr;
  if (object.owned && object.handed_at == 0 && guest != nullptr && ends) {
    object.owner = *guest;
    object.handed_at = now;
    return;
  }
  if (object.handed_at != 0 && age_of(object.handed_at, now).value_or(0) < kHandOver) return;
  object.handed_at = 0;
  object.owned = claims != nullptr;
  if (claims != nullptr) object.owner = *claims;
}

const WorldOutput& WorldLoop::step(Nanoseconds now, const WorldInput& input) {
  for (const ObjectCoupling& coupling : input.couplings)
    if (age_of(coupling.stamp.sample_time, now)) newest_input_ = std::max(newest_input_, coupling.stamp.sample_time);
  meet_hands(now, input);
  for (std::size_t slot = 0; slot < objects_.size(); ++slot)
    if (objects_[slot].present && objects_[slot].dynamic) follow(slot, now, input);
  // The hand computes friction, spring and detents of the objects that it owns. Its wrench on the twin has them.
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    if (joints_[j].present)
      engine_->set_passive(j, objects_[joints_[j].engine.parent].owned || objects_[joints_[j].engine.child].owned);
  }
  move_copies(now, input);
  engine_->step(step_);
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    if (!joints_[j].present) continue;
    joints_[j].engine.reaction = engine_->reaction(j);
    joints_[j].engine.coordinate = engine_->coordinate(j);
  }
  for (std::size_t slot = 0; slot < objects_.size(); ++slot) {
    Object& object = objects_[slot];
    if (!object.present || !object.dynamic) continue;
    const Pose pose = engine_->pose(slot);
    const Twist velocity = engine_->velocity(slot);
    if (!pose.position.allFinite() || !pose.orientation.coeffs().allFinite() || !velocity.linear.allFinite() ||
        !velocity.angular.allFinite()) {
      // Never publish NaN or infinity: the object stays at its last valid pose.
      ++counters_.repaired;
      detach(slot);
      engine_->remove(slot);
      add_to_engine(slot);
      object.velocity = object.previous_velocity = {};
      attach(slot);
      continue;
    }
    object.previous_velocity = object.velocity;
    object.pose = pose;
    object.velocity = velocity;
  }
  for (std::size_t slot = 0; slot < objects_.size(); ++slot) {
    objects_[slot].planes.clear();
    if (objects_[slot].near_hand) find_planes(slot);
  }
  publish_copies(now);
  publish(now);
  return *output_;
}

void WorldLoop::publish(Nanoseconds now) {
  WorldObjects& out = output_->objects;
  ++out.stamp.sequence;
  out.stamp.sample_time = now;
  out.step_period = step_;
  out.objects.clear();
  for (std::size_t slot = 0; slot < objects_.size(); ++slot) {
    const Object& object = objects_[slot];
    if (!object.present) continue;
    ObjectState& state = out.objects.items[out.objects.count++];
    state.object = static_cast<std::uint32_t>(slot + 1);
    state.gravity = to_wire(gravity_of(object));
    state.owned = object.owned ? 1 : 0;
    state.owner_user = object.owned ? object.owner.user : 0;
    state.owner_side = object.owned ? object.owner.side : 0;
    state.position = to_wire(object.pose.position);
    state.orientation = to_wire(object.pose.orientation);
    state.linear_velocity = to_wire(object.velocity.linear);
    state.angular_velocity = to_wire(object.velocity.angular);
    state.linear_acceleration = to_wire(Vector3((object.velocity.linear - object.previous_velocity.linear) / step_));
    state.angular_acceleration = to_wire(Vector3((object.velocity.angular - object.previous_velocity.angular) / step_));
    state.planes = object.planes;
  }
}

WorldLoop::Object* WorldLoop::find(std::string_view name) {
  for (Object& object : objects_)
    if (object.options.name == name) return &object;
  return nullptr;
}

MessageReply WorldLoop::answer(const Message& message, std::string_view module) {
  MessageReply reply;
  reply.id = message.id;
  set_text(reply.module, module);
  const std::string_view addressed = get_text(message.module);
  const std::string_view key = get_text(message.key);
  const std::string_view value = get_text(message.value);
  const auto result_of = [&reply](std::uint32_t result, const char* text, std::string_view subject = "") {
    reply.result = result;
    std::snprintf(reply.text.data(), reply.text.size(), "%s%.*s", text, static_cast<int>(subject.size()),
                  subject.data());
    return reply;
  };
  const bool known = key == "object.reset" || key == "object.remove" || key == "object.teleport";
  if (addressed != module && addressed != "*") return result_of(kReplyIgnored, "not for this module");
  if (!known) return result_of(kReplyIgnored, "unknown key; known: object.reset, object.remove, object.teleport");
  std::string_view name = value;
  if (key == "object.teleport") {
    // Names may contain spaces. Take the longest object name that a space follows.
    name = value.substr(0, value.find(' '));
    for (const Object& each : objects_)
      if (each.options.name.size() > name.size() && value.starts_with(each.options.name + " "))
        name = value.substr(0, each.options.name.size());
  }
  for (SoftCopy& copy : copies_) copy.wake();
  if (key == "object.reset" && name == "*") {
    restore_all();
    for (std::size_t number = 0; number < copies_.size(); ++number) restart_copy(number);
    return result_of(kReplyApplied, "all objects reset");
  }
  for (std::size_t number = 0; number < copies_.size() && key == "object.reset"; ++number) {
    if (copies_[number].name() != name) continue;
    restart_copy(number);
    return result_of(kReplyApplied, "reset");
  }
  Object* object = find(name);
  if (object == nullptr) return result_of(kReplyRefused, "expected the name of an object in the scene, not ", name);
  const auto slot = static_cast<std::size_t>(object - objects_.data());
  if (key == "object.reset") {
    restore(slot);
    return result_of(kReplyApplied, "reset");
  }
  if (!object->present) return result_of(kReplyRefused, "the object was removed; object.reset restores it");
  if (key == "object.remove") {
    detach(slot);
    for (std::size_t j = 0; j < joints_.size(); ++j) {
      if (joints_[j].engine.parent != slot && joints_[j].engine.child != slot) continue;
      joint_descriptions_[j].removed = 1;
      joint_descriptions_[j].stamp.sequence = ++descriptions_version_;
    }
    engine_->remove(slot);
    object->present = object->owned = object->near_hand = false;
    find_assemblies();
    object->handed_at = 0;
    object->planes.clear();
    describe(slot, true);
    return result_of(kReplyApplied, "removed");
  }
  const std::optional<Vector3> to = parse_vector(value.substr(name.size()));
  if (!to || to->norm() > 1000) return result_of(kReplyRefused, "expected NAME X Y Z in metres, within 1000");
  for (const Joint& joint : joints_) {
    if (joint.present && (joint.engine.parent == slot || objects_[joint.engine.child].assembly == object->assembly) &&
        !objects_[joint.engine.parent].dynamic)
      return result_of(kReplyRefused, "a joint holds the object to a static one");
  }
  // The message gives the place of the shape's frame, as in the scene file. The pose is that of the body frame.
  const Pose& body_frame = object->solid.body_frame;
  const Vector3 place = *to + object->pose.orientation * (body_frame.orientation.conjugate() * body_frame.position);
  const Vector3 shift = place - object->pose.position;
  for (std::size_t link = 0; link < objects_.size(); ++link) {
    Object& each = objects_[link];
    if (each.assembly != object->assembly || !each.present) continue;
    each.pose.position = link == slot ? place : Vector3(each.pose.position + shift);
    each.velocity = each.previous_velocity = {};
    each.planes.clear();
    engine_->place(link, each.pose, {});
    describe(link, false);
    take_from_hands(each);
  }
  return result_of(kReplyApplied, "moved");
}

void WorldLoop::fill_status(LoopStatus& status, Nanoseconds now) const {
  status.input_age_ms = age_ms_of(newest_input_, now);
  status.energies.clear();
  NamedValue mechanical;
  set_text(mechanical.name, "mechanical");
  mechanical.value = energy();
  status.energies.push_back(mechanical);
  add_counter(status, "refused_nonfinite", static_cast<double>(counters_.refused_nonfinite));
  add_counter(status, "refused_future", static_cast<double>(counters_.refused_future));
  add_counter(status, "refused_mode", static_cast<double>(counters_.refused_mode));
  if (!copies_.empty()) {
    add_counter(status, "refused_soft", static_cast<double>(counters_.refused_soft));
    add_counter(status, "soft_copies", static_cast<double>(std::ranges::count_if(copies_, &SoftCopy::is_there)));
    add_counter(status, "free_soft_objects",
                static_cast<double>(std::ranges::count_if(copies_, &SoftCopy::is_simulated)));
  }
  add_counter(status, "stalls", static_cast<double>(counters_.stalls));
  add_counter(status, "vanished", static_cast<double>(counters_.vanished));
  add_counter(status, "repaired", static_cast<double>(counters_.repaired));
  std::size_t asleep = 0;
  for (std::size_t slot = 0; slot < objects_.size(); ++slot)
    if (objects_[slot].present && objects_[slot].dynamic && engine_->asleep(slot)) ++asleep;
  add_counter(status, "asleep", static_cast<double>(asleep));
}

double WorldLoop::energy() const {
  double sum = 0;
  for (const Object& object : objects_) {
    if (!object.present || !object.dynamic) continue;
    const Vector3 spin = object.pose.orientation.conjugate() * object.velocity.angular;
    sum += 0.5 * object.options.mass * object.velocity.linear.squaredNorm() +
           0.5 * spin.dot(object.solid.inertia.cwiseProduct(spin)) -
           object.options.mass * gravity_of(object).dot(object.pose.position);
  }
  for (const Joint& joint : joints_) {
    if (!joint.present) continue;
    const JointLaw& law = joint.engine.law;
    if (law.has_coordinate()) sum += law.potential(coordinate_of(joint)).energy;
    if (law.kind == ObjectJointKind::ball)
      sum += law.stiffness * (1 - std::cos(rotation_log(pose_of(joint).relative).norm()));
  }
  return sum;
}

}  // namespace softhand
