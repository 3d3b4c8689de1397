// A tracking loop with a tracker, for its tests.
#pragma once

#include <cmath>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "support/block_hand.hpp"
#include "tracking/tracking_loop.hpp"

namespace softhand::testing::tracking {

inline constexpr Nanoseconds kMillisecond = 1'000'000;
inline constexpr Nanoseconds kStart = 10'000 * kMillisecond;
inline constexpr std::size_t kWrist = 1, kIndexTip = 10, kIndexDistal = 9, kIndexIntermediate = 8;

inline const HandModel& hand() {
  static const HandModel model = testing::block_hand();
  return model;
}

inline Skeleton skeleton_at(const Pose& wrist, std::uint64_t sequence, Nanoseconds time) {
  Skeleton out;
  out.stamp.sequence = sequence;
  out.stamp.epoch = 7;
  out.stamp.sample_time = out.stamp.publish_time = time;
  out.confidence = 1;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Pose pose = wrist * hand().rest_joints[j];
    out.joints[j].position = to_wire(pose.position);
    out.joints[j].orientation = to_wire(pose.orientation);
    out.joints[j].flags = kJointValid | kJointTracked;
  }
  return out;
}

inline constexpr double kHandRate = 90;  // Hz

inline Pose still() { return {Vector3(0.1, 1.2, -0.3), Quaternion::Identity()}; }

// Runs the loop at 1 kHz with a tracker at `rate` (Hz). The tracked wrist is at `wrist(t)`. `after(t, output)` is
// called after each step.
template <typename Motion, typename After>
void run(TrackingLoop& loop, double seconds, double rate, Motion wrist, After after, Nanoseconds latency = 0) {
  std::uint64_t sent = 0;
  for (int i = 0; i < static_cast<int>(seconds * 1000); ++i) {
    const Nanoseconds now = kStart + i * kMillisecond;
    const double t = i * 1e-3;
    Skeleton sample;
    TrackingInput input;
    const auto due =
        static_cast<std::uint64_t>(std::floor((t - static_cast<double>(latency) * 1e-9) * rate + 1e-9) + 1);
    if (t * 1e9 >= static_cast<double>(latency) && due > sent) {
      sent = due;
      const double taken = static_cast<double>(due - 1) / rate;
      sample = skeleton_at(wrist(taken), due, kStart + static_cast<Nanoseconds>(taken * 1e9));
      input.tracked = &sample;
    }
    after(t, loop.step(now, input));
  }
}

inline Vector3 position(const Skeleton& s, std::size_t joint) { return to_vector(s.joints[joint].position); }

}  // namespace softhand::testing::tracking
