#include "tracking/tracking_loop.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <utility>

#include "device/answer.hpp"
#include "device/intermediate_motion.hpp"
#include "math/rotation.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "messages/plausible.hpp"

namespace softhand {
namespace {

// Even a bone without coupling in the hand file follows its tracker, with at least this bandwidth.
constexpr double kMinimumBandwidth = 2 * M_PI * 50;  // rad/s
constexpr int kRotationIterations = 4;

std::size_t index(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }

// Secant stiffness of a capped spring: the force k_eff |stretch| never exceeds `cap`.
double capped(double stiffness, double stretch, double cap) {
  return stiffness * stretch > cap ? cap / stretch : stiffness;
}

// Isotropic inertia of a body about its joint's origin.
double inertia_about_joint(const BodyModel& body) {
  return (body.inertia.trace() + 2 * body.mass * body.joint_from_body.position.squaredNorm()) / 3;
}

double tracked_stiffness(double ratio, double coupling, double inertia) {
  return std::max(ratio * coupling, inertia * kMinimumBandwidth * kMinimumBandwidth);
}

// Growth per hand period of one degree of freedom. The intermediate bone is (x, v), the simulated bone is (y, w), and
// the tracker rests at zero. `old_periods` is the age of the copies in hand periods.
double growth_of(const TrackingOptions& o, double hand_rate_hz, double mass, double coupling, int old_periods) {
  const double m1 = o.mass_fraction * mass;
  const double k1 = tracked_stiffness(o.stiffness_ratio, coupling, m1);
  const double kf = o.feedback_ratio * coupling;
  const double b1 = 2 * o.damping_ratio * std::sqrt(k1 * m1);
  const double b2 = 2 * std::sqrt(coupling * mass);
  const double h = 1 / o.rate_hz, H = 1 / hand_rate_hz;
  const int steps = std::max(1, static_cast<int>(std::lround(H / h)));
  const double limit = o.input.extrapolation_limit;
  double x = 1, v = 0, y = -1, w = 0;
  double x_old = x, y_old = y, w_old = w;  // as published one hand period ago
  double x_taken = x, mean = 0;            // what the hand took last, and its mean velocity
  const double scale = std::sqrt(mass / coupling);
  const auto norm = [&] { return std::sqrt(x * x + y * y + scale * scale * (v * v + w * w)); };
  double log_growth = 0;
  constexpr int kSettle = 100, kMeasure = 400;
  for (int period = 0; period < kSettle + kMeasure; ++period) {
    const double y_copy = old_periods > 0 ? y_old : y, w_copy = old_periods > 0 ? w_old : w;
    const double x_copy = old_periods > 0 ? x_old : x;
    y_old = y, w_old = w, x_old = x;
    mean = mean_velocity(mean, x_copy - x_taken, H);
    x_taken = x_copy;
    const double x_target = x_copy + std::min(old_periods * H, limit) * mean;
    const double dy = (mass * w / H + coupling * (x_target - y) + b2 * mean) / (mass / (H * H) + b2 / H + coupling);
    for (int s = 0; s < steps; ++s) {
      const double y_age = std::min(old_periods * H + s * h, limit);
      const double dx = (m1 * v / h - k1 * x - kf * (x - y_copy - w_copy * y_age)) / (m1 / (h * h) + b1 / h + k1 + kf);
      x += dx;
      v = dx / h;
    }
    y += dy;
    w = dy / H;
    // Renormalise, so that the growth over many periods is measured without overflow. All equations are linear.
    const double size = norm();
    if (!(size > 0)) return 0;
    if (period >= kSettle) log_growth += std::log(size);
    for (double* value : {&x, &v, &y, &w, &x_old, &y_old, &w_old, &x_taken, &mean}) *value /= size;
  }
  return std::exp(log_growth / kMeasure);
}

}  // namespace

double chain_growth(const TrackingOptions& options, double hand_rate_hz, const HandModel& hand) {
  double worst = 0;
  for (const BodyModel& body : hand.bodies) {
    for (int old_periods : {0, 1}) {
      if (body.coupling_linear_stiffness > 0)
        worst =
            std::max(worst, growth_of(options, hand_rate_hz, body.mass, body.coupling_linear_stiffness, old_periods));
      if (body.coupling_angular_stiffness > 0) {
        worst = std::max(worst, growth_of(options, hand_rate_hz, inertia_about_joint(body),
                                          body.coupling_angular_stiffness, old_periods));
      }
    }
  }
  return worst;
}

void check_stability(const TrackingOptions& options, double hand_rate_hz, const HandModel& hand) {
  const double growth = chain_growth(options, hand_rate_hz, hand);
  if (growth < 1) return;
  // Search the nearest values that pass. Reduce the feedback first, because it costs least. Then make the intermediate
  // layer stiffer and lighter.
  TrackingOptions better = options;
  for (int attempt = 0; attempt < 40 && chain_growth(better, hand_rate_hz, hand) >= 1; ++attempt) {
    if (better.feedback_ratio > 0.1) {
      better.feedback_ratio = std::max(0.1, better.feedback_ratio * 0.8);
    } else {
      better.mass_fraction = std::max(0.001, better.mass_fraction * 0.8);
      better.stiffness_ratio = std::min(1000.0, better.stiffness_ratio * 1.1);
    }
  }
  char text[640];
  std::snprintf(text, sizeof text,
                "tracking: stiffness_ratio %g, feedback_ratio %g, mass_fraction %g at %g Hz with a hand at %g Hz: "
                "small deviations grow by a factor of %.4f per hand period; expected less than 1, e.g. "
                "stiffness_ratio %g, feedback_ratio %g, mass_fraction %g",
                options.stiffness_ratio, options.feedback_ratio, options.mass_fraction, options.rate_hz, hand_rate_hz,
                growth, better.stiffness_ratio, better.feedback_ratio, better.mass_fraction);
  throw std::invalid_argument(text);
}

TrackingLoop::TrackingLoop(const TrackingOptions& options, double hand_rate_hz, const HandModel& hand, HandKey key)
    : options_(options),
      time_step_(1 / options.rate_hz),
      feedback_ratio_(options.feedback_ratio),
      key_(key),
      input_(options.input) {
  check_stability(options, hand_rate_hz, hand);
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const BodyModel& body = hand.bodies[b];
    Bone& bone = bones_[b];
    bone.mass = options.mass_fraction * body.mass;
    bone.inertia = options.mass_fraction * inertia_about_joint(body);
    bone.coupling_linear = body.coupling_linear_stiffness;
    bone.coupling_angular = body.coupling_angular_stiffness;
    bone.force_cap = body.coupling_force_cap;
    bone.torque_cap = body.coupling_torque_cap;
    bone.tracked_linear = tracked_stiffness(options.stiffness_ratio, bone.coupling_linear, bone.mass);
    bone.tracked_angular = tracked_stiffness(options.stiffness_ratio, bone.coupling_angular, bone.inertia);
    bone.damping_linear = 2 * options.damping_ratio * std::sqrt(bone.tracked_linear * bone.mass);
    bone.damping_angular = 2 * options.damping_ratio * std::sqrt(bone.tracked_angular * bone.inertia);
  }
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Joint own = joint_of(body_of(static_cast<Joint>(j)));
    if (index(own) != j) joint_in_body_[j] = hand.rest_joints[index(own)].inverse() * hand.rest_joints[j];
    radii_[j] = hand.joint_radii[j];
  }
  bone_contacts_ = {};
}

/// Counts a sample of the hand that may not be used. A sample of a hand in time is younger than two of its periods.
bool TrackingLoop::is_timely(Nanoseconds sample_time, Nanoseconds now) {
  const std::optional<double> age = age_of(sample_time, now);
  if (!age) ++refused_future_;
  const bool is_late = age > options_.simulated_stale_after;
  if (is_late) ++refused_late_;
  return age && !is_late;
}

void TrackingLoop::take_simulated(const Skeleton& simulated, Nanoseconds now) {
  if (simulated_any_ && simulated.stamp.epoch == simulated_stamp_.epoch &&
      simulated.stamp.sequence <= simulated_stamp_.sequence)
    return;
  if (!is_timely(simulated.stamp.sample_time, now)) return;
  simulated_stamp_ = simulated.stamp;
  simulated_arrival_ = now;
  simulated_any_ = true;
  for (std::size_t b = 1; b < kBodyCount; ++b) {
    Bone& bone = bones_[b];
    const JointSample& joint = simulated.joints[index(joint_of(static_cast<Body>(b)))];
    const bool good = is_usable(joint);
    bone.simulated_seen = good;
    if (!good) {
      ++simulated_refused_;
      continue;
    }
    bone.simulated = {to_vector(joint.position), to_quaternion(joint.orientation).normalized()};
    bone.simulated_velocity = {to_vector(joint.linear_velocity), to_vector(joint.angular_velocity)};
  }
}

Pose TrackingLoop::simulated_at(const Bone& bone, double age) const {
  return increment(bone.simulated, age * bone.simulated_velocity.linear, age * bone.simulated_velocity.angular);
}

double TrackingLoop::Spring::energy(const Vector3& stretch, const Vector3& turn) const {
  const auto capped_energy = [](double k, double limit, double d) {
    return k * d > limit ? limit * d - 0.5 * limit * limit / k : 0.5 * k * d * d;
  };
  return capped_energy(stiffness, cap, stretch.norm()) + capped_energy(angular_stiffness, torque_cap, turn.norm());
}

TrackingLoop::Spring TrackingLoop::tracked_spring(const Bone& bone) const {
  const double c = bone.confidence;
  return {c * bone.tracked_linear, c * bone.tracked_angular, c * options_.stiffness_ratio * bone.force_cap,
          c * options_.stiffness_ratio * bone.torque_cap};
}

TrackingLoop::Spring TrackingLoop::feedback_spring(const Bone& bone) const {
  const double ratio = bone.confidence * feedback_ratio_;
  return {ratio * bone.coupling_linear, ratio * bone.coupling_angular, ratio * bone.force_cap, ratio * bone.torque_cap};
}

// The spring with which the simulated bone follows this one.
TrackingLoop::Spring TrackingLoop::coupling_of(const Bone& bone) const {
  const double c = bone.confidence;
  return {c * bone.coupling_linear, c * bone.coupling_angular, c * bone.force_cap, c * bone.torque_cap};
}

void TrackingLoop::move(Bone& bone, const BodyTarget& target, double simulated_age, bool simulated_fresh,
                        EnergyFlow* flow) const {
  const double h = time_step_;
  const bool feedback = simulated_fresh && bone.simulated_seen && feedback_ratio_ > 0;
  const Pose copy = feedback ? simulated_at(bone, simulated_age) : Pose{};
  const bool springs_change = std::exchange(bone.confidence, target.confidence) != target.confidence;
  const Spring tracked = tracked_spring(bone), back = feedback_spring(bone);
  const Pose start = bone.pose;
  const Twist start_velocity = bone.velocity;

  // Translation: the potential is quadratic, so one linear solve is exact. If a spring exceeds its cap, its secant
  // stiffness at the start of the step is used.
  const Vector3 to_tracked = target.pose.position - bone.pose.position;
  const Vector3 to_copy = feedback ? Vector3(copy.position - bone.pose.position) : Vector3::Zero();
  const double k1 = capped(tracked.stiffness, to_tracked.norm(), tracked.cap);
  const double k2 = feedback ? capped(back.stiffness, to_copy.norm(), back.cap) : 0.0;
  const Vector3 step = (bone.mass / h * bone.velocity.linear + k1 * to_tracked + k2 * to_copy) /
                       (bone.mass / (h * h) + bone.damping_linear / h + k1 + k2);

  // Rotation: the gradient of 1/2 k |log(exp(theta) R R_target^T)|^2 is k times that logarithm. (The Jacobian of log
  // maps its own argument to itself.) The Hessian is at most k. Newton's method with this bound descends monotonically
  // and needs one division.
  const Vector3 stretch = rotation_log(bone.pose.orientation * target.pose.orientation.conjugate());
  const Vector3 stretch_copy =
      feedback ? rotation_log(bone.pose.orientation * copy.orientation.conjugate()) : Vector3::Zero();
  const double a1 = capped(tracked.angular_stiffness, stretch.norm(), tracked.torque_cap);
  const double a2 = feedback ? capped(back.angular_stiffness, stretch_copy.norm(), back.torque_cap) : 0.0;
  const double curvature = bone.inertia / (h * h) + bone.damping_angular / h + a1 + a2;
  Vector3 theta = Vector3::Zero();
  Quaternion orientation = bone.pose.orientation;
  for (int iteration = 0; iteration < kRotationIterations; ++iteration) {
    Vector3 gradient = bone.inertia / (h * h) * (theta - h * bone.velocity.angular) + bone.damping_angular / h * theta +
                       a1 * rotation_log(orientation * target.pose.orientation.conjugate());
    if (feedback) gradient += a2 * rotation_log(orientation * copy.orientation.conjugate());
    const Vector3 change = -gradient / curvature;
    theta += change;
    orientation = (rotation_exp(theta) * bone.pose.orientation).normalized();
    if (change.squaredNorm() < 1e-24) break;
  }

  bone.pose.position += step;
  bone.pose.orientation = orientation;
  bone.velocity.linear = step / h;
  bone.velocity.angular = theta / h;
  if (flow == nullptr) return;

  const double kinetic =
      0.5 * (bone.mass * start_velocity.linear.squaredNorm() + bone.inertia * start_velocity.angular.squaredNorm());
  flow->work += kinetic - bone.kinetic;  // work on a bone that was moved from outside since the last step
  bone.kinetic =
      0.5 * (bone.mass * bone.velocity.linear.squaredNorm() + bone.inertia * bone.velocity.angular.squaredNorm());
  flow->stored += bone.kinetic;
  flow->integrator += 0.5 * (bone.mass * (bone.velocity.linear - start_velocity.linear).squaredNorm() +
                             bone.inertia * (bone.velocity.angular - start_velocity.angular).squaredNorm());
  flow->damping += (bone.damping_linear * step.squaredNorm() + bone.damping_angular * theta.squaredNorm()) / h;
  // The force at the end of the step does work at both ends of a spring. The bone's end moves by `step`. The other end
  // moves as its skeleton did since the last step. A spring that was inactive in the last step enters the ledger with
  // its stretch at the start of this step.
  const auto pull = [&](const Spring& spring, double k, double a, bool was_attached, Pose& end_before, const Pose& end,
                        double& energy) {
    if (!was_attached) end_before = end;
    if (!was_attached || springs_change) {
      const double before =
          std::exchange(energy, spring.energy(start.position - end_before.position,
                                              rotation_log(start.orientation * end_before.orientation.conjugate())));
      flow->work += was_attached ? energy - before : energy;
    }
    const Vector3 stretch_now = bone.pose.position - end.position;
    const Vector3 turn_now = rotation_log(bone.pose.orientation * end.orientation.conjugate());
    const Vector3 moved = end.position - end_before.position;
    const Vector3 turned = rotation_log(end.orientation * end_before.orientation.conjugate());
    const double before = std::exchange(energy, spring.energy(stretch_now, turn_now));
    flow->stored += energy;
    flow->work -= k * stretch_now.dot(moved) + a * turn_now.dot(turned);
    flow->integrator += before - energy + k * stretch_now.dot(step - moved) + a * turn_now.dot(theta - turned);
    end_before = end;
  };
  pull(tracked, k1, a1, bone.entered, bone.tracked_end, target.pose, bone.tracked_energy);
  if (feedback) {
    pull(back, k2, a2, bone.had_feedback, bone.copy_end, copy, bone.feedback_energy);
  } else {
    flow->work -= std::exchange(bone.feedback_energy, 0.0);
  }
  bone.had_feedback = feedback;
  bone.entered = true;
}

// Takes the energy of a bone and of its springs out of the ledger before the bone is set to another pose. The next step
// enters their energy at the new pose.
void TrackingLoop::release(Bone& bone, EnergyFlow& flow) {
  flow.work -= bone.kinetic + bone.tracked_energy + bone.feedback_energy;
  bone.kinetic = bone.tracked_energy = bone.feedback_energy = 0;
  bone.entered = bone.had_feedback = false;
}

void TrackingLoop::reset(Nanoseconds time) {
  reset_time_ = time;
  input_ = TrackedInput(options_.input);
  for (Bone& bone : bones_) bone.placed = bone.simulated_seen = false;
  simulated_any_ = reposition_asked_ = false;
  bone_contacts_ = {};
}

const TrackingOutput& TrackingLoop::step(Nanoseconds now, const TrackingInput& input) {
  if (input.head != nullptr) input_.add_head_pose(*input.head, now);
  const auto is_usable = [this](const auto* sample) {
    return sample != nullptr && sample->stamp.sample_time > reset_time_;
  };
  // The stamp of a tracker with another clock does not say whether a sample was taken before the reset.
  const bool is_timed = input.tracked != nullptr && is_plausible(input.tracked->stamp.sample_time, now);
  if (input.tracked != nullptr && (!is_timed || is_usable(input.tracked))) input_.add_sample(*input.tracked, now);
  if (is_usable(input.simulated)) take_simulated(*input.simulated, now);
  if (is_usable(input.contacts) && is_timely(input.contacts->stamp.sample_time, now)) {
    bone_contacts_ = sum_contacts(*input.contacts);
    contacts_arrival_ = now;
    contacts_time_ = input.contacts->stamp.sample_time;
  }

  const std::array<BodyTarget, kBodyCount>& targets = input_.targets(now);
  const bool reposition = input_.take_repositioned() || reposition_asked_;
  reposition_asked_ = false;
  const bool fresh = simulated_any_ && age_of(simulated_arrival_, now).value_or(0) <= options_.simulated_stale_after;
  const double age =
      std::min(age_of(simulated_stamp_.sample_time, now).value_or(0), options_.input.extrapolation_limit);

  output_.valid = false;
  coupling_stretch_ = 0;
  if (!input.ledger_requested) ledger_.restart();
  EnergyFlow flow;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    Bone& bone = bones_[b];
    if (!targets[b].valid) {
      flow.stored += bone.kinetic + bone.tracked_energy + bone.feedback_energy;
      continue;
    }
    output_.valid = true;
    if (reposition || !bone.placed) {
      release(bone, flow);
      bone.pose = targets[b].pose;
      bone.velocity = targets[b].velocity;
      bone.confidence = targets[b].confidence;
      bone.placed = true;
    } else {
      move(bone, targets[b], age, fresh, input.ledger_requested ? &flow : nullptr);
    }
    coupling_stretch_ = std::max(coupling_stretch_, (bone.pose.position - targets[b].pose.position).norm());
  }
  if (input.ledger_requested && output_.valid) ledger_.add(flow);
  ++sequence_;
  publish_skeleton(now);
  if (input.wrench_requested) publish_wrench(now, targets, age, fresh);
  return output_;
}

void TrackingLoop::publish_skeleton(Nanoseconds now) {
  Skeleton& out = output_.intermediate;
  const Stamp& tracked = input_.stamp();
  out.hand = key_;
  out.stamp.sequence = sequence_;
  out.stamp.sample_time = out.stamp.publish_time = now;
  out.stamp.chain = tracked.chain;
  if (tracked.chain.tracker_sample == 0) out.stamp.chain.tracker_sample = tracked.sample_time;
  out.stamp.chain.tracked_published = tracked.publish_time;
  out.stamp.chain.intermediate_published = now;
  out.confidence = input_.stale(now) ? 0.0 : input_.confidence();
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Bone& bone = bones_[static_cast<std::size_t>(index_of(body_of(static_cast<Joint>(j))))];
    JointSample& joint = out.joints[j];
    joint.flags = bone.placed ? kJointValid : 0;
    joint.velocity_valid = bone.placed ? 1 : 0;
    if (!bone.placed) continue;
    const Pose pose = bone.pose * joint_in_body_[j];
    const Vector3 lever = pose.position - bone.pose.position;
    joint.position = to_wire(pose.position);
    joint.orientation = to_wire(pose.orientation);
    joint.linear_velocity = to_wire(Vector3(bone.velocity.linear + bone.velocity.angular.cross(lever)));
    joint.angular_velocity = to_wire(bone.velocity.angular);
    joint.radius = radii_[j];
    joint.confidence = bone.confidence;
  }
}

void TrackingLoop::publish_wrench(Nanoseconds now, const std::array<BodyTarget, kBodyCount>& targets,
                                  double simulated_age, bool simulated_fresh) {
  BoneWrench& out = output_.wrench;
  out.hand = key_;
  out.stamp.sequence = sequence_;
  out.stamp.sample_time = out.stamp.publish_time = now;
  out.stamp.chain = simulated_stamp_.chain;
  out.stamp.chain.simulated_published = simulated_stamp_.publish_time;
  out.stamp.chain.wrench_published = now;
  out.simulated_valid = simulated_fresh ? 1 : 0;
  const bool contacts_fresh =
      simulated_fresh && age_of(contacts_arrival_, now).value_or(0) <= options_.simulated_stale_after;
  const double contacts_age = std::min(age_of(contacts_time_, now).value_or(0), options_.input.extrapolation_limit);
  const Bone& carpus = bones_[static_cast<std::size_t>(index_of(Body::carpus))];
  const Twist wrist = simulated_fresh && carpus.simulated_seen ? carpus.simulated_velocity : Twist{};
  out.wrist_velocity = to_wire(wrist.linear);
  out.wrist_angular_velocity = to_wire(wrist.angular);
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Bone& bone = bones_[b];
    BoneSample& sample = out.bones[b];
    sample = BoneSample{};
    if (!bone.placed) continue;
    sample.tracked_position = to_wire(targets[b].pose.position);
    sample.tracked_orientation = to_wire(targets[b].pose.orientation);
    sample.intermediate_position = to_wire(bone.pose.position);
    sample.intermediate_orientation = to_wire(bone.pose.orientation);
    // The forearm's frame is not in the message. The forearm follows the wrist, and the carpus reports the wrist's
    // coupling.
    if (!simulated_fresh || !bone.simulated_seen) continue;
    const Pose copy = simulated_at(bone, simulated_age);
    sample.simulated_position = to_wire(copy.position);
    sample.simulated_orientation = to_wire(copy.orientation);
    const Vector3 stretch = copy.position - bone.pose.position;
    const Vector3 turn = rotation_log(copy.orientation * bone.pose.orientation.conjugate());
    const Spring spring = coupling_of(bone);
    sample.coupling_force = to_wire(Vector3(capped(spring.stiffness, stretch.norm(), spring.cap) * stretch));
    sample.coupling_torque = to_wire(Vector3(capped(spring.angular_stiffness, turn.norm(), spring.torque_cap) * turn));
    if (!contacts_fresh) continue;
    sample.contact_force = to_wire(bone_contacts_[b].force);
    const BoneCoupling coupling{spring.stiffness, spring.cap, bone.mass / options_.mass_fraction};
    write_local_model(bone_contacts_[b], coupling, stretch.norm(), bone.pose.position - bone.simulated.position,
                      contacts_age, sample);
  }
}

MessageReply TrackingLoop::answer(const Message& message, const std::string& module) {
  if (!is_addressed(message, module)) return reply_to(message, module, kReplyIgnored, "not for this module");
  const std::string_view key = get_text(message.key);
  if (key == "reposition") {
    reposition_asked_ = true;
    return reply_to(message, module, kReplyApplied, "intermediate skeleton set to the tracked one");
  }
  if (key == "feedback_ratio") {
    const auto value = parse_number(get_text(message.value));
    if (!value || *value < 0 || *value > options_.feedback_ratio) {
      return reply_to(message, module, kReplyRefused,
                      "feedback_ratio: expected a number from 0 to the configured value");
    }
    feedback_ratio_ = *value;
    return reply_to(message, module, kReplyApplied, "feedback_ratio set");
  }
  return reply_to(message, module, kReplyIgnored, "unknown key; known: reposition, feedback_ratio");
}

void TrackingLoop::fill_status(LoopStatus& status, Nanoseconds now) const {
  const double age = input_.age(now);
  status.input_age_ms = age < 0 ? -1 : age * 1e3;
  status.coupling_stretch = coupling_stretch_;
  if (ledger_.started())
    ledger_.for_each_row([&status](std::string_view name, double joules) { add_named(status.ledger, name, joules); });
  const TrackedInputCounters& c = input_.counters();
  const auto add = [&status](std::string_view name, std::uint64_t value) {
    add_counter(status, name, static_cast<double>(value));
  };
  add("accepted", c.accepted);
  add("refused_nonfinite", c.refused_nonfinite);
  add("refused_implausible", c.refused_implausible);
  add("refused_order", c.refused_order);
  add("refused_mount", c.refused_mount);
  add("refused_future", refused_future_);
  add("refused_late", refused_late_);
  add("refused_head_clock", c.refused_head_clock);
  add("implausible_clock", c.implausible_clock);
  add("inferred", c.inferred);
  add("repositioned", c.repositioned);
  add("swapped", c.swapped);
  add("simulated_refused", simulated_refused_);
  add("stale", input_.stale(now) ? 1 : 0);
}

}  // namespace softhand
