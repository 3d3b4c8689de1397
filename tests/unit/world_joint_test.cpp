// Joints between objects in the physics world alone: known answers in Bullet, descriptions, messages, refusals.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "support/counters.hpp"
#include "unit/world_objects.hpp"
#include "world/world_loop.hpp"

namespace softhand::world_joint_test {
namespace {

using test::cube;
using test::object;
using test::position;

constexpr double kPi = std::numbers::pi;
constexpr double kStep = 1.0 / 250;

ObjectOptions base() {
  ObjectOptions o;
  o.name = "base";
  o.half_extents = {0.02, 0.02, 0.02};
  return o;
}

JointOptions joint(const char* kind, std::array<double, 3> axis = {0, 1, 0}) {
  JointOptions j;
  j.name = "joint";
  j.kind = kind;
  j.parent = "base";
  j.child = "cube";
  j.axis = axis;
  return j;
}

WorldOptions weightless() {
  WorldOptions options;
  options.gravity = {0, 0, 0};
  return options;
}

struct JointedWorld {
  JointedWorld(const std::vector<ObjectOptions>& objects, const std::vector<JointOptions>& joints,
               const WorldOptions& options = {})
      : world(options, objects, 1.0 / 90, joints) {
    test::accept_claims(world);
    steps = 1;
  }
  void run(
      double seconds, const std::function<void()>& after = [] {}) {
    for (int i = 0; i < std::lround(seconds / kStep); ++i) {
      world.step(++steps * 4000000LL, {});
      after();
    }
  }
  /// The cube.
  const ObjectState& child() const {
    for (const ObjectState& state : world.objects().objects)
      if (state.object == 2) return state;
    throw std::runtime_error("no child");
  }
  /// Pulls the cube by a hand's twin in mode owner for one step would hide the joint. So a push is a released twin.
  void throw_child(const Vector3& linear, const Vector3& angular) {
    ObjectCoupling coupling;
    coupling.stamp.sample_time = (steps + 1) * 4000000LL;
    coupling.step_period = 1.0 / 90;
    ObjectTwin twin;
    twin.object = 2;
    twin.owned = 1;
    twin.position = child().position;
    twin.orientation = child().orientation;
    for (int i = 0; i < 60; ++i) {
      coupling.stamp.sample_time = (steps + 1) * 4000000LL;
      Pose pose = to_pose(twin.position, twin.orientation);
      pose = increment(pose, kStep * linear, kStep * angular);
      twin.position = to_wire(pose.position);
      twin.orientation = to_wire(pose.orientation);
      twin.linear_velocity = to_wire(linear);
      twin.angular_velocity = to_wire(angular);
      coupling.twins.clear();
      coupling.twins.push_back(twin);
      world.step(++steps * 4000000LL, {{&coupling, 1}});
    }
    // From now on nobody owns it.
  }

  WorldLoop world;
  Nanoseconds steps = 0;
};

TEST(WorldJoint, PendulumHasThePeriodOfThePhysicalPendulum) {
  // The scene places the cube beside the hinge and gravity pulls it down: it swings by 90 degrees to either side of
  // -90 degrees. T = 4 sqrt((I + m l^2)/(m g l)) K(sin 45 deg) with K = 1.8541.
  ObjectOptions child = cube(0.05, 0);
  child.position = {0.1, 0, 0};
  JointOptions hinge = joint("hinge", {0, 0, 1});
  hinge.limits = {-4.5, 1.4};  // the coordinate may pass -180 degrees
  JointedWorld run({base(), child}, {hinge});
  const double inertia = 0.05 / 3 * 2 * 0.0004, arm = 0.1;
  const double period = 4 * std::sqrt((inertia + 0.05 * arm * arm) / (0.05 * 9.81 * arm)) * 1.854075;
  std::vector<double> crossings;
  double before = 0, gap = 0, lowest = 0;
  run.run(2.5 * period, [&] {
    const double q = run.world.joint_coordinate("joint");
    if (before > -kPi / 2 && q <= -kPi / 2)
      crossings.push_back(kStep * (static_cast<double>(run.steps) - (-kPi / 2 - q) / (before - q)));
    before = q;
    lowest = std::min(lowest, q);
    gap = std::max(gap, run.world.joint_gap("joint"));
  });
  ASSERT_GE(crossings.size(), 2u);
  std::printf("  period %.4f s, exact %.4f s; joint opens by %.3f mm\n", crossings[1] - crossings[0], period,
              1e3 * gap);
  EXPECT_NEAR(crossings[1] - crossings[0], period, 0.02 * period);
  EXPECT_NEAR(lowest, -kPi, 0.05) << "loses or gains energy";
  // A step of T turns the arm l by w T: the joint opens by l (w T)^2/2, and half of it is left after a step.
  EXPECT_LE(gap, 4e-4);
}

TEST(WorldJoint, SliderWithFrictionStopsWhereCoulombPredictsAndHolds) {
  JointOptions slide = joint("slider", {1, 0, 0});
  slide.friction = 0.1;
  ObjectOptions child = cube(0.05, 0);
  child.position = {0.1, 0, 0};
  JointedWorld run({base(), child}, {slide}, weightless());
  run.throw_child({0.4, 0, 0}, Vector3::Zero());
  run.run(kStep);
  const double speed = run.child().linear_velocity[0], start = run.world.joint_coordinate("joint");
  EXPECT_NEAR(speed, 0.4, 0.05);
  run.run(1);
  const double rest = run.world.joint_coordinate("joint");
  const double predicted = speed * speed * 0.05 / (2 * 0.1);
  std::printf("  slid %.3f mm, Coulomb %.3f mm\n", 1e3 * (rest - start), 1e3 * predicted);
  EXPECT_NEAR(rest - start, predicted, 0.03 * predicted);
  run.run(2);
  EXPECT_NEAR(run.world.joint_coordinate("joint"), rest, 1e-6);
  EXPECT_LE(run.world.joint_gap("joint"), 1e-5);
}

TEST(WorldJoint, FrictionHoldsALoadBelowItsBoundWithoutCreep) {
  JointOptions slide = joint("slider");
  slide.friction = 1.02 * 0.05 * 9.81;
  ObjectOptions child = cube(0.05, 0.1);
  JointedWorld run({base(), child}, {slide});
  run.run(10);
  EXPECT_NEAR(run.world.joint_coordinate("joint"), 0, 2e-6);
  slide.friction = 0.9 * 0.05 * 9.81;
  JointedWorld falling({base(), child}, {slide});
  falling.run(0.5);
  EXPECT_NEAR(falling.world.joint_coordinate("joint"), -0.5 * 0.1 * 9.81 * 0.25, 0.005);
}

TEST(WorldJoint, FrictionOfALoadedHingeIsCoefficientTimesRadiusTimesReaction) {
  // The load m g lies off the axis by an arm: its torque is m g arm, and friction holds up to mu r m g. So the mass
  // does not matter.
  constexpr double kLever = 0.3 * 0.02;  // mu r, m
  JointOptions hinge = joint("hinge", {0, 0, 1});
  hinge.load_friction = kLever;
  for (const double mass : {0.05, 5.0}) {
    for (const double share : {0.8, 1.2}) {
      ObjectOptions child = cube(mass, 0);
      child.position = {share * kLever, 0, 0};
      JointedWorld run({base(), child}, {hinge});
      run.run(1);
      const double early = run.world.joint_coordinate("joint");
      run.run(1);
      // The first step has no reaction of a step before. Above mu r the cube falls until the torque m g arm cos q is
      // that of the friction, and on with its speed.
      const double turned = -run.world.joint_coordinate("joint");
      std::printf("  %g kg at %g of the lever: turns by %.3g rad\n", mass, share, turned);
      EXPECT_EQ(turned > std::acos(1 / 1.2), share > 1);
      EXPECT_EQ(turned < 0.01, share < 1);
      EXPECT_NEAR(turned, -early, 1e-6) << "creep";
    }
  }
  // A wheel on its axis slows down by mu r m g/I.
  for (const double gravity : {5.0, 20.0}) {
    WorldOptions options;
    options.gravity = {0, -gravity, 0};
    JointedWorld run({base(), cube(0.05, 0)}, {hinge}, options);
    run.throw_child(Vector3::Zero(), {0, 0, 60});
    run.run(2 * kStep);
    const double before = run.child().angular_velocity[2];
    constexpr double kTime = 0.04;
    run.run(kTime);
    const double inertia = 0.05 * 0.04 * 0.04 / 6;
    const double torque = (before - run.child().angular_velocity[2]) / kTime * inertia;
    std::printf("  torque %.5g N m, mu r m g %.5g N m\n", torque, kLever * 0.05 * gravity);
    EXPECT_NEAR(torque, kLever * 0.05 * gravity, 0.01 * torque);
  }
}

TEST(WorldJoint, FrictionOfALoadedSliderIsCoefficientTimesReaction) {
  // A rail that leans by the angle a: the cube slides if tan a > mu.
  for (const double share : {0.95, 1.05}) {
    const double angle = std::atan(share * 0.4);
    JointOptions rail = joint("slider", {std::cos(angle), std::sin(angle), 0});
    rail.load_friction = 0.4;
    JointedWorld run({base(), cube(0.05, 0.1)}, {rail});
    run.run(1);
    const double early = to_vector(run.child().linear_velocity).norm();
    run.run(1);
    const double gained = to_vector(run.child().linear_velocity).norm() - early;
    const double expected = share < 1 ? 0 : 9.81 * (std::sin(angle) - 0.4 * std::cos(angle));
    std::printf("  %g of mu: faster by %.5g m/s in a second, Coulomb %.5g m/s\n", share, gained, expected);
    EXPECT_NEAR(gained, expected, 0.01 * expected + 1e-5);
  }
}

TEST(WorldJoint, SpringsOfAnyStiffnessHangAtTheirAnalyticPlace) {
  for (const double stiffness : {5.0, 300.0, 2e4, 1e6}) {
    JointOptions slide = joint("slider");
    slide.stiffness = stiffness;
    slide.damping = 2 * std::sqrt(stiffness * 0.05);
    JointedWorld run({base(), cube(0.05, 0.1)}, {slide});
    run.run(4);
    const double expected = -0.05 * 9.81 / stiffness;
    std::printf("  %g N/m hangs at %.6g mm, exact %.6g mm\n", stiffness, 1e3 * run.world.joint_coordinate("joint"),
                1e3 * expected);
    EXPECT_NEAR(run.world.joint_coordinate("joint"), expected, 1e-3 * std::abs(expected) + 2e-6) << stiffness;
  }
}

TEST(WorldJoint, SpringOscillatesWithItsFrequency) {
  JointOptions slide = joint("slider");
  slide.stiffness = 5;
  slide.rest = -0.02;
  JointedWorld run({base(), cube(0.05, 0.1)}, {slide}, weightless());
  double before = 0;
  std::vector<double> crossings;
  run.run(4, [&] {
    const double q = run.world.joint_coordinate("joint");
    if (before > -0.02 && q <= -0.02) crossings.push_back(static_cast<double>(run.steps) * kStep);
    before = q;
  });
  ASSERT_GE(crossings.size(), 3u);
  const double period = 2 * kPi * std::sqrt(0.05 / 5);
  EXPECT_NEAR((crossings.back() - crossings.front()) / static_cast<double>(crossings.size() - 1), period,
              0.02 * period);
}

TEST(WorldJoint, LimitsStopEveryKind) {
  ObjectOptions child = cube(0.05, 0);
  child.position = {0.1, 0, 0};
  const auto bounded = [](const char* kind, double low, double high) {
    JointOptions j = joint(kind, {0, 0, 1});
    j.limits = {low, high};
    return j;
  };
  JointedWorld hinge({base(), child}, {bounded("hinge", -0.5, 0.3)});
  double lowest = 0;
  hinge.run(3, [&] { lowest = std::min(lowest, hinge.world.joint_coordinate("joint")); });
  EXPECT_NEAR(hinge.world.joint_coordinate("joint"), -0.5, 1e-3);
  EXPECT_GE(lowest, -0.505);
  JointOptions slide = bounded("slider", -0.03, 0.01);
  slide.axis = {0, 1, 0};
  JointedWorld slider({base(), child}, {slide});
  slider.run(3);
  EXPECT_NEAR(slider.world.joint_coordinate("joint"), -0.03, 1e-4);
  JointOptions cone = bounded("ball", 0, 0.6);
  cone.axis = {1, 0, 0};  // towards the child
  JointedWorld ball({base(), child}, {cone});
  ball.run(3);
  const Vector3 down = position(ball.child());
  EXPECT_NEAR(std::atan2(-down.y(), std::hypot(down.x(), down.z())), 0.6, 2e-3);
  EXPECT_LE(ball.world.joint_gap("joint"), 2e-5);
  JointedWorld fixed({base(), child}, {joint("fixed")});
  fixed.run(3);
  EXPECT_LE((position(fixed.child()) - Vector3(0.1, 0, 0)).norm(), 2e-5);
}

TEST(WorldJoint, AFastCubeOnAnArmStopsAtItsLimit) {
  // The rail is 0.1 m beside the cube, so the limit's force also turns the cube. It arrives with 4 m/s.
  ObjectOptions child = cube(0.05, 0);
  child.position = {0.1, 0, 0};
  JointOptions rail = joint("slider");
  rail.limits = {-0.08, 0};
  WorldOptions options;
  options.gravity = {0, -98.1, 0};
  JointedWorld run({base(), child}, {rail}, options);
  double lowest = 0, gap = 0;
  run.run(1, [&] {
    lowest = std::min(lowest, run.world.joint_coordinate("joint"));
    gap = std::max(gap, run.world.joint_gap("joint"));
  });
  std::printf("  beyond the limit by %.4f mm, joint opens by %.4f mm\n", -1e3 * (lowest + 0.08), 1e3 * gap);
  EXPECT_GE(lowest, -0.0801);
  EXPECT_LE(gap, 1e-4);
}

TEST(WorldJoint, AHeavyLoadBehindLightLinksStaysOnItsJoints) {
  // Row by row Bullet needs thousands of visits: the joints open by decimetres, and the load flies away.
  const auto largest_gap = [](int links, double link, double load) {
    constexpr double kPitch = 0.03;
    std::vector<ObjectOptions> objects{base()};
    std::vector<JointOptions> joints;
    for (int i = 1; i <= links; ++i) {
      ObjectOptions each = cube(i < links ? link : load, 0);
      each.name = "link" + std::to_string(i);
      each.half_extents = {0.01, 0.01, 0.01};
      each.position = {kPitch * i, 0, 0};
      JointOptions hinge = joint("hinge", {0, 0, 1});
      hinge.name = hinge.child = each.name;
      hinge.parent = objects.back().name;
      hinge.position = {0.5 * kPitch, 0, 0};
      objects.push_back(each);
      joints.push_back(hinge);
    }
    JointedWorld run(objects, joints);
    double gap = 0;
    run.run(3, [&] {
      for (const JointOptions& each : joints) gap = std::max(gap, run.world.joint_gap(each.name));
    });
    std::printf("  %d links of %g kg with %g kg at the end open by %.2f mm\n", links, link, load, 1e3 * gap);
    return gap;
  };
  EXPECT_LE(largest_gap(2, 1e-3, 1), 0.005);
  EXPECT_LE(largest_gap(2, 1e-3, 100), 0.005);
  EXPECT_LE(largest_gap(8, 0.01, 0.01), 0.005);
}

TEST(WorldJoint, AScrewTurnsManyTimesAndAdvancesByItsPitch) {
  JointOptions thread = joint("screw");
  thread.pitch = 0.003;
  thread.limits = {0, 4 * 2 * kPi};
  JointedWorld run({base(), cube(0.05, 0.05)}, {thread}, weightless());
  run.throw_child({0, 0.003, 0}, {0, 2 * kPi, 0});
  run.run(2);
  const double q = run.world.joint_coordinate("joint");
  EXPECT_GT(q, 2 * 2 * kPi);
  EXPECT_NEAR(position(run.child()).y() - 0.05, 0.003 * q / (2 * kPi), 2e-5);
  run.run(10);
  EXPECT_LE(run.world.joint_coordinate("joint"), 4 * 2 * kPi + 1e-3);
}

TEST(WorldJoint, AScrewThatOpensByMoreThanHalfItsPitchKeepsItsTurn) {
  // Two free bodies tumble about an axis across the thread. Each step opens the joint by l (w T)^2/2.
  ObjectOptions parent = base(), child = cube(0.05, 0.1);
  parent.mass = 0.1;
  JointOptions thread = joint("screw");
  thread.pitch = 2e-5;
  thread.friction = 10;
  JointedWorld run({parent, child}, {thread}, weightless());
  run.throw_child({3, 0, 0}, {0, 0, -10});
  double gap = 0, turned = 0, before = run.world.joint_coordinate("joint");
  run.run(0.5, [&] {
    const double now = run.world.joint_coordinate("joint");
    turned = std::max(turned, std::abs(now - std::exchange(before, now)));
    gap = std::max(gap, run.world.joint_gap("joint"));
  });
  std::printf("  opens by %.4f mm, turns by up to %.4f rad in a step\n", 1e3 * gap, turned);
  EXPECT_GT(gap, 0.5 * thread.pitch) << "this test shows nothing";
  EXPECT_LT(turned, 0.5);

  run.world.forget();
  std::vector<std::byte> memory(1 << 20);
  ByteWriter saved(memory);
  run.world.save(saved);
  WorldLoop next(weightless(), {parent, child}, 1.0 / 90, {thread});
  ByteReader bytes(saved.written());
  next.load(bytes);
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(next.joint_coordinate("joint"), run.world.joint_coordinate("joint"));
    run.run(kStep);
    next.step(run.steps * 4000000LL, {});
  }
}

TEST(WorldJoint, DetentsHoldBelowTheirForceAndSnapAbove) {
  // A hinge with wells every 30 degrees. The torque is gravity on an arm.
  for (const double share : {0.4, 1.1}) {
    const double arm = 0.1, torque = 0.05 * 9.81 * arm, width = 0.2;
    JointOptions hinge = joint("hinge", {0, 0, 1});
    hinge.damping = 2e-3;
    hinge.detents = {{0, torque / share * width / 1.7173, width, kPi / 6}};
    ObjectOptions child = cube(0.05, 0);
    child.position = {arm, 0, 0};
    JointedWorld run({base(), child}, {hinge});
    run.run(2);
    const double q = run.world.joint_coordinate("joint");
    if (share < 1) {
      EXPECT_GT(q, -width / std::sqrt(5.0));
      EXPECT_NEAR(joint_law(hinge).potential(q).slope, -torque * std::cos(q), 0.01 * torque);
    } else {
      EXPECT_LT(q, -kPi / 12);
    }
  }
}

TEST(WorldJoint, JointedObjectsDoNotCollideAndSleepTogether) {
  // The cube overlaps its base.
  ObjectOptions child = cube(0.05, 0.01);
  JointedWorld run({base(), child}, {joint("hinge")});
  run.run(6);
  EXPECT_LE((position(run.child()) - Vector3(0, 0.01, 0)).norm(), 2e-5);
  LoopStatus status;
  run.world.fill_status(status, run.steps * 4000000LL);
  EXPECT_EQ(testing::counter_of(status, "asleep"), 1);
}

TEST(WorldJoint, TwoFreeLinksKeepTheirMomentum) {
  ObjectOptions parent = base(), child = cube(0.05, 0.05);
  parent.mass = 0.1;
  JointedWorld run({parent, child}, {joint("hinge", {1, 0, 0})}, weightless());
  run.throw_child({0, 0, 0.3}, {2, 0, 0});
  run.run(kStep);
  const auto momentum = [&run] {
    Vector3 sum = Vector3::Zero();
    for (const ObjectState& state : run.world.objects().objects)
      sum += (state.object == 1 ? 0.1 : 0.05) * to_vector(state.linear_velocity);
    return sum;
  };
  const Vector3 before = momentum();
  const double energy = run.world.energy();
  run.run(2);
  std::printf("  momentum changes by %.2g, energy by %.2g\n", (momentum() - before).norm() / before.norm(),
              run.world.energy() / energy - 1);
  EXPECT_LE((momentum() - before).norm(), 1e-4 * before.norm());
  EXPECT_NEAR(run.world.energy(), energy, 0.02 * energy);
  EXPECT_LE(run.world.joint_gap("joint"), 1e-4);
}

TEST(WorldJoint, EqualRunsGiveEqualBits) {
  const auto run_once = [] {
    JointOptions hinge = joint("hinge", {0, 0, 1});
    hinge.friction = 1e-3;
    hinge.stiffness = 0.1;
    ObjectOptions child = cube(0.05, 0);
    child.position = {0.1, 0, 0};
    JointedWorld run({base(), child}, {hinge});
    run.run(2);
    return run.child();
  };
  const ObjectState one = run_once(), two = run_once();
  EXPECT_EQ(one.position, two.position);
  EXPECT_EQ(one.orientation, two.orientation);
}

TEST(WorldJoint, DescriptionsCarryFramesAndLaw) {
  JointOptions slide = joint("slider", {1, 0, 0});
  slide.position = {0, 0.01, 0};
  slide.limits = {-0.01, 0.1};
  slide.friction = 0.3;
  slide.load_friction = 0.2;
  slide.detents = {{0, 0.001, 0.002, 0}};
  ObjectOptions child = cube(0.05, 0);
  child.position = {0.1, 0.02, 0};
  WorldLoop world({}, {base(), child}, 1.0 / 90, {slide});
  ASSERT_EQ(world.joint_descriptions().size(), 1u);
  const ObjectJointDescription& d = world.joint_descriptions()[0];
  EXPECT_EQ(d.joint, 1u);
  EXPECT_EQ(d.parent, 1u);
  EXPECT_EQ(d.child, 2u);
  EXPECT_EQ(d.limited, 1u);
  EXPECT_EQ(d.upper_limit, 0.1);
  ASSERT_EQ(d.detents.size(), 1u);
  EXPECT_LE((to_vector(d.parent_position) - Vector3(0, 0.01, 0)).norm(), 1e-12);
  EXPECT_LE((to_vector(d.child_position) - Vector3(-0.1, -0.01, 0)).norm(), 1e-12);
  EXPECT_LE((to_quaternion(d.parent_orientation) * Vector3::UnitY() - Vector3::UnitX()).norm(), 1e-12);
  const JointLaw law = to_law(d);
  EXPECT_EQ(law.minimum, -0.01);
  EXPECT_EQ(law.friction, 0.3);
  EXPECT_EQ(law.load_friction, 0.2);
  EXPECT_EQ(law.detent_count, 1u);
}

TEST(WorldJoint, MessagesMoveResetAndRemoveWholeAssemblies) {
  ObjectOptions parent = base(), child = cube(0.05, 0.05);
  parent.mass = 0.1;
  JointedWorld run({parent, child}, {joint("hinge")}, weightless());
  const auto send = [&run](const char* key, const char* value) {
    Message message;
    set_text(message.module, "world");
    set_text(message.key, key);
    set_text(message.value, value);
    return run.world.answer(message).result;
  };
  EXPECT_EQ(send("object.teleport", "cube 1 1 1"), kReplyApplied);
  run.run(0.1);
  EXPECT_LE((position(run.child()) - Vector3(1, 1, 1)).norm(), 1e-4);
  EXPECT_LE(run.world.joint_gap("joint"), 1e-5);
  EXPECT_EQ(send("object.reset", "base"), kReplyApplied);
  run.run(0.1);
  EXPECT_LE((position(run.child()) - Vector3(0, 0.05, 0)).norm(), 1e-5);
  const std::uint64_t before = run.world.descriptions_version();
  EXPECT_EQ(send("object.remove", "base"), kReplyApplied);
  EXPECT_EQ(run.world.joint_descriptions()[0].removed, 1u);
  EXPECT_GT(run.world.joint_descriptions()[0].stamp.sequence, before);
  run.run(0.1);
  EXPECT_EQ(send("object.reset", "base"), kReplyApplied);
  EXPECT_EQ(run.world.joint_descriptions()[0].removed, 0u);
  run.run(0.1);
  EXPECT_LE(run.world.joint_gap("joint"), 1e-5);

  JointedWorld housed({base(), child}, {joint("slider")});
  Message message;
  set_text(message.module, "world");
  set_text(message.key, "object.teleport");
  set_text(message.value, "cube 1 1 1");
  EXPECT_EQ(housed.world.answer(message).result, kReplyRefused);
}

TEST(WorldJoint, WhatARemovedLinkConnectedIsSeparate) {
  std::vector<ObjectOptions> chain;
  for (const char* name : {"first", "middle", "last"}) {
    ObjectOptions& link = chain.emplace_back(base());
    link.name = name;
    link.mass = 0.1;
    link.position[1] = 0.1 * static_cast<double>(chain.size());
  }
  JointOptions one = joint("hinge"), other = joint("hinge");
  one.parent = "first", one.child = "middle";
  other.name = "other", other.parent = "middle", other.child = "last";
  JointedWorld run(chain, {one, other}, weightless());
  const auto send = [&run](const char* key, const char* value) {
    Message message;
    set_text(message.module, "world");
    set_text(message.key, key);
    set_text(message.value, value);
    EXPECT_EQ(run.world.answer(message).result, kReplyApplied) << key << value;
    run.run(2 * kStep);
  };
  const auto height_of = [&run](std::uint32_t id) {
    for (const ObjectState& state : run.world.objects().objects)
      if (state.object == id) return state.position[1];
    return -1.0;
  };
  send("object.remove", "middle");
  send("object.teleport", "first 0 1 0");
  EXPECT_NEAR(height_of(1), 1, 1e-3);
  EXPECT_NEAR(height_of(3), 0.3, 1e-3);
  // The middle brings both back to the places where its joints fit.
  send("object.reset", "middle");
  EXPECT_NEAR(height_of(1), 0.1, 1e-3);
  EXPECT_LE(run.world.joint_gap("joint"), 1e-5);
  EXPECT_LE(run.world.joint_gap("other"), 1e-5);

  run.world.forget();
  std::vector<std::byte> memory(1 << 20);
  ByteWriter saved(memory);
  run.world.save(saved);
  ASSERT_FALSE(saved.overflowed());
  memory[sizeof(std::uint32_t)] = std::byte{0};  // the first object is absent
  WorldLoop next(weightless(), chain, 1.0 / 90, {one, other});
  ByteReader bytes(saved.written());
  EXPECT_THROW(next.load(bytes), std::runtime_error);
}

TEST(WorldJoint, RefusesJointsThatCannotRun) {
  const auto wrong = [](const std::function<void(JointOptions&)>& change) {
    JointOptions j = joint("hinge");
    change(j);
    const auto found = check_world({}, {base(), cube(0.05, 0.1)}, 1.0 / 90, {j});
    return found.empty() ? std::string() : found[0];
  };
  EXPECT_EQ(wrong([](JointOptions&) {}), "");
  EXPECT_NE(wrong([](JointOptions& j) { j.parent = "door"; }).find("expected the name of an object"),
            std::string::npos);
  EXPECT_NE(wrong([](JointOptions& j) { std::swap(j.parent, j.child); }).find("static"), std::string::npos);
  EXPECT_NE(wrong([](JointOptions& j) { j.parent = "cube"; }).find("same object"), std::string::npos);
  EXPECT_NE(wrong([](JointOptions& j) { j.axis = {0, 0, 0}; }).find("axis"), std::string::npos);
  EXPECT_NE(wrong([](JointOptions& j) { j.limits = {0.1, 0.2}; }).find("outside"), std::string::npos);
  EXPECT_NE(wrong([](JointOptions& j) { j.limits = {-4, 4}; }).find("range"), std::string::npos);
  EXPECT_NE(wrong([](JointOptions& j) { j.kind = "screw"; }).find("pitch"), std::string::npos);
  EXPECT_NE(wrong([](JointOptions& j) { j.kind = "fixed", j.friction = 1; }).find("free coordinate"),
            std::string::npos);
  EXPECT_NE(wrong([](JointOptions& j) { j.detents = {{0, 1, 1, 1}}; }).find("period"), std::string::npos);
}

TEST(WorldJoint, NamesSetsOfObjectsThatAHandCanNeverTake) {
  ObjectOptions first = cube(0.05, 0.1), second = first, third = first;
  first.name = "a", second.name = "b", third.name = "c";
  JointOptions one = joint("hinge"), two = one, three = one;
  one.parent = "a", one.child = "b";
  two.parent = "b", two.child = "c";
  three.parent = "base", three.child = "c";
  const std::vector<ObjectOptions> objects{base(), first, second, third};
  EXPECT_TRUE(check_assemblies(objects, {one, two, three}, 3, 3).empty());
  EXPECT_EQ(check_assemblies(objects, {one, two, three}, 2, 2).size(), 2u);
  EXPECT_TRUE(check_assemblies(objects, {one, three}, 2, 1).empty());
}

}  // namespace
}  // namespace softhand::world_joint_test
