// State: all variables of the hand simulation of one process. The solver writes it. Between steps the scene places the
// hand and the objects, and puts tangled tissue back.
#pragma once

#include <vector>

#include "math/types.hpp"

namespace softhand {

/// Numbering of the blocks of three degrees of freedom: first one block per node, then two blocks per body
/// (translation, rotation).
struct DofLayout {
  int node_count = 0;
  int body_count = 0;
  int border_bodies = 0;  ///< the last bodies: rigid objects. They border the solver's matrix (block_matrix.hpp)

  int border_count() const { return 2 * border_bodies; }
  int block_count() const { return node_count + 2 * body_count; }
  int dof_count() const { return 3 * block_count(); }
  int node_block(int node) const { return node; }
  int body_translation_block(int body) const { return node_count + 2 * body; }
  int body_rotation_block(int body) const { return node_count + 2 * body + 1; }
};

struct State {
  Eigen::Matrix3Xd node_positions;   ///< 3 x nodes, metres, world
  Eigen::Matrix3Xd node_velocities;  ///< 3 x nodes, m/s, world
  std::vector<Pose> body_poses;      ///< centre-of-mass frames in the world; the 21 bones first, then mirrored objects
  std::vector<Twist> body_velocities;  ///< of the centre of mass, world axes

  DofLayout layout() const { return {static_cast<int>(node_positions.cols()), static_cast<int>(body_poses.size())}; }
};

/// A state of this layout at rest: everything at the origin.
State empty_state(DofLayout layout);

/// state := state (+) scale * direction. Nodes and translations are added; rotations are spatial increments: exp(w) R.
void apply_increment(State& state, const VectorX& direction, double scale = 1.0);

/// a . b for two increments or gradients. Bodies of the border whose entries are zero change no bit of it.
double inner_product(DofLayout layout, const VectorX& a, const VectorX& b);

/// True if every number in the state is finite.
bool all_finite(const State& state);

}  // namespace softhand
