// A hand that two sources see: one its wrist, the other its fingers. For the tests of softhand-tracker-fusion.
#pragma once

#include <cmath>
#include <filesystem>
#include <memory>
#include <random>
#include <string>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "support/moving_hand.hpp"
#include "trackers/replay/generator.hpp"
#include "trackers/replay/recording.hpp"

namespace softhand::testing {

inline constexpr std::uint32_t kWristSource = 1, kFingerSource = 2;  // users
inline constexpr double kFingerDelay = 0.03;                         // s

/// Every joint of a shipped hand in motion, generated.
inline std::shared_ptr<const Motion> shipped_free_motion() {
  GeneratorOptions options;
  options.motion = "free_motion";
  return make_motion(load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json"), options);
}

/// The recorded Quest hand, or a generated motion on a machine without it.
inline std::shared_ptr<const Motion> quest_hand() {
  if (std::filesystem::exists(recorded_hand_path()))
    return std::make_shared<Recording>(Recording::load(recorded_hand_path()));
  std::printf("no recording; a generated motion instead\n");
  return shipped_free_motion();
}

/// A sample of all joints, in the world.
inline Skeleton whole_hand(const JointFrames& joints, std::uint32_t user) {
  Skeleton out;
  out.hand = {user, 1};
  out.confidence = 1;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    out.joints[j].position = to_wire(joints[j].position);
    out.joints[j].orientation = to_wire(joints[j].orientation);
    out.joints[j].flags = kJointValid | kJointTracked;
  }
  return out;
}
inline Skeleton only_wrist(const JointFrames& joints) {
  Skeleton out = whole_hand(joints, kWristSource);
  for (std::size_t j = 0; j < kJointCount; ++j)
    if (j != slot_of(Joint::wrist)) out.joints[j] = {};
  return out;
}
/// As a glove delivers them: the wrist is at the origin of the desk, and not tracked.
inline Skeleton only_fingers(const JointFrames& joints) {
  JointFrames local;
  for (std::size_t j = 0; j < kJointCount; ++j) local[j] = joints[slot_of(Joint::wrist)].inverse() * joints[j];
  Skeleton out = whole_hand(local, kFingerSource);
  out.frame = 2;
  out.joints[slot_of(Joint::wrist)].flags = kJointValid | kJointInferred;
  return out;
}

/// The finger source is in doubt for 50 ms of each second. Then its joints are wrong by 10 degrees and 5 mm.
inline bool in_doubt(double time) { return std::fmod(time, 1.0) > 0.95; }
inline Skeleton doubtful_fingers(const JointFrames& joints, double time, std::mt19937_64& random) {
  Skeleton out = only_fingers(joints);
  if (!in_doubt(time)) return out;
  out.confidence = 0.1;
  std::normal_distribution<double> normal;
  const auto noise = [&](double size) -> Vector3 {
    return size * Vector3(normal(random), normal(random), normal(random));
  };
  for (JointSample& joint : out.joints) {
    joint.position = to_wire(Vector3(to_vector(joint.position) + noise(0.005)));
    joint.orientation = to_wire(Quaternion(to_quaternion(joint.orientation) * rotation_exp(noise(0.17))));
  }
  return out;
}

/// Distances between the fingertips of samples and those of the undivided motion, m.
class TipErrors {
 public:
  void add(const Skeleton& sample, const JointFrames& real) {
    for (int f = 0; f < kFingerCount; ++f) {
      const std::size_t tip = slot_of(tip_of(static_cast<Finger>(f)));
      const double distance = (to_vector(sample.joints[tip].position) - real[tip].position).norm();
      sum_ += distance * distance;
      largest_ = std::max(largest_, distance);
      ++count_;
    }
  }
  double rms() const { return std::sqrt(sum_ / static_cast<double>(count_)); }
  double largest() const { return largest_; }
  int samples() const { return count_ / kFingerCount; }

 private:
  double sum_ = 0, largest_ = 0;
  int count_ = 0;
};

}  // namespace softhand::testing
