// Outcome: judges a run from its messages alone. Therefore `simulate` (virtual clock) and `up` (real processes) use the
// same rules.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "math/types.hpp"
#include "messages/messages.hpp"
#include "model/joint_law.hpp"
#include "trackers/replay/motion.hpp"

namespace softhand {

/// What a scene is for. A run succeeds if all of this happens to the grasped object. Zero = not asked for.
struct Goal {
  double travel = 0;        ///< m, largest distance of the object's centre of mass from its first place
  double tilt = 0;          ///< rad, largest angle by which it leaves its first vertical
  double returns = 0;       ///< m, the object ends this near to its first place, untouched and at rest
  bool both_sides = false;  ///< the same tilt towards the opposite side, too
  double swing = 0;         ///< rad or m, by which the coordinate of the joint rises above its first value
  double closes = 0;        ///< rad or m above the first value, to which it falls after each swing
  int times = 1;            ///< number of swings

  bool any() const { return travel > 0 || tilt > 0 || returns > 0 || swing > 0; }
};

/// A joint of the world whose coordinate is judged.
struct JudgedJoint {
  std::uint32_t parent = 0;  ///< ids of the objects
  std::uint32_t child = 0;
  JointLaw law;
  Pose parent_from_joint;  ///< the joint's frame in the bodies' frames
  Pose child_from_joint;
};

/// The reference data of the judgement. Times are seconds since `motion_start` on the clock of the messages.
struct OutcomeFrame {
  std::vector<MotionPhase> phases;
  Nanoseconds motion_start = 0;
  std::uint32_t object = 0;    ///< id of the object that is grasped
  double object_mass = 0;      ///< kg
  double gravity = 9.81;       ///< m/s^2 along -Y
  double shake_frequency = 0;  ///< Hz; 0 = not shaken
  Goal goal;
  JudgedJoint joint;      ///< used if the goal has a swing
  bool recorded = false;  ///< judge how a recorded hand is followed and holds, instead of the pinch
};

/// Stores copies of what it needs. Not for real-time threads.
class Outcome {
 public:
  void on_tracked(const Skeleton& skeleton);
  void on_simulated(const Skeleton& skeleton);
  void on_contacts(const Contacts& contacts);
  void on_coupling(const ObjectCoupling& coupling);
  void on_objects(const WorldObjects& objects);
  void on_bone_wrench(const BoneWrench& wrench);
  void on_device(const DeviceState& state);

  /// Keys and meaning: docs/outcome.md. A figure that the messages do not determine is null. A largest force is 0 then.
  nlohmann::ordered_json summary(const OutcomeFrame& frame) const;

 private:
  struct HandSample {
    Nanoseconds time;
    std::array<Pose, kJointCount> joints;
  };
  struct ContactSample {
    Nanoseconds time;
    std::array<double, 6> finger_force;  // N, magnitude per finger on any object
    std::array<std::uint32_t, 6> finger_object;
    std::array<std::uint32_t, 6> finger_contacts;
  };
  // Forces with which the phalanges of a finger press on an object. All bodies that are not phalanges count as palm.
  struct Press {
    Nanoseconds time;
    std::uint32_t object;
    std::array<double, 6> force;  // N, sum of the magnitudes at the contacts
  };
  struct Penetration {
    Nanoseconds time;
    std::uint32_t finger;
    double depth;
    double finger_force;
  };
  struct TwinSample {
    Nanoseconds time;
    std::uint32_t object;
    bool owned;
    Pose pose;
    Vector3 velocity;
    Vector3 contact_force;
  };
  struct ObjectSample {
    Nanoseconds time;
    std::uint32_t object;
    Pose pose;
    Vector3 velocity;
  };
  struct LatencySample {
    std::array<double, 6> hops_ms;  // tracker, tracking, hand, wrench, device, total
  };
  // A sample of the tracker, or a command with the newest sample in it.
  struct PublishedSample {
    Nanoseconds tracker_sample;
    Nanoseconds published;
  };

  /// For each sample of the tracker: time from its publication to the first command that contains the answer of the
  /// simulated hand to it or to a newer one.
  std::vector<double> first_effects_ms() const;
  /// Seconds. A longer interval between tracked samples is a gap. Nothing is compared with the tracker inside a gap.
  double longest_tracked_interval() const;
  /// Seconds on the clock of the messages: 0.5 s after the motion, or the end of the run if that is earlier. Later
  /// messages do not count for the success, because the tracker may repeat the motion.
  double last_time(const OutcomeFrame& frame) const;
  nlohmann::ordered_json success(const OutcomeFrame& frame, bool released) const;
  struct Swings {
    double largest = 0;
    int times = 0;
  };
  Swings swings(const OutcomeFrame& frame) const;
  nlohmann::ordered_json pinch(const OutcomeFrame& frame) const;
  nlohmann::ordered_json following(const OutcomeFrame& frame) const;

  std::vector<HandSample> tracked_;
  std::vector<HandSample> simulated_;
  std::vector<ContactSample> contacts_;
  std::vector<Press> presses_;  // one entry per touched object and time
  std::vector<Penetration> penetrations_;
  std::vector<TwinSample> twins_;
  std::vector<ObjectSample> objects_;
  std::vector<LatencySample> latencies_;
  std::vector<PublishedSample> tracker_samples_;
  std::vector<PublishedSample> commands_;
  std::uint64_t nonfinite_ = 0;
  double largest_finger_coupling_ = 0;  // N
  double largest_hand_coupling_ = 0;    // N
};

/// The goals of a part of the summary, for example of a flexible object, come in addition to those of the object.
void join_success(nlohmann::ordered_json& summary, const char* part);

/// Value at fraction q of the sorted values. NaN if `values` is empty.
double percentile(std::vector<double> values, double q);

}  // namespace softhand
