#include "cli/outcome.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>

#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kPressingForce = 3.0;   // N; depths are compared only up to this force of a finger
constexpr double kClosedFist = 0.060;    // m, middle fingertip to middle metacarpal joint
constexpr double kHeldMovement = 0.005;  // m in the palm's frame
constexpr double kUpright = 0.087;       // rad, 5 degrees, of an object that was put back
constexpr double kGripGap = 0.1;         // s
constexpr double kAtRest = 0.005;        // m/s
constexpr double kLargestShift = 0.030;  // s; a constant lag is searched from minus this to twice this
constexpr double kGapPeriods = 4;        // in median sample periods; a longer interval without tracked samples is a gap

double seconds(Nanoseconds t) { return static_cast<double>(t) * 1e-9; }

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

// Pose at a time, interpolated linearly between neighbours (orientation: shortest arc). Empty outside the range of the
// samples, and between neighbours that are more than `longest_span` seconds apart.
template <typename Sample, typename Get>
std::optional<Pose> pose_at(const std::vector<Sample>& samples, double time, Get get,
                            double longest_span = std::numeric_limits<double>::infinity()) {
  const auto after = std::lower_bound(samples.begin(), samples.end(), time,
                                      [](const Sample& s, double t) { return seconds(s.time) < t; });
  if (after == samples.end() || (after == samples.begin() && seconds(after->time) > time)) return std::nullopt;
  if (after == samples.begin()) return get(*after);
  const auto before = after - 1;
  const double span = seconds(after->time) - seconds(before->time);
  if (span > longest_span && time < seconds(after->time)) return std::nullopt;
  const double u = span > 0 ? (time - seconds(before->time)) / span : 1.0;
  const Pose a = get(*before);
  const Pose b = get(*after);
  return Pose{(1 - u) * a.position + u * b.position, a.orientation.slerp(u, b.orientation)};
}

// Seconds between successive samples. The samples are in order of time. Duplicates are skipped.
template <typename Sample>
std::vector<double> intervals(const std::vector<Sample>& samples) {
  std::vector<double> out;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const double interval = seconds(samples[i].time - samples[i - 1].time);
    if (interval > 0) out.push_back(interval);
  }
  return out;
}

std::optional<MotionPhase> find(const std::vector<MotionPhase>& phases, const std::string& name) {
  for (const MotionPhase& phase : phases) {
    if (phase.name == name) return phase;
  }
  return std::nullopt;
}

// The direction at `to` that was upright at `from`.
Vector3 upright(const Pose& from, const Pose& to) {
  return to.orientation * (from.orientation.conjugate() * Vector3::UnitY());
}

// Angle by which the direction that was upright at `from` has left the vertical, rad.
double tilt_between(const Pose& from, const Pose& to) {
  return std::acos(std::clamp(upright(from, to).y(), -1.0, 1.0));
}

std::size_t joint(Joint j) { return static_cast<std::size_t>(index_of(j)); }

bool valid(const Skeleton& skeleton) {
  return std::all_of(skeleton.joints.begin(), skeleton.joints.end(),
                     [](const JointSample& j) { return (j.flags & kJointValid) != 0; });
}

std::array<Pose, kJointCount> poses_of(const Skeleton& skeleton) {
  std::array<Pose, kJointCount> poses;
  for (std::size_t j = 0; j < kJointCount; ++j) poses[j] = to_pose(skeleton.joints[j]);
  return poses;
}

}  // namespace

void join_success(Json& summary, const char* part) {
  if (!summary.contains(part) || !summary[part].contains("success")) return;
  const Json of_part = summary[part];
  summary["success"] = of_part["success"].get<bool>() && summary.value("success", true);
  summary["success_because"] =
      (summary.contains("success_because") ? summary["success_because"].get<std::string>() + "; " : "") +
      of_part["success_because"].get<std::string>();
}

double percentile(std::vector<double> values, double q) {
  if (values.empty()) return std::nan("");
  const auto at = static_cast<std::size_t>(
      std::min(q * static_cast<double>(values.size()), static_cast<double>(values.size() - 1)));
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(at), values.end());
  return values[at];
}

void Outcome::on_tracked(const Skeleton& skeleton) {
  const Stamp& stamp = skeleton.stamp;
  tracker_samples_.push_back(
      {stamp.chain.tracker_sample != 0 ? stamp.chain.tracker_sample : stamp.sample_time, stamp.publish_time});
  if (valid(skeleton)) tracked_.push_back({skeleton.stamp.sample_time, poses_of(skeleton)});
}

void Outcome::on_simulated(const Skeleton& skeleton) {
  for (const JointSample& j : skeleton.joints) {
    if (!all_finite(j.position) || !all_finite(j.orientation) || !all_finite(j.linear_velocity) ||
        !all_finite(j.angular_velocity)) {
      ++nonfinite_;
      return;
    }
  }
  simulated_.push_back({skeleton.stamp.sample_time, poses_of(skeleton)});
}

void Outcome::on_contacts(const Contacts& contacts) {
  ContactSample sample{contacts.stamp.sample_time, {}, {}, {}};
  for (std::size_t f = 0; f < sample.finger_force.size(); ++f) {
    const FingerContact& finger = contacts.fingers[f];
    if (!all_finite(finger.force) || !all_finite(finger.centre) || !std::isfinite(finger.area)) ++nonfinite_;
    sample.finger_force[f] = to_vector(finger.force).norm();
    sample.finger_object[f] = finger.object;
    sample.finger_contacts[f] = finger.contact_count;
  }
  contacts_.push_back(sample);
  const std::size_t first = presses_.size();
  for (const Contact& contact : contacts.contacts) {
    if (!all_finite(contact.force) || !all_finite(contact.point) || !std::isfinite(contact.penetration)) ++nonfinite_;
    const auto finger = std::min<std::size_t>(contact.finger, 5);
    penetrations_.push_back({sample.time, contact.finger, contact.penetration, sample.finger_force[finger]});
    auto press = std::find_if(presses_.begin() + static_cast<std::ptrdiff_t>(first), presses_.end(),
                              [&contact](const Press& p) { return p.object == contact.object; });
    if (press == presses_.end()) press = presses_.insert(press, {sample.time, contact.object, {}});
    const bool phalanx = contact.body < kBodyCount && !is_metacarpal(static_cast<Body>(contact.body));
    press->force[phalanx ? finger : static_cast<std::size_t>(Finger::palm)] += to_vector(contact.force).norm();
  }
}

void Outcome::on_coupling(const ObjectCoupling& coupling) {
  for (const ObjectTwin& twin : coupling.twins) {
    if (!all_finite(twin.position) || !all_finite(twin.orientation) || !all_finite(twin.contact_force) ||
        !all_finite(twin.linear_velocity)) {
      ++nonfinite_;
      continue;
    }
    twins_.push_back({coupling.stamp.sample_time, twin.object, twin.owned != 0,
                      to_pose(twin.position, twin.orientation), to_vector(twin.linear_velocity),
                      to_vector(twin.contact_force)});
  }
}

void Outcome::on_objects(const WorldObjects& objects) {
  for (const ObjectState& object : objects.objects) {
    if (!all_finite(object.position) || !all_finite(object.orientation) || !all_finite(object.linear_velocity)) {
      ++nonfinite_;
      continue;
    }
    objects_.push_back({objects.stamp.sample_time, object.object, to_pose(object.position, object.orientation),
                        to_vector(object.linear_velocity)});
  }
}

void Outcome::on_bone_wrench(const BoneWrench& wrench) {
  std::array<double, 6> finger{};
  double hand = 0;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    if (!all_finite(wrench.bones[b].coupling_force) || !all_finite(wrench.bones[b].coupling_torque)) {
      ++nonfinite_;
      return;
    }
    const double force = to_vector(wrench.bones[b].coupling_force).norm();
    finger[static_cast<std::size_t>(finger_of(static_cast<Body>(b)))] += force;
    hand += force;
  }
  for (std::size_t f = 0; f < kFingerCount; ++f)
    largest_finger_coupling_ = std::max(largest_finger_coupling_, finger[f]);
  largest_hand_coupling_ = std::max(largest_hand_coupling_, hand);
}

void Outcome::on_device(const DeviceState& state) {
  for (const double command : state.commands) {
    if (!std::isfinite(command)) ++nonfinite_;
  }
  const Chain& chain = state.stamp.chain;
  if (state.live == 0 || state.kind != 0 || chain.tracker_sample == 0 || chain.wrench_published == 0) return;
  const auto ms = [](Nanoseconds from, Nanoseconds to) {
    return from == 0 || to == 0 ? std::nan("") : static_cast<double>(to - from) * 1e-6;
  };
  const Nanoseconds to_hand =
      chain.intermediate_published != 0 ? chain.intermediate_published : chain.tracked_published;
  latencies_.push_back(
      {{ms(chain.tracker_sample, chain.tracked_published), ms(chain.tracked_published, chain.intermediate_published),
        ms(to_hand, chain.simulated_published), ms(chain.simulated_published, chain.wrench_published),
        ms(chain.wrench_published, state.stamp.publish_time), ms(chain.tracker_sample, state.stamp.publish_time)}});
  commands_.push_back({chain.tracker_sample, state.stamp.publish_time});
}

std::vector<double> Outcome::first_effects_ms() const {
  std::vector<double> effects;
  auto command = commands_.begin();
  for (const PublishedSample& sample : tracker_samples_) {
    if (commands_.empty() || sample.published < commands_.front().published) continue;  // the rig was not complete
    command = std::find_if(command, commands_.end(),
                           [&sample](const PublishedSample& c) { return c.tracker_sample >= sample.tracker_sample; });
    if (command == commands_.end()) break;
    effects.push_back(static_cast<double>(command->published - sample.published) * 1e-6);
  }
  return effects;
}

double Outcome::longest_tracked_interval() const {
  const double median = percentile(intervals(tracked_), 0.5);
  return std::isnan(median) ? std::numeric_limits<double>::infinity() : kGapPeriods * median;
}

double Outcome::last_time(const OutcomeFrame& frame) const {
  double last = std::numeric_limits<double>::infinity();
  if (!contacts_.empty()) last = seconds(contacts_.back().time);
  if (!frame.phases.empty()) last = std::min(last, seconds(frame.motion_start) + frame.phases.back().end + 0.5);
  return last;
}

Json Outcome::pinch(const OutcomeFrame& frame) const {
  const double start = seconds(frame.motion_start);
  Json json;
  std::vector<TwinSample> twins;
  std::copy_if(twins_.begin(), twins_.end(), std::back_inserter(twins),
               [&frame](const TwinSample& t) { return t.object == frame.object; });

  double slip = std::nan("");
  double weight_ratio = std::nan("");
  double inertia_ratio = std::nan("");
  double lifted = std::nan("");
  double turned = std::nan("");
  std::array<double, 6> hold_force{};
  const auto hold = find(frame.phases, "hold");
  if (hold) {
    // Slip: the largest movement of the object in the frames of the two distal bones since the hold began. The larger
    // of the two bones' values counts.
    std::array<Vector3, 2> reference{Vector3::Zero(), Vector3::Zero()};
    std::array<bool, 2> referred{};
    double force_sum = 0;
    std::size_t count = 0;
    for (const TwinSample& twin : twins) {
      const double t = seconds(twin.time) - start;
      if (t < hold->begin || t > hold->end || !twin.owned) continue;
      force_sum += twin.contact_force.y();
      ++count;
      std::size_t k = 0;
      for (const Joint distal : {Joint::thumb_distal, Joint::index_distal}) {
        const auto bone =
            pose_at(simulated_, seconds(twin.time), [distal](const HandSample& s) { return s.joints[joint(distal)]; });
        if (bone) {
          const Vector3 local = bone->inverse() * twin.pose.position;
          if (!referred[k]) reference[k] = local;
          referred[k] = true;
          const double moved = (local - reference[k]).norm() * 1e3;
          slip = std::isnan(slip) ? moved : std::max(slip, moved);
        }
        ++k;
      }
    }
    // The mean is over all steps of the hold, including steps without contact.
    std::size_t steps = 0;
    for (const ContactSample& c : contacts_) {
      const double t = seconds(c.time) - start;
      steps += t >= hold->begin && t <= hold->end ? 1 : 0;
    }
    for (const Press& press : presses_) {
      const double t = seconds(press.time) - start;
      if (t < hold->begin || t > hold->end || press.object != frame.object) continue;
      for (std::size_t f = 0; f < hold_force.size(); ++f) hold_force[f] += press.force[f] / static_cast<double>(steps);
    }
    if (count > 0) weight_ratio = force_sum / static_cast<double>(count) / (frame.object_mass * frame.gravity);
    const auto before = find(frame.phases, "lift");
    if (before && !twins.empty()) {
      const auto pose_of = [](const TwinSample& s) { return s.pose; };
      const auto low = pose_at(twins, start + before->begin, pose_of);
      const auto high = pose_at(twins, start + hold->end - 0.05, pose_of);
      if (low && high) lifted = (high->position.y() - low->position.y()) * 1e3;
    }
  }
  if (const auto turn = find(frame.phases, "turn"); turn && !twins.empty()) {
    const auto pose_of = [](const TwinSample& s) { return s.pose; };
    const auto from = pose_at(twins, start + turn->begin, pose_of);
    const auto to = pose_at(twins, start + turn->end, pose_of);
    if (from && to) turned = rotation_log(to->orientation * from->orientation.conjugate()).norm() * 180.0 / M_PI;
  }
  if (const auto shake = find(frame.phases, "shake"); shake && frame.shake_frequency > 0) {
    // Fit position and force with c + s sin(wt) + k cos(wt) by least squares over whole periods. The acceleration is
    // minus w^2 times the position. The ratio uses the part of the force that is in phase with the acceleration.
    const double w = 2 * M_PI * frame.shake_frequency;
    std::vector<const TwinSample*> window;
    const double settle = shake->begin + 2.0 / frame.shake_frequency;  // the first two periods are skipped, because
                                                                       // transients die out in them
    const double periods = std::floor((shake->end - settle) * frame.shake_frequency + 1e-9);
    for (const TwinSample& twin : twins) {
      const double t = seconds(twin.time) - start;
      if (twin.owned && t >= settle && t < settle + periods / frame.shake_frequency) window.push_back(&twin);
    }
    if (window.size() >= 12 && periods >= 1) {
      Eigen::MatrixXd basis(window.size(), 3);
      Eigen::MatrixXd data(window.size(), 6);
      for (std::size_t i = 0; i < window.size(); ++i) {
        const double phase = w * (seconds(window[i]->time) - start);
        const auto row = static_cast<Eigen::Index>(i);
        basis.row(row) << 1.0, std::sin(phase), std::cos(phase);
        data.row(row) << window[i]->pose.position.transpose(), window[i]->contact_force.transpose();
      }
      const Eigen::MatrixXd fit = basis.colPivHouseholderQr().solve(data);
      const auto x = fit.block<2, 3>(1, 0);
      const auto f = fit.block<2, 3>(1, 3);
      const double power = x.squaredNorm();
      if (power > 1e-10) inertia_ratio = -(f.cwiseProduct(x)).sum() / (frame.object_mass * w * w * power);
    }
  }

  std::vector<double> depths;
  std::size_t hard = 0;
  for (const Penetration& p : penetrations_) {
    if (p.depth <= 0) continue;
    if (p.finger_force <= kPressingForce) {
      depths.push_back(p.depth * 1e3);
    } else {
      ++hard;
    }
  }
  const std::size_t touching = depths.size() + hard;

  // Released: in the last half second nothing touched the object, and it lay still.
  Json released = nullptr;
  if (!contacts_.empty() && !objects_.empty()) {
    const double end = last_time(frame);
    bool touched = false;
    for (const ContactSample& c : contacts_) {
      if (seconds(c.time) < end - 0.5 || seconds(c.time) > end) continue;
      for (std::size_t f = 0; f < c.finger_force.size(); ++f)
        touched = touched || (c.finger_contacts[f] > 0 && c.finger_object[f] == frame.object);
    }
    // The median is used because a physics engine may give a standing object a speed of some mm/s for one step.
    std::vector<double> speeds;
    for (const ObjectSample& o : objects_) {
      if (o.object == frame.object && seconds(o.time) >= end - 0.5 && seconds(o.time) <= end)
        speeds.push_back(o.velocity.norm());
    }
    released = !touched && percentile(speeds, 0.5) < kAtRest;
  }

  json["held_slip_mm"] = number(slip);
  json["carried_weight_ratio"] = number(weight_ratio);
  json["inertia_ratio"] = number(inertia_ratio);
  json["lifted_mm"] = number(lifted);
  json["turned_deg"] = number(turned);
  const auto palm = hold_force.begin() + static_cast<std::ptrdiff_t>(Finger::palm);
  const double fingers = std::accumulate(hold_force.begin(), palm, 0.0);
  for (std::size_t f = 0; f < hold_force.size(); ++f)
    json["hold_force_n"][std::string(kFingerNames[f])] = hold_force[f];
  json["hold_share_min"] = number(fingers > 0 ? *std::min_element(hold_force.begin(), palm) / fingers : std::nan(""));
  json["penetration_p95_mm"] = number(percentile(depths, 0.95));
  json["penetration_max_mm"] = number(depths.empty() ? std::nan("") : *std::max_element(depths.begin(), depths.end()));
  json["pressing_harder_fraction"] =
      number(touching == 0 ? std::nan("") : static_cast<double>(hard) / static_cast<double>(touching));
  json["released"] = released;
  if (frame.goal.any()) json.update(success(frame, released == true));
  return json;
}

Json Outcome::success(const OutcomeFrame& frame, bool released) const {
  const Goal& goal = frame.goal;
  Json json;
  const ObjectSample *first = nullptr, *last = nullptr;
  double travel = 0, tilt = 0, other_tilt = 0;
  Vector3 side = Vector3::Zero();  // horizontal, of the largest tilt
  const double end = last_time(frame);
  for (const ObjectSample& each : objects_) {
    if (each.object != frame.object || seconds(each.time) > end) continue;
    if (first == nullptr) first = &each;
    last = &each;
    travel = std::max(travel, (each.pose.position - first->pose.position).norm());
    const double here = tilt_between(first->pose, each.pose);
    if (here > tilt) {
      tilt = here;
      side = upright(first->pose, each.pose);
      side.y() = 0;
      side.normalize();
    }
  }
  for (const ObjectSample& each : objects_) {
    if (each.object != frame.object || seconds(each.time) > end) continue;
    const Vector3 up = upright(first->pose, each.pose);
    other_tilt = std::max(other_tilt, std::atan2(-up.dot(side), up.y()));
  }
  const Swings swung = goal.swing > 0 ? swings(frame) : Swings{};
  const bool touched = std::any_of(presses_.begin(), presses_.end(),
                                   [&frame](const Press& press) { return press.object == frame.object; });
  const double away = first == nullptr ? 0 : (last->pose.position - first->pose.position).norm();
  const double end_tilt = first == nullptr ? 0 : tilt_between(first->pose, last->pose);
  constexpr double kDegrees = 180.0 / M_PI;
  json["travel_mm"] = travel * 1e3;
  json["tilt_deg"] = tilt * kDegrees;
  json["other_tilt_deg"] = other_tilt * kDegrees;
  json["end_distance_mm"] = away * 1e3;
  json["end_tilt_deg"] = end_tilt * kDegrees;
  const bool turns = frame.joint.law.turns();
  if (goal.swing > 0) {
    json[turns ? "swing_deg" : "swing_mm"] = swung.largest * (turns ? kDegrees : 1e3);
    json["swings"] = swung.times;
  }
  bool success = true;
  std::string because;
  const auto state = [&](bool holds, const char* text, double got, double asked, const char* unit) {
    success = success && holds;
    std::array<char, 160> line{};
    std::snprintf(line.data(), line.size(), text, got, unit, asked, unit);
    because += (because.empty() ? "" : "; ") + std::string(line.data());
  };
  if (first == nullptr) {
    success = false;
    because = "the world published no state of the object";
  } else if (!touched) {
    success = false;
    because = "the hand did not touch the object";
  } else {
    if (goal.travel > 0)
      state(travel >= goal.travel, "the object moved by %.1f %s (asked: %.1f %s)", travel * 1e3, goal.travel * 1e3,
            "mm");
    if (goal.tilt > 0)
      state(tilt >= goal.tilt, "it tilted by %.1f %s (asked: %.1f %s)", tilt * kDegrees, goal.tilt * kDegrees,
            "degrees");
    if (goal.both_sides)
      state(other_tilt >= goal.tilt, "and by %.1f %s to the other side (asked: %.1f %s)", other_tilt * kDegrees,
            goal.tilt * kDegrees, "degrees");
    if (goal.swing > 0) {
      const double scale = turns ? kDegrees : 1e3;
      const char* unit = turns ? "degrees" : "mm";
      state(swung.largest >= goal.swing, "the joint moved by %.1f %s (asked: %.1f %s)", swung.largest * scale,
            goal.swing * scale, unit);
      if (goal.closes > 0)
        state(swung.times >= goal.times, "this far and back %.0f %s (asked: %.0f %s)", swung.times, goal.times,
              "times");
    }
    if (goal.returns > 0) {
      state(away <= goal.returns, "it ended %.2f %s from its first place (allowed: %.2f %s)", away * 1e3,
            goal.returns * 1e3, "mm");
      if (goal.tilt > 0)
        state(end_tilt <= kUpright, "and tilted by %.1f %s (allowed: %.1f %s)", end_tilt * kDegrees,
              kUpright * kDegrees, "degrees");
    }
    if (goal.returns > 0 || goal.swing > 0) {
      success = success && released;
      because += released ? "; the hand let go of it, and it rests" : "; it was touched or moved at the end";
    }
  }
  json["success"] = success;
  json["success_because"] = because;
  return json;
}

Outcome::Swings Outcome::swings(const OutcomeFrame& frame) const {
  const JudgedJoint& joint = frame.joint;
  Swings swings;
  std::optional<Pose> parent;
  std::optional<double> first;
  bool open = false;
  const double end = last_time(frame);
  for (const ObjectSample& each : objects_) {
    if (seconds(each.time) > end) break;
    if (each.object == joint.parent) parent = each.pose;
    if (each.object != joint.child || !parent) continue;
    const double q = joint_coordinate(joint.law, {*parent, each.pose, joint.parent_from_joint, joint.child_from_joint});
    if (!first) first = q;
    const double rise = q - *first;
    swings.largest = std::max(swings.largest, rise);
    if (!open && rise >= frame.goal.swing) {
      open = true;
      if (frame.goal.closes <= 0) ++swings.times;
    } else if (open && frame.goal.closes > 0 && rise <= frame.goal.closes) {
      open = false;
      ++swings.times;
    }
  }
  return swings;
}

Json Outcome::following(const OutcomeFrame& frame) const {
  Json json;
  constexpr std::array<Joint, 5> tips{Joint::thumb_tip, Joint::index_tip, Joint::middle_tip, Joint::ring_tip,
                                      Joint::little_tip};
  // Free motion: no finger touches anything now or touched anything within the last 0.3 s.
  std::vector<double> touching;
  for (const ContactSample& c : contacts_) {
    if (std::any_of(c.finger_contacts.begin(), c.finger_contacts.end(), [](std::uint32_t n) { return n > 0; }))
      touching.push_back(seconds(c.time));
  }
  const auto free_motion = [&touching](double t) {
    const auto later = std::lower_bound(touching.begin(), touching.end(), t - 0.3);
    return later == touching.end() || *later > t;
  };
  const double longest = longest_tracked_interval();
  const double first = tracked_.empty() ? 0 : seconds(tracked_.front().time) + 0.5;  // the hand first moves to the
                                                                                     // place of the tracked hand
  const auto rms_at = [&](double shift) {
    double sum = 0;
    std::size_t count = 0;
    for (const HandSample& sample : simulated_) {
      const double t = seconds(sample.time);
      if (t < first || !free_motion(t)) continue;
      for (const Joint tip : tips) {
        const auto target = pose_at(
            tracked_, t - shift, [tip](const HandSample& s) { return s.joints[joint(tip)]; }, longest);
        if (!target) continue;
        sum += (target->position - sample.joints[joint(tip)].position).squaredNorm();
        ++count;
      }
    }
    return count == 0 ? std::nan("") : std::sqrt(sum / static_cast<double>(count)) * 1e3;
  };
  double best_shift = 0;
  double best = rms_at(0);
  for (double shift = -kLargestShift; shift <= 2 * kLargestShift + 1e-9; shift += 0.001) {
    const double rms = rms_at(shift);
    if (rms < best) {
      best = rms;
      best_shift = shift;
    }
  }
  json["fingertip_rms_mm"] = number(best);
  json["lag_ms"] = number(std::isnan(best) ? best : best_shift * 1e3);
  json["fingertip_rms_unshifted_mm"] = number(rms_at(0));

  // Part of the time with a closed fist in which the object is held.
  std::vector<TwinSample> twins;
  std::copy_if(twins_.begin(), twins_.end(), std::back_inserter(twins),
               [&frame](const TwinSample& t) { return t.object == frame.object; });
  // A grip is a period with a closed fist, with gaps of at most 0.1 s. The place of the object in a grip is its median
  // place in the frame of the palm. The object counts as held while it is near this place.
  std::size_t closed_samples = 0;
  std::size_t held_samples = 0;
  double largest_movement = 0;
  std::vector<Vector3> places;
  double last_closed = -1;
  const auto end_grip = [&] {
    if (places.empty()) return;
    Vector3 median;
    for (Eigen::Index k = 0; k < 3; ++k) {
      std::vector<double> values;
      for (const Vector3& place : places) values.push_back(place[k]);
      median[k] = percentile(values, 0.5);
    }
    for (const Vector3& place : places) {
      const double moved = (place - median).norm();
      largest_movement = std::max(largest_movement, moved);
      if (moved < kHeldMovement) ++held_samples;
    }
    places.clear();
  };
  for (const ContactSample& c : contacts_) {
    const double t = seconds(c.time);
    const auto tip = pose_at(
        tracked_, t, [](const HandSample& s) { return s.joints[joint(Joint::middle_tip)]; }, longest);
    const auto root = pose_at(
        tracked_, t, [](const HandSample& s) { return s.joints[joint(Joint::middle_metacarpal)]; }, longest);
    if (!tip || !root || (tip->position - root->position).norm() >= kClosedFist) continue;
    if (t - last_closed > kGripGap) end_grip();
    last_closed = t;
    ++closed_samples;
    int fingers = 0;
    for (std::size_t f = 0; f < kFingerCount; ++f)
      fingers += c.finger_contacts[f] > 0 && c.finger_object[f] == frame.object;
    const auto palm = pose_at(simulated_, t, [](const HandSample& s) { return s.joints[joint(Joint::palm)]; });
    const auto object = pose_at(twins, t, [](const TwinSample& s) { return s.pose; });
    if (fingers >= 2 && palm && object) places.push_back(palm->inverse() * object->position);
  }
  end_grip();
  json["held_fraction"] = closed_samples == 0
                              ? Json(nullptr)
                              : Json(static_cast<double>(held_samples) / static_cast<double>(closed_samples));
  json["closed_samples"] = closed_samples;
  json["held_movement_max_mm"] = largest_movement * 1e3;
  return json;
}

Json Outcome::summary(const OutcomeFrame& frame) const {
  Json json = frame.recorded ? following(frame) : pinch(frame);
  double largest_finger = 0;
  for (const ContactSample& c : contacts_) {
    for (std::size_t f = 0; f < kFingerCount; ++f) largest_finger = std::max(largest_finger, c.finger_force[f]);
  }
  json["finger_force_max_n"] = largest_finger;
  double gaps = 0;
  const double longest = longest_tracked_interval();
  for (const double interval : intervals(tracked_)) gaps += interval > longest ? interval : 0;
  json["tracker_gaps_s"] = gaps;
  json["nonfinite_published"] = nonfinite_;
  json["finger_coupling_max_n"] = largest_finger_coupling_;
  json["hand_coupling_max_n"] = largest_hand_coupling_;
  constexpr std::array<const char*, 6> hops{"tracker", "tracking", "hand", "wrench", "device", "total"};
  for (const auto& [key, q] : {std::pair{"motion_to_force_ms_p50", 0.50}, std::pair{"motion_to_force_ms_p99", 0.99}}) {
    Json entry;
    for (std::size_t h = hops.size(); h-- > 0;) {
      std::vector<double> values;
      for (const LatencySample& sample : latencies_) {
        if (std::isfinite(sample.hops_ms[h])) values.push_back(sample.hops_ms[h]);
      }
      const Json value = number(percentile(values, q));
      if (h == 5) {
        entry["total"] = value;
      } else {
        entry["hops"][hops[h]] = value;
      }
    }
    json[key] = entry;
  }
  const std::vector<double> first_effects = first_effects_ms();
  json["first_effect_ms_p50"] = number(percentile(first_effects, 0.50));
  json["first_effect_ms_p99"] = number(percentile(first_effects, 0.99));
  return json;
}

}  // namespace softhand
