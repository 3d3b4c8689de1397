// Flexible objects in the hand's simulation: motion, weight, contact with the table, the hand and each other.
#include <gtest/gtest.h>

#include "energies/skin_contact.hpp"
#include "messages/plain_bytes.hpp"
#include "support/block_hand.hpp"
#include "support/cores.hpp"
#include "support/count_allocations.hpp"
#include "support/soft_bodies.hpp"
#include "unit/hand_simulation_rig.hpp"

namespace softhand {
namespace {

using namespace testing;

const Pose kFarAway{.position = {0, 1, 0}};
const Vector3 kEdge(0.04, 0.04, 0.04);

std::vector<SoftObject> cube_at(double height, double youngs_modulus, double poisson_ratio = 0.3) {
  SoftObject cube;
  cube.name = "cube";
  cube.body = soft_box({4, 4, 4}, kEdge, soft_material(youngs_modulus, poisson_ratio));
  cube.pose.position = {0, height, 0};
  cube.gravity = kGravity;
  return {cube};
}

struct Table {
  ShapeGeometry shape{box_shape({0.4, 0.02, 0.4})};
};

TEST(SoftObject, FallsAsBackwardEulerSays) {
  HandSimulation simulation(hand(), options(), 0, 0, {}, 0, cube_at(0, 1e4));
  simulation.reposition(kFarAway);
  set_rest_targets(simulation, kFarAway);
  const Vector3 before = centre_of_mass(*simulation.soft(), 0, simulation.state());
  const int steps = 18;
  for (int i = 0; i < steps; ++i) ASSERT_TRUE(simulation.step(kStep).state_changed);
  const double fall = 0.5 * steps * (steps + 1) * kStep * kStep * 9.81;
  EXPECT_NEAR((before - centre_of_mass(*simulation.soft(), 0, simulation.state())).y(), fall, 1e-9 + 1e-6 * fall);
  EXPECT_NEAR(simulation.soft()->mass(0), 0.0064, 1e-12);
}

TEST(SoftObject, RestsOnTheTableWithItsWeight) {
  const Table table;
  for (const double modulus : {1e3, 1e4, 1e5, 1e6, 1e7}) {
    HandSimulation simulation(hand(), options(), 0, 1, {}, 0, cube_at(0.0201, modulus));
    simulation.reposition(kFarAway);
    set_rest_targets(simulation, kFarAway);
    set_table(simulation, 0, table.shape, 0.02);
    double force = 0;
    int iterations = 0;
    for (int i = 0; i < 270; ++i) {
      const StepReport report = simulation.step(kStep);
      ASSERT_TRUE(report.state_changed);
      iterations = std::max(iterations, static_cast<int>(report.iterations));
      if (i >= 180) force -= simulation.contact_wrench(0).force.y() / 90;
    }
    const double weight = simulation.soft()->mass(0) * 9.81;
    EXPECT_NEAR(force / weight, 1, 0.01) << modulus;
    EXPECT_EQ(simulation.inverted_elements(), 0);
    double fastest = simulation.soft()->fastest(0, simulation.state());
    EXPECT_LT(fastest, 1e-3) << modulus;
    std::printf("%g %g %g %d\n", modulus, force / weight, fastest, iterations);
  }
}

}  // namespace
}  // namespace softhand
