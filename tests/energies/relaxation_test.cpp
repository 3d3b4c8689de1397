// Relaxation of the tissue: derivatives, balance, the closed form at ramps, heat, and memory.
#include "energies/relaxation.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "energies/dense_step.hpp"
#include "energies/derivative_suite.hpp"
#include "energies/inertia.hpp"
#include "energies/memory_suite.hpp"
#include "energies/tissue.hpp"
#include "math/instruction_set.hpp"
#include "math/rotation.hpp"
#include "support/box_mesh.hpp"

namespace softhand::relaxation_test {
namespace {

constexpr double kTimeStep = 1.0 / 90;
const RelaxationEnergy::Branches kTimes{0.004, 0.07, 1.4}, kWeights{0.5, 0.3, 0.7};

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

// A step of prescribed motion.
void step_to(RelaxationEnergy& term, State& state, const State& next) {
  term.begin_step(state, kTimeStep);
  state = next;
  term.end_step(state);
}

class RelaxationDerivatives : public ::testing::TestWithParam<std::uint64_t> {};

TEST_P(RelaxationDerivatives, AgreeAndBalance) {
  const HandModel hand = two_tetrahedra();
  RelaxationEnergy term(hand, kTimes, {kWeights, {0.2, 0, 0.9}});
  const State rest = at_rest(hand);
  State state = rest;
  step_to(term, state, testing::perturbed(rest, GetParam(), 2e-3, 1));
  const State end = testing::perturbed(state, GetParam() + 100, 1e-3, 1);
  testing::check_term(term, state, kTimeStep, end, {.step = 1e-6, .tolerance = 1e-6});
  testing::check_balance(term, end);
}

INSTANTIATE_TEST_SUITE_P(Seeds, RelaxationDerivatives, ::testing::Values(1, 2, 3, 4, 5));

TEST(Relaxation, RotationCostsNothing) {
  const HandModel hand = two_tetrahedra();
  RelaxationEnergy term(hand, kTimes, {kWeights, kWeights});
  State state = at_rest(hand), next = state;
  deform(next, hand, rotation_exp(Vector3(2, -1, 0.5)).toRotationMatrix());
  term.begin_step(state, kTimeStep);
  EXPECT_NEAR(term.value(next), 0, 1e-20);
  VectorX gradient = VectorX::Zero(next.layout().dof_count());
  term.add_gradient(next, gradient);
  EXPECT_LE(gradient.norm(), 1e-12);
}

// Green's strain rises evenly for `seconds` and then stays. The stress of each branch has a closed form.
class RelaxationRamp : public ::testing::TestWithParam<double> {};

TEST_P(RelaxationRamp, FollowsTheClosedFormAtAnyTimeStep) {
  constexpr double kStrain = 0.05;
  HandModel hand = two_tetrahedra();
  hand.tetrahedra.resize(1);
  hand.tetrahedron_material.resize(1);
  const Material& material = hand.materials[0];
  const double shear_modulus = material.youngs_modulus / (2 * (1 + material.poisson_ratio));
  RelaxationEnergy term(hand, kTimes, {kWeights, kWeights});
  const int rise = static_cast<int>(std::lround(GetParam() / kTimeStep));
  const double rate = kStrain / (rise * kTimeStep);
  State state = at_rest(hand);
  double released = 0;
  for (int i = 1; i <= rise + 200; ++i) {
    const double time = i * kTimeStep, duration = rise * kTimeStep, strain = rate * std::min(time, duration);
    State next = state;
    deform(next, hand, Vector3(std::sqrt(1 + 2 * strain), 1, 1).asDiagonal().toDenseMatrix());
    term.begin_step(state, kTimeStep);
    VectorX gradient = VectorX::Zero(next.layout().dof_count());
    term.add_gradient(next, gradient);
    state = next;
    term.end_step(state);
    double stress = 0;  // second Piola-Kirchhoff
    for (std::size_t b = 0; b < kRelaxationBranches; ++b) {
      const double rising = rate * kTimes[b] * -std::expm1(-std::min(time, duration) / kTimes[b]);
      stress += 2 * shear_modulus * kWeights[b] * rising * std::exp(-std::max(0.0, time - duration) / kTimes[b]);
    }
    // dU/dF = V F S. The x forces on the nodes give V F_xx S_xx.
    double virial = 0;
    for (int n = 0; n < 4; ++n) virial += gradient[3 * n] * hand.nodes[static_cast<std::size_t>(n)].x();
    const double volume =
        (hand.nodes[1] - hand.nodes[0]).cross(hand.nodes[2] - hand.nodes[0]).dot(hand.nodes[3] - hand.nodes[0]) / 6;
    EXPECT_NEAR(virial, volume * std::sqrt(1 + 2 * strain) * stress, 1e-9 * volume * shear_modulus) << "at " << time;
    released = stress;
  }
  EXPECT_LT(released, 2 * shear_modulus * kStrain * kWeights[2] * 0.3) << "it did not relax";
}

INSTANTIATE_TEST_SUITE_P(Seconds, RelaxationRamp, ::testing::Values(kTimeStep, 0.1, 1.0));

// The work of a prescribed motion is what the springs store plus the heat, up to the error of the step.
TEST(Relaxation, WorkIsStoredOrHeat) {
  const HandModel hand = two_tetrahedra();
  RelaxationEnergy term(hand, kTimes, {kWeights, kWeights});
  State state = at_rest(hand);
  double work = 0;
  constexpr double kStep = 2e-5;
  for (int i = 0; i < 20000; ++i) {
    State next = state;
    const double shear = 0.1 * std::sin(20 * (i + 1) * kStep);
    deform(next, hand, Matrix3::Identity() + shear * Matrix3::Identity().col(0) * Matrix3::Identity().row(1));
    term.begin_step(state, kStep);
    VectorX gradient = VectorX::Zero(next.layout().dof_count());
    term.add_gradient(next, gradient);
    const Eigen::Matrix3Xd way = next.node_positions - state.node_positions;
    work += gradient.dot(Eigen::Map<const VectorX>(way.data(), way.size()));
    state = next;
    term.end_step(state);
  }
  EXPECT_GT(term.dissipated(), 0.5 * work);
  EXPECT_NEAR(work, term.save().stored + term.dissipated(), 1e-3 * work);
}

// Tissue that is let go swings less with relaxation.
TEST(Relaxation, DampsAFreeBlock) {
  const HandModel hand = two_tetrahedra();
  double speed[2];
  for (const bool relaxes : {false, true}) {
    Tissue tissue(hand);
    RelaxationEnergy relaxation(hand, kTimes, {kWeights, kWeights});
    Inertia inertia(std::vector<double>(5, 1e-4), 0);
    State state = at_rest(hand);
    deform(state, hand, Vector3(1.1, 1, 1).asDiagonal().toDenseMatrix());
    std::vector<Energy*> terms{&inertia, &tissue};
    if (relaxes) terms.push_back(&relaxation);
    testing::DenseStepper step(terms, state);
    for (int i = 0; i < 20; ++i) step.step(state, 1e-3);
    speed[relaxes] = state.node_velocities.norm();
    EXPECT_GE(relaxation.dissipated(), 0);
  }
  EXPECT_LT(speed[1], 0.7 * speed[0]);
}

TEST(Relaxation, MemoryRepeatsTheBits) {
  const HandModel hand = two_tetrahedra();
  Tissue tissue(hand);
  RelaxationEnergy relaxation(hand, kTimes, {kWeights, kWeights});
  Inertia inertia(std::vector<double>(5, 1e-4), 0);
  State state = at_rest(hand);
  deform(state, hand, Vector3(1.1, 0.95, 1).asDiagonal().toDenseMatrix());
  testing::DenseStepper step({&inertia, &tissue, &relaxation}, state);
  testing::check_memory(relaxation, state, [&](State& s) { step.step(s, kTimeStep); });
}

// The end of a step prepares the next one. A next step that is another one than expected begins anew.
TEST(Relaxation, EachStepHasItsOwnStartAndDuration) {
  const HandModel hand = two_tetrahedra();
  RelaxationEnergy term(hand, kTimes, {kWeights, kWeights});
  const State rest = at_rest(hand);
  State state = rest;
  step_to(term, state, testing::perturbed(rest, 1, 1e-3, 1));
  const State moved = testing::perturbed(state, 2, 1e-3, 1), end = testing::perturbed(state, 3, 1e-3, 1);
  const auto expect_that_of_a_new_term = [&](const State& start, double time_step) {
    RelaxationEnergy other(hand, kTimes, {kWeights, kWeights});
    other.load(term.save());
    other.begin_step(start, time_step);
    term.begin_step(start, time_step);
    EXPECT_EQ(term.value(end), other.value(end));
    return term.value(end);
  };
  const double usual = expect_that_of_a_new_term(state, kTimeStep);
  EXPECT_NE(expect_that_of_a_new_term(moved, kTimeStep), usual);
  EXPECT_NE(expect_that_of_a_new_term(state, 0.5 * kTimeStep), usual);
  EXPECT_EQ(expect_that_of_a_new_term(state, kTimeStep), usual);
  term.reset();
  EXPECT_NE(expect_that_of_a_new_term(state, kTimeStep), usual);
}

TEST(Relaxation, LeavesOutMaterialsWithoutWeight) {
  const HandModel hand = two_tetrahedra();
  EXPECT_EQ(RelaxationEnergy(hand, kTimes, {kWeights, {0, 0, 0}}).element_count(), 1);
  EXPECT_EQ(RelaxationEnergy(hand, kTimes, {kWeights, kWeights}).element_count(), 2);
}

// A block of more than one batch, in a deformed state with strained springs.
TEST(Relaxation, EachInstructionSetGivesTheSameBits) {
  const HandModel hand = testing::box_mesh({2, 2, 2}, Vector3(0.02, 0.02, 0.02), two_tetrahedra().materials[0]);
  std::vector<double> results;
  for (const InstructionSet set : kInstructionSets) {
    if (!is_supported(set)) continue;
    RelaxationEnergy term(hand, kTimes, {kWeights}, set);
    ASSERT_GT(term.element_count(), 16);
    State state = at_rest(hand);
    for (int step = 0; step < 3; ++step) {
      term.begin_step(state, kTimeStep);
      for (int n = 0; n < hand.node_count(); ++n) {
        const double phase = n + 0.7 * step;
        state.node_positions.col(n) += 1e-3 * Vector3(std::sin(3 * phase), std::cos(5 * phase), std::sin(7 * phase));
      }
      VectorX gradient = VectorX::Zero(3 * hand.node_count());
      results.push_back(term.add_gradient(state, gradient));
      results.push_back(gradient.squaredNorm());
      term.end_step(state);
    }
    results.push_back(term.dissipated());
    const std::vector<double> of_set(results.end() - 7, results.end());
    EXPECT_EQ(of_set, std::vector<double>(results.begin(), results.begin() + 7)) << to_string(set);
    EXPECT_GT(term.dissipated(), 0);
  }
}

TEST(Relaxation, RefusesBadNumbers) {
  const HandModel hand = two_tetrahedra();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(RelaxationEnergy(hand, {0, 1, 1}, {kWeights, kWeights}), std::invalid_argument);
  EXPECT_THROW(RelaxationEnergy(hand, kTimes, {kWeights}), std::invalid_argument);
  EXPECT_THROW(RelaxationEnergy(hand, kTimes, {kWeights, {0, nan, 0}}), std::invalid_argument);
  EXPECT_THROW(RelaxationEnergy(hand, kTimes, {kWeights, {0, -1, 0}}), std::invalid_argument);
  RelaxationEnergy some(hand, kTimes, {kWeights, kWeights});
  const RelaxationEnergy none(hand, kTimes, {{0, 0, 0}, {0, 0, 0}});
  EXPECT_THROW(some.load(none.save()), std::invalid_argument);
}

}  // namespace
}  // namespace softhand::relaxation_test
