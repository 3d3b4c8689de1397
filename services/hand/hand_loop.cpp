#include "hand/hand_loop.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "device/answer.hpp"
#include "device/bone_contacts.hpp"
#include "math/rotation.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

std::size_t index(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }

// s after a reposition. The hand was placed in its rest pose, so its fingers move fast. They must not hit objects away,
// and pass through flexible ones.
constexpr double kSettlingTime = 0.1;

bool usable(const JointSample& joint) {
  return (joint.flags & kJointValid) != 0 && all_finite(joint.position) && all_finite(joint.orientation) &&
         all_finite(joint.linear_velocity) && all_finite(joint.angular_velocity) && joint.confidence >= 0 &&
         joint.confidence <= 1 && std::abs(to_quaternion(joint.orientation).norm() - 1.0) < 0.01;
}

Twist twist_of(const JointSample& joint) {
  return {to_vector(joint.linear_velocity), to_vector(joint.angular_velocity)};
}

}  // namespace

HandLoop::HandLoop(const HandModel& hand, const HandOptions& options, HandKey key, const ObjectSpring& object_spring,
                   std::vector<SoftObject> soft_objects)
    : options_(options),
      key_(key),
      symmetric_(object_spring.linear_stiffness > 0),
      time_step_(1.0 / options.rate_hz),
      simulation_(std::make_unique<HandSimulation>(hand, options.simulation, static_cast<int>(options.mirrored_objects),
                                                   static_cast<int>(options.static_objects), object_spring,
                                                   static_cast<int>(options.object_joints), std::move(soft_objects))),
      traction_(simulation_->hand()),
      mirror_(*simulation_, options_, key_, symmetric_),
      tracked_(options.tracked_input) {
  output_.simulated.hand = output_.coupling.hand = output_.contacts.hand = output_.traction.hand =
      output_.bone_wrench.hand = output_.surface.hand = key_;
  if (const SoftObjects* soft = simulation_->soft())
    output_.soft_objects.resize(static_cast<std::size_t>(soft->count()));
  for (SoftObjectState& each : output_.soft_objects) each.owner = key_;
}

HandLoop::~HandLoop() = default;

void HandLoop::take_state(const HandLoop& other) {
  simulation_->take_state(*other.simulation_);
  tracked_ = other.tracked_;
  traction_.load(other.traction_.save());
  mirror_.take_state(other.mirror_);
  skeleton_ = other.skeleton_;
  any_skeleton_ = other.any_skeleton_;
  reposition_asked_ = other.reposition_asked_;
  settling_time_ = other.settling_time_;
  reset_time_ = other.reset_time_;
  counters_ = other.counters_;
  output_ = other.output_;
}

void HandLoop::reset(Nanoseconds time) {
  reset_time_ = time;
  tracked_ = TrackedInput(options_.tracked_input);
  // The last valid joint poses say nothing about the place of the hand after the reset.
  skeleton_ = {};
  simulation_->clear_targets();
  traction_.forget();
  any_skeleton_ = reposition_asked_ = false;
  mirror_.release_all();
  for (int i = 0; i < static_cast<int>(output_.soft_objects.size()); ++i) simulation_->restart_soft_object(i);
}

void HandLoop::take_skeleton(Nanoseconds now, const Skeleton& skeleton) {
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

void HandLoop::take_world(Nanoseconds now, const WorldObjects& world) {
  if (age_of(world.stamp.sample_time, now)) {
    mirror_.take_world(world);
  } else {
    ++counters_.refused_future;
  }
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
      const BodyTarget& target = targets[b];
      if (target.valid) simulation_->set_target(static_cast<Body>(b), target.pose, target.velocity, target.confidence);
    }
    return;
  }
  if (!any_skeleton_) return;
  const double age = age_of(skeleton_.stamp.sample_time, now).value_or(0);
  const double ahead = std::clamp(age, 0.0, options_.extrapolation_limit);
  const bool moving = age <= options_.extrapolation_limit;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const JointSample& joint = skeleton_.joints[index(joint_of(static_cast<Body>(b)))];
    if ((joint.flags & kJointValid) == 0) continue;
    const Twist velocity = twist_of(joint);
    simulation_->set_target(static_cast<Body>(b),
                            increment(to_pose(joint), ahead * velocity.linear, ahead * velocity.angular),
                            moving ? velocity : Twist{}, std::max(joint.confidence, kLeastConfidence));
  }
}

HandOutput& HandLoop::step(Nanoseconds now, const HandInput& input, const RequestedOutputs& requested) {
  if (input.head != nullptr && options_.direct) tracked_.add_head_pose(*input.head, now);
  if (input.skeleton != nullptr) take_skeleton(now, *input.skeleton);
  if (input.world != nullptr && input.world->stamp.sample_time > reset_time_) take_world(now, *input.world);
  set_targets(now);
  output_.valid = any_skeleton_;
  if (!any_skeleton_) return output_;
  mirror_.begin_step(now, settling_time_ > 0, input.other_hands);
  const double age = input_age_ms(now);
  if (age < 0 || age > options_.stale_after * 1e3) ++counters_.stale_steps;
  simulation_->pass_through_soft_objects(settling_time_ > 0);
  simulation_->enable_ledger(requested.ledger);
  if (input.work_budget > 0 && options_.simulation.solver.work_budget > 0)
    simulation_->set_work_budget(input.work_budget);
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
  return any_skeleton_ ? 1e3 * age_of(skeleton_.stamp.sample_time, now).value_or(0) : -1.0;
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
                           1,
                           1.0};
  }

  ObjectCoupling& coupling = output_.coupling;
  coupling.stamp = stamp;
  coupling.mode = symmetric_ ? 1 : 0;
  coupling.step_period = time_step_;
  mirror_.write_twins(coupling);

  const bool writes_wrench = requested.bone_wrench && options_.direct;
  if (requested.contacts || writes_wrench) {
    output_.contacts.stamp = stamp;
    simulation_->write_contacts(output_.contacts);
  }
  if (requested.traction) {
    output_.traction.stamp = stamp;
    simulation_->write_traction(time_step_, traction_, output_.traction);
  } else {
    traction_.forget();
  }
  if (requested.surface) {
    TissueSurface& surface = output_.surface;
    surface.stamp = stamp;
    const Vector3 wrist = simulation_->joint_pose(Joint::wrist).position;
    surface.wrist_position = to_wire(wrist);
    const auto& nodes = simulation_->state().node_positions;
    surface.nodes.clear();
    for (int n = 0; n < simulation_->hand().node_count(); ++n) {
      const Eigen::Vector3f relative = (nodes.col(n) - wrist).cast<float>();
      surface.nodes.push_back({relative.x(), relative.y(), relative.z()});
    }
  }
  if (requested.soft_objects) {
    for (std::size_t i = 0; i < output_.soft_objects.size(); ++i) {
      output_.soft_objects[i].stamp = stamp;
      simulation_->soft()->write_state(static_cast<int>(i), simulation_->state(), output_.soft_objects[i]);
    }
  }
  if (writes_wrench) {
    BoneWrench& wrench = output_.bone_wrench;
    wrench.stamp = stamp;
    wrench.stamp.chain.simulated_published = wrench.stamp.chain.wrench_published = now;
    wrench.simulated_valid = 1;
    const auto& targets = tracked_.targets(now);
    const BoneContacts contacts = sum_contacts(output_.contacts);
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const Body body = static_cast<Body>(b);
      const Pose pose = simulation_->joint_pose(joint_of(body));
      const Wrench coupled = simulation_->coupling_wrench(body);
      // The coupling acts on the user's bone with the opposite sign of its action on the simulated bone.
      BoneSample& sample = wrench.bones[b];
      sample = {};
      sample.tracked_position = sample.intermediate_position = to_wire(targets[b].pose.position);
      sample.tracked_orientation = sample.intermediate_orientation = to_wire(targets[b].pose.orientation);
      sample.simulated_position = to_wire(pose.position);
      sample.simulated_orientation = to_wire(pose.orientation);
      sample.coupling_force = to_wire(Vector3(-coupled.force));
      sample.coupling_torque = to_wire(Vector3(-coupled.torque));
      const BodyModel& model = simulation_->hand().bodies[b];
      const double strength = targets[b].confidence;
      write_local_model(contacts[b],
                        {strength * model.coupling_linear_stiffness, strength * model.coupling_force_cap, model.mass},
                        (pose.position - targets[b].pose.position).norm(), Vector3::Zero(), sample);
      sample.contact_force = to_wire(simulation_->bone_contact_forces()[b]);
    }
  }
}

MessageReply HandLoop::answer(const Message& message, const std::string& module) {
  if (!is_addressed(message, module)) return reply_to(message, module, kReplyIgnored, "not for this module");
  if (get_text(message.key) == "reposition") {
    reposition_asked_ = true;
    return reply_to(message, module, kReplyApplied, "the hand goes to its target at once");
  }
  if (get_text(message.key) == "object.reset") return restart_soft_objects(message, module);
  return reply_to(message, module, kReplyIgnored, "unknown key; known: reposition, object.reset");
}

MessageReply HandLoop::restart_soft_objects(const Message& message, const std::string& module) {
  const std::string_view name = get_text(message.value);
  int restarted = 0;
  for (int i = 0; i < static_cast<int>(output_.soft_objects.size()); ++i) {
    if (name != "*" && name != simulation_->soft()->object(i).name) continue;
    simulation_->restart_soft_object(i);
    ++restarted;
  }
  // The world has the other objects.
  if (restarted == 0) return reply_to(message, module, kReplyIgnored, "no such flexible object");
  return reply_to(message, module, kReplyApplied, "back at its start");
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
              static_cast<double>(counters().refused_nonfinite + tracked_.counters().refused_nonfinite));
  add_counter(status, "refused_order",
              static_cast<double>(counters_.refused_order + tracked_.counters().refused_order));
  add_counter(status, "refused_future", static_cast<double>(counters_.refused_future));
  add_counter(status, "repositioned", static_cast<double>(counters_.repositioned));
  add_counter(status, "stale_steps", static_cast<double>(counters_.stale_steps));
  add_counter(status, "failed_steps", static_cast<double>(counters_.failed_steps));
  add_counter(status, "budget_steps", static_cast<double>(counters_.budget_steps));
  const WorkCounters work = simulation_->work();
  add_counter(status, "tissue_elements", static_cast<double>(work.tissue_elements));
  add_counter(status, "soft_elements", static_cast<double>(work.soft_elements));
  if (simulation_->soft() != nullptr) add_counter(status, "passed_objects", simulation_->soft()->passing());
  add_counter(status, "contact_queries", static_cast<double>(work.contact_queries));
  add_counter(status, "factorised_steps", static_cast<double>(work.factorised_steps));
  add_counter(status, "chord_steps", static_cast<double>(counters_.chord_steps));
  add_counter(status, "objects_without_slot", static_cast<double>(mirror_.counters().without_slot));
  add_counter(status, "untangled_nodes", static_cast<double>(simulation_->untangled_nodes()));
  add_counter(status, "dropped_regions", static_cast<double>(traction_.dropped()));
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

std::vector<SoftObjectDescription> HandLoop::soft_object_descriptions() const {
  std::vector<SoftObjectDescription> all(output_.soft_objects.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    const SoftObjects& soft = *simulation_->soft();
    const int k = static_cast<int>(i);
    const SoftObject& object = soft.object(k);
    SoftObjectDescription& out = all[i];
    out.object = SoftObjects::id(k);
    out.owner = key_;
    set_text(out.name, object.name);
    set_text(out.file.name, object.file_name);
    set_text(out.file.sha256, object.file_sha256);
    out.file.position = to_wire(object.pose.position);
    out.file.orientation = to_wire(object.pose.orientation);
    out.node_count = static_cast<std::uint32_t>(soft.node_count(k));
    out.mass = soft.mass(k);
  }
  return all;
}

template <typename Self, typename Visit>
void HandLoop::visit_own(Self& self, Visit&& visit) {
  visit(self.tracked_);
  visit(self.skeleton_);
  visit(self.any_skeleton_);
  visit(self.reposition_asked_);
  visit(self.settling_time_);
  visit(self.reset_time_);
  visit(self.counters_);
  visit(self.output_.simulated.stamp.sequence);
  visit(self.output_.coupling.twins);
}

void HandLoop::save(ByteWriter& out) const {
  mirror_.save(out);
  visit_own(*this, [&out](const auto& value) { out.write(value); });
  simulation_->save(out);
  out.write(traction_.save());
}

void HandLoop::load(ByteReader& in) {
  mirror_.load(in);
  visit_own(*this, [&in](auto& value) { in.read(value); });
  simulation_->load(in);
  try {
    traction_.load(in.take<SkinTractionReport::Memory>());
  } catch (const std::invalid_argument& error) {
    throw std::runtime_error(error.what());
  }
}

}  // namespace softhand
