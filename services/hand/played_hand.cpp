#include "hand/played_hand.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "device/bone_contacts.hpp"
#include "device/intermediate_motion.hpp"
#include "math/rotation.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "messages/plausible.hpp"

namespace softhand {
namespace {

// s after a reposition. The hand was moved in its posture at that time, so its fingers may move fast. They must not hit
// objects away, and pass through flexible ones and through the other hand.
constexpr double kSettlingTime = 0.1;

bool usable(const JointSample& joint) { return is_usable(joint) && joint.confidence >= 0 && joint.confidence <= 1; }

}  // namespace

PlayedHand::PlayedHand(HandSimulation& simulation, int hand, const HandOptions& options, HandKey key)
    : simulation_(simulation),
      hand_(hand),
      options_(options),
      key_(key),
      traction_(simulation.hand(hand), simulation.first_node(hand), simulation.first_body(hand)),
      tracked_(options.tracked_input) {
  output_.simulated.hand = output_.coupling.hand = output_.contacts.hand = output_.traction.hand =
      output_.bone_wrench.hand = output_.surface.hand = key_;
}

void PlayedHand::take_state(const PlayedHand& other) {
  tracked_ = other.tracked_;
  traction_.load(other.traction_.save());
  skeleton_ = other.skeleton_;
  mean_velocities_ = other.mean_velocities_;
  any_skeleton_ = other.any_skeleton_;
  reposition_asked_ = other.reposition_asked_;
  settling_time_ = other.settling_time_;
  reset_time_ = other.reset_time_;
  counters_ = other.counters_;
  output_ = other.output_;
}

void PlayedHand::reset(Nanoseconds time) {
  reset_time_ = time;
  tracked_ = TrackedInput(options_.tracked_input);
  // The last valid joint poses say nothing about the place of the hand after the reset.
  skeleton_ = {};
  mean_velocities_ = {};
  traction_.forget();
  any_skeleton_ = reposition_asked_ = false;
  settling_time_ = 0;
}

void PlayedHand::reposition(const Pose& wrist) {
  simulation_.reposition(wrist, hand_);
  settling_time_ = kSettlingTime;
  if (any_skeleton_) ++counters_.repositioned;
  reposition_asked_ = false;
}

void PlayedHand::take_skeleton(Nanoseconds now, const Skeleton& skeleton) {
  // The stamp of a tracker with another clock does not say whether a sample was taken before the reset.
  const bool timed = !options_.direct || is_plausible(skeleton.stamp.sample_time, now);
  if (timed && skeleton.stamp.sample_time <= reset_time_) return;
  if (options_.direct) {
    tracked_.add_sample(skeleton, now);
    return;
  }
  if (!age_of(skeleton.stamp.sample_time, now)) {
    ++counters_.refused_future;
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
    if (usable(skeleton.joints[j])) {
      skeleton_.joints[j].orientation = to_wire(to_quaternion(skeleton.joints[j].orientation).normalized());
      continue;
    }
    if ((skeleton.joints[j].flags & kJointValid) != 0) ++counters_.refused_nonfinite;
    skeleton_.joints[j] = before.joints[j];  // keeps its last valid pose
  }
  const JointSample& wrist = skeleton_.joints[slot_of(Joint::wrist)];
  if ((wrist.flags & kJointValid) == 0) return;
  const double jump = (to_vector(wrist.position) - simulation_.joint_pose(Joint::wrist, hand_).position).norm();
  if (!any_skeleton_ || jump > options_.reposition_distance || reposition_asked_) {
    reposition(to_pose(wrist));
    // Joints without a valid sample move rigidly with the wrist.
    const JointSample& wrist_before = before.joints[slot_of(Joint::wrist)];
    const Pose displacement =
        (wrist_before.flags & kJointValid) != 0 ? to_pose(wrist) * to_pose(wrist_before).inverse() : Pose{};
    for (std::size_t j = 0; j < kJointCount; ++j) {
      if (usable(skeleton.joints[j])) continue;
      JointSample& joint = skeleton_.joints[j];
      const Pose moved = displacement * to_pose(joint);
      joint.position = to_wire(moved.position);
      joint.orientation = to_wire(moved.orientation);
    }
    mean_velocities_ = {};
  } else {
    estimate_velocities(before);
  }
  any_skeleton_ = true;
}

void PlayedHand::estimate_velocities(const Skeleton& before) {
  const double elapsed =
      static_cast<double>(skeleton_.stamp.sample_time - before.stamp.sample_time) * kSecondsPerNanosecond;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    Twist& mean = mean_velocities_[j];
    if (!(elapsed > 0) || (before.joints[j].flags & kJointValid) == 0) {
      mean = {};
      continue;
    }
    const Pose from = to_pose(before.joints[j]), to = to_pose(skeleton_.joints[j]);
    mean.linear = mean_velocity<Vector3>(mean.linear, to.position - from.position, elapsed);
    mean.angular =
        mean_velocity<Vector3>(mean.angular, rotation_log(to.orientation * from.orientation.conjugate()), elapsed);
  }
}

void PlayedHand::set_targets(Nanoseconds now) {
  if (options_.direct) {
    const auto& targets = tracked_.targets(now);
    const auto& carpus = targets[static_cast<std::size_t>(index_of(Body::carpus))];
    // Without a wrist the reposition waits for one.
    if (carpus.valid && (tracked_.take_repositioned() || reposition_asked_)) {
      reposition(carpus.pose);
      any_skeleton_ = true;
    }
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const BodyTarget& target = targets[b];
      if (target.valid)
        simulation_.set_target(static_cast<Body>(b), target.pose, target.velocity, target.confidence, hand_);
    }
    return;
  }
  if (!any_skeleton_) return;
  const double age = age_of(skeleton_.stamp.sample_time, now).value_or(0);
  const double ahead = std::min(age, options_.extrapolation_limit);
  const bool moving = age <= options_.extrapolation_limit;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const std::size_t j = slot_of(joint_of(static_cast<Body>(b)));
    const JointSample& joint = skeleton_.joints[j];
    if ((joint.flags & kJointValid) == 0) continue;
    const Twist& mean = mean_velocities_[j];
    const Pose pose = increment(to_pose(joint), ahead * mean.linear, ahead * mean.angular);
    const Twist velocity = moving ? mean : Twist{};
    simulation_.set_target(static_cast<Body>(b), pose, velocity, std::max(joint.confidence, kLeastConfidence), hand_);
  }
}

double PlayedHand::input_age_ms(Nanoseconds now) const {
  if (options_.direct) {
    const double age = tracked_.age(now);
    return age < 0 ? -1.0 : age * 1e3;
  }
  return any_skeleton_ ? 1e3 * age_of(skeleton_.stamp.sample_time, now).value_or(0) : -1.0;
}

Stamp PlayedHand::next_stamp(Nanoseconds now) const {
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
  return stamp;
}

void PlayedHand::end_step(Nanoseconds now, double time_step, const RequestedOutputs& requested) {
  output_.valid = any_skeleton_;
  if (!any_skeleton_) return;
  const double age = input_age_ms(now);
  if (age < 0 || age > options_.stale_after * 1e3) ++counters_.stale_steps;
  settling_time_ = std::max(0.0, settling_time_ - time_step);

  const Stamp stamp = next_stamp(now);
  output_.simulated.stamp = output_.coupling.stamp = stamp;
  write_skeleton();
  const bool writes_wrench = requested.bone_wrench && options_.direct;
  if (requested.contacts || writes_wrench) {
    output_.contacts.stamp = stamp;
    simulation_.write_contacts(output_.contacts, hand_);
  }
  if (requested.traction) {
    output_.traction.stamp = stamp;
    simulation_.write_traction(time_step, traction_, output_.traction, hand_);
  } else {
    traction_.forget();
  }
  if (requested.surface) {
    output_.surface.stamp = stamp;
    write_surface();
  }
  if (writes_wrench) {
    output_.bone_wrench.stamp = stamp;
    write_bone_wrench(now);
  }
}

void PlayedHand::write_skeleton() {
  Skeleton& simulated = output_.simulated;
  simulated.source = skeleton_.source;
  simulated.confidence = options_.direct ? tracked_.confidence() : skeleton_.confidence;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Joint joint = static_cast<Joint>(j);
    const Pose pose = simulation_.joint_pose(joint, hand_);
    const Twist velocity = simulation_.joint_velocity(joint, hand_);
    simulated.joints[j] = {to_wire(pose.position),
                           to_wire(pose.orientation),
                           to_wire(velocity.linear),
                           to_wire(velocity.angular),
                           simulation_.hand(hand_).joint_radii[j],
                           kJointValid,
                           1,
                           1.0};
  }
}

void PlayedHand::write_surface() {
  TissueSurface& surface = output_.surface;
  const Vector3 wrist = simulation_.joint_pose(Joint::wrist, hand_).position;
  surface.wrist_position = to_wire(wrist);
  const auto& nodes = simulation_.state().node_positions;
  const int first = simulation_.first_node(hand_);
  surface.nodes.clear();
  for (int n = first; n < first + simulation_.hand(hand_).node_count(); ++n) {
    const Eigen::Vector3f relative = (nodes.col(n) - wrist).cast<float>();
    surface.nodes.push_back({relative.x(), relative.y(), relative.z()});
  }
}

void PlayedHand::write_bone_wrench(Nanoseconds now) {
  BoneWrench& wrench = output_.bone_wrench;
  wrench.stamp.chain.simulated_published = wrench.stamp.chain.wrench_published = now;
  wrench.simulated_valid = 1;
  const auto& targets = tracked_.targets(now);
  const Twist wrist = simulation_.joint_velocity(Joint::wrist, hand_);
  wrench.wrist_velocity = to_wire(wrist.linear);
  wrench.wrist_angular_velocity = to_wire(wrist.angular);
  const BoneContacts contacts = sum_contacts(output_.contacts);
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    const Pose pose = simulation_.joint_pose(joint_of(body), hand_);
    const Wrench coupled = simulation_.coupling_wrench(body, hand_);
    // The coupling acts on the user's bone with the opposite sign of its action on the simulated bone.
    BoneSample& sample = wrench.bones[b];
    sample = {};
    sample.tracked_position = sample.intermediate_position = to_wire(targets[b].pose.position);
    sample.tracked_orientation = sample.intermediate_orientation = to_wire(targets[b].pose.orientation);
    sample.simulated_position = to_wire(pose.position);
    sample.simulated_orientation = to_wire(pose.orientation);
    sample.coupling_force = to_wire(Vector3(-coupled.force));
    sample.coupling_torque = to_wire(Vector3(-coupled.torque));
    const BodyModel& model = simulation_.hand(hand_).bodies[b];
    const double strength = targets[b].confidence;
    write_local_model(contacts[b],
                      {strength * model.coupling_linear_stiffness, strength * model.coupling_force_cap, model.mass},
                      (pose.position - targets[b].pose.position).norm(), Vector3::Zero(), 0, sample);
    sample.contact_force = to_wire(simulation_.bone_contact_forces(hand_)[b]);
  }
}

template <typename Self, typename Visit>
void PlayedHand::visit_own(Self& self, Visit&& visit) {
  visit(self.tracked_);
  visit(self.skeleton_);
  visit(self.mean_velocities_);
  visit(self.any_skeleton_);
  visit(self.reposition_asked_);
  visit(self.settling_time_);
  visit(self.reset_time_);
  visit(self.counters_);
  visit(self.output_.simulated.stamp.sequence);
  visit(self.output_.coupling.twins);
}

void PlayedHand::save(ByteWriter& out) const {
  visit_own(*this, [&out](const auto& value) { out.write(value); });
  out.write(traction_.save());
}

void PlayedHand::load(ByteReader& in) {
  visit_own(*this, [&in](auto& value) { in.read(value); });
  try {
    traction_.load(in.take<SkinTractionReport::Memory>());
  } catch (const std::invalid_argument& error) {
    throw std::runtime_error(error.what());
  }
}

}  // namespace softhand
