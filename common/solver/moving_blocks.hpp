// The blocks of unknowns that a solve of contact moves, and the terms with kinks where it moves them to.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "energies/energy.hpp"
#include "math/block_matrix.hpp"
#include "model/state.hpp"

namespace softhand {

/// Each block that moves has a place, counted from 0. An increment of these blocks has three entries for each place.
/// No function allocates after construction.
class MovingBlocks {
 public:
  explicit MovingBlocks(DofLayout layout);

  /// From now on no block moves, and the trial state is `state`.
  void start(const State& state);
  void clear();
  /// The block moves, too. It takes the last place, unless it has one.
  void add(std::int32_t block);
  /// A block that did not move takes `place`. Those behind it go back.
  void insert(std::size_t place, std::int32_t block);
  /// Adds the rows and columns of the blocks in the journal.
  void add_journal(const BlockMatrix& hessian);
  /// The blocks before `first` do not move any more.
  void keep_from(std::int32_t first);
  void sort();
  /// `block_at(place)` gives each of these blocks a place.
  template <typename BlockAt>
  void reorder(BlockAt&& block_at) {
    for (std::size_t i = 0; i < blocks_.size(); ++i) blocks_[i] = block_at(i);
    number(0);
  }

  std::size_t size() const { return blocks_.size(); }
  /// Entries of an increment.
  Eigen::Index rows() const { return 3 * static_cast<Eigen::Index>(blocks_.size()); }
  std::int32_t operator[](std::size_t place) const { return blocks_[place]; }
  const std::vector<std::int32_t>& list() const { return blocks_; }
  /// The place of a block; -1: it is fixed.
  std::int32_t place(std::int32_t block) const { return place_[static_cast<std::size_t>(block)]; }
  bool moves(std::int32_t block) const { return place(block) >= 0; }

  /// The parts of `full`, a vector of all blocks, in the order of the places.
  template <typename Part>
  void select(const VectorX& full, Part part) const {
    for (std::size_t i = 0; i < blocks_.size(); ++i)
      part.template segment<3>(3 * static_cast<Eigen::Index>(i)) = full.segment<3>(3 * blocks_[i]);
  }
  /// The reverse: writes the moving blocks of `full`.
  void spread(const Eigen::Ref<const VectorX>& part, VectorX& full) const;

  /// Moves the trial state to `state` plus an increment. All other blocks equal `state` since `start`.
  void move_to(const State& state, const Eigen::Ref<const VectorX>& increment);
  const State& trial() const { return trial_; }
  /// Energy of the terms with kinks, J. `kinked_gradient` is then their gradient, of all blocks.
  double kinked_energy(std::span<Energy* const> kinked, const State& state);
  const VectorX& kinked_gradient() const { return kinked_gradient_; }
  /// Replaces the part of the terms with kinks in `hessian`, its journal, by that at `state`.
  static void renew_kinked(std::span<Energy* const> kinked, const State& state, Curvature curvature,
                           BlockMatrix& hessian);

 private:
  void number(std::size_t from);

  DofLayout layout_;
  std::vector<std::int32_t> blocks_;  // by place
  std::vector<std::int32_t> place_;   // by block
  State trial_;
  VectorX kinked_gradient_;
};

}  // namespace softhand
