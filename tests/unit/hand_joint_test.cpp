// Objects with joints in the loop of the hand: descriptions, slots, and what a hand refuses.
#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "hand/hand_loop.hpp"
#include "messages/convert.hpp"
#include "support/block_hand.hpp"
#include "support/shapes.hpp"
#include "support/skeleton.hpp"

namespace softhand::hand_joint_test {
namespace {

constexpr Nanoseconds kSecond = 1'000'000'000;
constexpr Nanoseconds kPeriod = 11'111'111;

HandModel hand() { return testing::block_hand(1); }

HandOptions loop_options(std::int64_t slots, std::int64_t joints) {
  HandOptions o;
  o.simulation.solver.max_iterations = 4;
  o.mirrored_objects = slots;
  o.static_objects = 1;
  o.object_joints = joints;
  return o;
}

ObjectDescription cube(std::uint32_t id, bool is_static = false) {
  ObjectDescription d;
  d.object = id;
  d.is_static = is_static ? 1 : 0;
  d.mass = is_static ? 0 : 0.05;
  d.inertia = {1.33e-5, 1.33e-5, 1.33e-5};
  d.friction = 0.8;
  d.shape = testing::cube_shape(0.02);
  return d;
}

ObjectJointDescription joint(std::uint32_t id, std::uint32_t parent, std::uint32_t child) {
  ObjectJointDescription d;
  d.joint = id;
  d.parent = parent;
  d.child = child;
  d.kind = static_cast<std::uint32_t>(ObjectJointKind::hinge);
  return d;
}

WorldObjects world(const std::vector<std::pair<std::uint32_t, Vector3>>& objects, Nanoseconds time) {
  WorldObjects out;
  out.stamp.sample_time = time;
  for (const auto& [id, position] : objects) {
    ObjectState state;
    state.object = id;
    state.position = to_wire(position);
    out.objects.push_back(state);
  }
  return out;
}

// Steps a hand at rest with objects at places relative to its fingertip. Returns the ids of the twins.
struct Stepper {
  explicit Stepper(const HandOptions& options) : loop(hand(), options, {}) {}
  std::vector<std::uint32_t> step(const std::vector<std::pair<std::uint32_t, Vector3>>& objects) {
    ++steps;
    const Nanoseconds now = kSecond + static_cast<Nanoseconds>(steps) * kPeriod;
    const Skeleton skeleton = testing::skeleton_at(hand(), {}, now, steps);
    const WorldObjects seen = world(objects, now);
    const HandOutput& output = loop.step(now, {&skeleton, nullptr, &seen}, {});
    std::vector<std::uint32_t> ids;
    for (const ObjectTwin& twin : output.coupling.twins) ids.push_back(twin.object);
    return ids;
  }
  HandLoop loop;
  std::uint64_t steps = 0;
};

Vector3 beside_the_tip(double distance) {
  return hand().rest_joints[static_cast<std::size_t>(index_of(Joint::index_tip))].position + Vector3(0, 0, -distance);
}

using Ids = std::vector<std::uint32_t>;

TEST(HandJoints, ObjectsThatJointsConnectGetSlotsTogether) {
  const Vector3 near = beside_the_tip(0.05), far = beside_the_tip(0.5);
  Stepper apart(loop_options(2, 2));
  for (const std::uint32_t id : {1u, 2u}) apart.loop.describe_object(cube(id));
  EXPECT_EQ(apart.step({{1, near}, {2, far}}), Ids{1});
  Stepper linked(loop_options(2, 2));
  for (const std::uint32_t id : {1u, 2u}) linked.loop.describe_object(cube(id));
  linked.loop.describe_joint(joint(1, 1, 2));
  EXPECT_EQ(linked.step({{1, near}, {2, far}}), (Ids{1, 2}));
  EXPECT_EQ(linked.step({{1, far}, {2, far}}), Ids{}) << "they leave together";
  EXPECT_EQ(linked.loop.counters().objects_without_slot, 0u);
}

TEST(HandJoints, TooFewSlotsOrPlacesTakeNone) {
  const Vector3 near = beside_the_tip(0.05);
  for (const auto& [slots, places] : {std::pair{1, 2}, std::pair{2, 0}}) {
    Stepper few(loop_options(slots, places));
    for (const std::uint32_t id : {1u, 2u}) few.loop.describe_object(cube(id));
    few.loop.describe_joint(joint(1, 1, 2));
    EXPECT_EQ(few.step({{1, near}, {2, near}}), Ids{}) << slots << " " << places;
    EXPECT_GT(few.loop.counters().objects_without_slot, 0u);
  }
}

TEST(HandJoints, ANearerSetTakesTheSlotsOfFartherObjectsOnlyIfAllFit) {
  Stepper stepper(loop_options(2, 2));
  for (const std::uint32_t id : {1u, 2u, 3u, 4u}) stepper.loop.describe_object(cube(id));
  stepper.loop.describe_joint(joint(1, 1, 2));
  const Vector3 far = beside_the_tip(0.5);
  EXPECT_EQ(stepper.step({{1, far}, {2, far}, {3, beside_the_tip(0.08)}, {4, beside_the_tip(0.085)}}), (Ids{3, 4}));
  EXPECT_EQ(stepper.step({{1, beside_the_tip(0.05)}, {2, far}, {3, beside_the_tip(0.08)}, {4, beside_the_tip(0.085)}}),
            (Ids{1, 2}));
  // A single nearer object takes the slots of the whole set.
  EXPECT_EQ(stepper.step({{1, beside_the_tip(0.08)}, {2, far}, {3, beside_the_tip(0.05)}, {4, far}}), Ids{3});
}

TEST(HandJoints, AStaticParentNeedsNoSlotAndARemovedJointFreesItsObjects) {
  Stepper stepper(loop_options(1, 1));
  stepper.loop.describe_object(cube(1, true));
  stepper.loop.describe_object(cube(2));
  stepper.loop.describe_object(cube(3));
  stepper.loop.describe_joint(joint(1, 1, 2));
  stepper.loop.describe_joint(joint(2, 2, 3));
  const Vector3 near = beside_the_tip(0.05), far = beside_the_tip(0.5);
  EXPECT_EQ(stepper.step({{1, far}, {2, near}, {3, far}}), Ids{}) << "two movable objects, one slot";
  ObjectJointDescription removed = joint(2, 2, 3);
  removed.removed = 1;
  stepper.loop.describe_joint(removed);
  EXPECT_EQ(stepper.step({{1, far}, {2, near}, {3, far}}), Ids{2});
}

// A drawer: object 2, which the fingertip may touch, moves along the fixed object 1.
void describe_drawer(HandLoop& loop) {
  loop.describe_object(cube(1, true));
  loop.describe_object(cube(2));
  loop.describe_joint(joint(1, 1, 2));
}

// The world describes an object again after `object.reset`, before its next sample.
TEST(HandJoints, ASetThatIsDescribedAgainWhileItsJointActsLeavesTheHand) {
  Stepper stepper(loop_options(1, 1));
  describe_drawer(stepper.loop);
  const Vector3 touching = beside_the_tip(0.019), fixed = beside_the_tip(0.1);
  for (int i = 0; i < 3; ++i) ASSERT_EQ(stepper.step({{1, fixed}, {2, touching}}), Ids{2});
  ASSERT_EQ(stepper.loop.simulation().slot_mode(0), SlotMode::dynamic) << "its joint must act";
  ObjectDescription again = cube(2);
  again.stamp.sample_time = kSecond + 100 * kPeriod;
  stepper.loop.describe_object(again);
  EXPECT_EQ(stepper.step({{1, fixed}, {2, touching}}), Ids{}) << "older samples say nothing about its place";
}

TEST(HandJoints, TheJointsOfASetThatLeavesActOnNoOtherObject) {
  Stepper stepper(loop_options(1, 1));
  describe_drawer(stepper.loop);
  stepper.loop.describe_object(cube(3));
  const Vector3 near = beside_the_tip(0.06), touching = beside_the_tip(0.019);
  const Vector3 fixed = beside_the_tip(0.1), far = beside_the_tip(1);
  for (int i = 0; i < 12; ++i) ASSERT_EQ(stepper.step({{1, fixed}, {2, near}, {3, far}}), Ids{2});
  ASSERT_EQ(stepper.step({{1, fixed}, {2, touching}, {3, far}}), Ids{2});
  ASSERT_EQ(stepper.loop.simulation().slot_mode(0), SlotMode::dynamic) << "the hand may touch it";
  ASSERT_EQ(stepper.loop.output().coupling.twins[0].owned, 0u) << "it did not touch it at the start of this step";
  for (int i = 0; i < 3; ++i) ASSERT_EQ(stepper.step({{1, fixed}, {2, far}, {3, touching}}), Ids{3});
  EXPECT_EQ(to_vector(stepper.loop.output().coupling.twins[0].coupling_force).norm(), 0);
  std::vector<std::byte> memory(1 << 20);
  ByteWriter saved(memory);
  stepper.loop.save(saved);
  HandLoop next(hand(), loop_options(1, 1), {});
  ByteReader bytes(saved.written());
  EXPECT_NO_THROW(next.load(bytes));
}

TEST(HandJoints, RefusesJointsThatCannotRunAndKeepsTheOldOne) {
  Stepper stepper(loop_options(2, 2));
  for (const std::uint32_t id : {1u, 2u}) stepper.loop.describe_object(cube(id));
  stepper.loop.describe_joint(joint(1, 1, 2));
  ObjectJointDescription bad = joint(1, 1, 1);
  EXPECT_THROW(stepper.loop.describe_joint(bad), std::invalid_argument);
  bad = joint(1, 1, 2);
  bad.kind = 9;
  EXPECT_THROW(stepper.loop.describe_joint(bad), std::invalid_argument);
  bad = joint(1, 1, 2);
  bad.stiffness = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(stepper.loop.describe_joint(bad), std::invalid_argument);
  bad = joint(1, 1, 2);
  bad.parent_orientation = {0, 0, 0, 0};
  EXPECT_THROW(stepper.loop.describe_joint(bad), std::invalid_argument);
  bad = joint(1, 1, 2);
  bad.child_position[1] = std::numeric_limits<double>::infinity();
  EXPECT_THROW(stepper.loop.describe_joint(bad), std::invalid_argument);
  EXPECT_EQ(stepper.step({{1, beside_the_tip(0.05)}, {2, beside_the_tip(0.5)}}), (Ids{1, 2}));
}

}  // namespace
}  // namespace softhand::hand_joint_test
