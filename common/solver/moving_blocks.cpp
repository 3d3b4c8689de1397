#include "solver/moving_blocks.hpp"

#include <algorithm>

#include "math/rotation.hpp"

namespace softhand {

MovingBlocks::MovingBlocks(DofLayout layout)
    : layout_(layout),
      place_(static_cast<std::size_t>(layout.block_count()), -1),
      trial_(empty_state(layout)),
      kinked_gradient_(layout.dof_count()) {
  blocks_.reserve(static_cast<std::size_t>(layout.block_count()));
}

void MovingBlocks::start(const State& state) {
  clear();
  trial_.node_positions = state.node_positions;
  trial_.body_poses = state.body_poses;
}

void MovingBlocks::clear() {
  for (const std::int32_t block : blocks_) place_[static_cast<std::size_t>(block)] = -1;
  blocks_.clear();
}

void MovingBlocks::add(std::int32_t block) {
  std::int32_t& place = place_[static_cast<std::size_t>(block)];
  if (place >= 0) return;
  place = static_cast<std::int32_t>(blocks_.size());
  blocks_.push_back(block);
}

void MovingBlocks::insert(std::size_t place, std::int32_t block) {
  blocks_.insert(blocks_.begin() + static_cast<std::ptrdiff_t>(place), block);
  number(place);
}

void MovingBlocks::add_journal(const BlockMatrix& hessian) {
  for (const std::int32_t stored : hessian.journal()) {
    const auto [row, column] = hessian.position(stored);
    add(column);
    add(row);
  }
}

void MovingBlocks::keep_from(std::int32_t first) {
  for (const std::int32_t block : blocks_) {
    if (block < first) place_[static_cast<std::size_t>(block)] = -1;
  }
  std::erase_if(blocks_, [first](std::int32_t block) { return block < first; });
  number(0);
}

void MovingBlocks::sort() {
  std::sort(blocks_.begin(), blocks_.end());
  number(0);
}

void MovingBlocks::number(std::size_t from) {
  for (std::size_t i = from; i < blocks_.size(); ++i)
    place_[static_cast<std::size_t>(blocks_[i])] = static_cast<std::int32_t>(i);
}

void MovingBlocks::spread(const Eigen::Ref<const VectorX>& part, VectorX& full) const {
  for (std::size_t i = 0; i < blocks_.size(); ++i)
    full.segment<3>(3 * blocks_[i]) = part.segment<3>(3 * static_cast<Eigen::Index>(i));
}

void MovingBlocks::move_to(const State& state, const Eigen::Ref<const VectorX>& increment) {
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    const std::int32_t block = blocks_[i];
    const Vector3 own = increment.segment<3>(3 * static_cast<Eigen::Index>(i));
    if (block < layout_.node_count) {
      trial_.node_positions.col(block) = state.node_positions.col(block) + own;
      continue;
    }
    const int body = (block - layout_.node_count) / 2;
    const Pose& start = state.body_poses[static_cast<std::size_t>(body)];
    Pose& pose = trial_.body_poses[static_cast<std::size_t>(body)];
    if (block == layout_.body_translation_block(body)) {
      pose.position = start.position + own;
    } else {
      pose.orientation = softhand::increment(start, Vector3::Zero(), own).orientation;
    }
  }
}

double MovingBlocks::kinked_energy(std::span<Energy* const> kinked, const State& state) {
  kinked_gradient_.setZero();
  double energy = 0;
  for (const Energy* term : kinked) energy += term->add_gradient(state, kinked_gradient_);
  return energy;
}

void MovingBlocks::renew_kinked(std::span<Energy* const> kinked, const State& state, Curvature curvature,
                                BlockMatrix& hessian) {
  hessian.take_back();
  for (const Energy* term : kinked) term->add_hessian(state, hessian, curvature);
}

}  // namespace softhand
