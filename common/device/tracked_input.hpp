// Converts the samples of a tracker into target poses in the world. It refuses samples that cannot be a hand, applies
// the mount, removes noise, estimates velocities and extrapolates to the time of the step. When another tracker takes
// the hand over, the difference between the two fades out. The tracking loop uses it. The hand simulation uses it if it
// runs without the intermediate skeleton (figure 2B).
#pragma once

#include <array>
#include <cstdint>

#include "device/pose_blend.hpp"
#include "device/pose_filter.hpp"
#include "math/types.hpp"
#include "messages/messages.hpp"
#include "runtime/options.hpp"

namespace softhand {

struct TrackedInputOptions {
  double extrapolation_limit = 0.05;
  double velocity_smoothing = 0.008;
  double smoothing_cutoff = 0;
  double smoothing_speed = 0.02;
  double stale_after = 0.08;
  double reposition_distance = 0.5;
  double maximum_speed = 10;
  double blend_time = 0.2;
  std::array<double, 3> headset_mount_position{0, 0, 0};
  std::array<double, 4> headset_mount_orientation{0, 0, 0, 1};
  std::array<double, 3> desk_mount_position{0, 0, 0};
  std::array<double, 4> desk_mount_orientation{0, 0, 0, 1};
};
void describe(OptionVisitor& v, TrackedInputOptions& o);

/// A coupling is never weaker than this part of its strength, so no bone floats.
inline constexpr double kLeastConfidence = 0.05;

/// Target of one body: the world pose and velocity of its joint frame.
struct BodyTarget {
  Pose pose;
  /// Of the joint's origin, world axes. Zero while the sample is older than the extrapolation limit.
  Twist velocity;
  /// Of the joint, kLeastConfidence to 1, low-pass filtered with a time constant of 50 ms: the part of its strength
  /// that the coupling to this target has.
  double confidence = 1;
  bool valid = false;  ///< false until the joint was seen once
};

/// Counts of accepted and refused samples and joints since start.
struct TrackedInputCounters {
  std::uint64_t accepted = 0;           ///< samples
  std::uint64_t refused_nonfinite = 0;  ///< joints with NaN or infinity
  /// joints beyond 1 km, with |q| outside [0.5, 2], a confidence outside [0, 1], or more than 0.5 m from their wrist
  std::uint64_t refused_implausible = 0;
  std::uint64_t refused_order = 0;  ///< samples with an old or equal sequence or time
  /// samples in an unknown frame, or in the headset's frame without a head pose of the last second before them
  std::uint64_t refused_mount = 0;
  std::uint64_t refused_head_clock = 0;  ///< head poses from the future or older than 1 s
  std::uint64_t implausible_clock = 0;   ///< samples whose time was replaced by their arrival time
  std::uint64_t inferred = 0;            ///< refused or unseen joints that were moved rigidly with a neighbour
  std::uint64_t repositioned = 0;        ///< jumps of the wrist beyond the reposition distance
  std::uint64_t swapped = 0;             ///< changes from one tracker to another
};

/// Returns false if the sample time cannot come from the clock of `now`. This is so if it is more than
/// `kFutureTolerance` in the future or more than 1 s in the past.
bool is_plausible(Nanoseconds sample_time, Nanoseconds now);

class TrackedInput {
 public:
  /// Throws std::invalid_argument if the quaternion of a mount is not close to unit length.
  explicit TrackedInput(const TrackedInputOptions& options);

  /// Adds a head pose. Head poses must come in the order of their times. A pose that is not finite, beyond 1 km or not
  /// newer is ignored without a message.
  void add_head_pose(const HeadPose& head, Nanoseconds now);
  /// Returns false if the whole sample was refused. A joint that was refused alone keeps its place relative to its
  /// neighbour.
  bool add_sample(const Skeleton& sample, Nanoseconds now);

  /// Targets extrapolated to `now`, indexed by body. Valid until the next call.
  const std::array<BodyTarget, kBodyCount>& targets(Nanoseconds now);
  /// Seconds since the newest accepted sample was measured; negative: no sample yet.
  double age(Nanoseconds now) const;
  /// True if there is no sample, or if the newest one is older than `stale_after`.
  bool stale(Nanoseconds now) const;
  /// Returns true once after a jump beyond the reposition distance and once after the first sample.
  bool take_repositioned();
  const TrackedInputCounters& counters() const { return counters_; }
  /// Stamp and confidence of the newest accepted sample, for messages derived from it.
  const Stamp& stamp() const { return stamp_; }
  double confidence() const { return confidence_; }
  /// Time of the newest accepted sample: its sample time, or its arrival if its clock is implausible.
  Nanoseconds time() const { return time_; }

  /// For writing and reading all that samples have changed (messages/plain_bytes.hpp).
  template <typename Self, typename Visit>
  static void visit_members(Self& self, Visit&& visit) {
    visit(self.heads_);
    visit(self.head_count_);
    visit(self.tracks_);
    visit(self.targets_);
    visit(self.stamp_);
    visit(self.time_);
    visit(self.targets_time_);
    visit(self.source_);
    visit(self.confidence_);
    visit(self.any_);
    visit(self.repositioned_);
    visit(self.counters_);
  }

 private:
  struct TimedPose {
    Nanoseconds time = 0;
    Pose pose;
  };
  struct Track {
    Pose pose;            // world, at `time`, filtered
    Twist velocity;       // filtered
    Pose from_neighbour;  // in the frame of the neighbour that this joint moves with when it is unseen; from the last
                          // sample with both
    PoseBlend blend;      // from the former tracker
    PoseFilter filter;
    double confidence = 1;           // at least kLeastConfidence, of the newest sample in which the joint was seen
    double filtered_confidence = 1;  // at the time of the targets
    bool seen = false;
    bool attached = false;  // from_neighbour is known
  };

  bool mount_at(std::uint32_t frame, Nanoseconds time, Pose& out) const;
  Pose pose_of(const Track& track, Nanoseconds time) const;
  void estimate_velocity(Track& track, const Pose& pose, double elapsed) const;

  TrackedInputOptions options_;
  Pose headset_mount_;
  Pose desk_mount_;
  std::array<TimedPose, 32> heads_{};  // ring buffer, newest at (head_count_ - 1) % size
  std::uint64_t head_count_ = 0;
  std::array<Track, kJointCount> tracks_{};
  std::array<BodyTarget, kBodyCount> targets_{};
  Stamp stamp_;
  Nanoseconds time_ = 0;          // of the newest accepted sample; its arrival time if its own clock is implausible
  Nanoseconds targets_time_ = 0;  // of the newest targets
  std::uint32_t source_ = 0;
  double confidence_ = 0;
  bool any_ = false;
  bool repositioned_ = false;
  TrackedInputCounters counters_;
};

}  // namespace softhand
