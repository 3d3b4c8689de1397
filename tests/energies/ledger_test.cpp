// Compares the energy ledger's rows with closed forms, and its residual with zero. Cases: free fall, oscillator, moved
// spring, damper, sliding blocks, kinematic objects, switched contacts.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "energies/body_coupling.hpp"
#include "energies/contact.hpp"
#include "energies/friction.hpp"
#include "energies/inertia.hpp"
#include "energies/plane_contact.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "solver/newton_solver.hpp"
#include "support/node_contact.hpp"

namespace softhand::ledger_test {
namespace {

constexpr double kGravity = 9.81;
constexpr double kStep = 1.0 / 90;

SolverOptions exact() {
  SolverOptions options;
  options.max_iterations = 60;
  options.residual_tolerance = 1e-11;
  options.increment_tolerance = 1e-14;
  return options;
}

// Steps a few terms and keeps their energy ledger.
class LedgerSimulation {
 public:
  LedgerSimulation(std::vector<Energy*> terms, const State& state)
      : terms_(std::move(terms)), solver_(terms_, state.layout(), exact()) {
    solver_.measure_work(true, true);
  }

  void step(State& state, double time_step) {
    const StepReport report = solver_.step(state, time_step);
    ASSERT_TRUE(report.state_changed && report.measured) << to_string(report.status);
    EnergyFlow step;
    double taken = 0;
    for (std::size_t t = 0; t < terms_.size(); ++t) {
      const TermEnergy& term = report.terms[t];
      step += terms_[t]->flow(term.start, term.joules, term.taken);
      taken += term.taken;
    }
    if (ledger.started()) residual_work += taken;
    ledger.add(step);
  }
  void run(State& state, int steps, double time_step = kStep) {
    for (int i = 0; i < steps; ++i) step(state, time_step);
  }
  /// Stored energy, work and losses must add up, except for the residual force that the minimiser leaves.
  void expect_closed(double scale) const {
    EXPECT_NEAR(ledger.residual(), residual_work, 1e-10 * scale);
    EXPECT_NEAR(ledger.residual(), 0, 1e-6 * scale);
  }

  EnergyLedger ledger;
  double residual_work = 0;  // J

 private:
  std::vector<Energy*> terms_;
  NewtonSolver solver_;
};

State state_of(int nodes, int bodies) {
  State state;
  state.node_positions = state.node_velocities = Eigen::Matrix3Xd::Zero(3, nodes);
  state.body_poses.resize(static_cast<std::size_t>(bodies));
  state.body_velocities.resize(static_cast<std::size_t>(bodies));
  return state;
}

Shape make(ShapeKind kind, Vec3 size = {}) {
  Shape shape;
  shape.kind = static_cast<std::uint32_t>(kind);
  shape.size = size;
  return shape;
}

TEST(EnergyLedger, FreeFallMatchesTheClosedForm) {
  State state = state_of(1, 1);
  state.body_velocities[0].angular = Vector3(3, -2, 7);
  Inertia inertia({0.02}, 1);
  const Vector3 gravity(0, -kGravity, 0);
  inertia.set_node_gravity(gravity);
  inertia.set_dynamic(0, 0.3, Vector3(1e-4, 2e-4, 3e-4).asDiagonal(), gravity);
  LedgerSimulation simulation({&inertia}, state);
  simulation.step(state, kStep);
  const double height = state.body_poses[0].position.y();
  const double mass = 0.32;
  const int steps = 40;
  simulation.run(state, steps);
  const double fallen = height - state.body_poses[0].position.y();
  ASSERT_GT(fallen, 0.5);
  EXPECT_NEAR(simulation.ledger.total().work, mass * kGravity * fallen, 1e-12);
  // The integrator's loss is m/2 (g dt)^2 per step. A tumbling body's energy has a small, bounded error that depends on
  // its orientation.
  EXPECT_NEAR(simulation.ledger.total().integrator, steps * 0.5 * mass * std::pow(kGravity * kStep, 2),
              2e-3 * simulation.ledger.scale());
  simulation.expect_closed(1);
}

TEST(EnergyLedger, OscillatorLosesEnergyLikeBackwardEuler) {
  for (const double z : {0.1, 1.0}) {
    State state = state_of(1, 1);
    const double mass = 0.02, stiffness = mass * z * z / (kStep * kStep);
    Inertia inertia({1.0}, 1);
    inertia.set_dynamic(0, mass, 1e-5 * Matrix3::Identity(), Vector3::Zero());
    BodyCoupling spring("spring", {{0, Pose{}, {.linear_stiffness = stiffness}}}, state.layout());
    spring.set_target(0, {}, {});
    state.body_poses[0].position = Vector3(0.01, 0, 0);
    state.body_velocities[0].linear = Vector3(0, 0.1, 0);
    LedgerSimulation simulation({&inertia, &spring}, state);
    simulation.step(state, kStep);
    const double initial = simulation.ledger.initial();
    EXPECT_NEAR(initial, (0.5 * stiffness * 1e-4 + 0.5 * mass * 0.01) / (1 + z * z), 1e-9 * initial);
    simulation.run(state, 20);
    EXPECT_NEAR(simulation.ledger.total().integrator, initial * (1 - std::pow(1 + z * z, -20)), 1e-9 * initial) << z;
    EXPECT_NEAR(simulation.ledger.total().work, 0, 1e-12);
    simulation.expect_closed(initial);
  }
}

// A spring drags a body with an eccentric frame through a circle while the body turns. The spring's force is capped in
// one run and not in the other.
TEST(EnergyLedger, DamperOfADraggedBodyDissipatesForceTimesDistance) {
  for (const double cap : {1e9, 0.2}) {
    State state = state_of(1, 1);
    Inertia inertia({1.0}, 1);
    inertia.set_dynamic(0, 0.05, Vector3(1e-5, 2e-5, 3e-5).asDiagonal(), Vector3::Zero());
    CouplingGains gains{.linear_stiffness = 200,
                        .angular_stiffness = 0.1,
                        .linear_damping = 2,
                        .angular_damping = 1e-3,
                        .force_cap = cap,
                        .torque_cap = cap};
    const Pose frame{Vector3(0.02, -0.01, 0.03), rotation_exp(Vector3(0.3, 0.1, 0))};
    BodyCoupling coupling("coupling", {{0, frame, gains}}, state.layout());
    LedgerSimulation simulation({&inertia, &coupling}, state);
    // The damper gets a target velocity of zero, so that it drags.
    const auto target = [&frame](double t) {
      return Pose{Vector3(0.1 * std::cos(6 * t), 0.1 * std::sin(6 * t), 0),
                  rotation_exp(Vector3(0, 0, 2 * t)) * frame.orientation};
    };
    state.body_poses[0].position = target(0).position;
    double heat = 0, largest_force = 0;
    for (int i = 0; i < 400; ++i) {
      const Pose before = state.body_poses[0] * frame;
      coupling.set_target(0, target(i * 0.005), {});
      simulation.step(state, 0.005);
      const Pose after = state.body_poses[0] * frame;
      const Vector3 turned = rotation_log(after.orientation * before.orientation.conjugate());
      if (i > 0) heat += (2 * (after.position - before.position).squaredNorm() + 1e-3 * turned.squaredNorm()) / 0.005;
      largest_force = std::max(largest_force, coupling.wrench(0, state).force.norm());
    }
    const EnergyFlow& total = simulation.ledger.total();
    EXPECT_GT(total.integrator, 0);
    if (cap > 1) {
      // The solver multiplies the damper's force by the turn about the arm at the end of the step. The test uses the
      // distance between the two positions.
      EXPECT_NEAR(total.damping, heat, 0.01 * heat);
      EXPECT_GT(simulation.ledger.initial() + total.work, total.damping);
    } else {
      ASSERT_NEAR(largest_force, cap, 1e-9);
      EXPECT_GT(total.damping, 0);
      EXPECT_LT(total.damping, heat) << "the cap leaves only a part of the damper's force";
    }
    simulation.expect_closed(simulation.ledger.scale());

    // Changes from outside: the body is moved with its target, the coupling is made softer, gets another target, and is
    // removed.
    state.body_poses[0].position += Vector3(3, 0, 0);
    state.body_velocities[0] = {};
    coupling.set_target(0, state.body_poses[0] * frame, {});
    simulation.run(state, 3, 0.005);
    EXPECT_NEAR(simulation.ledger.total().stored, 0, 1e-3);
    gains.linear_stiffness = 50;
    coupling.set_gains(0, gains);
    coupling.set_target(0, target(1), {});
    simulation.run(state, 3, 0.005);
    coupling.clear_target(0);
    simulation.run(state, 3, 0.005);
    simulation.expect_closed(simulation.ledger.scale());
  }
}

// A tracker turns the target so far between two steps that the spring pulls the other way round. The work is the energy
// that the spring holds afterwards.
TEST(EnergyLedger, WorkOfAJumpingTargetIsTheEnergyOfItsSpringAfterwards) {
  State state = state_of(1, 1);
  Inertia inertia({1.0}, 1);
  inertia.set_dynamic(0, 1, Matrix3::Identity(), Vector3::Zero());  // hardly turns
  const double stiffness = 0.1;
  BodyCoupling coupling("coupling", {{0, Pose{}, {.angular_stiffness = stiffness}}}, state.layout());
  LedgerSimulation simulation({&inertia, &coupling}, state);
  const auto turned = [](double angle) { return Pose{Vector3::Zero(), rotation_exp(Vector3(0, angle, 0))}; };
  coupling.set_target(0, turned(0.3), {});
  simulation.run(state, 3, 1e-3);
  const double before = simulation.ledger.total().work;
  coupling.set_target(0, turned(3.4), {});
  simulation.step(state, 1e-3);
  ASSERT_LT(coupling.wrench(0, state).torque.y(), 0) << "the shorter way is back";
  const double held = 0.5 * stiffness * (std::pow(2 * M_PI - 3.4, 2) - 0.3 * 0.3);
  EXPECT_NEAR(simulation.ledger.total().work - before, held, 1e-3 * held);
  EXPECT_LT(simulation.ledger.excess(), 1e-3);
  simulation.expect_closed(simulation.ledger.scale());
}

struct Skin {
  Skin(double mu, double stiffness, double mass, ContactObject kind)
      : plane(make(ShapeKind::plane)),
        contacts(testing::contact_at_nodes(hand(), std::vector<double>(3, mass)), 3,
                 testing::contact_stiffness(hand(), stiffness), 0, 1, 1),
        contact(contacts),
        friction(contacts),
        inertia(std::vector<double>(3, mass), 1),
        state(state_of(3, 1)) {
    contacts.set_object(0, &plane, mu, 1, kind);
    for (int n = 0; n < 3; ++n) state.node_positions.col(n) = hand().nodes[static_cast<std::size_t>(n)];
  }
  static HandModel hand() {
    HandModel model;
    model.nodes = {Vector3(0, 0, 0), Vector3(0, 0, 0.01), Vector3(0.01, 0, 0)};
    model.surface = {{0, 1, 2}};
    model.node_body.assign(3, static_cast<std::uint8_t>(index_of(Body::index_distal)));
    return model;
  }
  LedgerSimulation simulation() { return LedgerSimulation({&inertia, &contact, &friction}, state); }
  ShapeGeometry plane;
  ContactSet contacts;
  ContactEnergy contact;
  FrictionEnergy friction;
  Inertia inertia;
  State state;
};

TEST(EnergyLedger, SlidingNodesDissipateFrictionTimesDistance) {
  const double mu = 0.5, mass = 0.01;
  Skin skin(mu, 500, mass, ContactObject::fixed);
  skin.inertia.set_node_gravity(Vector3(0, -kGravity, 0));
  LedgerSimulation simulation = skin.simulation();
  simulation.run(skin.state, 300);
  ASSERT_EQ(skin.contacts.count(), 3);
  // The pushed nodes slide until they stop: mu m g d = m v^2/2.
  skin.state.node_velocities.row(0).setConstant(1.0);
  const double heat_before = simulation.ledger.total().friction, start = skin.state.node_positions(0, 0);
  const double work_before = simulation.ledger.total().work;
  simulation.step(skin.state, 1e-3);
  EXPECT_NEAR(simulation.ledger.total().work - work_before, 3 * 0.5 * mass, 1e-4)
      << "the push put the kinetic energy in";
  simulation.run(skin.state, 600, 1e-3);
  const double slid = skin.state.node_positions(0, 0) - start;
  ASSERT_NEAR(slid, 1 / (2 * mu * kGravity), 2e-3);
  ASSERT_LT(skin.state.node_velocities.norm(), 1e-3);
  EXPECT_NEAR(simulation.ledger.total().friction - heat_before, 3 * mu * mass * kGravity * slid,
              0.01 * 3 * mu * mass * kGravity * slid);
  simulation.expect_closed(simulation.ledger.scale());
  EXPECT_LT(simulation.ledger.excess(), 0.01);
}

TEST(EnergyLedger, SlidingBlockDissipatesFrictionTimesDistance) {
  const double mu = 0.4, mass = 0.05;
  const ShapeGeometry shape(make(ShapeKind::box, {0.04, 0.005, 0.04}));
  State state = state_of(1, 1);
  state.node_positions.setConstant(10);
  state.body_poses[0].position.y() = 0.005;
  Inertia inertia({1e-3}, 1);
  inertia.set_dynamic(0, mass, mass / shape.solid().volume * shape.solid().inertia, Vector3(0, -kGravity, 0));
  PlaneContact planes({1, 1}, 0, 1);
  planes.set_object(0, &shape, mass, mass * kGravity);
  NeighbourPlane table;
  table.neighbour = 9;
  table.normal = {0, 1, 0};
  table.friction = mu;
  planes.set_planes(0, {&table, 1});
  LedgerSimulation simulation({&inertia, &planes}, state);
  simulation.run(state, 200);
  ASSERT_GT(planes.count(0), 0);
  state.body_velocities[0].linear.x() = 0.8;
  const double heat = simulation.ledger.total().friction, start = state.body_poses[0].position.x();
  simulation.run(state, 500, 1e-3);
  const double slid = state.body_poses[0].position.x() - start;
  ASSERT_NEAR(slid, 0.8 * 0.8 / (2 * mu * kGravity), 2e-3);
  EXPECT_NEAR(simulation.ledger.total().friction - heat, mu * mass * kGravity * slid,
              0.02 * mu * mass * kGravity * slid);
  simulation.expect_closed(simulation.ledger.scale());

  // A moving belt does work on the block. Friction turns this work into heat and motion by the same law.
  const double work = simulation.ledger.total().work;
  table.velocity = {0.3, 0, 0};
  for (int i = 0; i < 400; ++i) {
    planes.set_planes(0, {&table, 1});
    simulation.step(state, 1e-3);
  }
  ASSERT_NEAR(state.body_velocities[0].linear.x(), 0.3, 1e-3);
  EXPECT_NEAR(simulation.ledger.total().work - work, mass * 0.3 * 0.3, 0.05 * mass * 0.3 * 0.3)
      << "half of the work is heat";
  simulation.expect_closed(simulation.ledger.scale());
  planes.clear_object(0);
  inertia.hold(0);
  simulation.run(state, 2, 1e-3);
  EXPECT_EQ(simulation.ledger.total().stored, 0);
  simulation.expect_closed(simulation.ledger.scale());
}

// The plate is moved between the steps, or it moves within the steps with its velocity.
void lift_nodes(bool within_step) {
  SCOPED_TRACE(within_step ? "moves within the steps" : "moves between the steps");
  const double mass = 0.01;
  Skin skin(0.8, 500, mass, ContactObject::fixed);
  skin.inertia.set_node_gravity(Vector3(0, -kGravity, 0));
  LedgerSimulation simulation = skin.simulation();
  simulation.run(skin.state, 300);
  const double work = simulation.ledger.total().work;
  const double height = skin.state.node_positions(1, 0), across = skin.state.node_positions(0, 0);
  const Vector3 stroke(0.0005, 0.001, 0);
  if (within_step) skin.state.body_velocities[0].linear = stroke / kStep;
  for (int i = 0; i < 180; ++i) {
    if (!within_step) skin.state.body_poses[0].position += stroke;
    simulation.step(skin.state, kStep);
  }
  const double lifted = skin.state.node_positions(1, 0) - height;
  ASSERT_NEAR(lifted, 0.18, 0.01);
  ASSERT_NEAR(skin.state.node_positions(0, 0) - across, 0.09, 0.01);
  // Gravity takes the work of the plate. What remains is the nodes' kinetic energy and the loss while they reach their
  // speed.
  EXPECT_NEAR(simulation.ledger.total().work - work, 3 * 0.5 * mass * (0.09 * 0.09 + 0.045 * 0.045), 5e-4);
  simulation.expect_closed(simulation.ledger.scale());
}

TEST(EnergyLedger, KinematicPlateDoesWorkOnTheNodesThatItLifts) {
  for (const bool within_step : {false, true}) lift_nodes(within_step);
}

// Contacts begin inside, slide over a moving ball, and are removed at the end. Meanwhile the ball changes between
// kinematic and dynamic.
TEST(EnergyLedger, ClosesWhileContactsAreSwitched) {
  const ShapeGeometry ball(make(ShapeKind::sphere, {0.05, 0, 0}));
  Skin skin(0.6, 800, 0.01, ContactObject::moving);
  const double mass = 0.1;
  const Matrix3 inertia = 1e-4 * Matrix3::Identity();
  skin.contacts.set_object(0, &ball, 0.6, 2, ContactObject::moving);
  skin.inertia.set_dynamic(0, mass, inertia, Vector3::Zero());
  skin.state.body_poses[0].position = Vector3(0.003, -0.0485, 0.002);
  skin.state.body_velocities[0].angular = Vector3(0, 0, 2);
  skin.inertia.set_node_gravity(Vector3(0.5, -3, 0));
  LedgerSimulation simulation = skin.simulation();
  int touched = 0, slid = 0;
  for (int i = 0; i < 240; ++i) {
    if (i == 60 || i == 150) {
      skin.inertia.hold(0);
      skin.contacts.set_object(0, &ball, 0.6, 2, ContactObject::fixed);
    }
    if (i == 100) {
      skin.contacts.set_object(0, &ball, 0.6, 2, ContactObject::moving);
      skin.inertia.set_dynamic(0, mass, inertia, Vector3::Zero());
      skin.state.body_velocities[0] = {Vector3(0.01, 0.05, 0), Vector3(1, 0, 0)};
    }
    if (skin.contacts.count() > 0 && i >= 150) {
      Pose& pose = skin.state.body_poses[0];
      pose = {pose.position + Vector3(0, 0.0005, 0.0003), rotation_exp(Vector3(0.01, 0, 0.02)) * pose.orientation};
    }
    if (i == 190) skin.state.body_velocities[0] = {Vector3(0.05, -0.02, 0.03), Vector3(2, 0, 3)};
    if (i == 220) skin.contacts.clear_object(0);
    simulation.step(skin.state, kStep);
    touched += skin.contacts.count();
    for (const ContactSet::Anchor& anchor : skin.contacts.anchors()) slid += anchor.sliding ? 1 : 0;
  }
  ASSERT_GT(touched, 100);
  ASSERT_GT(slid, 20);
  EXPECT_GT(simulation.ledger.total().friction, 0);
  EXPECT_NE(simulation.ledger.total().anchoring, 0);
  simulation.expect_closed(simulation.ledger.scale());
}

TEST(EnergyLedger, ReportsTheWorkThatATermOmits) {
  // This potential does not report the work of its target's movement. The residual is the omitted work.
  class Careless final : public Energy {
   public:
    std::string_view name() const override { return "careless"; }
    void add_pattern(BlockPattern&) const override {}
    void bind(const BlockMatrix& matrix) override { slot_ = matrix.find(0, 0); }
    void begin_step(const State&, double time_step) override { target_ += time_step; }
    double value(const State& state) const override {
      return 0.5 * 100 * std::pow(state.node_positions(0, 0) - target_, 2);
    }
    double add_gradient(const State& state, VectorX& gradient) const override {
      gradient(0) += 100 * (state.node_positions(0, 0) - target_);
      return value(state);
    }
    void add_hessian(const State&, BlockMatrix& hessian, Curvature) const override {
      hessian.add(slot_, Vector3(100, 0, 0).asDiagonal());
    }

   private:
    double target_ = 0;
    BlockSlot slot_;
  };
  State state = state_of(1, 0);
  Inertia inertia({0.1}, 0);
  Careless spring;
  LedgerSimulation simulation({&inertia, &spring}, state);
  simulation.run(state, 90);
  EXPECT_GT(simulation.ledger.defect(), 0.5);
}

}  // namespace
}  // namespace softhand::ledger_test
