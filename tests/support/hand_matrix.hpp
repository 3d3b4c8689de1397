// The step's matrix of a shipped hand in a grasp, for tests and benchmarks of linear solvers.
#pragma once

#include <string>

#include "energies/inertia.hpp"
#include "energies/joint.hpp"
#include "energies/skeleton_tissue.hpp"
#include "energies/tissue.hpp"
#include "math/block_matrix.hpp"
#include "support/box_mesh.hpp"

namespace softhand::testing {

/// The matrix of the hand `path` for a step of 1/90 s. The nodes are displaced by some tenths of a millimetre. Every
/// skin node may touch one object, and each twentieth node does, with `contact_stiffness` N/m.
inline BlockMatrix hand_matrix(const std::string& path, double contact_stiffness = 12000) {
  const HandModel hand = load_hand(path);
  const int object = kBodyCount;
  State state = rest_state(hand);
  state.body_poses.resize(kBodyCount + 1);
  state.body_velocities.resize(kBodyCount + 1);
  for (int b = 0; b < kBodyCount; ++b) {
    state.body_poses[static_cast<std::size_t>(b)] = hand.body_rest_pose(static_cast<Body>(b));
  }
  const DofLayout layout = state.layout();
  Inertia inertia(lumped_masses(hand), layout.body_count);
  for (int b = 0; b < kBodyCount; ++b) {
    const BodyModel& body = hand.bodies[static_cast<std::size_t>(b)];
    inertia.set_dynamic(b, body.mass, body.inertia, Vector3::Zero());
  }
  inertia.set_dynamic(object, 0.3, 1e-4 * Matrix3::Identity(), Vector3::Zero());
  Tissue tissue(hand);
  SkeletonTissue attachments(hand, layout);
  JointEnergy joints(hand_joints(hand), layout);

  std::vector<bool> is_skin(hand.nodes.size(), false);
  for (const auto& triangle : hand.surface) {
    for (const std::int32_t node : triangle) is_skin[static_cast<std::size_t>(node)] = true;
  }
  const int contact_blocks[2] = {layout.body_translation_block(object), layout.body_rotation_block(object)};
  BlockPattern pattern(layout.block_count());
  pattern.add(contact_blocks[1], contact_blocks[0]);
  for (int n = 0; n < hand.node_count(); ++n) {
    if (!is_skin[static_cast<std::size_t>(n)]) continue;
    for (const int block : contact_blocks) pattern.add(block, n);
  }
  const std::vector<Energy*> terms{&inertia, &tissue, &attachments, &joints};
  for (const Energy* term : terms) term->add_pattern(pattern);
  BlockMatrix matrix(pattern);
  for (Energy* term : terms) {
    term->bind(matrix);
    term->begin_step(state, 1.0 / 90);
  }
  Random random(1);
  for (int n = 0; n < hand.node_count(); ++n) state.node_positions.col(n) += 2e-4 * random.vector();
  for (const Energy* term : terms) term->add_hessian(state, matrix, Curvature::projected);
  for (int n = 0; n < hand.node_count(); n += 20) {
    if (!is_skin[static_cast<std::size_t>(n)]) continue;
    // k g g^T, where g is the gradient of the gap over the node, the object's position and its rotation.
    const Vector3 normal = random.vector().normalized();
    const Vector3 gradient[3] = {normal, -normal, -hand.nodes[static_cast<std::size_t>(n)].cross(normal)};
    const int block[3] = {n, contact_blocks[0], contact_blocks[1]};
    for (int a = 0; a < 3; ++a) {
      for (int b = 0; b <= a; ++b)
        matrix.add(matrix.find(block[a], block[b]), contact_stiffness * gradient[a] * gradient[b].transpose());
    }
  }
  return matrix;
}

}  // namespace softhand::testing
