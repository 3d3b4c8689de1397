// The coupling of eq. 18: derivatives, caps, damping, and the known results of couplings in series.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "energies/body_coupling.hpp"
#include "energies/dense_step.hpp"
#include "energies/inertia.hpp"
#include "energies/memory_suite.hpp"

namespace softhand::skeleton_coupling_test {
namespace {

using testing::DenseStepper;

constexpr double kTimeStep = 1.0 / 90;

CouplingSite site_of(int body, const CouplingGains& gains) {
  return {body, Pose{Vector3(0.01, -0.02, 0.03), rotation_exp(Vector3(0.3, 0.1, -0.5))}, gains};
}

// Body 0 is coupled at a site away from its centre of mass. Body 1 is not coupled.
struct Coupled {
  explicit Coupled(const CouplingGains& gains, std::uint64_t seed = 1)
      : state(testing::random_state({2, 2}, seed)), coupling("coupling", {site_of(0, gains)}, state.layout()) {}
  Pose frame() const { return state.body_poses[0] * site_of(0, {}).body_from_frame; }
  // Sets a target that differs from the frame by the given stretch and turn.
  void aim(const Vector3& stretch, const Vector3& turn, const Twist& velocity = {}) {
    coupling.set_target(0, increment(frame(), stretch, turn), velocity);
  }
  State state;
  BodyCoupling coupling;
};

TEST(BodyCoupling, DerivativesBelowTheCap) {
  for (const double angle : {0.01, 0.5, 2.0, 3.0}) {
    Coupled c({500, 0.5, 0, 0});
    c.aim(Vector3(0.01, 0.02, -0.01), angle * Vector3(0.6, 0, -0.8));
    testing::check_term(c.coupling, c.state, kTimeStep);
  }
}

TEST(BodyCoupling, DerivativesOfSpringAndDamperBeyondTheCaps) {
  const Twist velocity{Vector3(0.3, -0.1, 0.2), Vector3(1, 2, -1)};
  for (const double angle : {0.5, 2.0}) {
    Coupled c({500, 0.5, 3, 0.01, 4, 0.2});
    c.aim(Vector3(0.1, 0.2, -0.1), angle * Vector3(0.6, 0, -0.8), velocity);
    testing::check_term(c.coupling, c.state, kTimeStep, testing::perturbed(c.state, 4, 0.01, 0.2));
    EXPECT_NEAR(c.coupling.wrench(0, c.state).force.norm(), 4, 1e-12);
    EXPECT_NEAR(c.coupling.wrench(0, c.state).torque.norm(), 0.2, 1e-12);
  }
}

// With a damper the spring's target lags, and moves by less than the given target.
TEST(BodyCoupling, FollowedIsTheMovementOfTheTargetOfSpringAndDamper) {
  for (const double damping : {0.0, 20.0}) {
    Coupled c({500, 0.5, damping, 0});
    c.aim(Vector3(0.001, 0, 0), Vector3::Zero());
    c.coupling.begin_step(c.state, kTimeStep);
    EXPECT_FALSE(c.coupling.followed(0)) << "nothing is known of the step before";
    c.coupling.end_step(c.state);
    const Vector3 moved(0.003, -0.002, 0.001), turned(0.1, 0.05, -0.02);
    const Pose frame = c.frame();
    c.aim(Vector3(0.001, 0, 0) + moved, turned);
    c.coupling.begin_step(c.state, kTimeStep);
    const auto followed = c.coupling.followed(0);
    ASSERT_TRUE(followed);
    const Pose end = *followed * site_of(0, {}).body_from_frame;
    const double share = 500 / (500 + damping / kTimeStep);
    EXPECT_LE((end.position - frame.position - share * moved).norm(), 1e-12);
    EXPECT_LE((rotation_log(end.orientation * frame.orientation.conjugate()) - turned).norm(), 1e-12);
    c.coupling.end_step(c.state);
    c.coupling.reset();
    c.coupling.begin_step(c.state, kTimeStep);
    EXPECT_FALSE(c.coupling.followed(0)) << "after a reset";
  }
}

TEST(BodyCoupling, ExertsNoWrenchAtTheTarget) {
  Coupled c({500, 0.5, 0, 0});
  c.aim(Vector3::Zero(), Vector3::Zero());
  c.coupling.begin_step(c.state, kTimeStep);
  EXPECT_LE(c.coupling.value(c.state), 1e-25);
  EXPECT_LE(c.coupling.wrench(0, c.state).force.norm(), 1e-12);
  EXPECT_LE(c.coupling.wrench(0, c.state).torque.norm(), 1e-12);
}

TEST(BodyCoupling, ExertsNoWrenchWithoutATarget) {
  Coupled c({500, 0.5, 3, 0.01});
  c.aim(Vector3(0.1, 0, 0), Vector3(0.1, 0, 0));
  c.coupling.clear_target(0);
  c.coupling.begin_step(c.state, kTimeStep);
  EXPECT_EQ(c.coupling.value(c.state), 0);
  VectorX gradient = VectorX::Zero(c.state.layout().dof_count());
  c.coupling.add_gradient(c.state, gradient);
  EXPECT_EQ(gradient.norm(), 0);
  EXPECT_EQ(c.coupling.wrench(0, c.state).force.norm(), 0);
}

TEST(BodyCoupling, WrenchIsThatOfTheSpringAboutTheFramesOrigin) {
  Coupled c({500, 0.5, 0, 0});
  const Vector3 stretch(0.01, 0.02, -0.01), turn(0.4, -0.3, 0.2);
  c.aim(stretch, turn);
  const BlockMatrix matrix = testing::bound_matrix(c.coupling, c.state);
  c.coupling.begin_step(c.state, kTimeStep);
  const Wrench wrench = c.coupling.wrench(0, c.state);
  EXPECT_LE((wrench.force - 500 * stretch).norm(), 1e-11);
  EXPECT_LE((wrench.torque - 0.5 * turn).norm(), 1e-12);
  VectorX gradient = VectorX::Zero(c.state.layout().dof_count());
  c.coupling.add_gradient(c.state, gradient);
  const Vector3 arm = c.frame().position - c.state.body_poses[0].position;
  EXPECT_LE((gradient.segment<3>(6) + wrench.force).norm(), 1e-12);
  EXPECT_LE((gradient.segment<3>(9) + wrench.torque + arm.cross(wrench.force)).norm(), 1e-12);
}

TEST(BodyCoupling, SignOfTheQuaternionDoesNotMatterAndPiIsFinite) {
  Coupled c({500, 0.5, 1, 0.01});
  for (const double angle : {M_PI - 1e-9, M_PI, M_PI + 1e-9}) {
    Pose target = increment(c.frame(), Vector3::Zero(), angle * Vector3::UnitY());
    c.coupling.set_target(0, target, {});
    c.coupling.begin_step(c.state, kTimeStep);
    const double value = c.coupling.value(c.state);
    BlockMatrix matrix = testing::bound_matrix(c.coupling, c.state);
    c.coupling.add_hessian(c.state, matrix, Curvature::exact);
    EXPECT_TRUE(matrix.dense().allFinite());
    target.orientation.coeffs() *= -1;
    c.coupling.set_target(0, target, {});
    c.coupling.begin_step(c.state, kTimeStep);
    EXPECT_NEAR(c.coupling.value(c.state), value, 1e-7);
    EXPECT_TRUE(std::isfinite(value));
  }
}

TEST(BodyCoupling, TransverseStiffnessOfTheTurn) {
  // The stiffness across the turn's axis is k_a (t/2) cot(t/2): 0.785 k_a at 90 degrees, 0.0136 k_a at 179 degrees, and
  // 0 at 180 degrees. Along the turn's own axis it is k_a.
  for (const auto& [degrees, expected] :
       {std::pair{90.0, 0.785398}, std::pair{179.0, 0.013632}, std::pair{180.0, 0.0}}) {
    Coupled c({0, 2.0, 0, 0});
    c.coupling = BodyCoupling("coupling", {{0, Pose{}, {0, 2.0, 0, 0}}}, c.state.layout());
    c.coupling.set_target(
        0, increment(c.state.body_poses[0], Vector3::Zero(), -degrees * M_PI / 180 * Vector3::UnitZ()), {});
    BlockMatrix matrix = testing::bound_matrix(c.coupling, c.state);
    c.coupling.begin_step(c.state, kTimeStep);
    c.coupling.add_hessian(c.state, matrix, Curvature::exact);
    const Matrix3 rotation = matrix.dense().block<3, 3>(9, 9);
    EXPECT_NEAR(rotation(0, 0), 2.0 * expected, 2e-6) << degrees;
    EXPECT_NEAR(rotation(1, 1), 2.0 * expected, 2e-6) << degrees;
    EXPECT_NEAR(rotation(2, 2), 2.0, 1e-9) << degrees;
  }
}

TEST(BodyCoupling, DampingIsThatOfTheDissipationPotential) {
  // Spring and damper act as one spring. At every state of the step the force is
  // k (x_b - x) + b (v_b - (x - x_i)/dt).
  const Twist velocity{Vector3(0.3, -0.1, 0.2), Vector3(0.02, 0.01, -0.03)};
  Coupled c({500, 0.5, 3, 0.01});
  c.aim(Vector3(0.01, 0.02, -0.01), Vector3(2e-3, -1e-3, 3e-3), velocity);
  const Pose target = increment(c.frame(), Vector3(0.01, 0.02, -0.01), Vector3(2e-3, -1e-3, 3e-3));
  const Pose start = c.frame();
  c.coupling.begin_step(c.state, kTimeStep);
  c.state = testing::perturbed(c.state, 3, 0.005, 2e-3);
  const Pose frame = c.frame();
  const Vector3 force =
      500 * (target.position - frame.position) + 3 * (velocity.linear - (frame.position - start.position) / kTimeStep);
  const Vector3 torque =
      0.5 * rotation_log(target.orientation * frame.orientation.conjugate()) +
      0.01 * (velocity.angular - rotation_log(frame.orientation * start.orientation.conjugate()) / kTimeStep);
  const Wrench wrench = c.coupling.wrench(0, c.state);
  EXPECT_LE((wrench.force - force).norm(), 1e-11);
  EXPECT_LE((wrench.torque - torque).norm(), 1e-5);  // small angles only
  EXPECT_GT(torque.norm(), 2e-3);
}

TEST(BodyCoupling, TwoInSeriesHaveTheKnownOffset) {
  // World --k1-- body 0 --k2-- (copy of body 0, exchanged each step) body 1 <- F.
  // The offset is F (1/k1 + 1/k2). One exchange contracts the error by k2/(k1 + k2).
  constexpr double k1 = 100, k2 = 1000, force = 0.5;
  State state = testing::random_state({0, 2}, 1);
  state.body_poses.assign(2, Pose{});
  state.body_velocities.assign(2, Twist{});
  // Quasi-static: light bodies and long steps.
  Inertia inertia({}, 2);
  inertia.set_dynamic(0, 1e-9, 1e-9 * Matrix3::Identity(), Vector3::Zero());
  inertia.set_dynamic(1, 1e-9, 1e-9 * Matrix3::Identity(), Vector3(force / 1e-9, 0, 0));
  BodyCoupling ground("ground", {{0, Pose{}, {k1, 1, 0, 0}}}, state.layout());
  BodyCoupling to_copy("to_copy", {{0, Pose{}, {k2, 1, 0, 0}}, {1, Pose{}, {k2, 1, 0, 0}}}, state.layout());
  ground.set_target(0, Pose{}, {});
  DenseStepper stepper({&inertia, &ground, &to_copy}, state);
  constexpr double offset = force * (1 / k1 + 1 / k2);
  double last_error = 0;
  for (int exchange = 0; exchange < 400; ++exchange) {
    to_copy.set_target(0, state.body_poses[1], {});
    to_copy.set_target(1, state.body_poses[0], {});
    stepper.step(state, 1.0);
    for (Twist& velocity : state.body_velocities) velocity = Twist{};
    const double error = offset - state.body_poses[1].position.x();
    // Both copies are one exchange old here, so two exchanges contract by k2/(k1 + k2).
    if (exchange >= 20 && exchange < 60 && exchange % 2 == 0) {
      if (last_error > 0) {
        EXPECT_NEAR(error / last_error, k2 / (k1 + k2), 1e-3) << exchange;
      }
      last_error = error;
    }
  }
  EXPECT_NEAR(state.body_poses[1].position.x(), offset, 1e-4 * offset);
}

TEST(BodyCoupling, DampedBodyFollowsAMovingCopyWithoutLag) {
  // The copy moves at constant velocity. Its given pose is that at the end of the step. So relative damping adds no
  // drag.
  const double mass = 0.02, k = 500;
  State state = testing::random_state({0, 1}, 1);
  state.body_poses[0] = Pose{};
  state.body_velocities[0] = Twist{};
  Inertia inertia({}, 1);
  inertia.set_dynamic(0, mass, 4e-6 * Matrix3::Identity(), Vector3::Zero());
  BodyCoupling coupling("coupling", {{0, Pose{}, {k, 0.5, 2 * std::sqrt(k * mass), 2 * std::sqrt(0.5 * 4e-6)}}},
                        state.layout());
  DenseStepper stepper({&inertia, &coupling}, state);
  const Twist velocity{Vector3(0.5, 0, 0.2), Vector3(0, 1.5, 0)};
  for (int i = 1; i <= 180; ++i) {
    const double time = i * kTimeStep;
    coupling.set_target(0, {time * velocity.linear, rotation_exp(time * velocity.angular)}, velocity);
    stepper.step(state, kTimeStep);
  }
  EXPECT_LE((state.body_poses[0].position - 2.0 * velocity.linear).norm(), 1e-9);
  EXPECT_LE(rotation_log(state.body_poses[0].orientation * rotation_exp(-2.0 * velocity.angular)).norm(), 1e-9);
  EXPECT_LE((state.body_velocities[0].linear - velocity.linear).norm(), 1e-8);
}

TEST(BodyCoupling, TeleportPullsNoHarderThanTheCap) {
  Coupled c({500, 0.5, 6, 0.003, 4, 1});
  Inertia inertia({0.1, 0.1}, 2);
  inertia.set_dynamic(0, 0.02, 4e-6 * Matrix3::Identity(), Vector3::Zero());
  c.state.body_velocities[0] = Twist{};
  c.coupling.set_target(0, increment(c.frame(), Vector3(10, 0, 0), Vector3(0, 3.1, 0)), {});
  DenseStepper stepper({&inertia, &c.coupling}, c.state);
  for (int i = 0; i < 200; ++i) {
    stepper.step(c.state, kTimeStep);
    ASSERT_TRUE(all_finite(c.state));
    const Wrench wrench = c.coupling.wrench(0, c.state);
    ASSERT_LE(wrench.force.norm(), 4 * (1 + 1e-12));
    ASSERT_LE(wrench.torque.norm(), 1 * (1 + 1e-12));
  }
}

TEST(BodyCoupling, StrengthMultipliesAllGainsAndCaps) {
  const Twist velocity{Vector3(0.3, -0.1, 0.2), Vector3(0.02, 0.01, -0.03)};
  for (const double stretch : {0.002, 0.2}) {  // below the caps and beyond them
    Coupled weakened({500, 0.5, 3, 0.01, 4, 0.2}), weak({100, 0.1, 0.6, 0.002, 0.8, 0.04});
    const Pose target = increment(weak.frame(), Vector3(stretch, 0, 0), Vector3(0, stretch, 0));
    weakened.coupling.set_target(0, target, velocity, 0.2);
    weak.coupling.set_target(0, target, velocity);
    testing::check_term(weakened.coupling, weakened.state, kTimeStep);
    for (Coupled* each : {&weakened, &weak}) {
      each->coupling.begin_step(each->state, kTimeStep);
      each->state = testing::perturbed(each->state, 3, 0.005, 2e-3);
    }
    const Wrench is = weakened.coupling.wrench(0, weakened.state), expected = weak.coupling.wrench(0, weak.state);
    ASSERT_GT(expected.force.norm(), 0.1);
    EXPECT_LE((is.force - expected.force).norm(), 1e-12);
    EXPECT_LE((is.torque - expected.torque).norm(), 1e-12);
    EXPECT_NEAR(weakened.coupling.value(weakened.state), weak.coupling.value(weak.state), 1e-12);
    weakened.coupling.set_target(0, target, velocity);
    weakened.coupling.begin_step(weakened.state, kTimeStep);
    EXPECT_GT(weakened.coupling.wrench(0, weakened.state).force.norm(), 4 * is.force.norm());
  }
}

TEST(BodyCoupling, MemoryRepeatsTheBits) {
  Coupled c({500, 0.5, 3, 0.01, 4, 0.2});
  Inertia inertia({1.0, 1.0}, 2);
  inertia.set_dynamic(0, 0.1, 1e-4 * Matrix3::Identity(), Vector3(0, -1, 0));
  DenseStepper stepper({&inertia, &c.coupling}, c.state);
  c.aim(Vector3(0.01, 0.02, -0.01), Vector3(0.6, 0, -0.8), {Vector3(0.3, 0, 0.1), Vector3(0, 1, 0)});
  testing::check_memory(c.coupling, c.state, [&](State& state) { stepper.step(state, kTimeStep); });
  BodyCoupling other("coupling", {}, c.state.layout());
  EXPECT_THROW(other.load(c.coupling.save()), std::invalid_argument);
}

TEST(BodyCoupling, RefusesInvalidGains) {
  const DofLayout layout{0, 1};
  const auto with = [&layout](const CouplingGains& gains) { BodyCoupling("c", {{0, Pose{}, gains}}, layout); };
  EXPECT_THROW(with({-1, 0}), std::invalid_argument);
  EXPECT_THROW(with({1, std::numeric_limits<double>::quiet_NaN()}), std::invalid_argument);
  EXPECT_THROW(with({1, 1, 0, 0, 0, 1}), std::invalid_argument);
  EXPECT_NO_THROW(with({1, 1}));
}

}  // namespace
}  // namespace softhand::skeleton_coupling_test
