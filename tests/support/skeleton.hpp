// A tracker's sample of a hand at rest.
#pragma once

#include "messages/convert.hpp"
#include "messages/messages.hpp"
#include "model/hand_model.hpp"

namespace softhand::testing {

/// The hand's rest pose with its wrist joint at `wrist` in the world, sampled at `time`. All joints are valid and
/// tracked.
inline Skeleton skeleton_at(const HandModel& model, const Pose& wrist, Nanoseconds time, std::uint64_t sequence) {
  Skeleton skeleton;
  skeleton.stamp.sequence = sequence;
  skeleton.stamp.sample_time = time;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Pose pose = wrist * model.rest_joints[j];
    skeleton.joints[j].position = to_wire(pose.position);
    skeleton.joints[j].orientation = to_wire(pose.orientation);
    skeleton.joints[j].flags = kJointValid | kJointTracked;
  }
  return skeleton;
}

}  // namespace softhand::testing
