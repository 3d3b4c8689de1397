// The hand loop and objects: slots, ownership, motion of the world, and what it refuses.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "support/count_allocations.hpp"
#include "unit/hand_loop_rig.hpp"

namespace softhand::hand_loop_objects_test {
namespace {

using testing::come_near_a_cube;
using testing::cube;
using testing::hand;
using testing::kSecond;
using testing::loop_options;
using testing::skeleton_at;
using testing::world_with;

TEST(HandLoop, MirrorsNearObjectsOwnsTouchedOnesAndReleasesThemLater) {
  const HandModel model = hand();
  HandLoop loop(model, loop_options(), {});
  loop.describe_object(cube(3));
  Nanoseconds now = kSecond;
  std::uint64_t sequence = 0;
  const auto step = [&](double wrist_y, const Vector3& object) -> const HandOutput& {
    now += 11'111'111;
    const Skeleton sample = skeleton_at(model, {Vector3(0, wrist_y, 0), Quaternion::Identity()}, now, ++sequence);
    const WorldObjects world = world_with(3, object, now);
    return loop.step(now, {&sample, nullptr, &world}, {});
  };
  const Vector3 below(-0.012, -0.018 - 0.02 - 0.001, -0.092);
  EXPECT_TRUE(step(0, Vector3(2, 0, 0)).coupling.twins.empty()) << "an object two metres away has no twin";
  const HandOutput& near = step(0, below);
  ASSERT_EQ(near.coupling.twins.size(), 1u);
  EXPECT_EQ(near.coupling.twins[0].owned, 0u);
  int steps_to_own = 0;
  while (step(-0.004, below).coupling.twins[0].owned == 0 && steps_to_own < 60) ++steps_to_own;
  EXPECT_LT(steps_to_own, 60) << "the hand must own an object that it presses";
  int owned_steps = 0;
  while (step(0.03, below).coupling.twins[0].owned == 1 && owned_steps < 90) ++owned_steps;
  EXPECT_GE(owned_steps, 8) << "the hand must own it for another tenth of a second";
  EXPECT_LT(owned_steps, 90);
}

// The hand makes ten steps per sample of the world. In this time the table under a held object moves by 4 mm.
TEST(HandLoop, PlanesOfAHeldObjectMoveBetweenSamplesOfTheWorld) {
  const HandModel model = hand();
  HandOptions options = loop_options();
  options.rate_hz = 500;
  HandLoop loop(model, options, {});
  loop.describe_object(cube(3));
  const Vector3 below(-0.012, -0.018 - 0.02 - 0.001, -0.092);
  constexpr double kRise = 0.2;  // m/s
  double height = 0, deepest = 0;
  bool owned = false;
  WorldObjects world;
  int rising = 0;
  for (int i = 0; i < 400 && rising < 50; ++i) {
    const Nanoseconds now = kSecond + i * 2'000'000;
    height = kRise * 0.002 * rising;
    Skeleton sample = skeleton_at(model, {Vector3(0, height - 0.004, 0), Quaternion::Identity()}, now,
                                  static_cast<std::uint64_t>(i) + 1);
    for (JointSample& joint : sample.joints) joint.linear_velocity = {0, rising > 0 ? kRise : 0, 0};
    const bool sampled = i % 10 == 0;
    if (sampled) {
      world = world_with(3, below + Vector3(0, height, 0), now);
      world.objects[0].gravity = {0, -9.81, 0};
      NeighbourPlane table;
      table.neighbour = 9;
      table.point = to_wire(Vector3(below + Vector3(0, height - 0.02, 0)));
      table.normal = {0, 1, 0};
      table.velocity = {0, owned ? kRise : 0, 0};
      world.objects[0].planes.push_back(table);
    }
    const HandOutput& output = loop.step(now, {&sample, nullptr, sampled ? &world : nullptr}, {});
    if (sampled && rising == 0 && output.coupling.twins.size() == 1 && output.coupling.twins[0].owned != 0)
      owned = true;
    if (owned && (rising > 0 || i % 10 == 9)) ++rising;
    if (rising > 1) deepest = std::max(deepest, below.y() + height - loop.simulation().slot_pose(0).position.y());
  }
  ASSERT_EQ(rising, 50) << "the hand never owned the object";
  EXPECT_LE(deepest, 1e-3);
}

// A hand and a block under its fingers reach a common velocity in half a second. The block is static, or it rests on a
// plane that moves with it. The world's samples are `age` old. If `age` is negative, they are newer than the step.
class MovingTogether {
 public:
  MovingTogether(const Vector3& velocity, double gap, double pressed, bool is_static, Nanoseconds age)
      : velocity_(velocity), gap_(gap), pressed_(pressed), age_(age), loop_(hand(), options(), {}) {
    ObjectDescription block = cube(3);
    block.is_static = is_static ? 1 : 0;
    loop_.describe_object(block);
  }
  void step(int i) {
    const Nanoseconds now = kSecond + i * 11'111'111;
    const auto [hand_way, hand_velocity] = motion(now);
    const auto [block_way, block_velocity] = motion(now - age_);
    const Pose wrist{hand_way - Vector3(0, pressed_, 0), Quaternion::Identity()};
    Skeleton sample = skeleton_at(model_, wrist, now, static_cast<std::uint64_t>(i) + 1);
    for (JointSample& joint : sample.joints) joint.linear_velocity = to_wire(hand_velocity);
    WorldObjects world = world_with(3, Vector3(-0.012, -0.018 - 0.02 - gap_, -0.092) + block_way, now - age_);
    ObjectState& block = world.objects[0];
    block.linear_velocity = to_wire(block_velocity);
    block.gravity = {0, -9.81, 0};
    NeighbourPlane table;
    table.neighbour = 9;
    table.point = to_wire(Vector3(to_vector(block.position) - Vector3(0, 0.02, 0)));
    table.normal = {0, 1, 0};
    table.velocity = block.linear_velocity;
    block.planes.push_back(table);
    loop_.step(now, {&sample, nullptr, &world}, {});
  }
  const HandSimulation& simulation() const { return loop_.simulation(); }

 private:
  // Displacement and velocity.
  std::pair<Vector3, Vector3> motion(Nanoseconds time) const {
    constexpr double kRise = 0.5;  // s
    const double t = std::max(0.0, static_cast<double>(time - kSecond) * 1e-9), rising = std::min(t, kRise);
    return {(rising * rising / (2 * kRise) + t - rising) * velocity_, rising / kRise * velocity_};
  }
  static HandOptions options() {
    HandOptions o = loop_options();
    o.static_objects = 1;
    o.simulation.solver.max_iterations = 60;
    return o;
  }
  Vector3 velocity_;
  double gap_, pressed_;
  Nanoseconds age_;
  const HandModel model_ = hand();
  HandLoop loop_;
};

constexpr std::array<Nanoseconds, 4> kAgesOfWorld{0, 4'000'000, 20'000'000, -2'000'000};

TEST(HandLoop, DistantBlockWithTheHandsVelocityDoesNotTouchTheHand) {
  for (const bool is_static : {false, true}) {
    for (const Nanoseconds age : kAgesOfWorld) {
      for (const Vector3& velocity : {Vector3(0, 5, 0), Vector3(0, -5, 0), Vector3(5, 0, 0)}) {
        MovingTogether pair(velocity, 0.010, 0, is_static, age);
        for (int i = 0; i < 90; ++i) {
          pair.step(i);
          ASSERT_EQ(pair.simulation().contact_count(), 0)
              << velocity.transpose() << (is_static ? ", static" : "") << ", age " << age << ", step " << i;
        }
      }
    }
  }
}

TEST(HandLoop, BlockThatMovesWithTheHandIsPressedLikeARestingOne) {
  for (const bool is_static : {false, true}) {
    const auto force = [is_static](const Vector3& velocity, Nanoseconds age) {
      MovingTogether pair(velocity, 0.001, 0.004, is_static, age);
      for (int i = 0; i < 135; ++i) pair.step(i);
      return pair.simulation().contact_wrench(is_static ? 1 : 0).force;
    };
    const Vector3 resting = force(Vector3::Zero(), 0);
    ASSERT_LT(resting.y(), -0.5);
    for (const Nanoseconds age : kAgesOfWorld) {
      for (const Vector3& velocity :
           {Vector3(0, 0.3, 0), Vector3(0, -0.3, 0), Vector3(0, 3, 0), Vector3(0, 0.3, 0.3)}) {
        // Only the normal force is compared. Friction depends on how hand and block reached this velocity.
        EXPECT_NEAR(force(velocity, age).y(), resting.y(), 0.01 * resting.norm())
            << velocity.transpose() << (is_static ? ", static" : ", free") << ", age " << age;
      }
    }
  }
}

// A step at 60 Hz moves the coin by 0.17 m or by 0.27 m. The shorter way is more than the distance within which an
// object is mirrored. The longer one is more than the jump that counts as a teleport.
TEST(HandLoop, TouchesObjectsOfAnySpeed) {
  const HandModel model = hand();
  HandOptions options = loop_options();
  options.rate_hz = 60;
  constexpr double kTimeStep = 1.0 / 60;
  for (int trial = 0; trial < 40; ++trial) {
    const double speed = trial < 20 ? 10 : 16;
    HandLoop loop(model, options, {});
    ObjectDescription coin = cube(3);
    coin.shape.size = {0.012, 0.00025, 0.012};
    loop.describe_object(coin);
    bool touched = false;
    for (int i = 0; i < 6; ++i) {
      const Nanoseconds now = kSecond + i * 16'666'667;
      const Skeleton sample = skeleton_at(model, {}, now, static_cast<std::uint64_t>(i) + 1);
      WorldObjects world = world_with(3, Vector3(-0.012, speed * kTimeStep * (i - 3 + trial % 20 / 20.0), -0.092), now);
      world.objects[0].linear_velocity = {0, speed, 0};
      loop.step(now, {&sample, nullptr, &world}, {});
      touched = touched || loop.simulation().touched(0);
    }
    EXPECT_TRUE(touched) << speed << " m/s, phase " << trial % 20;
  }
}

// The hand moves down at 0.5 m/s and hits a floating cube. Already in the step of the first touch the cube is a free
// body: the impulse of the contact is its momentum. The world learns of it.
TEST(HandLoop, AFirstTouchGivesAFreeObjectItsImpulse) {
  const HandModel model = hand();
  HandOptions options = loop_options();
  options.simulation.solver.max_iterations = 60;
  HandLoop loop(model, options, {});
  loop.describe_object(cube(3));
  Nanoseconds now = kSecond;
  const Vector3 below(-0.012, -0.018 - 0.02 - 0.022, -0.092);
  int i = 0;
  for (; i < 40 && !loop.simulation().touched(0); ++i) {
    now += 11'111'111;
    const double down = 0.5 / 90 * std::max(0, i - 12);  // not before the hand has settled
    const Skeleton sample =
        skeleton_at(model, {Vector3(0, -down, 0), Quaternion::Identity()}, now, static_cast<std::uint64_t>(i) + 1);
    const WorldObjects world = world_with(3, below, now);
    loop.step(now, {&sample, nullptr, &world}, {});
  }
  ASSERT_TRUE(loop.simulation().touched(0));
  const Wrench impulse = loop.simulation().contact_wrench(0);
  ASSERT_LT(impulse.force.y(), -0.1);
  const Twist velocity = loop.simulation().slot_velocity(0);
  EXPECT_NEAR((0.05 * velocity.linear - impulse.force / 90).norm(), 0, 0.02 * impulse.force.norm() / 90);
  const WorldObjects unmoved = world_with(3, below, now + 11'111'111);
  const HandOutput& output = loop.step(now + 11'111'111, {nullptr, nullptr, &unmoved}, {});
  ASSERT_EQ(output.coupling.twins.size(), 1u);
  EXPECT_EQ(output.coupling.twins[0].owned, 1u);
  EXPECT_LT(output.coupling.twins[0].linear_velocity[1], 0.5 * velocity.linear.y());
}

TEST(HandLoop, SlotsGoToTheNearestObjectsAndTouchedObjectsKeepTheirs) {
  const HandModel model = hand();
  HandLoop loop(model, loop_options(), {});  // one slot
  const Vector3 below(-0.012, -0.018 - 0.02 - 0.001, -0.092);
  constexpr std::uint32_t kFar = 3, kNear = 4;
  for (const std::uint32_t id : {kFar, kNear}) loop.describe_object(cube(id));
  Nanoseconds now = kSecond;
  std::uint64_t sequence = 0;
  const auto holder = [&](double wrist_y, double height_of_far, double height_of_near) {
    now += 11'111'111;
    const Skeleton sample = skeleton_at(model, {Vector3(0, wrist_y, 0), Quaternion::Identity()}, now, ++sequence);
    WorldObjects world = world_with(kFar, below + Vector3(0, height_of_far, 0), now);
    world.objects.push_back(world_with(kNear, below + Vector3(0, height_of_near, 0), now).objects[0]);
    const ObjectCoupling& coupling = loop.step(now, {&sample, nullptr, &world}, {}).coupling;
    return coupling.twins.size() == 1 ? coupling.twins[0].object : 0u;
  };
  EXPECT_EQ(holder(0, -0.02, -0.01), kNear) << "although the other was announced first";
  EXPECT_EQ(loop.counters().objects_without_slot, 1u);
  EXPECT_EQ(holder(0, -0.012, -0.014), kNear) << "an object that is equally near does not take the slot";
  EXPECT_EQ(holder(0, -0.01, -0.02), kFar);
  for (int i = 0; i < 30 && !loop.simulation().touched(0); ++i) holder(-0.004, 0, -0.02);
  ASSERT_TRUE(loop.simulation().touched(0));
  EXPECT_EQ(holder(-0.004, 0, 0.02), kFar) << "a nearer object does not take the slot of a touched one";
}

TEST(HandLoop, ManyObjectsOutOfReachGetNoSlotAndNoQuery) {
  const HandModel model = hand();
  HandLoop loop(model, loop_options(), {});
  const auto world = std::make_unique<WorldObjects>();
  world->stamp.sample_time = kSecond;
  for (std::uint32_t id = 1; id <= 100; ++id) {
    loop.describe_object(cube(id));
    world->objects.push_back(world_with(id, Vector3(1 + 0.1 * id, 0, 0), kSecond).objects[0]);
  }
  const Skeleton sample = skeleton_at(model, {}, kSecond, 1);
  const HandOutput& output = loop.step(kSecond, {&sample, nullptr, world.get()}, {});
  EXPECT_TRUE(output.coupling.twins.empty());
  EXPECT_EQ(loop.counters().objects_without_slot, 0u);
  EXPECT_EQ(loop.simulation().work().contact_queries, 0u);
}

TEST(HandLoop, RemovedObjectLeavesItsSlot) {
  HandLoop loop(hand(), loop_options(), {});
  const WorldObjects world = come_near_a_cube(loop);
  ObjectDescription gone = cube(3);
  gone.removed = 1;
  loop.describe_object(gone);
  EXPECT_TRUE(loop.step(kSecond + 11'000'000, {nullptr, nullptr, &world}, {}).coupling.twins.empty());
}

// As after the world was killed: what lies on a table must not fall before the first sample of the new process.
TEST(HandLoop, AStaticObjectStaysWhileTheWorldDescribesItAgain) {
  const HandModel model = hand();
  HandOptions options = loop_options();
  options.static_objects = 1;
  HandLoop loop(model, options, {});
  ObjectDescription block = cube(3);
  block.is_static = 1;
  loop.describe_object(block);
  const Vector3 below(-0.012, -0.018 - 0.02 - 0.001, -0.092);
  Nanoseconds now = kSecond;
  std::uint64_t sequence = 0;
  const auto contacts_after_step = [&](const WorldObjects* world) {
    now += 11'111'111;
    const Skeleton sample = skeleton_at(model, {Vector3(0, -0.004, 0), Quaternion::Identity()}, now, ++sequence);
    loop.step(now, {&sample, nullptr, world}, {});
    return loop.simulation().contact_count();
  };
  int contacts = 0;
  for (int i = 0; i < 20; ++i) {
    const WorldObjects world = world_with(3, below, now);
    contacts = contacts_after_step(&world);
  }
  ASSERT_GT(contacts, 0);
  block.stamp.sample_time = now + 1;
  loop.describe_object(block);
  EXPECT_EQ(contacts_after_step(nullptr), contacts);
  EXPECT_EQ(contacts_after_step(nullptr), contacts);
  // The new process has it at another place. There it does not sweep the hand away.
  const WorldObjects moved = world_with(3, below + Vector3(0, 0, 1), now);
  EXPECT_EQ(contacts_after_step(&moved), 0);
  const WorldObjects back = world_with(3, below, now);
  block.stamp.sample_time = now;
  loop.describe_object(block);
  EXPECT_EQ(contacts_after_step(&back), contacts) << "the new place counts";
  block.friction *= 0.5;
  loop.describe_object(block);
  EXPECT_EQ(contacts_after_step(nullptr), 0) << "it is another object";
}

// The world is another process, so its descriptions may hold any values.
TEST(HandLoop, RefusesUnusableDescriptions) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  HandLoop loop(hand(), loop_options(), {});
  const auto refused = [&loop](const char* field, auto&& corrupt) {
    ObjectDescription description = cube(3);
    corrupt(description);
    try {
      loop.describe_object(description);
      ADD_FAILURE() << field;
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find(field), std::string::npos) << error.what();
    }
  };
  for (const std::uint32_t id : {0u, kFirstSoftObject}) refused("id", [=](ObjectDescription& d) { d.object = id; });
  for (const double friction : {kNan, -0.1, 1e300})
    refused("friction", [=](ObjectDescription& d) { d.friction = friction; });
  for (const double mass : {kNan, 0.0, -1.0, 1e300}) refused("mass", [=](ObjectDescription& d) { d.mass = mass; });
  for (const double inertia : {kNan, 0.0, -1.0, 1e300})
    refused("inertia", [=](ObjectDescription& d) { d.inertia[1] = inertia; });
  ObjectDescription fixed = cube(3);
  fixed.is_static = 1;
  fixed.mass = 0;
  fixed.inertia = {};
  EXPECT_NO_THROW(loop.describe_object(fixed));
}

TEST(HandLoop, KeepsAHeldObjectWhoseNewDescriptionIsRefused) {
  const HandModel model = hand();
  HandLoop loop(model, loop_options(), {});
  loop.describe_object(cube(3));
  Nanoseconds now = kSecond;
  std::uint64_t sequence = 0;
  const auto step = [&](double wrist_y) {
    now += 11'111'111;
    const Skeleton sample = skeleton_at(model, {Vector3(0, wrist_y, 0), Quaternion::Identity()}, now, ++sequence);
    const WorldObjects world = world_with(3, Vector3(-0.012, -0.039, -0.092), now);
    const HandOutput& output = loop.step(now, {&sample, nullptr, &world}, {});
    return !output.coupling.twins.empty() && output.coupling.twins[0].owned != 0;
  };
  step(0);
  int steps = 0;
  while (!step(-0.004) && steps < 60) ++steps;
  ASSERT_LT(steps, 60);
  ObjectDescription bad = cube(3);
  bad.friction = -1;
  EXPECT_THROW(loop.describe_object(bad), std::invalid_argument);
  const Skeleton same = skeleton_at(model, {Vector3(0, -0.004, 0), Quaternion::Identity()}, now, ++sequence);
  const HandOutput& output = loop.step(now, {&same}, {});
  ASSERT_EQ(output.coupling.twins.size(), 1u);
  EXPECT_EQ(output.coupling.twins[0].owned, 1u);
}

TEST(HandLoop, RefusesInvalidObjectStatesAndContinues) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const HandModel model = hand();
  NeighbourPlane plane;
  plane.normal = {0, 1, 0};
  const std::vector<std::function<void(ObjectState&)>> corruptions{
      [](ObjectState& s) { s.gravity[1] = kNan; }, [](ObjectState& s) { s.angular_velocity[0] = 1e200; },
      [](ObjectState& s) { s.position[0] = 1e200; },
      [=](ObjectState& s) { s.planes.push_back(plane), s.planes[0].normal = {}; },
      [=](ObjectState& s) { s.planes.push_back(plane), s.planes[0].friction = kNan; }};
  for (const auto& corrupt : corruptions) {
    HandLoop loop(model, loop_options(), {});
    loop.describe_object(cube(3));
    Nanoseconds now = kSecond;
    std::uint64_t sequence = 0;
    const auto step = [&](double wrist_y, bool corrupted) -> const HandOutput& {
      now += 11'111'111;
      const Skeleton sample = skeleton_at(model, {Vector3(0, wrist_y, 0), Quaternion::Identity()}, now, ++sequence);
      WorldObjects world = world_with(3, Vector3(-0.012, -0.039, -0.092), now);
      if (corrupted) corrupt(world.objects[0]);
      return loop.step(now, {&sample, nullptr, &world}, {});
    };
    step(0, false);
    for (int i = 0; i < 60; ++i) step(-0.004, true);
    EXPECT_EQ(loop.counters().refused_nonfinite, 60u);
    EXPECT_EQ(loop.counters().failed_steps, 0u);
    for (int i = 0; i < 120; ++i) step(0.1, false);
    EXPECT_NEAR(loop.simulation().joint_pose(Joint::wrist).position.y(), 0.1, 5e-3);
    EXPECT_EQ(loop.counters().failed_steps, 0u);
  }
}

TEST(HandLoop, ObjectThatTheWorldNoLongerListsIsGone) {
  HandLoop loop(hand(), loop_options(), {});
  WorldObjects world = come_near_a_cube(loop);
  const WorldObjects other = world_with(4, Vector3(1, 0, 0), kSecond + 11'000'000);
  EXPECT_TRUE(loop.step(kSecond + 11'000'000, {nullptr, nullptr, &other}, {}).coupling.twins.empty());
  world.stamp.sample_time = kSecond + 22'000'000;
  EXPECT_EQ(loop.step(kSecond + 22'000'000, {nullptr, nullptr, &world}, {}).coupling.twins.size(), 1u);
}

// A hull of 256 vertices takes about 30 ms to load, which is three periods.
TEST(HandLoop, DoesNotLoadAKnownShapeAgain) {
#ifndef SOFTHAND_COUNT_MALLOC
  GTEST_SKIP() << "the sanitizer brings its own malloc";
#endif
  HandLoop loop(hand(), loop_options(), {});
  ObjectDescription hull = cube(3);
  hull.shape.kind = static_cast<std::uint32_t>(ShapeKind::convex_hull);
  for (int i = 0; i < 8; ++i)
    hull.shape.vertices.push_back({i & 1 ? 0.02 : -0.02, i & 2 ? 0.02 : -0.02, i & 4 ? 0.02 : -0.02});
  loop.describe_object(hull);
  hull.mass = 0.1;
  allocations = 0;
  counting = true;
  loop.describe_object(hull);
  counting = false;
  EXPECT_EQ(std::exchange(allocations, 0), 0);
  hull.shape.vertices[0][0] = -0.03;
  counting = true;
  loop.describe_object(hull);
  counting = false;
  EXPECT_GT(std::exchange(allocations, 0), 0);
}

// Whole steps, from all inputs to all outputs. An object comes near, is touched, held and released. The budget is in
// fast steps; 0 is unlimited.
class HandLoopAllocations : public ::testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Budget, HandLoopAllocations, ::testing::Values(0.0, 0.5));
TEST_P(HandLoopAllocations, AStepAllocatesNothing) {
#ifndef SOFTHAND_COUNT_MALLOC
  GTEST_SKIP() << "the sanitizer brings its own malloc";
#endif
  const HandModel model = hand();
  HandOptions options = loop_options();
  options.simulation.solver.work_budget = GetParam();
  HandLoop loop(model, options, {});
  loop.describe_object(cube(3));
  Nanoseconds now = kSecond;
  std::uint64_t sequence = 0;
  const Vector3 below(-0.012, -0.018 - 0.02 - 0.001, -0.092);
  const auto samples = std::make_unique<std::pair<Skeleton, WorldObjects>>();
  bool touched = false;
  int contact_solves = 0;
  counting = true;
  ::operator delete(::operator new(64));
  counting = false;
  ASSERT_EQ(std::exchange(allocations, 0), 1) << "the counter does not count";
  for (int i = 0; i < 120; ++i) {
    now += 11'111'111;
    samples->first =
        skeleton_at(model, {Vector3(0, i < 60 ? -0.004 : 0.03, 0), Quaternion::Identity()}, now, ++sequence);
    samples->second = world_with(3, i < 5 ? Vector3(2, 0, 0) : below, now);
    counting = true;
    const HandOutput& output = loop.step(now, {&samples->first, nullptr, &samples->second}, {true, true, true});
    counting = false;
    touched = touched || output.contacts.contacts.size() > 0;
    contact_solves += output.report.contact_solves;
  }
  EXPECT_TRUE(touched);
  EXPECT_EQ(contact_solves > 0, GetParam() > 0) << "only truncated steps solve contact alone";
  EXPECT_EQ(std::exchange(allocations, 0), 0);
}

// The right hand of these tests presses on a cube. The left hand is only its messages.
struct WithAnotherHand {
  WithAnotherHand() : loop(model, options(), {0, 1}) {
    loop.describe_object(cube(3));
    other.hand = {0, 0};
    ObjectTwin twin;
    twin.object = 3;
    twin.position = to_wire(below);
    other.twins.push_back(twin);
    ContactPatch patch;
    patch.object = 3;
    patch.point = to_wire(Vector3(below - Vector3(0, 0.02, 0)));
    patch.normal = {0, 1, 0};
    patch.force = {0, 0.3, 0};
    patch.stiffness = 500;
    patch.radius = 0.004;
    patch.friction = 0.8;
    other.patches.push_back(patch);
  }
  static HandOptions options() {
    HandOptions o = loop_options();
    o.simulation.other_hands = true;
    return o;
  }
  const HandOutput& step() {
    const Nanoseconds now = kSecond + i * 11'111'111;
    const Skeleton sample =
        skeleton_at(model, {Vector3(0, -0.004, 0), Quaternion::Identity()}, now, static_cast<std::uint64_t>(i++));
    WorldObjects world = world_with(3, below, now);
    world.objects[0].owned = owner ? 1 : 0;
    world.objects[0].owner_side = owner.value_or(0);
    other.stamp.sample_time = now - 11'111'111;
    return loop.step(now, {&sample, nullptr, &world, {&other, 1}}, {});
  }
  bool owns() { return step().coupling.twins[0].owned != 0; }
  void own() {
    owner.reset();
    for (int n = 0; n < 60 && !owns(); ++n) continue;
    ASSERT_TRUE(owns());
  }
  HandModel model = hand();
  HandLoop loop;
  Vector3 below{-0.012, -0.039, -0.092};
  ObjectCoupling other;
  std::optional<std::uint32_t> owner;  // side of the hand that owns the cube for the world
  int i = 1;
};

TEST(HandLoop, ContactsOfAnotherHandActOnAnOwnedObject) {
  WithAnotherHand hands;
  hands.own();
  hands.owner = 1;
  const ObjectTwin twin = hands.step().coupling.twins[0];
  EXPECT_EQ(twin.owned, 1u);
  EXPECT_GT(twin.coupling_force[1], 0.05) << "N, from the other hand";
  EXPECT_GT(hands.loop.simulation().work().patches_used, 0u);
}

TEST(HandLoop, OneHandTellsTheOtherItsContacts) {
  WithAnotherHand hands;
  hands.own();
  const HandOutput& output = hands.step();
  ASSERT_GT(output.coupling.patches.size(), 0u);
  Vector3 force = Vector3::Zero();
  for (const ContactPatch& patch : output.coupling.patches) {
    EXPECT_EQ(patch.object, 3u);
    EXPECT_GT(patch.stiffness, 0);
    force += to_vector(patch.force);
  }
  EXPECT_LT((force - to_vector(output.coupling.twins[0].contact_force)).norm(), 0.05 * force.norm());
  hands.other.twins.clear();
  EXPECT_EQ(hands.step().coupling.patches.size(), 0u) << "no other hand has the object";
}

TEST(HandLoop, GivesAnObjectUpOnlyWhenTheNextOwnerClaimsIt) {
  WithAnotherHand hands;
  hands.own();
  hands.owner = 0;
  for (int n = 0; n < 5; ++n) EXPECT_TRUE(hands.owns());
  hands.other.twins[0].owned = 1;
  EXPECT_FALSE(hands.owns());
  EXPECT_GT(hands.loop.simulation().contact_count(), 0) << "a guest goes on touching it";
  hands.owner = 1;
  hands.other.twins[0].owned = 0;
  EXPECT_TRUE(hands.owns());
}

TEST(HandLoop, GuestFollowsTheTwinOfTheOwner) {
  WithAnotherHand hands;
  hands.own();
  hands.owner = 0;
  hands.other.twins[0].owned = 1;
  hands.other.twins[0].position[0] += 0.001;
  const ObjectTwin twin = hands.step().coupling.twins[0];
  EXPECT_NEAR(twin.position[0], hands.below.x() + 0.001, 2e-4);
}

TEST(HandLoop, RefusesAbsurdContactsOfAnotherHand) {
  WithAnotherHand hands;
  hands.own();
  hands.owner = 1;
  const ContactPatch good = hands.other.patches[0];
  for (const auto& spoil : std::vector<std::function<void(ContactPatch&)>>{
           [](ContactPatch& p) { p.force[1] = std::nan(""); }, [](ContactPatch& p) { p.stiffness = 1e300; },
           [](ContactPatch& p) {
             p.normal = {0, 0, 0};
           },
           [](ContactPatch& p) { p.friction = -1; }, [](ContactPatch& p) { p.linear_velocity[2] = 1e9; },
           [](ContactPatch& p) { p.radius = std::nan(""); }}) {
    hands.other.patches.items[0] = good;
    spoil(hands.other.patches.items[0]);
    const std::uint64_t before = hands.loop.counters().refused_nonfinite;
    const ObjectTwin twin = hands.step().coupling.twins[0];
    EXPECT_EQ(hands.loop.counters().refused_nonfinite, before + 1);
    EXPECT_EQ(twin.coupling_force, (Vec3{0, 0, 0}));
  }
}

}  // namespace
}  // namespace softhand::hand_loop_objects_test
