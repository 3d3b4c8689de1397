// Attachments of the tissue to the bones (ES2725128A1 eq. 31): one spring per (bone, tetrahedron) pair, at the centroid
// of their intersection.
//
//   U = sum over attachments 1/2 k |x_c + R r - sum_i w_i x_i|^2
//
// r is the rest position of the attachment, sum_i w_i X_i, in the bone's body frame. The weights w_i sum to one. So
// each stretch is a weighted sum of node offsets z_i = x_c + R X_i - x_i. z_i points from the node to its place in a
// rigid motion with the bone. Therefore
//
//   U = sum over bones 1/2 sum_ij K_ij z_i . z_j,   K_ij = sum over its attachments k w_i w_j
//
// Thousands of springs become one small constant matrix K per bone. This is the same energy, not an approximation. It
// loses no digits far from the origin, because every z_i is zero at rest.
//
// Departure from the source: none in the energy. Assumption: attachments are at rest in the model's rest pose.
// Projected Hessian: without the curvature of R (Gauss-Newton), a sum of squares. Degrees of freedom: the nodes of the
// crossed tetrahedra and the bones. Units: J; m, rad. Evaluation uses scratch memory of this object: one thread at a
// time.
#pragma once

#include <cstdint>
#include <vector>

#include "energies/energy.hpp"
#include "model/hand_model.hpp"

namespace softhand {

class SkeletonTissue final : public Energy {
 public:
  /// Node n of the hand is node `first_node` + n of the state, and bone b is body `first_body` + b. Throws
  /// std::invalid_argument if the state has fewer nodes or bodies.
  SkeletonTissue(const HandModel& hand, DofLayout layout, int first_node = 0, int first_body = 0);

  std::string_view name() const override { return "skeleton_tissue"; }
  bool is_potential() const override { return true; }
  int needed_bodies() const override;
  void add_pattern(BlockPattern& pattern) const override;
  void bind(const BlockMatrix& matrix) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  double add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const override;

 private:
  // A (node, bone) pair, without the data that only the Hessian needs.
  struct Tie {
    std::int32_t node = 0;
    std::int32_t row_end = 0;        // end of its row in `entries`
    Vector3 rest = Vector3::Zero();  // X_i, body frame
  };
  struct TieBlocks {
    double row_sum = 0;                         // sum_j K_ij
    Vector3 moment = Vector3::Zero();           // sum_j K_ij X_j, body frame
    BlockSlot translation_slot, rotation_slot;  // (bone's block, node)
  };
  struct Entry {
    std::int32_t column = 0;  // index of the tie
    double stiffness = 0;
  };
  struct Bone {
    int body = 0;
    std::vector<Tie> ties;
    std::vector<TieBlocks> blocks;            // per tie
    std::vector<Entry> entries;               // K, row by row
    double total = 0;                         // sum_ij K_ij
    Vector3 moment = Vector3::Zero();         // sum_ij K_ij X_j
    Matrix3 second_moment = Matrix3::Zero();  // sum_ij K_ij [X_i]^T [X_j]
    BlockSlot translation_slot, coupling_slot, rotation_slot;
  };
  // The constant node-node part of the Hessian, summed over the bones: stiffness times identity.
  struct NodePair {
    std::int32_t row = 0, column = 0;
    double stiffness = 0;
    BlockSlot slot;
  };

  double evaluate(const State& state, VectorX* gradient, BlockMatrix* hessian, Curvature curvature) const;

  DofLayout layout_;
  std::vector<Bone> bones_;
  std::vector<NodePair> node_pairs_;
  // z_i of one bone, with a zero as fourth entry so that it fills whole vectors of the processor.
  mutable Eigen::Matrix4Xd offset_;
};

}  // namespace softhand
