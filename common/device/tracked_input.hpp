// From a tracker's samples to targets in the world: refuses what cannot be a hand, composes the mount, estimates
// velocities and extrapolates to the time of the step. Used by the tracking loop, and by the hand simulation where the
// intermediate layer is left out (figure 2B).
#pragma once

#include <array>
#include <cstdint>

#include "math/types.hpp"
#include "messages/messages.hpp"
#include "runtime/options.hpp"

namespace softhand {

struct TrackedInputOptions {
  double extrapolation_limit = 0.05;
  double velocity_smoothing = 0.008;
  double stale_after = 0.08;
  double reposition_distance = 0.5;
  double maximum_speed = 10;
  std::array<double, 3> headset_mount_position{0, 0, 0};
  std::array<double, 4> headset_mount_orientation{0, 0, 0, 1};
  std::array<double, 3> desk_mount_position{0, 0, 0};
  std::array<double, 4> desk_mount_orientation{0, 0, 0, 1};
};
void describe(OptionVisitor& v, TrackedInputOptions& o);

/// What a sample asks of one body: the world frame of its joint.
struct BodyTarget {
  Pose pose;
  Twist velocity;  ///< of the joint's origin, world axes; zero while the sample is older than the extrapolation limit
  bool valid = false;  ///< false until the joint was seen once
};

/// Why a sample, or one joint of it, was not used; all since start.
struct TrackedInputCounters {
  std::uint64_t accepted = 0;           ///< samples
  std::uint64_t refused_nonfinite = 0;  ///< joints with NaN or infinity
  std::uint64_t refused_implausible =
      0;  ///< joints beyond 1 km, with |q| outside [0.5, 2], or more than 0.5 m from their wrist
  std::uint64_t refused_order = 0;      ///< samples with an old or equal sequence or time
  std::uint64_t refused_mount = 0;      ///< samples in an unknown frame, or in the headset's without a head pose
  std::uint64_t implausible_clock = 0;  ///< samples whose time was replaced by that of their arrival
  std::uint64_t inferred = 0;           ///< joints carried along by a neighbour because they were refused or not seen
  std::uint64_t repositioned = 0;       ///< jumps of the wrist beyond the reposition distance
};

/// False where a sample's time cannot be of the clock that says `now`: it is in the future, or more than a second ago.
bool is_plausible(Nanoseconds sample_time, Nanoseconds now);

class TrackedInput {
 public:
  /// Throws std::invalid_argument where a mount's quaternion is not close to unit length.
  explicit TrackedInput(const TrackedInputOptions& options);

  /// Head poses in the order of their times; refused (silently, keeping what is known) when not finite, beyond
  /// 1 km or not newer.
  void add_head_pose(const HeadPose& head);
  /// False when the sample as a whole was refused. Single refused joints keep their place relative to their neighbour.
  bool add_sample(const Skeleton& sample, Nanoseconds now);

  /// Targets extrapolated to `now`, by body. Valid until the next call.
  const std::array<BodyTarget, kBodyCount>& targets(Nanoseconds now);
  /// Seconds since the newest accepted sample was taken; negative = none yet.
  double age(Nanoseconds now) const;
  /// True when there is no sample or the newest is older than `stale_after`.
  bool stale(Nanoseconds now) const;
  /// True once after a jump beyond the reposition distance, or after the first sample.
  bool take_repositioned();
  const TrackedInputCounters& counters() const { return counters_; }
  /// Stamp and confidence of the newest accepted sample, for what is derived from it.
  const Stamp& stamp() const { return stamp_; }
  double confidence() const { return confidence_; }

 private:
  struct TimedPose {
    Nanoseconds time = 0;
    Pose pose;
  };
  struct Track {
    Pose pose;            // world, at `time`
    Twist velocity;       // filtered
    Pose from_neighbour;  // in the frame of the neighbour that carries it along, as last seen
    bool seen = false;
    bool attached = false;  // from_neighbour is known
  };

  bool mount_at(std::uint32_t frame, Nanoseconds time, Pose& out) const;
  void estimate_velocity(Track& track, const Pose& pose, double elapsed) const;

  TrackedInputOptions options_;
  Pose headset_mount_;
  Pose desk_mount_;
  std::array<TimedPose, 32> heads_{};  // ring, newest at (head_count_ - 1) % size
  std::uint64_t head_count_ = 0;
  std::array<Track, kJointCount> tracks_{};
  std::array<BodyTarget, kBodyCount> targets_{};
  Stamp stamp_;
  Nanoseconds time_ = 0;  // of the newest accepted sample; that of its arrival where its own clock is implausible
  std::uint32_t source_ = 0;
  double confidence_ = 0;
  bool any_ = false;
  bool repositioned_ = false;
  TrackedInputCounters counters_;
};

}  // namespace softhand
