// Forward kinematics of a hand model's skeleton, and the points of its finger pads.
#pragma once

#include "model/hand_model.hpp"
#include "trackers/replay/motion.hpp"

namespace softhand {

/// Rotation vectors of the bodies against their rest-aligned parents, as in `JointModel`: x flexion (negative =
/// flexed), y abduction, z twist; radians. Zero is the rest pose.
using JointAngles = std::array<Vector3, kBodyCount>;

/// An open hand: fingers nearly straight (joints flexed by 8 to 19 degrees), the same posture however flexed the rest
/// pose is. Made motions count flexion from here.
JointAngles open_hand(const HandModel& hand);

/// Joint frames in the frame of `wrist`'s parent. Tips and palm ride on their bodies.
JointFrames forward_kinematics(const HandModel& hand, const Pose& wrist, const JointAngles& angles);

/// Where the pad of a finger touches: the most palmar skin over the middle of the distal bone, in that bone's joint
/// frame. From the mesh where the hand has one, else from the joint radii.
Vector3 pad_in_distal(const HandModel& hand, Finger finger);

}  // namespace softhand
