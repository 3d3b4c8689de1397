// Forward kinematics of a hand model's skeleton, and the points of its finger pads.
#pragma once

#include "model/hand_model.hpp"

namespace softhand {

/// The joint in whose frame the pose of `joint` is given: that of the next bone towards the wrist. For a tip it is its
/// own distal joint, for the palm the middle metacarpal, for the wrist itself.
constexpr Joint parent_of(Joint joint) {
  const Body body = body_of(joint);
  return joint_of(body) == joint ? joint_of(parent_of(body)) : joint_of(body);
}

/// Rotation vectors of the bodies against their rest-aligned parents, as in `JointModel`, in radians: x flexion
/// (negative = flexed), y abduction, z twist. Zero is the rest pose.
using JointAngles = std::array<Vector3, kBodyCount>;

/// An open hand with nearly straight fingers (joints flexed by 8 to 19 degrees). The posture does not depend on the
/// flexion of the rest pose. Generated motions measure flexion from here.
JointAngles open_hand(const HandModel& hand);

/// Joint frames in the parent frame of `wrist`. Tips and palm move with their bodies.
JointFrames forward_kinematics(const HandModel& hand, const Pose& wrist, const JointAngles& angles);

/// The vertices of the display skin around the distal bone, at rest, in that bone's joint frame. Empty if the hand has
/// no display skin. The skin is the same for all meshes of a hand, up to the rounding of its weights.
std::vector<Vector3> distal_skin(const HandModel& hand, Finger finger);

/// The contact point of a finger pad: the most palmar skin over the middle of the distal bone, in that bone's joint
/// frame. It is computed from the display skin, or from the joint radii if the hand has none.
Vector3 pad_in_distal(const HandModel& hand, Finger finger);

}  // namespace softhand
