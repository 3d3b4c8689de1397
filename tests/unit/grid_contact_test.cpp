// A hand touches a sphere as a distance grid and as an analytic shape.
#include <gtest/gtest.h>

#include "scene/hand_simulation.hpp"
#include "support/meshes.hpp"
#include "support/shapes.hpp"

namespace grid_contact_test {
namespace {

using namespace softhand;

constexpr double kStep = 1.0 / 90;
constexpr double kRadius = 0.02;

struct Forces {
  std::vector<Vector3> of_step;
  double largest = 0;
};

// Presses a ball of prescribed motion 2 mm into the pulp of the index finger. Then slides it by 12 mm, along the finger
// and across it, so that its surface passes many cells.
Forces slide(const ShapeGeometry& ball) {
  const HandModel hand = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  HandSimulation simulation(hand, {}, 0, 1);
  for (int b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    simulation.set_target(body, hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(body)))], {});
  }
  Vector3 pad(0, 1, 0);
  for (std::size_t n = 0; n < hand.nodes.size(); ++n)
    if (static_cast<Body>(hand.node_body[n]) == Body::index_distal && hand.nodes[n].y() < pad.y()) pad = hand.nodes[n];
  simulation.set_slot(0, {7, &ball, 1, Matrix3::Identity(), 0.8});
  const Quaternion turn(Eigen::AngleAxisd(0.3, Vector3(1, 2, 3).normalized()));
  Forces forces;
  Vector3 place = pad - Vector3(0, kRadius + 0.0005, 0);
  simulation.set_slot_motion(0, {place, turn}, {});
  for (int i = 0; i < 120; ++i) {
    Twist velocity;
    if (i < 25) {
      velocity.linear.y() = 0.0025 / (25 * kStep);
    } else if (i >= 40) {
      velocity.linear = Vector3(0.009, 0, 0.008) / (80 * kStep);
    }
    simulation.set_slot_motion(0, {place, turn}, velocity);
    simulation.step(kStep);
    place += kStep * velocity.linear;
    forces.of_step.push_back(simulation.contact_wrench(0).force);
    forces.largest = std::max(forces.largest, forces.of_step.back().norm());
  }
  return forces;
}

TEST(GridContact, SphereAsAGridIsFeltAsTheSphere) {
  const Forces exact = slide(ShapeGeometry(softhand::testing::sphere_shape(kRadius)));
  const Forces grid = slide(ShapeGeometry(softhand::testing::sphere_mesh(kRadius, 0.0004), 0.001));
  double worst = 0, roughness = 0, exact_roughness = 0;
  for (std::size_t i = 0; i < exact.of_step.size(); ++i) {
    worst = std::max(worst, (grid.of_step[i] - exact.of_step[i]).norm());
    if (i < 42) continue;
    roughness = std::max(roughness, (grid.of_step[i] - grid.of_step[i - 1]).norm());
    exact_roughness = std::max(exact_roughness, (exact.of_step[i] - exact.of_step[i - 1]).norm());
  }
  std::printf("largest force %.3f N, largest difference %.3f %%, largest change in a step %.3f %% (analytic %.3f %%)\n",
              exact.largest, 100 * worst / exact.largest, 100 * roughness / exact.largest,
              100 * exact_roughness / exact.largest);
  EXPECT_GT(exact.largest, 0.3);
  EXPECT_LT(worst, 0.01 * exact.largest);
  EXPECT_LT(roughness, exact_roughness + 0.01 * exact.largest);
}

}  // namespace
}  // namespace grid_contact_test
