// One hand and one head from several trackers: the wrist from one, each finger from one, the head from one.
//
// Each source is validated and put into the world by its own TrackedInput. So sources may have any rate, delay and
// mount. Fingers are taken relative to the wrist of their own source and put on the wrist of another one.
//
// Parts whose newest sample is older than the composed hand are predicted. TrackedInput extrapolates the wrist. A
// finger is predicted by its joint angles, so bones keep their length. Its angular velocity w fades with the time
// constant T:
//   R(t + h) = R(t) exp(T (1 - e^(-h/T)) w).
// This is the expected rotation if the velocity is an Ornstein-Uhlenbeck process (a finger that brakes and turns back
// at random; Uhlenbeck and Ornstein 1930, Phys. Rev. 36).
//
// Each part has one owner at a time: the best source that is good. A source is good for a part while it sends samples
// of this part with enough confidence. When the owner changes, the difference between the old and the new pose fades
// out. So the hand does not jump.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "device/pose_blend.hpp"
#include "device/tracked_input.hpp"
#include "messages/messages.hpp"
#include "model/hand_model.hpp"
#include "trackers/fusion/fusion_options.hpp"

namespace softhand {

/// Users of the sources of each part, best first.
struct FusionSources {
  std::vector<std::uint32_t> wrist, fingers, head;
};
/// Throws ConfigError if a list has something else than users 0 to 15, a user twice, or `own_user`, which is
/// that of the fused hand.
FusionSources parse_sources(const FusionOptions& options, std::uint32_t own_user);

/// Which source owns a part. Does not allocate after construction.
class Ownership {
 public:
  /// `candidates`: sources, best first.
  Ownership(std::vector<std::uint32_t> candidates, const FusionOptions& options);

  /// A sample of this part arrived from `source`.
  void add(std::uint32_t source, bool good, Nanoseconds now);
  /// Chooses the owner. Returns true if it is another one than at the last call.
  bool update(Nanoseconds now);
  /// Empty: no source is alive.
  std::optional<std::uint32_t> owner() const { return owner_; }
  /// Number of changes since the start, from one source to another.
  std::uint64_t changes() const { return changes_; }

 private:
  struct Candidate {
    std::uint32_t source;
    Nanoseconds newest = 0;      // arrival; 0 = none
    Nanoseconds good_since = 0;  // 0 = not good
  };
  std::vector<Candidate> candidates_;
  Nanoseconds stale_after_;
  Nanoseconds patience_;
  std::optional<std::uint32_t> owner_;
  std::optional<std::uint32_t> last_owner_;
  std::uint64_t changes_ = 0;
};

/// The head: the pose of its owner, blended at changes. All head poses are in the world.
class HeadFusion {
 public:
  HeadFusion(const FusionOptions& options, std::vector<std::uint32_t> sources);
  /// `sample.user` is the source. Returns true if `out` is a new pose.
  bool add(const HeadPose& sample, Nanoseconds now, HeadPose& out);
  const Ownership& ownership() const { return owner_; }
  std::uint64_t refused() const { return refused_; }

 private:
  Ownership owner_;
  double blend_time_;
  std::uint64_t refused_ = 0;   // samples from the future or older than 1 s
  std::uint64_t sequence_ = 0;  // of `out`
  PoseBlend blend_;
  std::optional<std::uint32_t> used_;  // owner of the last pose
  Pose last_;
  Nanoseconds last_time_ = 0;
};

/// One hand. Does not allocate after construction.
class HandFusion {
 public:
  /// `hand` is of the fused side. `input` has the mounts of the sources, and how they are extrapolated.
  HandFusion(const FusionOptions& options, const TrackedInputOptions& input, const FusionSources& sources,
             const HandModel& hand);

  /// For sources on a headset.
  void add_head(const HeadPose& head, Nanoseconds now);
  /// `sample.hand.user` is the source. Samples of other users are ignored.
  void add(const Skeleton& sample, Nanoseconds now);
  /// Composes the hand at the time of the newest sample of an owner, minus the delay. Returns false if no such sample
  /// arrived since the last call, or if no wrist is known. The hand is in the world. Fingers without an owner keep
  /// their posture and are marked as inferred.
  bool compose(Nanoseconds now, Skeleton& out);

  const Ownership& wrist() const { return parts_[0]; }
  const Ownership& finger(Finger finger) const { return parts_[1 + static_cast<std::size_t>(finger)]; }
  std::uint64_t poor() const { return poor_; }        ///< samples below the least confidence
  std::uint64_t refused() const { return refused_; }  ///< samples that TrackedInput refused

 private:
  static constexpr std::size_t kParts = 1 + kFingerCount;  // wrist, then the fingers
  struct Posture {
    Nanoseconds time = 0;
    Pose wrist;                            // world
    std::array<Pose, kJointCount> joints;  // relative to the parent joint; not for the wrist
  };
  struct Source {
    std::uint32_t user;
    TrackedInput input;
    Skeleton newest{};              // the newest sample that was used
    Nanoseconds used_at = 0;        // its arrival
    Nanoseconds good_at = 0;        // arrival of the newest sample with enough confidence
    bool resumed = false;           // the newest sample came after a gap
    std::array<Posture, 8> past{};  // ring buffer, newest at (count - 1) % size
    std::uint64_t count = 0;

    std::uint64_t stored() const { return std::min<std::uint64_t>(count, past.size()); }
    const Posture& back(std::uint64_t i) const { return past[(count - 1 - i) % past.size()]; }
    Posture posture{};  // at the time of the composition; joints that the source never saw are at rest
  };

  Source* source_of(std::optional<std::uint32_t> user);
  static void measure(Source& source);
  void recall(Source& source, Nanoseconds time) const;
  void predict(Source& source, Nanoseconds time) const;

  double reposition_distance_;
  double least_confidence_;
  double blend_time_;
  Nanoseconds stale_after_, patience_, delay_;
  std::uint32_t side_;
  std::array<double, kJointCount> radii_;
  std::vector<Source> sources_;
  std::vector<Ownership> parts_;
  std::array<std::optional<std::uint32_t>, kParts> used_;  // owner at the last composition
  std::array<PoseBlend, kJointCount> blends_;
  Posture posture_;  // the last one that was composed
  std::uint64_t sequence_ = 0;
  bool fed_ = false;
  bool any_ = false;
  std::uint64_t poor_ = 0;
  std::uint64_t refused_ = 0;
};

}  // namespace softhand
