// Relaxation of tissue: derivatives, balance, the closed form at ramps, passivity, the ledger, and memory.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <vector>

#include "energies/dense_step.hpp"
#include "energies/derivative_suite.hpp"
#include "energies/inertia.hpp"
#include "energies/memory_suite.hpp"
#include "energies/relaxing_tissue.hpp"
#include "energies/tissue.hpp"
#include "math/instruction_set.hpp"
#include "math/rotation.hpp"
#include "solver/incremental_potential.hpp"
#include "solver/step_report.hpp"
#include "support/box_mesh.hpp"

namespace softhand::relaxation_test {
namespace {

constexpr double kTimeStep = 1.0 / 90;
constexpr PronySeries::Branches kTimes{0.004, 0.07, 1.4};
const PronySeries::Branches kWeights{0.3, 0.2, 0.25}, kOtherWeights{0.1, 0, 0.4}, kNone{0, 0, 0};

// Two tetrahedra with a common face. Their materials differ.
HandModel two_tetrahedra() {
  HandModel hand;
  hand.nodes = {{0, 0, 0}, {0.012, 0.001, 0}, {0.002, 0.011, 0}, {0, 0.001, 0.013}, {0.011, 0.012, 0.011}};
  hand.tetrahedra = {{0, 1, 2, 3}, {1, 2, 3, 4}};
  if ((hand.nodes[2] - hand.nodes[1]).cross(hand.nodes[3] - hand.nodes[1]).dot(hand.nodes[4] - hand.nodes[1]) < 0)
    std::swap(hand.tetrahedra[1][0], hand.tetrahedra[1][1]);
  for (const double modulus : {2e4, 5e4}) {
    Material material;
    material.youngs_modulus = modulus;
    material.poisson_ratio = 0.3;
    material.strain_limit_energy = 1e6;
    hand.materials.push_back(material);
  }
  hand.tetrahedron_material = {0, 1};
  hand.node_body.assign(hand.nodes.size(), 0);
  return hand;
}

State at_rest(const HandModel& hand) {
  State state;
  state.node_positions.resize(3, hand.node_count());
  state.node_velocities.setZero(3, hand.node_count());
  for (int n = 0; n < hand.node_count(); ++n) state.node_positions.col(n) = hand.nodes[static_cast<std::size_t>(n)];
  return state;
}

void deform(State& state, const HandModel& hand, const Matrix3& deformation_gradient) {
  for (int n = 0; n < hand.node_count(); ++n)
    state.node_positions.col(n) = deformation_gradient * hand.nodes[static_cast<std::size_t>(n)];
}

RelaxingTissue relaxing(const TissueModel& model,
                        const std::vector<PronySeries::Branches>& weights = {kWeights, kOtherWeights},
                        InstructionSet set = widest_instruction_set()) {
  return RelaxingTissue(model, {kTimes, weights}, set);
}

// A step of prescribed motion. Returns the gradient at its end.
VectorX step_to(RelaxingTissue& tissue, State& state, const State& next, double time_step = kTimeStep) {
  tissue.begin_step(state, time_step);
  VectorX gradient = VectorX::Zero(next.layout().dof_count());
  tissue.add_gradient(next, gradient);
  state = next;
  tissue.end_step(state);
  return gradient;
}

VectorX elastic_gradient(const HandModel& hand, const State& state) {
  VectorX gradient = VectorX::Zero(state.layout().dof_count());
  Tissue(hand).add_gradient(state, gradient);
  return gradient;
}

class RelaxationDerivatives : public ::testing::TestWithParam<std::uint64_t> {};

TEST_P(RelaxationDerivatives, AgreeAndBalance) {
  const HandModel hand = two_tetrahedra();
  RelaxingTissue tissue = relaxing(hand);
  const State rest = at_rest(hand);
  State state = rest;
  step_to(tissue, state, testing::perturbed(rest, GetParam(), 1e-3, 1));
  const State end = testing::perturbed(state, GetParam() + 100, 5e-4, 1);
  testing::check_term(tissue, state, kTimeStep, end, {.step = 1e-7, .tolerance = 1e-5});
  testing::check_balance(tissue, end);
}

INSTANTIATE_TEST_SUITE_P(Seeds, RelaxationDerivatives, ::testing::Values(1, 2, 3, 4, 5));

TEST(Relaxation, RotationCostsNothing) {
  const HandModel hand = two_tetrahedra();
  RelaxingTissue tissue = relaxing(hand);
  State state = at_rest(hand);
  step_to(tissue, state, testing::perturbed(state, 3, 1e-3, 1));
  State turned = state;
  turned.node_positions = rotation_exp(Vector3(2, -1, 0.5)).toRotationMatrix() * state.node_positions;
  tissue.begin_step(state, kTimeStep);
  const double value = tissue.value(state);
  EXPECT_NEAR(tissue.value(turned), value, 1e-12 * value);
  VectorX gradient = VectorX::Zero(turned.layout().dof_count()), after = gradient;
  tissue.add_gradient(state, gradient);
  tissue.add_gradient(turned, after);
  EXPECT_NEAR(after.norm(), gradient.norm(), 1e-12 * gradient.norm());
}

// The elastic law is the instantaneous one. What lasts is its share c_0, of strain limiting too.
TEST(Relaxation, GoesFromTheElasticStressToItsLastingPart) {
  HandModel hand = two_tetrahedra();
  hand.tetrahedra.resize(1);
  hand.tetrahedron_material.resize(1);
  hand.materials[0].strain_limit_energy = 100;
  hand.materials[0].strain_limit_stiffness = 2000;
  RelaxingTissue tissue = relaxing(hand, {kWeights, kNone});
  State state = at_rest(hand), next = state;
  deform(next, hand, Vector3(1.3, 0.8, 1.1).asDiagonal().toDenseMatrix());
  ASSERT_GT(Tissue(hand).energy_density(next, 0), 1000) << "the limit does not act";
  const VectorX elastic = elastic_gradient(hand, next);
  const VectorX at_once = step_to(tissue, state, next, 1e-9);
  EXPECT_LE((at_once - elastic).norm(), 1e-6 * elastic.norm());
  VectorX last;
  for (int i = 0; i < 2000; ++i) last = step_to(tissue, state, next);
  EXPECT_LE((last - 0.25 * elastic).norm(), 1e-6 * elastic.norm());
  EXPECT_EQ(tissue.value(state), Tissue(hand).value(state)) << "between two steps the law is elastic";
}

// The elastic stress rises evenly for `seconds` and then stays. The stress of each branch has a closed form.
class RelaxationRamp : public ::testing::TestWithParam<double> {};

TEST_P(RelaxationRamp, FollowsTheClosedFormAtAnyTimeStep) {
  HandModel hand = two_tetrahedra();
  hand.tetrahedra.resize(1);
  hand.tetrahedron_material.resize(1);
  const CorotationalMaterial material = corotational_material(hand.materials[0]);
  RelaxingTissue tissue = relaxing(hand);
  const int rise = static_cast<int>(std::lround(GetParam() / kTimeStep));
  // At a stretch of s along x alone, the second Piola-Kirchhoff stress is (2 mu + lambda)(1 - 1/s).
  const double modulus = 2 * material.mu + material.lambda, most = 0.05 * modulus, rate = most / (rise * kTimeStep);
  const double volume =
      (hand.nodes[1] - hand.nodes[0]).cross(hand.nodes[2] - hand.nodes[0]).dot(hand.nodes[3] - hand.nodes[0]) / 6;
  State state = at_rest(hand);
  double stress = 0;
  for (int i = 1; i <= rise + 200; ++i) {
    const double time = i * kTimeStep, duration = rise * kTimeStep, elastic = rate * std::min(time, duration);
    const double stretch = 1 / (1 - elastic / modulus);
    State next = state;
    deform(next, hand, Vector3(stretch, 1, 1).asDiagonal().toDenseMatrix());
    const VectorX gradient = step_to(tissue, state, next);
    stress = elastic;
    for (std::size_t b = 0; b < kRelaxationBranches; ++b) {
      const double rising = rate * kTimes[b] * -std::expm1(-std::min(time, duration) / kTimes[b]);
      stress += kWeights[b] * (rising * std::exp(-std::max(0.0, time - duration) / kTimes[b]) - elastic);
    }
    // dU/dF = V F S. The x forces on the nodes give V F_xx S_xx.
    double virial = 0;
    for (int n = 0; n < 4; ++n) virial += gradient[3 * n] * hand.nodes[static_cast<std::size_t>(n)].x();
    EXPECT_NEAR(virial, volume * stretch * stress, 1e-9 * volume * modulus) << "at " << time;
  }
  EXPECT_LT(stress, 0.4 * most) << "it did not relax";
}

INSTANTIATE_TEST_SUITE_P(Seconds, RelaxationRamp, ::testing::Values(kTimeStep, 0.1, 1.0));

// A motion that ends where it began, much later than the slowest branch. The tissue cannot have given energy.
class RelaxationCycle : public ::testing::TestWithParam<std::uint64_t> {};

TEST_P(RelaxationCycle, TakesEnergyAndTheLedgerBalances) {
  HandModel hand = two_tetrahedra();
  hand.materials[0].strain_limit_energy = 200;
  hand.materials[0].strain_limit_stiffness = 1000;
  RelaxingTissue tissue = relaxing(hand);
  const State rest = at_rest(hand);
  State state = rest;
  testing::Random random(GetParam());
  double work = 0, least = 0, stored = 0, damped = 0, lost = 0;
  for (int leg = 0; leg < 12; ++leg) {
    const State from = state, to = leg < 11 ? testing::perturbed(rest, GetParam() + 10u * leg, 1.2e-3, 1) : rest;
    const double duration = 0.05 * std::exp(4 * random());
    constexpr int kSteps = 2000;
    for (int i = 1; i <= kSteps; ++i) {
      State next = state;
      next.node_positions = from.node_positions + (to.node_positions - from.node_positions) * i / kSteps;
      const Eigen::Matrix3Xd way = next.node_positions - state.node_positions;
      tissue.begin_step(state, duration / kSteps);
      const double start = tissue.value(state);
      EXPECT_NEAR(start, stored, 1e-12 + 1e-9 * stored) << "the step does not begin with what the tissue stores";
      VectorX gradient = VectorX::Zero(next.layout().dof_count());
      const double end = tissue.add_gradient(next, gradient);
      const double taken = gradient.dot(Eigen::Map<const VectorX>(way.data(), way.size()));
      state = next;
      tissue.end_step(state);
      const EnergyFlow flow = tissue.flow(start, end, taken);
      EXPECT_NEAR(flow.stored - stored, taken - flow.damping - flow.integrator, 1e-15 + 1e-9 * stored);
      stored = flow.stored;
      damped += flow.damping;
      lost += flow.integrator;
      work += taken;
      least = std::min(least, work);
    }
  }
  EXPECT_GT(work, 1e-5);
  EXPECT_GE(least, -1e-9) << "the tissue gave energy that nobody put in";
  EXPECT_NEAR(stored, 0, 1e-15);
  EXPECT_NEAR(work, damped, 1e-2 * work);
  EXPECT_LE(std::abs(lost), 1e-2 * work) << "the steps are long";
}

INSTANTIATE_TEST_SUITE_P(Seeds, RelaxationCycle, ::testing::Range(std::uint64_t{1}, std::uint64_t{9}));

// Tissue that is let go swings less with relaxation.
TEST(Relaxation, DampsAFreeBlock) {
  const HandModel hand = two_tetrahedra();
  double speed[2];
  for (const bool relaxes : {false, true}) {
    const PronySeries series{kTimes, {relaxes ? kWeights : kNone, kNone}};
    Tissue tissue(hand, widest_instruction_set(), "tissue", series);
    RelaxingTissue relaxing_tissue(hand, series);
    Inertia inertia(std::vector<double>(5, 1e-4), 0);
    State state = at_rest(hand);
    deform(state, hand, Vector3(1.1, 1, 1).asDiagonal().toDenseMatrix());
    testing::DenseStepper step({&inertia, &tissue, &relaxing_tissue}, state);
    double fastest = 0;
    for (int i = 0; i < 600; ++i) {
      step.step(state, 1e-4);
      if (i >= 400) fastest = std::max(fastest, state.node_velocities.norm());
    }
    speed[relaxes] = fastest;
  }
  EXPECT_LT(speed[1], 0.7 * speed[0]);
}

// Tissue that was pressed flat or turned inside out for long comes back, and the projected Hessian still finds the way.
TEST(Relaxation, FlatAndInvertedTissueComesBack) {
  const HandModel hand = two_tetrahedra();
  for (const double height : {0.3, 1e-3, 0.0, -0.5}) {
    RelaxingTissue tissue = relaxing(hand, {kWeights, kWeights});
    Inertia inertia(std::vector<double>(5, 1e-4), 0);
    State state = at_rest(hand);
    testing::DenseStepper step({&inertia, &tissue}, state);
    State flat = state;
    deform(flat, hand, Vector3(1, 1, height).asDiagonal().toDenseMatrix());
    for (int i = 0; i < 200; ++i) step_to(tissue, state, flat);
    for (int i = 0; i < 3000; ++i) EXPECT_LT(step.step(state, kTimeStep, 1e-9), 50) << height << " at " << i;
    EXPECT_TRUE(state.node_positions.allFinite());
    EXPECT_LT(tissue.value(state), 1e-9) << height << ": it began with about 1e-2 J";
  }
}

TEST(Relaxation, MemoryRepeatsTheBits) {
  const HandModel hand = two_tetrahedra();
  RelaxingTissue tissue = relaxing(hand);
  Inertia inertia(std::vector<double>(5, 1e-4), 0);
  State state = at_rest(hand);
  deform(state, hand, Vector3(1.1, 0.95, 1).asDiagonal().toDenseMatrix());
  testing::DenseStepper step({&inertia, &tissue}, state);
  testing::check_memory(tissue, state, [&](State& s) { step.step(s, kTimeStep); });
}

// The end of a step prepares the next one. A next step that is another one than expected begins anew.
TEST(Relaxation, EachStepHasItsOwnStartAndDuration) {
  const HandModel hand = two_tetrahedra();
  RelaxingTissue tissue = relaxing(hand);
  const State rest = at_rest(hand);
  State state = rest;
  step_to(tissue, state, testing::perturbed(rest, 1, 1e-3, 1));
  const State moved = testing::perturbed(state, 2, 1e-3, 1), end = testing::perturbed(state, 3, 1e-3, 1);
  const auto expect_that_of_a_new_term = [&](const State& start, double time_step) {
    RelaxingTissue other = relaxing(hand);
    other.load(tissue.save());
    other.begin_step(start, time_step);
    tissue.begin_step(start, time_step);
    EXPECT_EQ(tissue.value(end), other.value(end));
    return tissue.value(end);
  };
  const double usual = expect_that_of_a_new_term(state, kTimeStep);
  EXPECT_NE(expect_that_of_a_new_term(moved, kTimeStep), usual);
  EXPECT_NE(expect_that_of_a_new_term(state, 0.5 * kTimeStep), usual);
  EXPECT_EQ(expect_that_of_a_new_term(state, kTimeStep), usual);
  tissue.cancel_step();
  EXPECT_EQ(tissue.value(end), Tissue(hand).value(end)) << "the step was called off";
  tissue.reset();
  EXPECT_NE(expect_that_of_a_new_term(state, kTimeStep), usual);
}

// What was put somewhere between two steps answers as tissue that rested there.
TEST(Relaxation, MovedTetrahedraForget) {
  HandModel hand = two_tetrahedra();
  RelaxingTissue tissue = relaxing(hand), first_alone = relaxing(hand, {kWeights, kNone});
  const State rest = at_rest(hand);
  State state = rest, same = rest;
  const State pressed = testing::perturbed(rest, 3, 1e-3, 1);
  for (int i = 0; i < 20; ++i) step_to(tissue, state, pressed);
  for (int i = 0; i < 20; ++i) step_to(first_alone, same, pressed);
  tissue.reset_moved(state);
  EXPECT_NE(tissue.save().mean_stresses, relaxing(hand).save().mean_stresses) << "nothing was moved";
  state.node_positions.col(4) = rest.node_positions.col(4);  // only the second tetrahedron has this node
  tissue.reset_moved(state);
  const State end = testing::perturbed(pressed, 4, 1e-3, 1);
  tissue.begin_step(state, kTimeStep);
  first_alone.begin_step(same, kTimeStep);
  RelaxingTissue second_alone = relaxing(hand, {kNone, kOtherWeights});
  second_alone.begin_step(state, kTimeStep);
  VectorX all = VectorX::Zero(15), parts = all;
  tissue.add_gradient(end, all);
  first_alone.add_gradient(end, parts);
  second_alone.add_gradient(end, parts);
  EXPECT_LE((all - parts).norm(), 1e-12 * all.norm());
}

TEST(Relaxation, EachTetrahedronBelongsToOneTerm) {
  const HandModel hand = two_tetrahedra();
  const State state = testing::perturbed(at_rest(hand), 2, 1e-3, 1);
  const double whole = Tissue(hand).value(state);
  for (const PronySeries::Branches& second : {kNone, kWeights}) {
    const PronySeries series{kTimes, {kWeights, second}};
    const Tissue tissue(hand, widest_instruction_set(), "tissue", series);
    const RelaxingTissue relaxing_tissue(hand, series);
    EXPECT_EQ(relaxing_tissue.element_count(), second == kNone ? 1 : 2);
    EXPECT_EQ(tissue.element_count(), 2) << "it knows the shape of all";
    EXPECT_NEAR(tissue.value(state) + relaxing_tissue.value(state), whole, 1e-12 * whole);
    EXPECT_EQ(tissue.value(state) == 0, second != kNone);
  }
}

// Tissue that starts strained holds its elastic energy. The share of the branches counts as put in.
TEST(Relaxation, CountsWhatTheBranchesHoldAtTheStart) {
  const HandModel hand = two_tetrahedra();
  RelaxingTissue tissue = relaxing(hand, {kWeights, kWeights});
  State state = testing::perturbed(at_rest(hand), 4, 1e-3, 1);
  const double held = tissue.value(state);
  double work = 0, damped = 0, stored = 0;
  for (int i = 0; i < 2000; ++i) {
    tissue.begin_step(state, kTimeStep);
    const double start = tissue.value(state);
    tissue.end_step(state);
    const EnergyFlow flow = tissue.flow(start, start, 0);
    work += flow.work;
    damped += flow.damping;
    stored = flow.stored;
  }
  EXPECT_NEAR(work, 0.75 * held, 1e-9 * held);
  EXPECT_NEAR(damped, work, 1e-9 * held);
  EXPECT_NEAR(stored, 0.25 * held, 1e-9 * held);
}

// A block of more than one batch, half of which relaxes.
TEST(Relaxation, EachInstructionSetGivesTheSameBits) {
  HandModel hand = testing::box_mesh({3, 3, 3}, Vector3(0.02, 0.02, 0.02), two_tetrahedra().materials[0]);
  hand.materials.push_back(two_tetrahedra().materials[1]);
  for (std::size_t t = 0; t < hand.tetrahedra.size(); t += 2) hand.tetrahedron_material[t] = 1;
  std::vector<double> results;
  for (const InstructionSet set : kInstructionSets) {
    if (!is_supported(set)) continue;
    RelaxingTissue tissue = relaxing(hand, {kWeights, kNone}, set);
    ASSERT_GT(tissue.element_count(), 16);
    State state = at_rest(hand);
    for (int step = 0; step < 3; ++step) {
      State next = state;
      for (int n = 0; n < hand.node_count(); ++n) {
        const double phase = n + 0.7 * step;
        next.node_positions.col(n) += 1e-3 * Vector3(std::sin(3 * phase), std::cos(5 * phase), std::sin(7 * phase));
      }
      results.push_back(step_to(tissue, state, next).squaredNorm());
      results.push_back(tissue.flow(0, 0, 0).stored);
    }
    EXPECT_NE(results.back(), 0);
    const std::vector<double> of_set(results.end() - 6, results.end());
    EXPECT_EQ(of_set, std::vector<double>(results.begin(), results.begin() + 6)) << to_string(set);
  }
}

// The local part of the derivatives, and the second thread, see the function of the step.
TEST(Relaxation, ElementsAroundNodesRelaxToo) {
  HandModel hand = testing::box_mesh({4, 3, 3}, Vector3(0.04, 0.03, 0.03), two_tetrahedra().materials[0]);
  hand.materials.push_back(two_tetrahedra().materials[1]);
  for (std::size_t t = 0; t < hand.tetrahedra.size(); t += 3) hand.tetrahedron_material[t] = 1;
  RelaxingTissue tissue = relaxing(hand, {kWeights, kNone});
  State state = at_rest(hand);
  step_to(tissue, state, testing::perturbed(state, 5, 1e-3, 1));
  tissue.begin_step(state, kTimeStep);
  const State end = testing::perturbed(state, 6, 1e-3, 1);
  testing::check_around(tissue, end, {2, 3, 7, 20, 41});
  const double value = tissue.value(end);
  HelperThread helper;
  tissue.use(helper);
  EXPECT_EQ(tissue.value(end), value);
}

// A few nodes are moved with all that they strain, and the rest of the Hessian is the inertia alone.
TEST(Relaxation, IsATermOfNodesForTheSolver) {
  const HandModel hand = two_tetrahedra();
  const PronySeries series{kTimes, {kWeights, kNone}};
  constexpr double kMass = 1e-4;
  Inertia inertia(std::vector<double>(5, kMass), 0);
  Tissue tissue(hand, widest_instruction_set(), "tissue", series);
  RelaxingTissue relaxing_tissue(hand, series);
  State state = at_rest(hand);
  IncrementalPotential potential({&inertia, &tissue, &relaxing_tissue}, state.layout(), SolverOptions{});
  const StepWork prices;
  const std::function<double()> clock = [] { return 0.0; };
  StepMeter meter(prices, clock);
  potential.begin_step(state, kTimeStep);
  const State end = testing::perturbed(state, 8, 1e-3, 1);
  ASSERT_TRUE(potential.evaluate(end, meter, {.hessian = true}));
  ASSERT_TRUE(potential.knows_other_stiffness());
  const std::vector<std::int32_t> nodes{0, 1, 2, 3, 4};
  VectorX gradient = VectorX::Zero(15);
  std::vector<double> blocks(9 * 16, 0.0);
  const Energy::Around around = potential.add_around(nodes, end, gradient.data(), blocks.data());
  const double value = tissue.value(end) + relaxing_tissue.value(end);
  EXPECT_NEAR(around.energy, value, 1e-12 * value);
  EXPECT_EQ(around.share, 1);
  const double expected = kMass / (kTimeStep * kTimeStep);
  for (const std::int32_t n : nodes) {
    const Matrix3 other = potential.other_stiffness(potential.hessian().find(n, n).index);
    EXPECT_LE((other - expected * Matrix3::Identity()).norm(), 1e-6 * expected) << n;
  }
}

TEST(Relaxation, RefusesBadNumbers) {
  const HandModel hand = two_tetrahedra();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(RelaxingTissue(hand, {{0, 1, 1}, {kWeights, kWeights}}), std::invalid_argument);
  EXPECT_THROW(relaxing(hand, {kWeights}), std::invalid_argument);
  EXPECT_THROW(relaxing(hand, {kWeights, {0, nan, 0}}), std::invalid_argument);
  EXPECT_THROW(relaxing(hand, {kWeights, {0, -1, 0}}), std::invalid_argument);
  EXPECT_THROW(relaxing(hand, {kWeights, {0.5, 0.25, 0.25}}), std::invalid_argument);
  RelaxingTissue some = relaxing(hand);
  const RelaxingTissue none = relaxing(hand, {kNone, kNone});
  EXPECT_THROW(some.load(none.save()), std::invalid_argument);
}

}  // namespace
}  // namespace softhand::relaxation_test
