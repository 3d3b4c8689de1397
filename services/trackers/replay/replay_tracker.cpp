#include "trackers/replay/replay_tracker.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kDefaultRate = 90;

// SplitMix64: the n-th number of a stream. The noise belongs to a sample and does not depend on the order of calls.
std::uint64_t mix(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}
double uniform(std::uint64_t x) { return (static_cast<double>(mix(x) >> 11) + 0.5) * 0x1.0p-53; }

// Normal distribution (Box and Muller).
double normal(std::uint64_t stream, std::uint64_t n) {
  const std::uint64_t base = mix(stream) + 2 * n;
  return std::sqrt(-2 * std::log(uniform(base))) * std::cos(2 * M_PI * uniform(base + 1));
}
Vector3 normal3(std::uint64_t stream, std::uint64_t n) {
  return {normal(stream, 3 * n), normal(stream, 3 * n + 1), normal(stream, 3 * n + 2)};
}

bool within(double time, double at, double duration) { return at >= 0 && time >= at && time < at + duration; }

}  // namespace

ReplayTracker::ReplayTracker(std::shared_ptr<const Motion> motion, const ReplayOptions& options, HandKey hand,
                             std::uint32_t source)
    : motion_(std::move(motion)), options_(options), hand_(hand), source_(source), nan_joint_(kJointCount) {
  for (std::size_t j = 0; j < kJointCount; ++j) {
    if (kJointNames[j] == options.nan_joint) nan_joint_ = j;
  }
  if (nan_joint_ == kJointCount)
    throw std::invalid_argument("nan_joint: expected an OpenXR joint name such as index_intermediate, got '" +
                                options.nan_joint + "'");
  const std::span<const double> times = motion_->times();
  period_ = options.rate_hz > 0 ? 1 / options.rate_hz : times.empty() ? 1 / kDefaultRate : 0;
  if (period_ == 0) {
    first_ = static_cast<std::size_t>(std::lower_bound(times.begin(), times.end(), options.start_time) - times.begin());
    if (first_ == times.size()) first_ = times.size() - 1;
  }
}

double ReplayTracker::sample_time(std::int64_t i) const {
  if (period_ > 0) return static_cast<double>(i) * period_;
  const std::span<const double> times = motion_->times();
  const auto played = static_cast<std::int64_t>(times.size() - first_);
  const std::int64_t at = i + static_cast<std::int64_t>(first_);
  // A repeated recording continues after a gap of its mean period. A finished recording repeats its last frame at that
  // period.
  const double gap = times.size() > 1 ? times.back() / static_cast<double>(times.size() - 1) : 1 / kDefaultRate;
  if (i < played) return times[static_cast<std::size_t>(at)] - times[first_];
  const double once = times.back() - times[first_] + gap;
  if (!options_.repeat) return once + static_cast<double>(i - played) * gap;
  const std::int64_t rounds = i / played, rest = i % played;
  return static_cast<double>(rounds) * once + times[first_ + static_cast<std::size_t>(rest)] - times[first_];
}

std::int64_t ReplayTracker::newest_due(double elapsed) const {
  if (elapsed < 0) return -1;
  if (period_ > 0) return static_cast<std::int64_t>(std::floor(elapsed / period_ + 1e-9));
  std::int64_t i = std::max<std::int64_t>(last_, -1);
  while (sample_time(i + 1) <= elapsed + 1e-9) ++i;
  return i;
}

bool ReplayTracker::dropped(double time) const {
  if (within(time, options_.freeze_at, options_.freeze_time)) return true;
  if (options_.dropout_period <= 0) return false;
  return std::fmod(time, options_.dropout_period) >= options_.dropout_period - options_.dropout_time;
}

void ReplayTracker::fill(std::int64_t i, Skeleton& out) const {
  const double since_start = sample_time(i);
  double time;
  if (period_ > 0) {
    time = options_.start_time + since_start;
    if (options_.repeat) time = std::fmod(time, motion_->duration());
  } else {
    const auto played = static_cast<std::int64_t>(motion_->times().size() - first_);
    const std::int64_t within_round = options_.repeat ? i % played : std::min(i, played - 1);
    time = motion_->times()[first_ + static_cast<std::size_t>(within_round)];
  }
  const JointFrames frames = motion_->at(time);
  const double now = options_.start_time + since_start;
  const Vector3 offset =
      within(now, options_.teleport_at, options_.teleport_time) ? to_vector(options_.teleport_offset) : Vector3::Zero();
  const auto seed = static_cast<std::uint64_t>(options_.seed);
  out = Skeleton{};
  out.hand = hand_;
  out.source = source_;
  out.confidence = within(now, options_.doubt_at, options_.doubt_time) ? 0.1 : 1;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    Pose pose = frames[j];
    const std::uint64_t n = static_cast<std::uint64_t>(i) * kJointCount + j;
    pose.position += offset;
    if (options_.position_noise > 0) pose.position += options_.position_noise * normal3(2 * seed, n);
    if (options_.rotation_noise > 0)
      pose.orientation = rotation_exp(options_.rotation_noise * normal3(2 * seed + 1, n)) * pose.orientation;
    JointSample& joint = out.joints[j];
    joint.position = to_wire(pose.position);
    joint.orientation = to_wire(pose.orientation);
    if (options_.flip_signs && i % 2 == 1) {
      for (double& x : joint.orientation) x = -x;
    }
    joint.radius = motion_->radii()[j];
    joint.flags = kJointValid | (j == 0 && motion_->palm_inferred() ? kJointInferred : kJointTracked);
    if (j == nan_joint_ && within(now, options_.nan_at, options_.nan_time))
      joint.position[0] = std::numeric_limits<double>::quiet_NaN();
  }
}

bool ReplayTracker::sample(Nanoseconds now, Skeleton& out) {
  if (!started_) {
    started_ = true;
    start_ = now;
  }
  if (remaining_duplicates_ > 0) {
    --remaining_duplicates_;
    out = last_sample_;
    return true;
  }
  const double elapsed = static_cast<double>(now - start_) * 1e-9 - options_.latency;
  std::int64_t i = newest_due(elapsed);
  if (i <= last_) return false;
  last_ = i;
  if (dropped(options_.start_time + sample_time(i))) return false;
  fill(i, out);
  out.stamp.sequence = static_cast<std::uint64_t>(i) + 1;
  out.stamp.sample_time = start_ + static_cast<Nanoseconds>(std::llround(sample_time(i) * 1e9));
  if (options_.duplicate) {
    remaining_duplicates_ = 1;
    last_sample_ = out;
  }
  return true;
}

void ReplayTracker::poll(Nanoseconds now, TrackerSink& out) {
  if (sample(now, polled_)) out.hand(polled_);
}

void ReplayTracker::restart(Nanoseconds begin) {
  started_ = true;
  start_ = begin;
  last_ = -1;
  remaining_duplicates_ = 0;
}

void ReplayTracker::fill_status(LoopStatus& status) const {
  const Nanoseconds motion_start = started_ ? start_ - static_cast<Nanoseconds>(options_.start_time * 1e9) : 0;
  add_counter(status, "motion_start_s", static_cast<double>(motion_start) * 1e-9);
}

bool ReplayTracker::finished(Nanoseconds now) const {
  if (!started_ || options_.repeat) return false;
  return static_cast<double>(now - start_) * 1e-9 - options_.latency + options_.start_time > motion_->duration();
}

}  // namespace softhand
