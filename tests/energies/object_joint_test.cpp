// Joints between objects: derivatives of every kind and law, balance, laws of the coordinate, and known answers.
#include "energies/object_joint.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <vector>

#include "energies/dense_step.hpp"
#include "energies/inertia.hpp"
#include "math/rotation.hpp"
#include "solver/newton_solver.hpp"
#include "support/count_allocations.hpp"

namespace softhand::object_joint_test {
namespace {

using testing::DenseStepper;

constexpr double kStep = 1.0 / 90;
constexpr double kPi = std::numbers::pi;

ObjectJoint joint_of(ObjectJointKind kind) {
  ObjectJoint joint;
  joint.law.kind = kind;
  if (kind == ObjectJointKind::screw) joint.law.pitch = 0.02;
  joint.parent = 0;
  joint.child = 1;
  joint.parent_from_joint = {Vector3(0, 0.01, -0.03), rotation_exp(Vector3(0.2, 0.1, 0))};
  joint.child_from_joint = {Vector3(0.002, 0, 0.02), rotation_exp(Vector3(0, 0.3, 0.1))};
  joint.parent_mass = 0.2;
  joint.child_mass = 0.05;
  joint.parent_inertia = 1e-4 * Matrix3::Identity();
  joint.child_inertia = Vector3(2e-5, 1e-5, 3e-5).asDiagonal();
  return joint;
}

ObjectJoint with_laws(ObjectJointKind kind) {
  ObjectJoint joint = joint_of(kind);
  JointLaw& law = joint.law;
  if (kind == ObjectJointKind::fixed) return joint;
  law.friction = 0.02;
  law.load_friction = 0.01;
  law.stiffness = 0.5;
  if (kind == ObjectJointKind::ball) {
    law.minimum = 0;
    law.maximum = 0.6;
    return joint;
  }
  law.damping = 0.01;
  law.rest = 0.1;
  law.minimum = -0.4;
  law.maximum = 0.5;
  law.detents[0] = {0.1, 0.02, 0.3, 0};
  law.detents[1] = {0.2, -0.01, 0.1, 0.3};
  law.detent_count = 2;
  return joint;
}

// The child at a twist (rad), a distance along the axis (m) and an additional swing, joint otherwise closed.
State posed(const ObjectJoint& joint, double twist, double along, const Vector3& swing = Vector3::Zero(),
            std::uint64_t seed = 2) {
  State state = testing::random_state({1, 2}, seed);
  const Pose parent = joint.parent < 0 ? Pose{} : state.body_poses[static_cast<std::size_t>(joint.parent)];
  state.body_poses[static_cast<std::size_t>(joint.child)] =
      parent * joint.parent_from_joint *
      Pose{Vector3(0, along, 0), rotation_exp(swing) * rotation_exp(Vector3(0, twist, 0))} *
      joint.child_from_joint.inverse();
  return state;
}

std::string name_of(const ::testing::TestParamInfo<ObjectJointKind>& info) {
  return std::string(to_string(info.param));
}

class ObjectJointKinds : public ::testing::TestWithParam<ObjectJointKind> {};
INSTANTIATE_TEST_SUITE_P(, ObjectJointKinds,
                         ::testing::Values(ObjectJointKind::fixed, ObjectJointKind::hinge, ObjectJointKind::slider,
                                           ObjectJointKind::ball, ObjectJointKind::screw),
                         name_of);

TEST_P(ObjectJointKinds, DerivativesBalanceAndRigidMotion) {
  const ObjectJoint joint = with_laws(GetParam());
  ObjectJointEnergy term({1, 2}, 0, 2, 1);
  term.set_joint(0, joint);
  // Inside the limits, beyond either, and far from everything that the joint holds.
  for (const double q : {0.1, 0.25, 0.7, -0.8, 2.5}) {
    for (const Vector3& swing : {Vector3(0.02, 0, -0.01), Vector3(0.9, 0.2, -1.1)}) {
      const State start = testing::perturbed(posed(joint, q + 0.03, 0.05 * q, swing), 3, 0.002, 0.01);
      const State state = testing::perturbed(posed(joint, q, 0.1 * q, swing), 7, 0.004, 0.02);
      testing::check_term(term, start, 0.01, state, {.step = 3e-6, .tolerance = 2e-6});
      testing::check_balance(term, state);
      testing::check_rigid_motion(term, state, {Vector3(1, -2, 0.5), rotation_exp(Vector3(2, 1, -1))});
    }
  }
}

TEST_P(ObjectJointKinds, DerivativesWithAPrescribedParent) {
  ObjectJoint joint = with_laws(GetParam());
  joint.parent = -1;
  ObjectJointEnergy term({1, 2}, 0, 2, 1);
  term.set_joint(0, joint);
  term.set_parent_motion(0, {}, {Vector3(0.1, 0.2, 0), Vector3(0, 1, 0.5)});
  const State state = testing::perturbed(posed(joint, 0.2, 0.02), 7, 0.004, 0.02);
  testing::check_term(term, state, 0.01, {.step = 3e-6, .tolerance = 2e-6});
}

TEST_P(ObjectJointKinds, FiniteAtRestAtHalfATurnAndWithOpposedAxes) {
  const ObjectJoint joint = with_laws(GetParam());
  ObjectJointEnergy term({1, 2}, 0, 2, 1);
  term.set_joint(0, joint);
  for (const Vector3& swing : {Vector3(0, 0, 0), Vector3(kPi, 0, 0), Vector3(0, 0, kPi - 1e-9)}) {
    for (const double twist : {0.0, kPi - 1e-12, kPi, kPi + 1e-12, 2 * kPi}) {
      const State state = posed(joint, twist, 0, swing);
      BlockMatrix matrix = testing::bound_matrix(term, state);
      term.begin_step(state, 0.01);
      VectorX gradient = VectorX::Zero(state.layout().dof_count());
      EXPECT_TRUE(std::isfinite(term.add_all(state, gradient, matrix, Curvature::exact)));
      term.add_hessian(state, matrix, Curvature::projected);
      EXPECT_TRUE(gradient.allFinite() && matrix.dense().allFinite());
    }
  }
}

TEST_P(ObjectJointKinds, AClosedJointCostsNothing) {
  const ObjectJoint joint = joint_of(GetParam());
  ObjectJointEnergy term({1, 2}, 0, 2, 1);
  term.set_joint(0, joint);
  const bool turns = joint.law.turns(), slides = GetParam() == ObjectJointKind::slider;
  const double twist = turns ? 0.7 : 0, along = slides                                 ? 0.03
                                                : GetParam() == ObjectJointKind::screw ? 0.02 * 0.7 / (2 * kPi)
                                                                                       : 0;
  const State state = posed(joint, twist, along);
  term.begin_step(state, kStep);
  EXPECT_LE(term.value(state), 1e-20);
  EXPECT_NEAR(term.coordinate(0, state), turns ? 0.7 : along, 1e-12);
  EXPECT_LE(term.gap(0, state), 1e-12);
  EXPECT_LE(term.misalignment(0, state), 1e-9);
}

// --- the step ------------------------------------------------------------------------------------

State at_rest(std::vector<Pose> poses) {
  State state;
  state.node_positions.resize(3, 0);
  state.node_velocities.resize(3, 0);
  state.body_velocities.resize(poses.size());
  state.body_poses = std::move(poses);
  return state;
}

// One body on a joint to a static parent at the origin. The joint's frame is the world's and lies at the body's centre,
// or `arm` above it.
struct OneBody {
  explicit OneBody(const JointLaw& law, const Vector3& gravity, const Vector3& arm = Vector3::Zero())
      : inertia({}, 1), term({0, 1}, 0, 1, 1), state(at_rest({Pose{-arm, Quaternion::Identity()}})) {
    ObjectJoint joint;
    joint.law = law;
    joint.child = 0;
    joint.child_from_joint.position = arm;
    joint.child_mass = mass;
    joint.child_inertia = turning * Matrix3::Identity();
    inertia.set_dynamic(0, mass, turning * Matrix3::Identity(), gravity);
    term.set_joint(0, joint);
    stepper = std::make_unique<DenseStepper>(std::vector<Energy*>{&inertia, &term}, state);
  }
  void step(double time_step = kStep) { stepper->step(state, time_step); }
  double q() const { return term.coordinate(0, state); }

  static constexpr double mass = 0.05, turning = 2e-5;
  Inertia inertia;
  ObjectJointEnergy term;
  State state;
  std::unique_ptr<DenseStepper> stepper;
};

JointLaw law_of(ObjectJointKind kind) {
  JointLaw law;
  law.kind = kind;
  if (kind == ObjectJointKind::screw) law.pitch = 0.003;
  return law;
}

TEST(ObjectJoint, PendulumHasThePeriodOfThePhysicalPendulum) {
  // A hinge about the world's y axis, gravity along -x. Small swings: T = 2 pi sqrt((I + m l^2)/(m g l)).
  const double arm = 0.1;
  OneBody body(law_of(ObjectJointKind::hinge), {-9.81, 0, 0}, Vector3(arm, 0, 0));
  body.state.body_poses[0] = Pose{Vector3::Zero(), rotation_exp(Vector3(0, 0.05, 0))} * body.state.body_poses[0];
  const double expected =
      2 * kPi * std::sqrt((OneBody::turning + OneBody::mass * arm * arm) / (OneBody::mass * 9.81 * arm));
  const double dt = 1e-4;
  std::vector<double> crossings;
  double before = body.q();
  for (int i = 1; i * dt < 2.2 * expected; ++i) {
    body.step(dt);
    const double now = body.q();
    if (before > 0 && now <= 0) crossings.push_back(dt * (i - now / (now - before)));
    before = now;
  }
  ASSERT_GE(crossings.size(), 2u);
  std::printf("  period %.5f s, exact %.5f s\n", crossings[1] - crossings[0], expected);
  EXPECT_NEAR(crossings[1] - crossings[0], expected, 2e-3 * expected);
  EXPECT_LE(body.term.gap(0, body.state), 1e-5);
}

TEST(ObjectJoint, SliderWithFrictionStopsWhereCoulombPredicts) {
  // v^2/(2 a) with a = B/m, on a frictional slider without gravity. Backward Euler stops v dt/2 earlier.
  JointLaw law = law_of(ObjectJointKind::slider);
  law.friction = 0.1;
  OneBody body(law, Vector3::Zero());
  const double speed = 0.5, dt = 1e-3;
  body.state.body_velocities[0].linear = {0, speed, 0};
  for (int i = 0; i < 1000; ++i) body.step(dt);
  const double predicted = speed * speed * OneBody::mass / (2 * law.friction);
  std::printf("  slid %.3f mm, Coulomb %.3f mm\n", 1e3 * body.q(), 1e3 * (predicted - 0.5 * speed * dt));
  EXPECT_NEAR(body.q(), predicted - 0.5 * speed * dt, 0.01 * predicted);
  const double rest = body.q();
  for (int i = 0; i < 1000; ++i) body.step(dt);
  EXPECT_NEAR(body.q(), rest, 1e-9) << "creep";
}

TEST(ObjectJoint, BallWithFrictionStopsWhereCoulombPredicts) {
  JointLaw law = law_of(ObjectJointKind::ball);
  law.friction = 1e-3;
  OneBody body(law, Vector3::Zero());
  const double spin = 6, dt = 1e-3;
  body.state.body_velocities[0].angular = spin * Vector3(0.6, 0, 0.8);
  for (int i = 0; i < 1000; ++i) body.step(dt);
  const double turned = rotation_log(body.state.body_poses[0].orientation).norm();
  const double predicted = spin * spin * OneBody::turning / (2 * law.friction);
  EXPECT_NEAR(turned, predicted - 0.5 * spin * dt, 0.02 * predicted);
}

TEST(ObjectJoint, FrictionOfALoadedHingeIsCoefficientTimesRadiusTimesReaction) {
  // A wheel on its axis (world y) under a load along x slows down by mu r N/I.
  JointLaw law = law_of(ObjectJointKind::hinge);
  law.load_friction = 0.3 * 0.02;
  for (const double gravity : {5.0, 20.0}) {
    OneBody body(law, {gravity, 0, 0});
    body.state.body_velocities[0].angular = {0, 60, 0};
    const double dt = 1e-3;
    for (int i = 0; i < 20; ++i) body.step(dt);
    const double before = body.state.body_velocities[0].angular.y();
    for (int i = 0; i < 50; ++i) body.step(dt);
    const double torque = (before - body.state.body_velocities[0].angular.y()) / (50 * dt) * OneBody::turning;
    const double expected = law.load_friction * OneBody::mass * gravity;
    std::printf("  torque %.6g N m, mu r N %.6g N m\n", torque, expected);
    EXPECT_NEAR(torque, expected, 2e-3 * expected);
  }
  // The load m g lies off the axis by an arm, so friction holds up to an arm of mu r.
  for (const double share : {0.8, 1.2}) {
    OneBody body(law, {0, 0, 9.81}, Vector3(share * law.load_friction, 0, 0));
    for (int i = 0; i < 180; ++i) body.step();
    // The first step has no reaction of a step before. Above mu r the body falls until the torque m g arm cos q is that
    // of the friction.
    EXPECT_EQ(std::abs(body.q()) > 0.9 * std::acos(1 / 1.2), share > 1) << body.q();
    EXPECT_EQ(std::abs(body.q()) < 0.05, share < 1) << body.q();
  }
}

TEST(ObjectJoint, TheForceOfFrictionStaysWhenTheLoadChangesItsStiffness) {
  // A light wheel: k_f is B/(2 mrad). A torque below the bound winds the friction up, and the load then grows slowly.
  JointLaw law = law_of(ObjectJointKind::slider);
  law.load_friction = 0.4;
  OneBody body(law, {10, -2, 0});
  for (int i = 0; i < 100; ++i) body.step();
  const double held = body.q();
  const auto load = [&body](double across) {
    body.inertia.set_dynamic(0, OneBody::mass, OneBody::turning * Matrix3::Identity(), {across, -2, 0});
  };
  for (int i = 0; i < 100; ++i) {
    load(10 + 40.0 * i);
    body.step();
  }
  // The friction carries the weight of 2 m/s^2 all the time: the cube moves by less than the elastic slide.
  EXPECT_LE(std::abs(body.q() - held), 1e-4);
}

TEST(ObjectJoint, FrictionHoldsALoadBelowItsBoundAndSlipsAbove) {
  JointLaw law = law_of(ObjectJointKind::slider);
  law.friction = 0.5;
  OneBody held(law, {0, -0.98 * law.friction / OneBody::mass, 0});
  for (int i = 0; i < 200; ++i) held.step();
  const double sag = held.q();
  EXPECT_LE(std::abs(sag), 1.1e-4);
  for (int i = 0; i < 500; ++i) held.step();
  EXPECT_NEAR(held.q(), sag, 1e-10) << "creep";
  OneBody slipping(law, {0, -1.2 * law.friction / OneBody::mass, 0});
  for (int i = 0; i < 90; ++i) slipping.step();
  // Acceleration 0.2 B/m for a second.
  EXPECT_NEAR(slipping.q(), -0.5 * 0.2 * law.friction / OneBody::mass, 0.05);
}

TEST(ObjectJoint, LimitsHold) {
  for (const ObjectJointKind kind : {ObjectJointKind::slider, ObjectJointKind::hinge, ObjectJointKind::screw}) {
    JointLaw law = law_of(kind);
    law.minimum = -0.02;
    law.maximum = 0.03;
    if (kind == ObjectJointKind::screw) law.maximum = 9;  // more than one turn
    OneBody body(law, Vector3::Zero());
    for (const double direction : {-1.0, 1.0}) {
      for (int i = 0; i < 400; ++i) {
        (kind == ObjectJointKind::slider ? body.state.body_velocities[0].linear : body.state.body_velocities[0].angular)
            .y() += direction * 0.05;
        body.step();
      }
      EXPECT_NEAR(body.q(), direction > 0 ? law.maximum : law.minimum, 1e-4) << to_string(kind);
      EXPECT_LE(body.term.gap(0, body.state), 1e-5) << to_string(kind);
    }
  }
}

TEST(ObjectJoint, AScrewAdvancesByItsPitch) {
  OneBody body(law_of(ObjectJointKind::screw), Vector3::Zero());
  body.state.body_velocities[0].angular = {0, 7, 0};
  for (int i = 0; i < 270; ++i) body.step();
  EXPECT_GT(body.q(), 3 * kPi) << "counts turns";
  EXPECT_NEAR(body.state.body_poses[0].position.y(), 0.003 * body.q() / (2 * kPi), 1e-6);
  EXPECT_LE(body.term.misalignment(0, body.state), 1e-4);
}

TEST(ObjectJoint, AScrewThatALoadOpensByMoreThanHalfItsPitchKeepsItsTurn) {
  // Friction holds the thread, and the held offset opens by F/k with k = 1000 m/dt^2.
  const double force = 40, opening = force * kStep * kStep / (1000 * OneBody::mass);
  JointLaw law = law_of(ObjectJointKind::screw);
  law.friction = 0.5;
  for (const double share : {0.7, 1.1, 2.6}) {
    law.pitch = opening / share;
    OneBody body(law, {0, -force / OneBody::mass, 0});
    for (int i = 0; i < 45; ++i) body.step();
    OneBody loaded(law, {0, -force / OneBody::mass, 0});
    loaded.state = body.state;
    loaded.term.load(body.term.save());
    EXPECT_EQ(loaded.q(), body.q());
    for (int i = 0; i < 45; ++i) {
      body.step();
      loaded.step();
    }
    EXPECT_EQ(loaded.state.body_poses[0].position, body.state.body_poses[0].position);
    EXPECT_NEAR(body.state.body_poses[0].position.y(), -opening, 0.02 * opening) << share;
    EXPECT_NEAR(body.term.gap(0, body.state), opening, 0.02 * opening) << share;
    EXPECT_NEAR(body.q(), 0, 0.01) << share;
    // A joint that is set anew, or reset, takes the turn of its place.
    body.term.reset();
    EXPECT_NEAR(body.q(), -std::round(share) * 2 * kPi, 0.01);
  }
}

// A push button: a spring that is compressed at rest against the upper limit, and a hump that snaps.
JointLaw button() {
  JointLaw law = law_of(ObjectJointKind::slider);
  law.minimum = -0.004;
  law.maximum = 0;
  law.stiffness = 300;
  law.rest = 0.002;
  law.damping = 2;
  law.detents[0] = {-0.0025, 0.0008, 0.0015, 0};
  law.detent_count = 1;
  return law;
}

TEST(ObjectJoint, ButtonRestsWhereItsForcesBalanceAndSnapsAtItsLargestForce) {
  const JointLaw law = button();
  // The button resists with F(q) = -dU/dq. It snaps at the largest F outside the well's steep side.
  double largest = 0;
  for (double q = 0; q > -0.0015; q -= 1e-7) largest = std::max(largest, -law.potential(q).slope);
  // Push slowly with a growing force until the button jumps.
  double force = 0, before = 0;
  OneBody body(law, Vector3::Zero());
  for (int i = 0; i < 50; ++i) body.step();
  const double rest = body.q();
  EXPECT_NEAR(rest, 0, 2e-5) << "pre-compressed against its limit";
  for (;; force += 2e-4) {
    body.inertia.set_dynamic(0, OneBody::mass, OneBody::turning * Matrix3::Identity(), {0, -force / OneBody::mass, 0});
    before = body.q();
    for (int i = 0; i < 3; ++i) body.step(0.02);
    if (before - body.q() > 2e-4 && before < -1e-4) break;
    ASSERT_LT(force, 3);
  }
  std::printf("  snaps at %.4f N, exact %.4f N\n", force, largest);
  EXPECT_NEAR(force, largest, 0.01 * largest);
  // Released, it returns through the well to its limit: the spring is stronger than the well.
  body.inertia.set_dynamic(0, OneBody::mass, OneBody::turning * Matrix3::Identity(), Vector3::Zero());
  for (int i = 0; i < 400; ++i) body.step();
  EXPECT_NEAR(body.q(), rest, 1e-7);
}

TEST(ObjectJoint, DetentsHoldTheAnalyticPositionUnderALoad) {
  JointLaw law = law_of(ObjectJointKind::hinge);
  law.damping = 1e-3;
  law.detents[0] = {0, 0.004, 0.2, kPi / 6};
  law.detent_count = 1;
  const double strongest = 96.0 / (25 * std::sqrt(5.0)) * law.detents[0].depth / law.detents[0].width;
  // Gravity on an arm of a light body is the torque.
  for (const double share : {0.5, 0.95, 1.05}) {
    const double arm = 0.02;
    OneBody body(law, {-share * strongest / (OneBody::mass * arm), 0, 0}, Vector3(0, 0, arm));
    for (int i = 0; i < 400; ++i) body.step();
    const double q = body.q();
    if (share > 1) {
      EXPECT_GT(std::abs(q), 0.2) << "snapped out";
      continue;
    }
    EXPECT_LT(std::abs(q), 0.2 / std::sqrt(5.0));
    std::printf("  holds %.4g of %.4g N m at %.4f rad\n", std::abs(law.potential(q).slope), strongest, q);
    EXPECT_NEAR(std::abs(law.potential(q).slope), share * strongest * std::abs(std::cos(q)), 1e-3 * strongest);
  }
}

// --- two free bodies -----------------------------------------------------------------------------

TEST_P(ObjectJointKinds, TwoFreeBodiesKeepTheirMomentum) {
  const ObjectJoint joint = with_laws(GetParam());
  Inertia inertia({1.0}, 2);
  inertia.set_dynamic(0, joint.parent_mass, joint.parent_inertia, Vector3::Zero());
  inertia.set_dynamic(1, joint.child_mass, joint.child_inertia, Vector3::Zero());
  ObjectJointEnergy term({1, 2}, 0, 2, 1);
  term.set_joint(0, joint);
  State state = posed(joint, 0, 0);
  state.node_velocities.setZero();
  for (Twist& twist : state.body_velocities) twist.linear *= 0.2;
  const auto momentum = [&] {
    Eigen::Matrix<double, 6, 1> sum = Eigen::Matrix<double, 6, 1>::Zero();
    for (std::size_t b = 0; b < 2; ++b) {
      const double mass = b == 0 ? joint.parent_mass : joint.child_mass;
      const Matrix3 axes = state.body_poses[b].orientation.toRotationMatrix();
      const Vector3 spin = axes * (b == 0 ? joint.parent_inertia : joint.child_inertia) * axes.transpose() *
                           state.body_velocities[b].angular;
      const Vector3 linear = mass * state.body_velocities[b].linear;
      sum.head<3>() += linear;
      sum.tail<3>() += state.body_poses[b].position.cross(linear) + spin;
    }
    return sum;
  };
  DenseStepper stepper({&inertia, &term}, state);
  const auto before = momentum();
  for (int i = 0; i < 100; ++i) stepper.step(state, 1e-3, 1e-13);
  const auto after = momentum();
  std::printf("  momentum changes by %.2g, angular momentum by %.2g in 100 steps\n",
              (after - before).head<3>().norm() / before.head<3>().norm(),
              (after - before).tail<3>().norm() / before.tail<3>().norm());
  EXPECT_LE((after - before).head<3>().norm(), 1e-9 * before.head<3>().norm());
  // Backward Euler takes the torque at the end of the step and the arm at both ends: O(dt) of the angular momentum.
  EXPECT_LE((after - before).tail<3>().norm(), 0.02 * before.tail<3>().norm());
}

TEST_P(ObjectJointKinds, LedgerCloses) {
  const ObjectJoint joint = with_laws(GetParam());
  Inertia inertia({1.0}, 2);
  inertia.set_dynamic(0, joint.parent_mass, joint.parent_inertia, Vector3::Zero());
  inertia.set_dynamic(1, joint.child_mass, joint.child_inertia, Vector3(0, -1, 0));
  ObjectJointEnergy term({1, 2}, 0, 2, 1);
  term.set_joint(0, joint);
  SolverOptions options;
  options.max_iterations = 60;
  options.residual_tolerance = 1e-11;
  options.increment_tolerance = 1e-14;
  State state = posed(joint, 0, 0);
  state.node_velocities.setZero();
  NewtonSolver solver({&inertia, &term}, state.layout(), options);
  solver.measure_work(true, true);
  EnergyLedger ledger;
  const auto step = [&] {
    const StepReport report = solver.step(state, kStep);
    ASSERT_TRUE(report.state_changed && report.measured);
    EnergyFlow flow = inertia.flow(report.terms[0].start, report.terms[0].joules, report.terms[0].taken);
    flow += term.flow(report.terms[1].start, report.terms[1].joules, report.terms[1].taken);
    ledger.add(flow);
  };
  for (int i = 0; i < 30; ++i) step();
  // A joint that is cleared and set again enters as work.
  term.clear_joint(0);
  step();
  term.set_joint(0, joint);
  for (int i = 0; i < 30; ++i) step();
  EXPECT_LE(ledger.defect(), 1e-6);
  if (joint.law.has_coordinate()) {
    EXPECT_GT(ledger.total().friction, 0);
  }
}

TEST_P(ObjectJointKinds, AStepThatDoesNotEndHasNoEffectAndMemoryRepeatsTheBits) {
  const ObjectJoint joint = with_laws(GetParam());
  Inertia inertia({1.0}, 2);
  inertia.set_dynamic(0, joint.parent_mass, joint.parent_inertia, Vector3::Zero());
  inertia.set_dynamic(1, joint.child_mass, joint.child_inertia, Vector3(0, -1, 0));
  ObjectJointEnergy term({1, 2}, 0, 2, 1);
  term.set_joint(0, joint);
  State state = posed(joint, 0, 0);
  DenseStepper stepper({&inertia, &term}, state);
  for (int i = 0; i < 10; ++i) stepper.step(state, kStep);
  const State saved = state;
  const ObjectJointEnergy::Memory memory = term.save();
  for (int i = 0; i < 5; ++i) stepper.step(state, kStep);
  const State expected = state;
  const ObjectJointEnergy::Memory after = term.save();

  state = saved;
  term.load(memory);
  term.begin_step(testing::perturbed(saved, 4, 0.01, 0.5), 0.3);
  for (int i = 0; i < 5; ++i) stepper.step(state, kStep);
  EXPECT_EQ(term.save().joints[0].anchor, after.joints[0].anchor);
  EXPECT_EQ(term.save().stored, after.stored);
  for (std::size_t b = 0; b < 2; ++b) {
    EXPECT_EQ(state.body_poses[b].position, expected.body_poses[b].position);
    EXPECT_EQ(state.body_poses[b].orientation.coeffs(), expected.body_poses[b].orientation.coeffs());
  }
}

TEST_P(ObjectJointKinds, AfterAResetTheTermStepsLikeAFreshOne) {
  const ObjectJoint joint = with_laws(GetParam());
  const auto stepped = [&joint](State state, int earlier_steps) {
    Inertia inertia({1.0}, 2);
    inertia.set_dynamic(0, joint.parent_mass, joint.parent_inertia, Vector3::Zero());
    inertia.set_dynamic(1, joint.child_mass, joint.child_inertia, Vector3(0, -1, 0));
    ObjectJointEnergy term({1, 2}, 0, 2, 1);
    term.set_joint(0, joint);
    DenseStepper stepper({&inertia, &term}, state);
    State earlier = state;
    for (int i = 0; i < earlier_steps; ++i) stepper.step(earlier, kStep);
    term.reset();
    for (int i = 0; i < 3; ++i) stepper.step(state, kStep);
    return state;
  };
  const State start = posed(joint, 0, 0);
  const State fresh = stepped(start, 0), reset = stepped(start, 10);
  for (std::size_t b = 0; b < 2; ++b) {
    EXPECT_EQ(reset.body_poses[b].position, fresh.body_poses[b].position);
    EXPECT_EQ(reset.body_poses[b].orientation.coeffs(), fresh.body_poses[b].orientation.coeffs());
  }
}

TEST(ObjectJoint, WorkOfAMovedParentEntersTheLedger) {
  JointLaw law = law_of(ObjectJointKind::hinge);
  law.friction = 0.001;
  OneBody body(law, {0, -9.81, 0}, Vector3(0.03, 0, 0));
  SolverOptions options;
  options.max_iterations = 60;
  options.residual_tolerance = 1e-11;
  options.increment_tolerance = 1e-14;
  NewtonSolver solver({&body.inertia, &body.term}, body.state.layout(), options);
  solver.measure_work(true, true);
  EnergyLedger ledger;
  Pose parent;
  for (int i = 0; i < 100; ++i) {
    const Twist velocity{Vector3(0.1 * std::cos(0.1 * i), 0, 0.05), Vector3(0, std::sin(0.07 * i), 0.3)};
    body.term.set_parent_motion(0, parent, velocity);
    parent = advanced(parent, velocity, kStep);
    const StepReport report = solver.step(body.state, kStep);
    EnergyFlow flow = body.inertia.flow(report.terms[0].start, report.terms[0].joules, report.terms[0].taken);
    flow += body.term.flow(report.terms[1].start, report.terms[1].joules, report.terms[1].taken);
    ledger.add(flow);
  }
  EXPECT_LE(ledger.defect(), 1e-6);
}

TEST(ObjectJoint, AllocatesNothingAfterBind) {
  const ObjectJoint joint = with_laws(ObjectJointKind::hinge);
  ObjectJointEnergy term({1, 2}, 0, 2, 1);
  term.set_joint(0, joint);
  State state = posed(joint, 0.2, 0);
  BlockMatrix matrix = testing::bound_matrix(term, state);
  VectorX gradient = VectorX::Zero(state.layout().dof_count());
  counting = true;
  allocations = 0;
  term.begin_step(state, kStep);
  term.add_all(state, gradient, matrix, Curvature::projected);
  term.end_step(state);
  term.clear_joint(0);
  term.set_joint(0, joint);
  counting = false;
  EXPECT_EQ(allocations, 0);
}

TEST(ObjectJoint, RefusesLawsThatCannotRun) {
  ObjectJointEnergy term({1, 2}, 0, 2, 1);
  const auto refused = [&term](ObjectJoint joint) { EXPECT_THROW(term.set_joint(0, joint), std::invalid_argument); };
  ObjectJoint joint = joint_of(ObjectJointKind::screw);
  joint.law.pitch = 0;
  refused(joint);
  joint = joint_of(ObjectJointKind::hinge);
  joint.law.minimum = -4;
  joint.law.maximum = 4;
  refused(joint);
  joint = joint_of(ObjectJointKind::fixed);
  joint.law.friction = 1;
  refused(joint);
  joint = joint_of(ObjectJointKind::slider);
  joint.child = 2;
  refused(joint);
  joint = joint_of(ObjectJointKind::slider);
  joint.law.detents[0].period = 0.5;  // shorter than the well
  joint.law.detent_count = 1;
  refused(joint);
}

}  // namespace
}  // namespace softhand::object_joint_test
