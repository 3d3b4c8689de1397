// Inertia: derivatives, conservation, and the rigid body's known motions.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "energies/dense_step.hpp"
#include "energies/inertia.hpp"
#include "math/rotation.hpp"

namespace softhand::skeleton_inertia_test {
namespace {

using testing::DenseStepper;

const Vector3 kGravity(0, -9.81, 0);

Matrix3 crooked_inertia() {
  const Matrix3 r = rotation_exp(Vector3(0.4, -0.8, 0.3)).toRotationMatrix();
  return r * Vector3(2e-5, 3e-5, 4.5e-5).asDiagonal() * r.transpose();
}

// One free body without other energies. One projected Newton step is exact at any speed.
struct FreeBody {
  explicit FreeBody(const Matrix3& inertia_body, double mass = 1.0, const Vector3& gravity = Vector3::Zero())
      : state(testing::random_state({0, 1}, 3)), inertia({}, 1) {
    state.body_poses[0] = Pose{};
    state.body_velocities[0] = Twist{};
    inertia.set_dynamic(0, mass, inertia_body, gravity);
    body_inertia = inertia_body;
  }
  Vector3 momentum() const {
    const Matrix3 r = state.body_poses[0].orientation.toRotationMatrix();
    return r * body_inertia * r.transpose() * state.body_velocities[0].angular;
  }
  State state;
  Inertia inertia;
  Matrix3 body_inertia;
};

TEST(Inertia, Derivatives) {
  Inertia inertia({0.1, 0.3, 0.02}, 3);
  inertia.set_node_gravity(kGravity);
  inertia.set_dynamic(0, 0.2, crooked_inertia(), kGravity);
  inertia.set_dynamic(2, 0.05, 0.1 * crooked_inertia(), Vector3::Zero());  // body 1 stays held
  const State start = testing::random_state({3, 3}, 11, 0.1, 5.0);
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    const State state = testing::perturbed(start, seed, 0.02, 1.2);
    testing::check_term(inertia, start, 1.0 / 90, state);
  }
  // A soft part alone, because a stiff part could hide its errors.
  Inertia soft({1e-4}, 1);
  soft.set_dynamic(0, 1e-3, 1e-2 * crooked_inertia(), Vector3::Zero());
  const State soft_start = testing::random_state({1, 1}, 12);
  testing::check_term(soft, soft_start, 0.01, testing::perturbed(soft_start, 1, 0.05, 1.7));
}

TEST(Inertia, RefusesMassesThatAreNotPositive) {
  EXPECT_THROW(Inertia({1.0, 0.0}, 0), std::invalid_argument);
  EXPECT_THROW(Inertia({std::numeric_limits<double>::quiet_NaN()}, 0), std::invalid_argument);
}

TEST(Inertia, FreeFallMatchesBackwardEuler) {
  Inertia inertia({0.5}, 2);
  inertia.set_node_gravity(kGravity);
  inertia.set_dynamic(0, 2.0, Matrix3::Identity(), kGravity);
  State state = testing::random_state({1, 2}, 5);
  const State start = state;
  DenseStepper stepper({&inertia}, state);
  constexpr double dt = 1.0 / 90;
  constexpr int steps = 90;
  for (int i = 0; i < steps; ++i) stepper.step(state, dt);
  // Backward Euler: v_n = v_0 + n dt g, x_n = x_0 + n dt v_0 + n (n + 1)/2 dt^2 g.
  const Vector3 fallen = 0.5 * steps * (steps + 1) * dt * dt * kGravity;
  EXPECT_LE((state.node_positions - start.node_positions - steps * dt * start.node_velocities - fallen).norm(), 1e-11);
  EXPECT_LE((state.body_poses[0].position - start.body_poses[0].position -
             steps * dt * start.body_velocities[0].linear - fallen)
                .norm(),
            1e-11);
  EXPECT_LE((state.node_velocities - start.node_velocities - steps * dt * kGravity).norm(), 1e-11);
  // The held body has moved with its velocity.
  EXPECT_LE((state.body_poses[1].position - start.body_poses[1].position - steps * dt * start.body_velocities[1].linear)
                .norm(),
            1e-11);
  const Quaternion turned =
      rotation_exp(steps * dt * start.body_velocities[1].angular) * start.body_poses[1].orientation;
  EXPECT_LE(rotation_log(state.body_poses[1].orientation * turned.conjugate()).norm(), 1e-11);
  EXPECT_EQ(state.body_velocities[1].angular, start.body_velocities[1].angular);
}

TEST(Inertia, TumblingConservesAngularMomentumToRounding) {
  FreeBody body(crooked_inertia());
  body.state.body_velocities[0].angular = Vector3(12, -7, 30);
  const Vector3 before = body.momentum();
  const double energy = body.inertia.kinetic_energy(body.state);
  DenseStepper stepper({&body.inertia}, body.state);
  for (int i = 0; i < 5000; ++i) stepper.step(body.state, 1.0 / 90);
  EXPECT_LE((body.momentum() - before).norm(), 1e-11 * before.norm());
  // The momentum bounds the energy at all times: L^2/(2 I_max) .. L^2/(2 I_min).
  EXPECT_LE(body.inertia.kinetic_energy(body.state), before.squaredNorm() / (2 * 2e-5));
  EXPECT_GE(body.inertia.kinetic_energy(body.state), before.squaredNorm() / (2 * 4.5e-5));
  EXPECT_GT(energy, 0);
}

TEST(Inertia, FastSpinStaysStableAtAHeadsetsRate) {
  // 100 rad/s at 90 Hz are 1.1 rad per step. The body spins about its stable largest axis, with a wobble.
  FreeBody body(Vector3(2e-5, 3e-5, 4.5e-5).asDiagonal());
  body.state.body_velocities[0].angular = Vector3(1, 0, 100);
  const Vector3 before = body.momentum();
  DenseStepper stepper({&body.inertia}, body.state);
  for (int i = 0; i < 9000; ++i) {
    stepper.step(body.state, 1.0 / 90);
    ASSERT_NEAR(body.state.body_velocities[0].angular.norm(), 100, 5) << i;
  }
  EXPECT_LE((body.momentum() - before).norm(), 1e-10 * before.norm());
}

TEST(Inertia, TurnsBeyondTheShortestArcAreLimitedAndFinite) {
  FreeBody body(Matrix3::Identity());
  body.state.body_velocities[0].angular = Vector3(0, 1000, 0);
  DenseStepper stepper({&body.inertia}, body.state);
  stepper.step(body.state, 1.0 / 90);
  EXPECT_TRUE(all_finite(body.state));
  EXPECT_NEAR(body.state.body_velocities[0].angular.norm(), 270, 1e-6);
}

TEST(Inertia, KineticEnergyMatchesTheClosedForm) {
  Inertia inertia({2.0}, 2);
  inertia.set_dynamic(0, 3.0, Vector3(1, 2, 4).asDiagonal(), Vector3::Zero());
  State state = testing::random_state({1, 2}, 9);
  state.node_velocities.col(0) = Vector3(1, 2, 2);
  state.body_poses[0].orientation = rotation_exp(Vector3(0, 0, M_PI / 2));  // body x is world y
  state.body_velocities[0] = {Vector3(0, 2, 0), Vector3(0, 3, 0)};
  EXPECT_NEAR(inertia.kinetic_energy(state), 0.5 * 2 * 9 + 0.5 * 3 * 4 + 0.5 * 1 * 9,
              1e-12);  // the held body does not count
}

}  // namespace
}  // namespace softhand::skeleton_inertia_test
