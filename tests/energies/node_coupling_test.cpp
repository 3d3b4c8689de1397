// Springs between the nodes of a flexible object and its copy.
#include "energies/node_coupling.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "energies/dense_step.hpp"
#include "energies/derivative_suite.hpp"
#include "energies/inertia.hpp"
#include "energies/memory_suite.hpp"

namespace softhand::node_coupling_test {
namespace {

const std::vector<double> kMasses{0.01, 0.02, 0.03};

TEST(NodeCoupling, Derivatives) {
  NodeCoupling coupling(1, kMasses, 300, 0.7);
  const State state = testing::random_state({5, 1}, 1);
  coupling.set_target(Eigen::Matrix3Xd::Random(3, 3), Eigen::Matrix3Xd::Random(3, 3));
  testing::check_term(coupling, state, 0.01, testing::perturbed(state, 2, 0.02, 0.1));
}

TEST(NodeCoupling, IsOffWithoutATarget) {
  NodeCoupling coupling(0, kMasses, 300, 1);
  State state = testing::random_state({3, 0}, 1);
  coupling.begin_step(state, 0.01);
  EXPECT_EQ(coupling.value(state), 0);
  coupling.set_target(state.node_positions.array() + 0.01, Eigen::Matrix3Xd::Zero(3, 3));
  EXPECT_GT(coupling.value(state), 0);
  coupling.clear_target();
  EXPECT_EQ(coupling.value(state), 0);
}

TEST(NodeCoupling, MemoryRepeatsTheBitsAndTheLedgerCloses) {
  NodeCoupling coupling(0, kMasses, 6, 0.3);
  Inertia inertia(kMasses, 0);
  State state = testing::random_state({3, 0}, 1);
  coupling.set_target(state.node_positions.array() + 0.01, Eigen::Matrix3Xd::Zero(3, 3));
  testing::DenseStepper stepper({&inertia, &coupling}, state);
  testing::check_memory(coupling, state, [&](State& s) { stepper.step(s, 0.01); });
  const double before = coupling.save().stored;
  stepper.step(state, 0.01);
  const EnergyFlow flow = coupling.flow(0, 0, 0.25);
  EXPECT_GT(flow.damping, 0);
  EXPECT_NEAR(before + flow.work + 0.25, flow.stored + flow.damping, 1e-15);
}

// All nodes have the frequency of the whole object, whatever their masses. With critical damping and a step that is
// short for it, they come to rest at the copy.
TEST(NodeCoupling, NodesOfAnyMassMoveAlike) {
  NodeCoupling coupling(0, kMasses, 6, 1);
  Inertia inertia(kMasses, 0);
  State state = testing::random_state({3, 0}, 1, 0, 0);
  Eigen::Matrix3Xd target = state.node_positions;
  target.row(1).array() += 0.01;
  coupling.set_target(target, Eigen::Matrix3Xd::Zero(3, 3));
  testing::DenseStepper stepper({&inertia, &coupling}, state);
  for (int i = 0; i < 100; ++i) {
    stepper.step(state, 0.002);
    EXPECT_NEAR(state.node_positions(1, 0), state.node_positions(1, 1), 1e-9);
    EXPECT_NEAR(state.node_positions(1, 0), state.node_positions(1, 2), 1e-9);
    if (i != 49) continue;
    EXPECT_NEAR(state.node_positions(1, 0), 0.01 * (1 - 2 * std::exp(-1)), 4e-4) << "omega t = 1";
  }
  for (int i = 0; i < 1000; ++i) stepper.step(state, 0.002);
  EXPECT_LT((state.node_positions - target).norm(), 1e-8);
}

}  // namespace
}  // namespace softhand::node_coupling_test
