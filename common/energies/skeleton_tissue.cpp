#include "energies/skeleton_tissue.hpp"

#include <algorithm>
#include <map>
#include <stdexcept>
#include <string>

#include "math/rotation.hpp"

namespace softhand {

SkeletonTissue::SkeletonTissue(const HandModel& hand, DofLayout layout, int first_node, int first_body)
    : layout_(layout) {
  if (layout.node_count < first_node + hand.node_count() || layout.body_count < first_body + kBodyCount) {
    throw std::invalid_argument("SkeletonTissue: the state has " + std::to_string(layout.node_count) + " nodes and " +
                                std::to_string(layout.body_count) + " bodies, expected at least " +
                                std::to_string(first_node + hand.node_count()) + " and " +
                                std::to_string(first_body + kBodyCount));
  }
  // (column, row). An ordered map gives the same sums on every machine.
  std::map<std::pair<std::int32_t, std::int32_t>, double> node_stiffness;
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
    bone.body = first_body + body;
    const Pose rest = hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(static_cast<Body>(body))))] *
                      hand.bodies[static_cast<std::size_t>(body)].joint_from_body;
    const Pose body_from_rest = rest.inverse();
    std::map<std::int32_t, int> partners;
    for (const auto& [pair, k] : stiffness) {
      ++partners[pair.first];
      if (pair.first != pair.second) ++partners[pair.second];
    }
    // Rows of equal length follow each other, so that the processor predicts the end of each row.
    std::vector<std::pair<int, std::int32_t>> order;
    for (const auto& [node, count] : partners) order.emplace_back(count, node);
    std::sort(order.begin(), order.end());
    std::map<std::int32_t, std::int32_t> tie_of_node;
    for (const auto& [count, node] : order) {
      tie_of_node[node] = static_cast<std::int32_t>(bone.ties.size());
      Tie tie;
      tie.node = first_node + node;
      tie.rest = body_from_rest * hand.nodes[static_cast<std::size_t>(node)];
      bone.ties.push_back(tie);
    }
    bone.blocks.resize(bone.ties.size());
    std::vector<std::vector<Entry>> rows(bone.ties.size());
    const auto accumulate = [&bone, &rows](std::int32_t row, std::int32_t column, double k) {
      const auto i = static_cast<std::size_t>(row), j = static_cast<std::size_t>(column);
      const Vector3& other = bone.ties[j].rest;
      rows[i].push_back({column, k});
      bone.blocks[i].row_sum += k;
      bone.blocks[i].moment += k * other;
      bone.total += k;
      bone.moment += k * other;
      bone.second_moment += k * skew(bone.ties[i].rest).transpose() * skew(other);
    };
    for (const auto& [pair, k] : stiffness) {
      const std::int32_t i = tie_of_node.at(pair.first);
      const std::int32_t j = tie_of_node.at(pair.second);
      accumulate(i, j, k);
      if (i != j) accumulate(j, i, k);
      node_stiffness[{pair.second, pair.first}] += k;
    }
    for (std::size_t i = 0; i < rows.size(); ++i) {
      bone.entries.insert(bone.entries.end(), rows[i].begin(), rows[i].end());
      bone.ties[i].row_end = static_cast<std::int32_t>(bone.entries.size());
    }
    most_ties = std::max(most_ties, bone.ties.size());
    bones_.push_back(std::move(bone));
  }
  for (const auto& [pair, k] : node_stiffness)
    node_pairs_.push_back({first_node + pair.second, first_node + pair.first, k, {}});
  offset_.setZero(4, static_cast<Eigen::Index>(most_ties));
}

int SkeletonTissue::needed_bodies() const {
  int bodies = 0;
  for (const Bone& bone : bones_) bodies = std::max(bodies, bone.body + 1);
  return bodies;
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
  for (NodePair& pair : node_pairs_)
    pair.slot = matrix.find(layout_.node_block(pair.row), layout_.node_block(pair.column));
  for (Bone& bone : bones_) {
    const int translation = layout_.body_translation_block(bone.body);
    const int rotation = layout_.body_rotation_block(bone.body);
    bone.translation_slot = matrix.find(translation, translation);
    bone.coupling_slot = matrix.find(rotation, translation);
    bone.rotation_slot = matrix.find(rotation, rotation);
    for (std::size_t i = 0; i < bone.ties.size(); ++i) {
      bone.blocks[i].translation_slot = matrix.find(translation, layout_.node_block(bone.ties[i].node));
      bone.blocks[i].rotation_slot = matrix.find(rotation, layout_.node_block(bone.ties[i].node));
    }
  }
}

double SkeletonTissue::evaluate(const State& state, VectorX* gradient, BlockMatrix* hessian,
                                Curvature curvature) const {
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
        offset_.col(i).head<3>() = r * tie.rest + (pose.position - state.node_positions.col(tie.node));
      }
      Eigen::Vector4d twice_energy = Eigen::Vector4d::Zero(), force = Eigen::Vector4d::Zero();
      Eigen::Matrix<double, 4, 3> moment = Eigen::Matrix<double, 4, 3>::Zero();  // sum of pull X^T
      const Entry* entry = bone.entries.data();
      for (Eigen::Index i = 0; i < count; ++i) {
        const Tie& tie = bone.ties[static_cast<std::size_t>(i)];
        Eigen::Vector4d pull = Eigen::Vector4d::Zero();  // sum_j K_ij z_j
        for (const Entry* end = bone.entries.data() + tie.row_end; entry != end; ++entry)
          pull += entry->stiffness * offset_.col(entry->column);
        twice_energy += pull.cwiseProduct(offset_.col(i));
        if (gradient != nullptr) {
          gradient->segment<3>(3 * layout_.node_block(tie.node)) -= pull.head<3>();
          force += pull;
          for (int k = 0; k < 3; ++k) moment.col(k) += tie.rest[k] * pull;
        }
        if (hessian != nullptr && curvature == Curvature::exact)
          geometric += rotated_arm_second_derivative(r * tie.rest, pull.head<3>());
      }
      energy += 0.5 * twice_energy.sum();
      if (gradient != nullptr) {
        // Sum of pull (R X)^T. Its skew part is the torque.
        const Matrix3 turned = moment.topRows<3>() * r.transpose();
        gradient->segment<3>(3 * layout_.body_translation_block(bone.body)) += force.head<3>();
        gradient->segment<3>(3 * layout_.body_rotation_block(bone.body)) +=
            Vector3(turned(2, 1) - turned(1, 2), turned(0, 2) - turned(2, 0), turned(1, 0) - turned(0, 1));
      }
    }
    if (hessian != nullptr) {
      // dz_i/d(translation) = I, dz_i/d(rotation) = -[R X_i], dz_i/dx_i = -I.
      hessian->add(bone.translation_slot, bone.total * Matrix3::Identity());
      hessian->add(bone.coupling_slot, skew(r * bone.moment));
      hessian->add(bone.rotation_slot, r * bone.second_moment * r.transpose() + geometric);
      for (const TieBlocks& blocks : bone.blocks) {
        hessian->add(blocks.translation_slot, -blocks.row_sum * Matrix3::Identity());
        hessian->add(blocks.rotation_slot, -skew(r * blocks.moment));
      }
    }
  }
  if (hessian != nullptr) {
    // Multiples of the identity: three of nine entries. They are the same if the block is stored transposed.
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

double SkeletonTissue::value(const State& state) const {
  return evaluate(state, nullptr, nullptr, Curvature::projected);
}

double SkeletonTissue::add_gradient(const State& state, VectorX& gradient) const {
  return evaluate(state, &gradient, nullptr, Curvature::projected);
}

void SkeletonTissue::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  evaluate(state, nullptr, &hessian, curvature);
}

double SkeletonTissue::add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const {
  return evaluate(state, &gradient, &hessian, curvature);
}

}  // namespace softhand
