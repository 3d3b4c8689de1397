#include "trackers/fusion/fusion.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string>

#include "device/tracked_input.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "model/kinematics.hpp"
#include "runtime/config.hpp"

namespace softhand {
namespace {

constexpr std::uint32_t kMostUsers = 16;
// The angular velocity of a joint is its mean over at least this time, s. So the noise of a fast tracker is not
// amplified more than that of a slow one.
constexpr double kVelocityTime = 0.015;
constexpr double kVelocityFades = 0.06;      // s, time constant (README.md, "Accuracy")
constexpr double kMaximumAngularSpeed = 60;  // rad/s; fast finger flicks reach 40

Nanoseconds nanoseconds(double seconds) { return static_cast<Nanoseconds>(seconds * 1e9); }

// 0 = wrist, 1.. = thumb..; the palm belongs to the middle finger.
std::size_t part_of(Joint joint) {
  return joint == Joint::wrist ? 0 : 1 + static_cast<std::size_t>(finger_of(body_of(joint)));
}

bool is_valid(const JointSample& joint) { return (joint.flags & kJointValid) != 0; }
bool delivers(const Skeleton& sample, std::size_t part) {
  const JointSample& wrist = sample.joints[slot_of(Joint::wrist)];
  if (!is_valid(wrist)) return false;
  if (part == 0) return (wrist.flags & kJointInferred) == 0;
  for (std::size_t j = 0; j < kJointCount; ++j)
    if (part_of(static_cast<Joint>(j)) == part && is_valid(sample.joints[j])) return true;
  return false;
}

std::vector<std::uint32_t> parse_list(const std::string& name, const std::string& text, std::uint32_t own_user) {
  const auto refuse = [&](const std::string& why) {
    return ConfigError("tracker_fusion." + name + " = '" + text + "': " + why);
  };
  std::vector<std::uint32_t> out;
  const char* const end = text.data() + text.size();
  for (const char* begin = text.data();;) {
    while (begin != end && *begin == ' ') ++begin;
    if (begin == end) return out;
    std::uint32_t user = 0;
    const auto [after, error] = std::from_chars(begin, end, user);
    if (error != std::errc{} || (after != end && *after != ' ') || user >= kMostUsers)
      throw refuse("expected users 0 to 15, separated by spaces");
    if (std::find(out.begin(), out.end(), user) != out.end()) throw refuse("a user appears twice");
    if (user == own_user)
      throw refuse("user " + std::to_string(user) +
                   " is the fused hand; start each source with "
                   "another --user");
    out.push_back(user);
    begin = after;
  }
}

}  // namespace

FusionSources parse_sources(const FusionOptions& options, std::uint32_t own_user) {
  return {parse_list("wrist", options.wrist, own_user), parse_list("fingers", options.fingers, own_user),
          parse_list("head", options.head, own_user)};
}

Ownership::Ownership(std::vector<std::uint32_t> candidates, const FusionOptions& options)
    : stale_after_(nanoseconds(options.stale_after)), patience_(nanoseconds(options.patience)) {
  for (const std::uint32_t source : candidates) candidates_.push_back({source});
}

void Ownership::add(std::uint32_t source, bool good, Nanoseconds now) {
  for (Candidate& each : candidates_) {
    if (each.source != source) continue;
    each.newest = now;
    if (!good || each.good_since == 0) each.good_since = good ? now : 0;
  }
}

bool Ownership::update(Nanoseconds now) {
  const auto is_alive = [&](const Candidate& each) { return each.newest != 0 && now - each.newest <= stale_after_; };
  const Candidate* own = nullptr;
  for (Candidate& each : candidates_) {
    if (!is_alive(each)) each.good_since = 0;
    if (owner_ == each.source && is_alive(each)) own = &each;
  }
  const Candidate* chosen = nullptr;
  for (const Candidate& each : candidates_) {
    if (each.good_since == 0) continue;
    // A source that comes and goes must not make the hand move to and fro. It waits as long as the owner is good.
    if (own != nullptr && own->good_since != 0 && &each != own && now - each.good_since < patience_) continue;
    chosen = &each;
    break;
  }
  if (chosen == nullptr) chosen = own;
  if (chosen == nullptr) {
    const auto alive = std::find_if(candidates_.begin(), candidates_.end(), is_alive);
    if (alive != candidates_.end()) chosen = &*alive;
  }
  const std::optional<std::uint32_t> before = owner_;
  owner_ = chosen == nullptr ? std::nullopt : std::optional(chosen->source);
  if (owner_ && last_owner_ && owner_ != last_owner_) ++changes_;
  if (owner_) last_owner_ = owner_;
  return owner_ != before;
}

HeadFusion::HeadFusion(const FusionOptions& options, std::vector<std::uint32_t> sources)
    : owner_(std::move(sources), options), blend_time_(options.blend_time) {}

bool HeadFusion::add(const HeadPose& sample, Nanoseconds now, HeadPose& out) {
  const Quaternion orientation = to_quaternion(sample.orientation);
  if (sample.valid == 0 || !all_finite(sample.position) || !(std::abs(orientation.norm() - 1) < 0.1)) return false;
  // The time of the device is not that of the stamp, which the reader has judged.
  if (!is_plausible(sample.stamp.sample_time, now)) {
    ++refused_;
    return false;
  }
  owner_.add(sample.user, true, now);
  owner_.update(now);
  if (owner_.owner() != sample.user || sample.stamp.sample_time <= last_time_) return false;
  const Pose pose{to_vector(sample.position), orientation.normalized()};
  if (used_ && used_ != owner_.owner()) blend_.begin(sample.stamp.sample_time, last_, pose);
  last_ = blend_.apply(sample.stamp.sample_time, blend_time_, pose);
  last_time_ = sample.stamp.sample_time;
  used_ = owner_.owner();
  out = sample;
  out.stamp.sequence = ++sequence_;
  out.position = to_wire(last_.position);
  out.orientation = to_wire(last_.orientation);
  return true;
}

HandFusion::HandFusion(const FusionOptions& options, const TrackedInputOptions& input, const FusionSources& sources,
                       const HandModel& hand)
    : reposition_distance_(input.reposition_distance),
      least_confidence_(options.least_confidence),
      blend_time_(options.blend_time),
      stale_after_(nanoseconds(options.stale_after)),
      patience_(nanoseconds(options.patience)),
      delay_(nanoseconds(options.delay)),
      side_(static_cast<std::uint32_t>(hand.side)),
      radii_(hand.joint_radii) {
  for (std::size_t j = 0; j < kJointCount; ++j)
    posture_.joints[j] = hand.rest_joints[slot_of(parent_of(static_cast<Joint>(j)))].inverse() * hand.rest_joints[j];
  for (const auto* users : {&sources.wrist, &sources.fingers}) {
    for (const std::uint32_t user : *users) {
      if (source_of(user) != nullptr) continue;
      sources_.push_back({user, TrackedInput(input)});
      sources_.back().posture = posture_;
    }
  }
  parts_.emplace_back(sources.wrist, options);
  for (int f = 0; f < kFingerCount; ++f) parts_.emplace_back(sources.fingers, options);
}

HandFusion::Source* HandFusion::source_of(std::optional<std::uint32_t> user) {
  const auto found =
      std::find_if(sources_.begin(), sources_.end(), [&](const Source& each) { return user == each.user; });
  return found == sources_.end() ? nullptr : &*found;
}

void HandFusion::add_head(const HeadPose& head, Nanoseconds now) {
  for (Source& each : sources_) each.input.add_head_pose(head, now);
}

void HandFusion::add(const Skeleton& sample, Nanoseconds now) {
  Source* const source = source_of(sample.hand.user);
  if (source == nullptr || sample.hand.side != side_) return;
  const bool good = sample.confidence >= least_confidence_;
  if (!good) ++poor_;
  // The source is extrapolated past a few poor samples. It follows them if nothing better comes.
  const bool follow = good || now - source->good_at > patience_;
  if (follow) {
    if (!source->input.add_sample(sample, now)) {
      ++refused_;
      return;
    }
    source->newest = sample;
    source->resumed = source->resumed || now - source->used_at > stale_after_;
    source->used_at = now;
    measure(*source);
    source->past[source->count++ % source->past.size()] = source->posture;
    fed_ = true;
  }
  if (good) source->good_at = now;
  for (std::size_t part = 0; part < kParts; ++part)
    if (delivers(sample, part)) parts_[part].add(source->user, good, now);
}

// The posture of the source in its newest sample.
void HandFusion::measure(Source& source) {
  const Nanoseconds time = source.input.time();
  const auto& targets = source.input.targets(time);
  const auto target_of = [&](Joint joint) -> const BodyTarget& {
    return targets[static_cast<std::size_t>(index_of(body_of(joint)))];
  };
  Posture& out = source.posture;
  out.time = time;
  if (target_of(Joint::wrist).valid) out.wrist = target_of(Joint::wrist).pose;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Joint joint = static_cast<Joint>(j), parent = parent_of(joint);
    if (joint == Joint::wrist) continue;
    if (joint_of(body_of(joint)) == joint) {
      if (target_of(joint).valid && target_of(parent).valid)
        out.joints[j] = target_of(parent).pose.inverse() * target_of(joint).pose;
    } else if (is_valid(source.newest.joints[j]) && is_valid(source.newest.joints[slot_of(parent)])) {
      // Tips and the palm are rigid on their bones.
      const Pose pose = to_pose(source.newest.joints[slot_of(parent)]).inverse() * to_pose(source.newest.joints[j]);
      if (pose.position.norm() < 0.1 && std::abs(pose.orientation.norm() - 1) < 1e-6) out.joints[j] = pose;
    }
  }
}

// The posture of the source at a time after its newest sample.
void HandFusion::predict(Source& source, Nanoseconds time) const {
  const Posture& newest = source.back(0);
  Posture& out = source.posture;
  out = newest;
  out.time = time;
  const BodyTarget& wrist = source.input.targets(time)[static_cast<std::size_t>(index_of(body_of(Joint::wrist)))];
  if (wrist.valid) out.wrist = wrist.pose;
  std::uint64_t i = 1;
  while (i + 1 < source.stored() && newest.time - source.back(i).time < nanoseconds(kVelocityTime)) ++i;
  // Across a gap a finger may have moved anywhere.
  if (i >= source.stored() || newest.time - source.back(i).time > stale_after_) return;
  const Posture& older = source.back(i);
  const double elapsed = static_cast<double>(newest.time - older.time) * 1e-9;
  const double ahead = static_cast<double>(time - newest.time) * 1e-9;
  const double reach = kVelocityFades * (1 - std::exp(-ahead / kVelocityFades));
  for (std::size_t j = slot_of(Joint::wrist) + 1; j < kJointCount; ++j) {
    if (joint_of(body_of(static_cast<Joint>(j))) != static_cast<Joint>(j)) continue;  // a tip is rigid on its bone
    const Quaternion& now = newest.joints[j].orientation;
    const Vector3 velocity = rotation_log(older.joints[j].orientation.conjugate() * now) / elapsed;
    if (velocity.norm() <= kMaximumAngularSpeed) out.joints[j].orientation = now * rotation_exp(reach * velocity);
  }
}

// The posture of the source at `time`: between two samples, or predicted.
void HandFusion::recall(Source& source, Nanoseconds time) const {
  if (source.count == 0) return;
  if (time >= source.input.time()) return predict(source, time);
  const std::uint64_t stored = source.stored();
  std::uint64_t i = 1;
  while (i + 1 < stored && source.back(i).time > time) ++i;
  if (i >= stored || source.back(i).time > time) {
    source.posture = source.back(stored - 1);
    return;
  }
  const Posture &older = source.back(i), &newer = source.back(i - 1);
  const double share = static_cast<double>(time - older.time) / static_cast<double>(newer.time - older.time);
  const auto between = [&](const Pose& a, const Pose& b) {
    return Pose{a.position + share * (b.position - a.position), a.orientation.slerp(share, b.orientation)};
  };
  source.posture.time = time;
  source.posture.wrist = between(older.wrist, newer.wrist);
  for (std::size_t j = 0; j < kJointCount; ++j) source.posture.joints[j] = between(older.joints[j], newer.joints[j]);
}

bool HandFusion::compose(Nanoseconds now, Skeleton& out) {
  for (Ownership& part : parts_) part.update(now);
  Source* const wrist = source_of(parts_[0].owner());
  if (!fed_ || wrist == nullptr) return false;
  Nanoseconds time = wrist->input.time();
  for (const Ownership& part : parts_)
    if (const Source* const owner = source_of(part.owner())) time = std::max(time, owner->input.time());
  time -= delay_;
  if (time <= posture_.time) return false;

  for (Source& each : sources_) recall(each, time);
  out = Skeleton{};
  out.confidence = wrist->input.confidence();
  const auto pose_of = [](Posture& posture, std::size_t joint) -> Pose& {
    return joint == slot_of(Joint::wrist) ? posture.wrist : posture.joints[joint];
  };
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const std::size_t part = part_of(static_cast<Joint>(j));
    Source* const owner = source_of(parts_[part].owner());
    if (owner == nullptr) continue;  // the posture stays
    out.confidence = std::min(out.confidence, owner->input.confidence());
    const Pose& raw = pose_of(owner->posture, j);
    if (any_ && (used_[part] != parts_[part].owner() || owner->resumed)) {
      // Where the former owner would be now, or where the joint was held.
      Source* const former = source_of(used_[part]);
      const Pose before = former == nullptr || former == owner
                              ? pose_of(posture_, j)
                              : blends_[j].apply(time, blend_time_, pose_of(former->posture, j));
      // A wrist that is far away is repositioned, as after any jump.
      if (part > 0 || (before.position - raw.position).norm() <= reposition_distance_)
        blends_[j].begin(time, before, raw);
    }
    pose_of(posture_, j) = blends_[j].apply(time, blend_time_, raw);
  }
  posture_.time = time;
  for (std::size_t part = 0; part < kParts; ++part) used_[part] = parts_[part].owner();
  for (Source& each : sources_) each.resumed = false;

  std::array<Pose, kJointCount> world;
  world[slot_of(Joint::wrist)] = posture_.wrist;
  const auto place = [&](Joint joint) {
    world[slot_of(joint)] = world[slot_of(parent_of(joint))] * posture_.joints[slot_of(joint)];
  };
  for (std::size_t j = slot_of(Joint::wrist) + 1; j < kJointCount; ++j) place(static_cast<Joint>(j));
  place(Joint::palm);  // on the middle metacarpal
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Source* const owner = source_of(used_[part_of(static_cast<Joint>(j))]);
    JointSample& joint = out.joints[j];
    joint.position = to_wire(world[j].position);
    joint.orientation = to_wire(world[j].orientation);
    joint.radius = radii_[j];
    joint.flags = kJointValid | kJointInferred;
    if (owner == nullptr || !is_valid(owner->newest.joints[j])) continue;
    const JointSample& newest = owner->newest.joints[j];
    joint.flags = newest.flags;
    if (newest.radius > 0) joint.radius = newest.radius;
    if (newest.confidence >= 0 && newest.confidence <= 1) joint.confidence = newest.confidence;
  }
  out.hand.side = side_;
  out.stamp.sample_time = time;
  out.stamp.sequence = ++sequence_;
  fed_ = false;
  any_ = true;
  return true;
}

}  // namespace softhand
