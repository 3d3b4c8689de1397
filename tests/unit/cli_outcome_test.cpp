// The outcome judge with generated messages whose results are known.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>

#include "cli/outcome.hpp"
#include "messages/convert.hpp"

namespace softhand::cli_outcome_test {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kRate = 90;
constexpr Nanoseconds kStart = 5'000'000'000;
constexpr std::uint32_t kCube = 3;
constexpr double kMass = 0.05;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

Nanoseconds at(double t) { return kStart + static_cast<Nanoseconds>(std::llround(t * 1e9)); }
std::size_t index(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }

Skeleton skeleton(double t, const std::function<Pose(std::size_t)>& pose_of) {
  Skeleton s;
  s.stamp.sample_time = at(t);
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Pose pose = pose_of(j);
    s.joints[j].position = to_wire(pose.position);
    s.joints[j].orientation = to_wire(pose.orientation);
    s.joints[j].flags = kJointValid | kJointTracked;
  }
  return s;
}

// The joints of a hand that moves as one rigid body with the pose `motion`.
Pose joint_in(const Pose& motion, std::size_t j) {
  return motion * Pose{Vector3(0.01 * static_cast<double>(j), 0.02, -0.03), Quaternion::Identity()};
}

ObjectCoupling coupling(double t, const Pose& pose, const Vector3& force, bool owned = true) {
  ObjectCoupling c;
  c.stamp.sample_time = at(t);
  ObjectTwin twin;
  twin.object = kCube;
  twin.owned = owned;
  twin.position = to_wire(pose.position);
  twin.orientation = to_wire(pose.orientation);
  twin.contact_force = to_wire(force);
  c.twins.push_back(twin);
  return c;
}

OutcomeFrame pinch_frame() {
  OutcomeFrame frame;
  frame.phases = {{"approach", 0, 1}, {"lift", 1, 2},   {"hold", 2, 7},
                  {"shake", 7, 10},   {"turn", 10, 11}, {"retreat", 11, 12}};
  frame.motion_start = kStart;
  frame.object = kCube;
  frame.object_mass = kMass;
  frame.shake_frequency = 3;
  return frame;
}

double smooth(double u) { return u <= 0 ? 0 : u >= 1 ? 1 : u * u * (3 - 2 * u); }

struct PinchTruth {
  double slip = 0.0007;  // m, over the hold
  double weight = 1.01;
  double inertia = 0.97;
  double quadrature = 0.2;  // out-of-phase force over m a; this force is not inertia
  double lift = 0.15;
  double turn = M_PI / 3;
  bool lies_still = true;
};

void play_pinch(Outcome& outcome, const PinchTruth& truth) {
  const double w = 2 * M_PI * 3;
  for (int i = 0; i <= static_cast<int>(12 * kRate); ++i) {
    const double t = i / kRate;
    // The hand lifts the object, tilts it during the hold (which is not slip), shakes it, and turns it.
    Pose motion;
    motion.position = Vector3(0, truth.lift * smooth(t - 1), 0);
    double x = 0;
    if (t >= 7 && t <= 10) x = 0.03 * std::sin(w * (t - 7));
    motion.position.x() += x;
    motion.orientation =
        Quaternion(Eigen::AngleAxisd(t > 2 && t < 7 ? 0.2 * std::sin(M_PI * (t - 2) / 5) : 0, Vector3::UnitZ()));
    if (t >= 10) motion.orientation = Quaternion(Eigen::AngleAxisd(truth.turn * smooth(t - 10), Vector3::UnitY()));
    outcome.on_simulated(skeleton(t, [&motion](std::size_t j) { return joint_in(motion, j); }));

    Pose object = motion * Pose{Vector3(0.02, 0, 0.01), Quaternion::Identity()};
    if (t >= 2 && t <= 7)
      object = motion * Pose{Vector3(0.02, 0, 0.01 + truth.slip * (t - 2) / 5), Quaternion::Identity()};
    Vector3 force(0, truth.weight * kMass * 9.81, 0);
    if (t >= 7 && t <= 10) {
      const double a = -w * w * x;
      force.x() = truth.inertia * kMass * a + truth.quadrature * kMass * w * w * 0.03 * std::cos(w * (t - 7));
    }
    outcome.on_coupling(coupling(t, object, force, t > 0.9));

    Contacts contacts;
    contacts.stamp.sample_time = at(t);
    if (t < 11.2) {
      contacts.fingers[0] = {{0, 0, 2.0}, {0, 0, 0}, {0, 0, 1}, 1e-4, 0, kCube, 5};
      contacts.fingers[1] = {{0, 0, -2.5}, {0, 0, 0}, {0, 0, -1}, 1e-4, 0, kCube, 5};
      for (std::uint32_t k = 0; k < 10; ++k) {
        Contact contact;
        contact.finger = k % 2;
        contact.object = kCube;
        contact.penetration = 1e-5 * (k + 1);  // 10 to 100 um
        contacts.contacts.push_back(contact);
      }
    }
    outcome.on_contacts(contacts);
    WorldObjects world;
    world.stamp.sample_time = at(t);
    ObjectState state;
    state.object = kCube;
    state.linear_velocity = {0, truth.lies_still ? 0.0 : 0.02, 0};
    world.objects.push_back(state);
    outcome.on_objects(world);
  }
}

TEST(OutcomePinch, FindsSlipWeightInertiaLiftAndTurn) {
  Outcome outcome;
  play_pinch(outcome, {});
  const auto json = outcome.summary(pinch_frame());
  EXPECT_NEAR(json["held_slip_mm"].get<double>(), 0.7, 1e-3) << "neither rotation with the hand nor lifting is slip";
  EXPECT_NEAR(json["carried_weight_ratio"].get<double>(), 1.01, 1e-9);
  EXPECT_NEAR(json["inertia_ratio"].get<double>(), 0.97, 1e-6) << "the out-of-phase part of the force does not count";
  EXPECT_NEAR(json["lifted_mm"].get<double>(), 150, 0.5)
      << "measured just before the hold ends, when the tilt is almost zero";
  EXPECT_NEAR(json["turned_deg"].get<double>(), 60, 0.1);
  EXPECT_NEAR(json["penetration_max_mm"].get<double>(), 0.1, 1e-12);
  EXPECT_NEAR(json["penetration_p95_mm"].get<double>(), 0.1, 1e-12);
  EXPECT_DOUBLE_EQ(json["finger_force_max_n"].get<double>(), 2.5);
  EXPECT_EQ(json["pressing_harder_fraction"].get<double>(), 0);
  EXPECT_EQ(json["released"], true);
  EXPECT_EQ(json["nonfinite_published"], 0);
}

TEST(OutcomePinch, ReportsZeroSlipIfNothingSlips) {
  Outcome outcome;
  PinchTruth truth;
  truth.slip = 0;
  play_pinch(outcome, truth);
  EXPECT_NEAR(outcome.summary(pinch_frame())["held_slip_mm"].get<double>(), 0, 1e-6);
}

// The object moves by 0.1 m along x, tilts by 50 degrees and comes back, unless `stays`.
Json success_of(const Goal& goal, bool stays, bool touches = true, std::vector<MotionPhase> phases = {}) {
  Outcome outcome;
  for (int i = 0; i <= 400; ++i) {
    const double t = 0.01 * i, share = t < 3 ? 0.5 - 0.5 * std::cos(2 * M_PI * t / 3) : 0;
    const double place = stays && t > 1.5 ? 1 : share;
    WorldObjects world;
    world.stamp.sample_time = at(t);
    ObjectState state;
    state.object = kCube;
    state.position = {0.1 * place, 0, 0};
    state.orientation = to_wire(Quaternion(Eigen::AngleAxisd(50 * M_PI / 180 * place, Vector3::UnitZ())));
    world.objects.push_back(state);
    outcome.on_objects(world);
    Contacts contacts;
    contacts.stamp.sample_time = at(t);
    if (touches && t > 0.5 && t < 3) {
      Contact contact;
      contact.object = kCube;
      contact.force = {1, 0, 0};
      contacts.contacts.push_back(contact);
    }
    outcome.on_contacts(contacts);
  }
  OutcomeFrame frame;
  frame.motion_start = kStart;
  frame.object = kCube;
  frame.goal = goal;
  frame.phases = std::move(phases);
  return outcome.summary(frame);
}

TEST(OutcomeSuccess, WhatFollowsTheMotionDoesNotCount) {
  // The object reaches 100 mm after 1.5 s.
  EXPECT_NEAR(success_of({0.09, 0, 0}, false, true, {{"lift", 0, 0.25}})["travel_mm"].get<double>(), 50, 1);
  EXPECT_NEAR(success_of({0.09, 0, 0}, false, true, {{"lift", 0, 2}})["travel_mm"].get<double>(), 100, 0.1);
}

TEST(OutcomeSuccess, StatesEachDemandAndWhetherItHolds) {
  const Json good = success_of({0.09, 0.8, 0.002}, false);
  EXPECT_EQ(good["success"], true) << good["success_because"];
  EXPECT_NEAR(good["travel_mm"].get<double>(), 100, 0.1);
  EXPECT_NEAR(good["tilt_deg"].get<double>(), 50, 0.1);
  const std::string because = good["success_because"];
  for (const char* part : {"moved by 100.0 mm", "tilted by 50.0 degrees", "let go"})
    EXPECT_NE(because.find(part), std::string::npos) << because;
  EXPECT_EQ(success_of({0.11, 0, 0}, false)["success"], false);
  EXPECT_EQ(success_of({0, 0.9, 0}, false)["success"], false);
  EXPECT_EQ(success_of({0.09, 0, 0.002}, true)["success"], false) << "it stays away";
  EXPECT_EQ(success_of({0.09, 0, 0}, false, false)["success"], false) << "nothing touched it";
  EXPECT_FALSE(success_of({}, false).contains("success")) << "the scene asks for nothing";
}

// A joint of kCube with an object at rest. Its coordinate follows `path` for 4 s. The hand touches it until 3 s.
Json joint_success(ObjectJointKind kind, const Goal& goal, const std::function<double(double)>& path) {
  constexpr std::uint32_t kBase = 2;
  OutcomeFrame frame;
  frame.motion_start = kStart;
  frame.object = kCube;
  frame.goal = goal;
  frame.joint = {kBase, kCube, {}, {{0.1, 0, 0}, Quaternion::Identity()}, {{0, 0.02, 0}, Quaternion::Identity()}};
  frame.joint.law.kind = kind;
  frame.joint.law.pitch = kind == ObjectJointKind::screw ? 0.004 : 0;
  const Pose base{{0.3, 0.2, 0.1}, Quaternion(Eigen::AngleAxisd(0.7, Vector3(1, 2, 3).normalized()))};
  Outcome outcome;
  for (int i = 0; i <= 400; ++i) {
    const double t = 0.01 * i, q = path(t);
    const Pose turned{{0, frame.joint.law.pitch * q / (2 * M_PI), 0},
                      Quaternion(Eigen::AngleAxisd(q, Vector3::UnitY()))};
    const Pose cube = base * frame.joint.parent_from_joint * turned * frame.joint.child_from_joint.inverse();
    WorldObjects world;
    world.stamp.sample_time = at(t);
    for (const auto& [id, pose] : {std::pair{kBase, base}, std::pair{kCube, cube}}) {
      ObjectState state;
      state.object = id;
      state.position = to_wire(pose.position);
      state.orientation = to_wire(pose.orientation);
      world.objects.push_back(state);
    }
    outcome.on_objects(world);
    Contacts contacts;
    contacts.stamp.sample_time = at(t);
    if (t > 0.5 && t < 3) {
      Contact contact;
      contact.object = kCube;
      contact.force = {1, 0, 0};
      contacts.contacts.push_back(contact);
    }
    outcome.on_contacts(contacts);
  }
  return outcome.summary(frame);
}

TEST(OutcomeSuccess, CountsSwingsOfAJoint) {
  // Opens by 0.6 rad and closes three times. The third time it closes to 0.1 rad only.
  const auto path = [](double t) {
    const double s = 0.3 - 0.3 * std::cos(2 * M_PI * t);
    return t >= 3 ? 0.1 : t > 2.5 ? std::max(s, 0.1) : s;
  };
  Goal goal;
  goal.swing = 0.5;
  goal.closes = 0.15;
  goal.times = 3;
  const Json good = joint_success(ObjectJointKind::hinge, goal, path);
  EXPECT_EQ(good["success"], true) << good["success_because"];
  EXPECT_NEAR(good["swing_deg"].get<double>(), 0.6 * 180 / M_PI, 0.1);
  EXPECT_EQ(good["swings"], 3);
  goal.closes = 0.05;
  const Json twice = joint_success(ObjectJointKind::hinge, goal, path);
  EXPECT_EQ(twice["success"], false);
  EXPECT_EQ(twice["swings"], 2) << twice["success_because"];
  goal = {};
  goal.swing = 0.7;
  EXPECT_EQ(joint_success(ObjectJointKind::hinge, goal, path)["success"], false);
}

TEST(OutcomeSuccess, CountsTurnsOfAScrew) {
  const auto path = [](double t) { return 3.1 * std::min(t, 3.0); };
  Goal goal;
  goal.swing = 9.2;
  const Json good = joint_success(ObjectJointKind::screw, goal, path);
  EXPECT_EQ(good["success"], true) << good["success_because"];
  EXPECT_NEAR(good["swing_deg"].get<double>(), 9.3 * 180 / M_PI, 0.1);
  goal.swing = 9.4;
  EXPECT_EQ(joint_success(ObjectJointKind::screw, goal, path)["success"], false);
}

// The object tilts by 50 degrees to one side and by `other` degrees to the other side.
TEST(OutcomeSuccess, ATiltToBothSidesNeedsBoth) {
  const auto tilted = [](double other) {
    Outcome outcome;
    for (int i = 0; i <= 400; ++i) {
      const double t = 0.01 * i, wave = std::sin(M_PI * t);
      WorldObjects world;
      world.stamp.sample_time = at(t);
      ObjectState state;
      state.object = kCube;
      const double degrees = t > 2 ? 0 : wave > 0 ? 50 * wave : other * wave;
      state.orientation = to_wire(Quaternion(Eigen::AngleAxisd(degrees * M_PI / 180, Vector3(1, 0, 2).normalized())));
      world.objects.push_back(state);
      outcome.on_objects(world);
      Contacts contacts;
      contacts.stamp.sample_time = at(t);
      Contact contact;
      contact.object = kCube;
      contacts.contacts.push_back(contact);
      outcome.on_contacts(contacts);
    }
    OutcomeFrame frame;
    frame.motion_start = kStart;
    frame.object = kCube;
    frame.goal.tilt = 0.785;
    frame.goal.both_sides = true;
    return outcome.summary(frame);
  };
  const Json good = tilted(47);
  EXPECT_EQ(good["success"], true) << good["success_because"];
  EXPECT_NEAR(good["tilt_deg"].get<double>(), 50, 0.1);
  EXPECT_NEAR(good["other_tilt_deg"].get<double>(), 47, 0.1);
  EXPECT_EQ(tilted(40)["success"], false);
  EXPECT_EQ(tilted(-50)["success"], false) << "twice to the same side";
}

TEST(OutcomePinch, AMovingObjectIsNotReleased) {
  Outcome outcome;
  PinchTruth truth;
  truth.lies_still = false;
  play_pinch(outcome, truth);
  EXPECT_EQ(outcome.summary(pinch_frame())["released"], false);
}

TEST(OutcomePinch, AJoltOfOneStepDoesNotCountAsMovement) {
  Outcome outcome;
  play_pinch(outcome, {});
  WorldObjects world;
  world.stamp.sample_time = at(12);
  ObjectState state;
  state.object = kCube;
  state.linear_velocity = {0.02, 0, 0};
  world.objects.push_back(state);
  outcome.on_objects(world);
  EXPECT_EQ(outcome.summary(pinch_frame())["released"], true);
}

TEST(OutcomePinch, AnObjectThatSticksToAFingerIsNotReleased) {
  Outcome outcome;
  play_pinch(outcome, {});
  Contacts contacts;
  contacts.stamp.sample_time = at(12.01);
  contacts.fingers[1].object = kCube;
  contacts.fingers[1].contact_count = 1;
  outcome.on_contacts(contacts);
  EXPECT_EQ(outcome.summary(pinch_frame())["released"], false);
}

TEST(OutcomePinch, ATrackerThatRepeatsItsMotionDoesNotUndoTheRelease) {
  Outcome outcome;
  play_pinch(outcome, {});
  Contacts contacts;
  contacts.stamp.sample_time = at(14);
  contacts.fingers[1].object = kCube;
  contacts.fingers[1].contact_count = 1;
  outcome.on_contacts(contacts);
  EXPECT_EQ(outcome.summary(pinch_frame())["released"], true)
      << "the motion and the half second after it had already ended";
}

TEST(OutcomePinch, CountsPenetrationOnlyOfFingersThatPressGently) {
  Outcome outcome;
  Contacts contacts;
  contacts.stamp.sample_time = at(1);
  contacts.fingers[0].force = {0, 0, 3.5};
  contacts.fingers[1].force = {0, 0, 2.5};
  Contact deep, shallow, gone;
  deep.finger = 0, deep.penetration = 0.002;
  shallow.finger = 1, shallow.penetration = 0.0003;
  gone.finger = 1, gone.penetration = 0;
  for (const Contact& c : {deep, shallow, shallow, shallow, gone}) contacts.contacts.push_back(c);
  outcome.on_contacts(contacts);
  const auto json = outcome.summary(pinch_frame());
  EXPECT_NEAR(json["penetration_max_mm"].get<double>(), 0.3, 1e-12);
  EXPECT_NEAR(json["pressing_harder_fraction"].get<double>(), 0.25, 1e-12) << "fraction of the touching nodes";
}

TEST(OutcomePinch, ReportsTheForceOfEachFingerDuringTheHold) {
  Outcome outcome;
  // The object is held from 2 s to 7 s. The fingers press in every second step: 1 N (thumb) to 5 N (little finger),
  // each finger with two nodes.
  for (int i = 0; i < static_cast<int>(8 * kRate); ++i) {
    const double t = (i + 0.5) / kRate;
    Contacts contacts;
    contacts.stamp.sample_time = at(t);
    for (std::uint32_t f = 0; f < 5 && (i % 2 == 0 || t > 7); ++f) {
      for (const double sign : {-1.0, 1.0}) {  // a finger that wraps around the object pulls both ways
        Contact contact;
        contact.finger = f;
        contact.body = static_cast<std::uint32_t>(index_of(distal_of(static_cast<Finger>(f))));
        contact.object = kCube;
        contact.force = {sign * 0.5 * (f + 1), 0, 0};
        contacts.contacts.push_back(contact);
      }
    }
    Contact palm;  // skin over a metacarpal belongs to the palm, not to the finger
    palm.finger = 1;
    palm.body = static_cast<std::uint32_t>(index_of(Body::index_metacarpal));
    palm.object = kCube;
    palm.force = {0, 0, 7};
    contacts.contacts.push_back(palm);
    Contact elsewhere = palm;
    elsewhere.object = kCube + 1;
    elsewhere.body = static_cast<std::uint32_t>(index_of(Body::index_distal));
    contacts.contacts.push_back(elsewhere);
    outcome.on_contacts(contacts);
  }
  const auto json = outcome.summary(pinch_frame());
  EXPECT_NEAR(json["hold_force_n"]["thumb"].get<double>(), 0.5, 1e-9);
  EXPECT_NEAR(json["hold_force_n"]["little"].get<double>(), 2.5, 1e-9);
  EXPECT_NEAR(json["hold_force_n"]["palm"].get<double>(), 7, 1e-9);
  EXPECT_NEAR(json["hold_share_min"].get<double>(), 1.0 / 15, 1e-9);
}

TEST(OutcomePinch, ReportsNullWithoutInput) {
  const auto json = Outcome().summary(pinch_frame());
  for (const char* key : {"held_slip_mm", "carried_weight_ratio", "inertia_ratio", "lifted_mm", "turned_deg",
                          "penetration_p95_mm", "hold_share_min", "released"}) {
    EXPECT_TRUE(json[key].is_null()) << key << ": " << json[key];
  }
  EXPECT_TRUE(json["motion_to_force_ms_p50"]["total"].is_null());
  EXPECT_TRUE(json["motion_to_force_ms_p50"]["hops"]["tracker"].is_null());
  EXPECT_TRUE(json["first_effect_ms_p50"].is_null());
}

OutcomeFrame recorded_frame() {
  OutcomeFrame frame;
  frame.motion_start = kStart;
  frame.object = kCube;
  frame.object_mass = 0.2;
  frame.recorded = true;
  return frame;
}

Pose waving(double t) { return {Vector3(0.1 * std::sin(4 * t), 0.05 * std::cos(3 * t), 0), Quaternion::Identity()}; }

TEST(OutcomeFollowing, FindsTheLagAndTheErrorThatRemains) {
  Outcome outcome;
  constexpr double lag = 0.012;
  const Vector3 offset(0, 0, 0.002);
  for (int i = 0; i < static_cast<int>(6 * kRate); ++i) {
    const double t = i / kRate;
    outcome.on_tracked(skeleton(t, [t](std::size_t j) { return joint_in(waving(t), j); }));
    // The hand is held back by 20 mm during contact and 0.2 s after it. This is not an error of following: the judge
    // ignores contact and the 0.3 s after it.
    const bool held_back = t >= 3 && t < 4.2;
    outcome.on_simulated(skeleton(t, [&](std::size_t j) {
      Pose pose = joint_in(waving(t - lag), j);
      pose.position += held_back ? Vector3(0, 0, 0.02) : offset;
      return pose;
    }));
    Contacts contacts;
    contacts.stamp.sample_time = at(t);
    if (t >= 3 && t < 4) contacts.fingers[1].contact_count = 1;
    outcome.on_contacts(contacts);
  }
  const auto json = outcome.summary(recorded_frame());
  EXPECT_NEAR(json["lag_ms"].get<double>(), 12, 1);
  EXPECT_NEAR(json["fingertip_rms_mm"].get<double>(), 2, 0.05);
  EXPECT_GT(json["fingertip_rms_unshifted_mm"].get<double>(), 3);
}

TEST(OutcomeFollowing, LeavesOutTimesWithoutTrackedSamplesAndReportsTheirLength) {
  Outcome outcome;
  const Vector3 offset(0, 0, 0.002);
  for (int i = 0; i < static_cast<int>(6 * kRate); ++i) {
    const double t = i / kRate;
    // Nothing is tracked from 2 s to 3 s. The hand keeps waving, far from a straight line between the neighbouring
    // samples.
    if (t <= 2 || t >= 3) {
      outcome.on_tracked(skeleton(t, [t](std::size_t j) { return joint_in(waving(t), j); }));
    }
    if (i == 100)
      outcome.on_tracked(skeleton(t, [t](std::size_t j) { return joint_in(waving(t), j); }));  // a duplicate
    outcome.on_simulated(skeleton(t, [&](std::size_t j) {
      Pose pose = joint_in(waving(t), j);
      pose.position += offset;
      return pose;
    }));
  }
  const auto json = outcome.summary(recorded_frame());
  EXPECT_NEAR(json["fingertip_rms_mm"].get<double>(), 2, 0.05);
  EXPECT_NEAR(json["lag_ms"].get<double>(), 0, 1);
  EXPECT_NEAR(json["tracker_gaps_s"].get<double>(), 1, 1e-6);
}

TEST(OutcomeFollowing, OneMissingSampleIsNotAGap) {
  Outcome outcome;
  for (int i = 0; i < static_cast<int>(3 * kRate); ++i) {
    if (i % 10 == 3) continue;
    outcome.on_tracked(skeleton(i / kRate, [](std::size_t j) { return joint_in(Pose{}, j); }));
  }
  EXPECT_EQ(outcome.summary(recorded_frame())["tracker_gaps_s"].get<double>(), 0);
}

TEST(OutcomeFollowing, ReportsTheLargestForceOnOneFinger) {
  Outcome outcome;
  for (int i = 0; i < 3; ++i) {
    Contacts contacts;
    contacts.stamp.sample_time = at(i / kRate);
    contacts.fingers[2].force = {0, 3.0 * i, 4.0 * i};
    contacts.fingers[4].force = {0.5, 0, 0};
    outcome.on_contacts(contacts);
  }
  EXPECT_DOUBLE_EQ(outcome.summary(recorded_frame())["finger_force_max_n"].get<double>(), 10);
}

TEST(OutcomeFollowing, HeldFractionNeedsTwoFingersAndNoMovementInThePalm) {
  Outcome outcome;
  // The hand is closed from 1 s to 3 s. Only one finger touches from 1.0 s to 1.2 s. From 2.8 s on the object has moved
  // by 6 mm.
  for (int i = 0; i < 400; ++i) {
    const double t = 0.01 * i + 0.001;
    const bool closed = t > 1 && t < 3;
    outcome.on_tracked(skeleton(t, [&](std::size_t j) {
      Pose pose{Vector3(0, 0, 1), Quaternion::Identity()};
      if (j == index(Joint::middle_metacarpal)) pose.position = Vector3::Zero();
      if (j == index(Joint::middle_tip)) pose.position = Vector3(0, 0, closed ? 0.055 : 0.15);
      return pose;
    }));
    outcome.on_simulated(skeleton(t, [t](std::size_t) { return waving(t); }));
    const Vector3 local(0, t > 2.8 ? 0.006 : 0.0, 0.04);
    outcome.on_coupling(coupling(t, waving(t) * Pose{local, Quaternion::Identity()}, Vector3::Zero()));
    Contacts contacts;
    contacts.stamp.sample_time = at(t);
    for (std::size_t f = 0; f < 3; ++f) {
      contacts.fingers[f].object = f == 2 ? kCube + 1 : kCube;  // the third finger touches something else
      contacts.fingers[f].contact_count = t > 1.2 || f == 0 ? 4 : 0;
    }
    outcome.on_contacts(contacts);
  }
  const auto json = outcome.summary(recorded_frame());
  EXPECT_EQ(json["closed_samples"], 200);
  EXPECT_NEAR(json["held_fraction"].get<double>(), 0.8, 0.006);
  EXPECT_NEAR(json["held_movement_max_mm"].get<double>(), 6, 1e-6);
}

TEST(OutcomeLatency, ReportsEveryHopAndTheTotal) {
  Outcome outcome;
  for (int i = 1; i <= 100; ++i) {
    DeviceState state;
    state.live = 1;
    Chain& chain = state.stamp.chain;
    chain.tracker_sample = kStart;
    chain.tracked_published = kStart + 1'000'000;
    chain.intermediate_published = kStart + 3'000'000;
    chain.simulated_published = kStart + 7'000'000;
    chain.wrench_published = kStart + 9'000'000;
    state.stamp.publish_time = kStart + 9'000'000 + i * 10'000;  // 0.01 to 1 ms
    outcome.on_device(state);
    state.live = 0;  // zeroed commands do not come through the chain
    state.stamp.publish_time = kStart + 900'000'000;
    outcome.on_device(state);
    state.live = 1;
    state.kind = 1;  // a tactile device has another chain
    outcome.on_device(state);
  }
  const auto json = outcome.summary(pinch_frame());
  const auto& p50 = json["motion_to_force_ms_p50"];
  EXPECT_NEAR(p50["hops"]["tracker"].get<double>(), 1, 1e-9);
  EXPECT_NEAR(p50["hops"]["tracking"].get<double>(), 2, 1e-9);
  EXPECT_NEAR(p50["hops"]["hand"].get<double>(), 4, 1e-9);
  EXPECT_NEAR(p50["hops"]["wrench"].get<double>(), 2, 1e-9);
  EXPECT_NEAR(p50["hops"]["device"].get<double>(), 0.5, 0.011);
  EXPECT_NEAR(p50["total"].get<double>(), 9.5, 0.011);
  EXPECT_NEAR(json["motion_to_force_ms_p99"]["total"].get<double>(), 9.99, 0.011);
}

TEST(OutcomeLatency, HandHopStartsAtTheTrackerWithoutTheIntermediateLayer) {
  Outcome outcome;
  DeviceState state;
  state.live = 1;
  state.stamp.chain = {kStart, kStart + 1'000'000, 0, kStart + 6'000'000, kStart + 6'000'000};
  state.stamp.publish_time = kStart + 7'000'000;
  outcome.on_device(state);
  const auto json = outcome.summary(pinch_frame());
  EXPECT_TRUE(json["motion_to_force_ms_p50"]["hops"]["tracking"].is_null());
  EXPECT_NEAR(json["motion_to_force_ms_p50"]["hops"]["hand"].get<double>(), 5, 1e-9);
}

TEST(OutcomeLatency, FirstEffectIsTheFirstCommandWithTheSampleOrANewerOne) {
  Outcome outcome;
  const auto command = [&outcome](Nanoseconds sample, Nanoseconds time) {
    DeviceState state;
    state.live = 1;
    state.stamp.chain = {kStart + sample, kStart + sample, 0, kStart + time, kStart + time};
    state.stamp.publish_time = kStart + time;
    outcome.on_device(state);
  };
  for (const Nanoseconds sampled : {0, 10'000'000, 20'000'000, 30'000'000, 40'000'000}) {
    Skeleton tracked = skeleton(0, [](std::size_t) { return Pose{}; });
    tracked.stamp.chain.tracker_sample = kStart + sampled;
    tracked.stamp.publish_time = kStart + sampled + 2'000'000;
    outcome.on_tracked(tracked);
  }
  command(0, 7'000'000);  // before it the rig was not complete: the first sample does not count
  command(10'000'000, 16'000'000);
  command(10'000'000, 17'000'000);
  command(30'000'000, 39'000'000);  // also the first answer to the sample at 20 ms; nothing answers the last sample
  const auto json = outcome.summary(pinch_frame());
  EXPECT_NEAR(json["first_effect_ms_p50"].get<double>(), 7, 1e-9);  // 4, 17 and 7 ms
  EXPECT_NEAR(json["first_effect_ms_p99"].get<double>(), 17, 1e-9);
}

TEST(OutcomeFinite, CountsEveryMessageWithNaNOrInfinity) {
  Outcome outcome;
  Skeleton s = skeleton(0, [](std::size_t) { return Pose{}; });
  s.joints[4].linear_velocity[1] = kNaN;
  outcome.on_simulated(s);
  outcome.on_coupling(coupling(0, Pose{}, Vector3(0, kNaN, 0)));
  WorldObjects world;
  ObjectState state;
  state.position[2] = std::numeric_limits<double>::infinity();
  world.objects.push_back(state);
  outcome.on_objects(world);
  BoneWrench wrench;
  wrench.bones[7].coupling_torque[0] = kNaN;
  outcome.on_bone_wrench(wrench);
  DeviceState device;
  device.commands.push_back(kNaN);
  outcome.on_device(device);
  Contacts contacts;
  contacts.fingers[2].area = kNaN;
  outcome.on_contacts(contacts);
  EXPECT_EQ(outcome.summary(pinch_frame())["nonfinite_published"], 6);
}

TEST(OutcomeCoupling, SumsForcesByFingerAndByHand) {
  Outcome outcome;
  BoneWrench wrench;
  double sum = 0, thumb = 0;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    wrench.bones[b].coupling_force = {0.1 * static_cast<double>(b + 1), 0, 0};
    sum += 0.1 * static_cast<double>(b + 1);
    if (finger_of(static_cast<Body>(b)) == Finger::thumb) thumb += 0.1 * static_cast<double>(b + 1);
  }
  outcome.on_bone_wrench(wrench);
  const auto json = outcome.summary(pinch_frame());
  EXPECT_NEAR(json["hand_coupling_max_n"].get<double>(), sum, 1e-12);
  EXPECT_GE(json["finger_coupling_max_n"].get<double>(), thumb);
  EXPECT_LT(json["finger_coupling_max_n"].get<double>(), sum);
}

TEST(Percentile, KnownValues) {
  EXPECT_TRUE(std::isnan(percentile({}, 0.5)));
  EXPECT_EQ(percentile({7}, 0.99), 7);
  EXPECT_EQ(percentile({3, 1, 2}, 0.5), 2);
  EXPECT_EQ(percentile({3, 1, 2}, 1.0), 3);
  EXPECT_EQ(percentile({3, 1, 2}, 0.0), 1);
}

TEST(Outcome, TheSuccessOfAPartIsJoined) {
  Json summary{{"success", true}, {"success_because", "a"}, {"soft", {{"success", false}, {"success_because", "b"}}}};
  join_success(summary, "soft");
  EXPECT_EQ(summary["success"], false);
  EXPECT_EQ(summary["success_because"], "a; b");
  Json alone{{"soft", {{"success", true}, {"success_because", "b"}}}};
  join_success(alone, "soft");
  EXPECT_EQ(alone["success"], true);
  join_success(alone, "hands");
  EXPECT_EQ(alone["success_because"], "b");
}

}  // namespace
}  // namespace softhand::cli_outcome_test
