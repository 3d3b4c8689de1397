#include "energies/skeleton_tissue.hpp"

#include <algorithm>
#include <map>
#include <stdexcept>
#include <string>

#include "math/rotation.hpp"

namespace softhand {

SkeletonTissue::SkeletonTissue(const HandModel& hand, DofLayout layout) : layout_(layout) {
  if (layout.node_count < hand.node_count() || layout.body_count < kBodyCount) {
    throw std::invalid_argument("SkeletonTissue: the state has " + std::to_string(layout.node_count) + " nodes and " +
                                std::to_string(layout.body_count) + " bodies, the hand " + std::to_string(hand.node_count()) + " and " +
                                std::to_string(kBodyCount));
  }
  std::map<std::pair<std::int32_t, std::int32_t>, double> node_stiffness;  // (column, row), ordered: the same sums on every machine
  std::size_t most_ties = 0;
  for (int body = 0; body < kBodyCount; ++body) {
    std::map<std::pair<std::int32_t, std::int32_t>, double> stiffness;  // (node i, node j), i >= j
    for (const Attachment& attachment : hand.attachments) {
      if (attachment.body != body) continue;
      const auto& nodes = hand.tetrahedra[static_cast<std::size_t>(attachment.tetrahedron)];
      for (std::size_t a = 0; a < 4; ++a) {
        for (std::size_t b = 0; b < 4; ++b) {
          if (nodes[a] < nodes[b]) continue;
          stiffness[{nodes[a], nodes[b]}] += attachment.stiffness * attachment.weights[a] * attachment.weights[b];
        }
      }
    }
    if (stiffness.empty()) continue;
    Bone bone;
    bone.body = body;
    const Pose rest = hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(static_cast<Body>(body))))] *
                      hand.bodies[static_cast<std::size_t>(body)].joint_from_body;
    const Pose body_from_rest = rest.inverse();
    std::map<std::int32_t, std::int32_t> tie_of_node;
    for (const auto& [pair, k] : stiffness) {
      const auto& [i, j] = pair;
      if (i != j) continue;
      tie_of_node[i] = static_cast<std::int32_t>(bone.ties.size());
      Tie tie;
      tie.node = i;
      tie.rest = body_from_rest * hand.nodes[static_cast<std::size_t>(i)];
      bone.ties.push_back(tie);
      bone.diagonal.push_back(k);
    }
    const auto accumulate = [&bone](std::int32_t i, std::int32_t j, double k) {
      Tie& tie = bone.ties[static_cast<std::size_t>(i)];
      const Vector3& other = bone.ties[static_cast<std::size_t>(j)].rest;
      tie.row_sum += k;
      tie.moment += k * other;
      bone.total += k;
      bone.moment += k * other;
      bone.second_moment += k * skew(tie.rest).transpose() * skew(other);
    };
    for (const auto& [pair, k] : stiffness) {
      const std::int32_t i = tie_of_node.at(pair.first);
      const std::int32_t j = tie_of_node.at(pair.second);
      accumulate(i, j, k);
      if (i != j) {
        accumulate(j, i, k);
        bone.pairs.push_back({i, j, k});
      }
      node_stiffness[{pair.second, pair.first}] += k;
    }
    most_ties = std::max(most_ties, bone.ties.size());
    bones_.push_back(std::move(bone));
  }
  for (const auto& [pair, k] : node_stiffness) node_pairs_.push_back({pair.second, pair.first, k, {}});
  offset_.setZero(3, static_cast<Eigen::Index>(most_ties));
  pull_ = offset_;
}

void SkeletonTissue::add_pattern(BlockPattern& pattern) const {
  for (const NodePair& pair : node_pairs_) pattern.add(layout_.node_block(pair.row), layout_.node_block(pair.column));
  for (const Bone& bone : bones_) {
    const int translation = layout_.body_translation_block(bone.body);
    const int rotation = layout_.body_rotation_block(bone.body);
    pattern.add(rotation, translation);
    for (const Tie& tie : bone.ties) {
      pattern.add(translation, layout_.node_block(tie.node));
      pattern.add(rotation, layout_.node_block(tie.node));
    }
  }
}

void SkeletonTissue::bind(const BlockMatrix& matrix) {
  for (NodePair& pair : node_pairs_) pair.slot = matrix.find(layout_.node_block(pair.row), layout_.node_block(pair.column));
  for (Bone& bone : bones_) {
    const int translation = layout_.body_translation_block(bone.body);
    const int rotation = layout_.body_rotation_block(bone.body);
    bone.translation_slot = matrix.find(translation, translation);
    bone.coupling_slot = matrix.find(rotation, translation);
    bone.rotation_slot = matrix.find(rotation, rotation);
    for (Tie& tie : bone.ties) {
      tie.translation_slot = matrix.find(translation, layout_.node_block(tie.node));
      tie.rotation_slot = matrix.find(rotation, layout_.node_block(tie.node));
    }
  }
}

double SkeletonTissue::evaluate(const State& state, VectorX* gradient, BlockMatrix* hessian, Curvature curvature) const {
  const bool needs_pull = gradient != nullptr || hessian == nullptr || curvature == Curvature::exact;
  double energy = 0;
  for (const Bone& bone : bones_) {
    const Pose& pose = state.body_poses[static_cast<std::size_t>(bone.body)];
    const Matrix3 r = pose.orientation.toRotationMatrix();
    Matrix3 geometric = Matrix3::Zero();
    if (needs_pull) {
      const auto count = static_cast<Eigen::Index>(bone.ties.size());
      for (Eigen::Index i = 0; i < count; ++i) {
        const Tie& tie = bone.ties[static_cast<std::size_t>(i)];
        offset_.col(i) = r * tie.rest + (pose.position - state.node_positions.col(tie.node));
        pull_.col(i) = bone.diagonal[static_cast<std::size_t>(i)] * offset_.col(i);
      }
      for (const Pair& pair : bone.pairs) {
        pull_.col(pair.i) += pair.stiffness * offset_.col(pair.j);
        pull_.col(pair.j) += pair.stiffness * offset_.col(pair.i);
      }
      Vector3 force = Vector3::Zero();
      Vector3 torque = Vector3::Zero();
      for (Eigen::Index i = 0; i < count; ++i) {
        const Tie& tie = bone.ties[static_cast<std::size_t>(i)];
        const Vector3 arm = r * tie.rest;
        const Vector3 pull = pull_.col(i);
        energy += 0.5 * pull.dot(offset_.col(i));
        if (gradient != nullptr) {
          gradient->segment<3>(3 * layout_.node_block(tie.node)) -= pull;
          force += pull;
          torque += arm.cross(pull);
        }
        if (hessian != nullptr && curvature == Curvature::exact) geometric += rotated_arm_second_derivative(arm, pull);
      }
      if (gradient != nullptr) {
        gradient->segment<3>(3 * layout_.body_translation_block(bone.body)) += force;
        gradient->segment<3>(3 * layout_.body_rotation_block(bone.body)) += torque;
      }
    }
    if (hessian != nullptr) {
      // dz_i/d(translation) = I, dz_i/d(rotation) = -[R X_i], dz_i/dx_i = -I.
      hessian->add(bone.translation_slot, bone.total * Matrix3::Identity());
      hessian->add(bone.coupling_slot, skew(r * bone.moment));
      hessian->add(bone.rotation_slot, r * bone.second_moment * r.transpose() + geometric);
      for (const Tie& tie : bone.ties) {
        hessian->add(tie.translation_slot, -tie.row_sum * Matrix3::Identity());
        hessian->add(tie.rotation_slot, -skew(r * tie.moment));
      }
    }
  }
  if (hessian != nullptr) {
    // Multiples of the identity: three entries of nine, whichever way the block is stored.
    const std::span<double> values = hessian->values();
    for (const NodePair& pair : node_pairs_) {
      const std::size_t first = 9 * static_cast<std::size_t>(pair.slot.index);
      values[first] += pair.stiffness;
      values[first + 4] += pair.stiffness;
      values[first + 8] += pair.stiffness;
    }
  }
  return energy;
}

double SkeletonTissue::value(const State& state) const { return evaluate(state, nullptr, nullptr, Curvature::projected); }

void SkeletonTissue::add_gradient(const State& state, VectorX& gradient) const {
  evaluate(state, &gradient, nullptr, Curvature::projected);
}

void SkeletonTissue::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  evaluate(state, nullptr, &hessian, curvature);
}

double SkeletonTissue::add_value_and_gradient(const State& state, VectorX& gradient) const {
  return evaluate(state, &gradient, nullptr, Curvature::projected);
}

double SkeletonTissue::add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const {
  return evaluate(state, &gradient, &hessian, curvature);
}

}  // namespace softhand
