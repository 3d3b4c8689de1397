#include "device/tracked_input.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "math/rotation.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "model/kinematics.hpp"

namespace softhand {
namespace {

constexpr double kMaximumCoordinate = 1e3;  // m
constexpr double kMaximumHandExtent = 0.5;  // m from the wrist; the longest hands measure 0.25
// Half and twice unit length, with room for rounding.
constexpr double kShortestQuaternion = 0.5 - 1e-6, kLongestQuaternion = 2 + 1e-6;
constexpr double kMaximumAngularSpeed = 60;  // rad/s; fast finger flicks reach 40
// s; a sample that is older at its arrival comes from another clock. An older head pose is not used for a hand.
constexpr double kPast = 1;
constexpr double kConfidenceTime = 0.05;  // s, time constant; fast enough for a finger that is hidden for a moment

// The joint that an unseen `joint` moves with.
Joint neighbour_of(Joint joint) { return joint == Joint::wrist ? Joint::middle_metacarpal : parent_of(joint); }

Pose mount(const std::array<double, 3>& position, const std::array<double, 4>& orientation, const char* key) {
  const Pose pose = to_pose(position, orientation);
  if (!all_finite(position) || !all_finite(orientation) || std::abs(pose.orientation.norm() - 1) > 1e-3) {
    throw std::invalid_argument(std::string(key) + ": expected finite numbers and a unit quaternion xyzw");
  }
  return {pose.position, pose.orientation.normalized()};
}

}  // namespace

void describe(OptionVisitor& v, TrackedInputOptions& o) {
  v.number("extrapolation_limit", o.extrapolation_limit, "s", {0, 0.2},
           "Longest extrapolation of a sample by its age. Older samples are held still at the extrapolated pose.");
  v.number("velocity_smoothing", o.velocity_smoothing, "s", {0, 0.2},
           "Time constant of the low-pass filter on the velocities that are estimated from samples.");
  v.number(
      "smoothing_cutoff", o.smoothing_cutoff, "Hz", {0, 100},
      "Cutoff of the low-pass filter on the joints of a hand at rest. It grows with the speed. 0.3 is for a tracker "
      "with a noise of 1 mm. 0 = no filter.");
  v.number("smoothing_speed", o.smoothing_speed, "m/s", {0.001, 10},
           "Speed of a joint at which this cutoff is twice that of rest. Less gives less lag and passes more noise.");
  v.number("stale_after", o.stale_after, "s", {0.01, 10},
           "If the newest sample is older than this, the status reports the tracker as stale.");
  v.number("reposition_distance", o.reposition_distance, "m", {0.1, 100},
           "If the wrist jumps farther than this between two samples, the skeleton is moved there in one step.");
  v.number("maximum_speed", o.maximum_speed, "m/s", {1, 100},
           "If a joint or the head moves faster than this between two samples, the motion counts as a jump and gives "
           "no velocity.");
  v.number("blend_time", o.blend_time, "s", {0, 2},
           "When another tracker takes the hand over, its difference to the former one fades out in this time.");
  v.numbers("headset_mount_position", o.headset_mount_position.data(), 3, "m", {-10, 10},
            "Position of a device mounted on the headset, in the head's frame.");
  v.numbers("headset_mount_orientation", o.headset_mount_orientation.data(), 4, "1", {-1, 1},
            "Orientation of a device mounted on the headset, in the head's frame, quaternion xyzw.");
  v.numbers("desk_mount_position", o.desk_mount_position.data(), 3, "m", {-1000, 1000},
            "Position of a device on a desk, in the world frame.");
  v.numbers("desk_mount_orientation", o.desk_mount_orientation.data(), 4, "1", {-1, 1},
            "Orientation of a device on a desk, in the world frame, quaternion xyzw.");
}

bool is_plausible(Nanoseconds sample_time, Nanoseconds now) {
  const std::optional<double> age = age_of(sample_time, now);
  return age && *age <= kPast;
}

TrackedInput::TrackedInput(const TrackedInputOptions& options)
    : options_(options),
      headset_mount_(
          mount(options.headset_mount_position, options.headset_mount_orientation, "headset_mount_orientation")),
      desk_mount_(mount(options.desk_mount_position, options.desk_mount_orientation, "desk_mount_orientation")) {}

void TrackedInput::add_head_pose(const HeadPose& head, Nanoseconds now) {
  if (!is_plausible(head.stamp.sample_time, now)) {
    ++counters_.refused_head_clock;
    return;
  }
  if (head.valid == 0 || !all_finite(head.position) || !all_finite(head.orientation)) return;
  const Quaternion orientation = to_quaternion(head.orientation);
  if (!(orientation.norm() > 0.5 && orientation.norm() < 2) ||
      !(to_vector(head.position).cwiseAbs().maxCoeff() <= kMaximumCoordinate))
    return;
  if (head_count_ > 0 && head.stamp.sample_time <= heads_[(head_count_ - 1) % heads_.size()].time) return;
  heads_[head_count_++ % heads_.size()] = {head.stamp.sample_time,
                                           {to_vector(head.position), orientation.normalized()}};
}

bool TrackedInput::mount_at(std::uint32_t frame, Nanoseconds time, Pose& out) const {
  if (frame == 0) {
    out = Pose{};
    return true;
  }
  if (frame == 2) {
    out = desk_mount_;
    return true;
  }
  if (frame != 1 || head_count_ == 0) return false;
  const Nanoseconds newest = heads_[(head_count_ - 1) % heads_.size()].time;
  if (age_of(newest, time) > kPast) return false;
  const std::uint64_t stored = std::min<std::uint64_t>(head_count_, heads_.size());
  const auto back = [this](std::uint64_t i) -> const TimedPose& {
    return heads_[(head_count_ - 1 - i) % heads_.size()];
  };
  // Interpolates between the two head poses around `time`. A sample newer than the newest head pose is extrapolated
  // from the last two head poses, at most by `extrapolation_limit` (default 50 ms).
  std::uint64_t i = 1;
  while (i + 1 < stored && back(i).time > time) ++i;
  if (stored == 1) {
    out = back(0).pose * headset_mount_;
    return true;
  }
  const TimedPose& older = back(i);
  const TimedPose& newer = back(i - 1);
  const double span = static_cast<double>(newer.time - older.time) * kSecondsPerNanosecond;
  const double offset = static_cast<double>(time - older.time) * kSecondsPerNanosecond;
  const Vector3 moved = newer.pose.position - older.pose.position;
  const Vector3 turn = rotation_log(newer.pose.orientation * older.pose.orientation.conjugate());
  // A jump of the head, for example when an XR runtime is recentred, is not extrapolated.
  const bool jumped = moved.norm() > options_.maximum_speed * span || turn.norm() > kMaximumAngularSpeed * span;
  const double fraction = std::clamp(offset, 0.0, span + (jumped ? 0.0 : options_.extrapolation_limit)) / span;
  out = increment(older.pose, fraction * moved, fraction * turn) * headset_mount_;
  return true;
}

void TrackedInput::estimate_velocity(Track& track, const Pose& pose, double elapsed) const {
  const Vector3 linear = (pose.position - track.pose.position) / elapsed;
  const Vector3 angular = rotation_log(pose.orientation * track.pose.orientation.conjugate()) / elapsed;
  if (!(linear.norm() <= options_.maximum_speed) || !(angular.norm() <= kMaximumAngularSpeed)) {
    track.velocity = Twist{};
    return;
  }
  const double gain = elapsed / (elapsed + options_.velocity_smoothing);
  track.velocity.linear += gain * (linear - track.velocity.linear);
  track.velocity.angular += gain * (angular - track.velocity.angular);
}

bool TrackedInput::add_sample(const Skeleton& sample, Nanoseconds now) {
  const bool same_writer = any_ && sample.stamp.epoch == stamp_.epoch && sample.source == source_;
  if (same_writer && sample.stamp.sequence <= stamp_.sequence) {
    ++counters_.refused_order;
    return false;
  }
  Nanoseconds time = sample.stamp.sample_time;
  if (!is_plausible(time, now)) {
    ++counters_.implausible_clock;
    time = now;
  }
  if (any_ && time <= time_) {
    ++counters_.refused_order;
    return false;
  }
  Pose world_from_device;
  if (!mount_at(sample.frame, time, world_from_device)) {
    ++counters_.refused_mount;
    return false;
  }

  std::array<Pose, kJointCount> poses;
  std::array<bool, kJointCount> good{};
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const JointSample& joint = sample.joints[j];
    if ((joint.flags & kJointValid) == 0) continue;
    if (!all_finite(joint.position) || !all_finite(joint.orientation) || !std::isfinite(joint.confidence)) {
      ++counters_.refused_nonfinite;
      continue;
    }
    const Quaternion orientation = to_quaternion(joint.orientation);
    const double norm = orientation.coeffs().stableNorm();
    if (!(to_vector(joint.position).cwiseAbs().maxCoeff() <= kMaximumCoordinate) ||
        !(norm >= kShortestQuaternion && norm <= kLongestQuaternion) || joint.confidence < 0 || joint.confidence > 1) {
      ++counters_.refused_implausible;
      continue;
    }
    poses[j] = world_from_device * Pose{to_vector(joint.position), orientation.normalized()};
    good[j] = true;
  }
  const std::size_t wrist = slot_of(Joint::wrist);
  if (good[wrist]) {
    for (std::size_t j = 0; j < kJointCount; ++j) {
      if (!good[j] || (poses[j].position - poses[wrist].position).norm() <= kMaximumHandExtent) continue;
      ++counters_.refused_implausible;
      good[j] = false;
    }
  }

  // Unseen joints move rigidly with their neighbour: first the wrist with the middle metacarpal, then every bone with
  // its parent, which has the lower index. If the neighbour is missing too, a joint stays where it was.
  std::array<bool, kJointCount> placed = good;
  const auto infer = [&](Joint joint) {
    const std::size_t j = slot_of(joint);
    if (placed[j] || !tracks_[j].seen) return;
    const std::size_t n = slot_of(neighbour_of(joint));
    poses[j] = placed[n] && tracks_[j].attached ? poses[n] * tracks_[j].from_neighbour : tracks_[j].pose;
    placed[j] = true;
    ++counters_.inferred;
  };
  infer(Joint::wrist);
  for (std::size_t j = slot_of(Joint::thumb_metacarpal); j < kJointCount; ++j) {
    if (joint_of(body_of(static_cast<Joint>(j))) == static_cast<Joint>(j)) infer(static_cast<Joint>(j));
  }

  const double elapsed = static_cast<double>(time - time_) * kSecondsPerNanosecond;
  const bool jumped = any_ && placed[wrist] && tracks_[wrist].seen &&
                      (poses[wrist].position - tracks_[wrist].pose.position).norm() > options_.reposition_distance;
  const bool swapped = any_ && !jumped && (sample.stamp.epoch != stamp_.epoch || sample.source != source_);
  if (jumped) ++counters_.repositioned;
  if (swapped) ++counters_.swapped;
  if (jumped || !any_) repositioned_ = true;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    if (!placed[j]) continue;
    Track& track = tracks_[j];
    const bool filters = options_.smoothing_cutoff > 0 && track.seen && !jumped && !swapped;
    if (!filters) track.filter.restart(poses[j]);
    const Pose pose =
        filters ? track.filter.add(poses[j], elapsed, options_.smoothing_cutoff, options_.smoothing_speed) : poses[j];
    if (!track.seen || jumped) {
      track.velocity = Twist{};
      track.blend = {};
    } else if (swapped) {
      // Two trackers differ, so their difference over time is no velocity. That of the hand is the former one.
      track.blend.begin(time, pose_of(track, time), pose);
      if (elapsed > options_.extrapolation_limit) track.velocity = Twist{};
    } else {
      estimate_velocity(track, pose, elapsed);
    }
    track.pose = pose;
    const std::size_t n = slot_of(neighbour_of(static_cast<Joint>(j)));
    if (good[j] && good[n]) {
      track.from_neighbour = poses[n].inverse() * poses[j];
      track.attached = true;
    }
    if (!good[j]) continue;
    track.confidence = std::max(sample.joints[j].confidence, kLeastConfidence);
    if (!track.seen) track.filtered_confidence = track.confidence;
    track.seen = true;
  }
  stamp_ = sample.stamp;
  time_ = time;
  source_ = sample.source;
  confidence_ = std::isfinite(sample.confidence) ? std::clamp(sample.confidence, 0.0, 1.0) : 0.0;
  any_ = true;
  ++counters_.accepted;
  return true;
}

// World pose at `time`, extrapolated from the newest sample.
Pose TrackedInput::pose_of(const Track& track, Nanoseconds time) const {
  const double ahead = any_ ? std::clamp(age(time), 0.0, options_.extrapolation_limit) : 0.0;
  const Pose pose = increment(track.pose, ahead * track.velocity.linear, ahead * track.velocity.angular);
  return track.blend.apply(time, options_.blend_time, pose);
}

const std::array<BodyTarget, kBodyCount>& TrackedInput::targets(Nanoseconds now) {
  const bool held = any_ && age(now) > options_.extrapolation_limit;
  const double elapsed = static_cast<double>(std::max<Nanoseconds>(now - targets_time_, 0)) * kSecondsPerNanosecond;
  const double gain = 1 - std::exp(-elapsed / kConfidenceTime);
  targets_time_ = now;
  for (Track& track : tracks_) track.filtered_confidence += gain * (track.confidence - track.filtered_confidence);
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Track& track = tracks_[slot_of(joint_of(static_cast<Body>(b)))];
    BodyTarget& target = targets_[b];
    target.valid = track.seen;
    if (!track.seen) continue;
    target.confidence = track.filtered_confidence;
    target.pose = pose_of(track, now);
    target.velocity = track.blend.velocity(now, options_.blend_time);
    if (held) continue;
    target.velocity.linear += track.velocity.linear;
    target.velocity.angular += track.velocity.angular;
  }
  return targets_;
}

double TrackedInput::age(Nanoseconds now) const { return any_ ? age_of(time_, now).value_or(0) : -1.0; }

bool TrackedInput::stale(Nanoseconds now) const { return !any_ || age(now) > options_.stale_after; }

bool TrackedInput::take_repositioned() {
  const bool was = repositioned_;
  repositioned_ = false;
  return was;
}

}  // namespace softhand
