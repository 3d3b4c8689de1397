// Curls and splays become joints by the hand's own ranges of motion.
#include "device/curl_lifter.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "support/count_allocations.hpp"

namespace softhand::curl_lifter_test {
namespace {

HandModel shipped_hand() { return load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json"); }
Vector3 place(const Skeleton& hand, Joint joint) { return to_vector(hand.joints[slot_of(joint)].position); }

std::array<FingerCurl, kFingerCount> all(double curl, double splay = 0) {
  std::array<FingerCurl, kFingerCount> fingers;
  fingers.fill({true, {curl, curl, curl}, splay});
  return fingers;
}

// Angles of a bone against its rest pose, as in JointModel.
Vector3 angles_of(const Skeleton& sample, const HandModel& hand, Body body) {
  const std::size_t joint = slot_of(joint_of(body)), parent = slot_of(joint_of(parent_of(body)));
  const auto turn = [&](std::size_t j) { return to_quaternion(sample.joints[j].orientation); };
  const Quaternion rest = hand.rest_joints[parent].orientation.conjugate() * hand.rest_joints[joint].orientation;
  return rotation_log(rest.conjugate() * turn(parent).conjugate() * turn(joint));
}

TEST(CurlLifter, ReachesTheEndsOfTheRanges) {
  const HandModel right = shipped_hand();
  for (const Side side : {Side::right, Side::left}) {
    const HandModel hand = side == Side::right ? right : mirrored(right);
    const CurlLifter lifter(right, side);
    Skeleton open, half, closed;
    lifter.lift(all(0), open);
    lifter.lift(all(0.5), half);
    lifter.lift(all(1), closed);
    EXPECT_EQ(open.hand.side, static_cast<std::uint32_t>(side));
    for (int f = 0; f < kFingerCount; ++f) {
      for (int k = 0; k < 3; ++k) {
        const Body body = static_cast<Body>(index_of(distal_of(static_cast<Finger>(f))) - 2 + k);
        const auto& range = hand.bodies[static_cast<std::size_t>(index_of(body))].joint.flexion_range;
        const double from = angles_of(open, hand, body).x(), to = angles_of(closed, hand, body).x();
        EXPECT_NEAR(from, open_hand(hand)[static_cast<std::size_t>(index_of(body))].x(), 1e-9) << f << k;
        EXPECT_NEAR(to, range[0], 1e-9) << f << k;
        EXPECT_NEAR(angles_of(half, hand, body).x(), 0.5 * (from + to), 1e-9) << f << k;
        EXPECT_LT(to, from - 0.5) << f << k;  // flexion is negative
      }
    }
    Skeleton beyond;
    lifter.lift(all(1.7), beyond);
    EXPECT_EQ(place(beyond, Joint::index_tip), place(closed, Joint::index_tip));
    // The closed fingertips are on the palmar side, nearer to the wrist.
    EXPECT_LT(place(closed, Joint::middle_tip).y(), -0.02);
    EXPECT_LT(place(closed, Joint::middle_tip).norm(), place(open, Joint::middle_tip).norm() - 0.05);
  }
}

TEST(CurlLifter, SplaysTowardsTheThumbOnBothSides) {
  const HandModel right = shipped_hand();
  for (const Side side : {Side::right, Side::left}) {
    const HandModel hand = side == Side::right ? right : mirrored(right);
    const CurlLifter lifter(right, side);
    Skeleton none, splayed, most;
    lifter.lift(all(0), none);
    lifter.lift(all(0, 0.1), splayed);
    lifter.lift(all(0, 3), most);
    const double thumb = place(none, Joint::thumb_tip).x() > 0 ? 1 : -1;
    for (const Joint tip : {Joint::index_tip, Joint::middle_tip, Joint::ring_tip, Joint::little_tip})
      EXPECT_GT(thumb * (place(splayed, tip).x() - place(none, tip).x()), 0.004) << index_of(tip);
    for (const Body body : {Body::thumb_metacarpal, Body::index_proximal, Body::little_proximal}) {
      const auto& range = hand.bodies[static_cast<std::size_t>(index_of(body))].joint.abduction_range;
      EXPECT_NEAR(std::abs(angles_of(most, hand, body).y()), side == Side::right ? range[1] : -range[0], 0.05);
    }
  }
}

TEST(CurlLifter, MarksWhatTheGloveSees) {
  const CurlLifter lifter(shipped_hand(), Side::right);
  auto fingers = all(0.3);
  fingers[4].valid = false;
  Skeleton hand;
  lifter.lift(fingers, hand);
  EXPECT_EQ(hand.frame, 2u);
  EXPECT_EQ(place(hand, Joint::wrist), Vector3::Zero());
  EXPECT_EQ(hand.joints[slot_of(Joint::wrist)].flags, kJointValid | kJointInferred);
  EXPECT_EQ(hand.joints[slot_of(Joint::palm)].flags, kJointValid | kJointInferred);
  EXPECT_EQ(hand.joints[slot_of(Joint::thumb_metacarpal)].flags, kJointValid | kJointTracked);
  EXPECT_EQ(hand.joints[slot_of(Joint::index_metacarpal)].flags, kJointValid | kJointInferred);
  EXPECT_EQ(hand.joints[slot_of(Joint::index_proximal)].flags, kJointValid | kJointTracked);
  EXPECT_EQ(hand.joints[slot_of(Joint::ring_tip)].flags, kJointValid | kJointTracked);
  EXPECT_EQ(hand.joints[slot_of(Joint::little_proximal)].flags, 0u);
  EXPECT_EQ(hand.joints[slot_of(Joint::little_tip)].flags, 0u);
  for (const JointSample& joint : hand.joints) EXPECT_GT(joint.radius, 0);
}

TEST(CurlLifter, DoesNotAllocate) {
  const CurlLifter lifter(shipped_hand(), Side::right);
  Skeleton hand;
  counting = true;
  lifter.lift(all(0.3), hand);
  counting = false;
  EXPECT_EQ(allocations, 0);
}

}  // namespace
}  // namespace softhand::curl_lifter_test
