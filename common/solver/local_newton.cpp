#include "solver/local_newton.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "math/rotation.hpp"
#include "solver/slope_bracket.hpp"

namespace softhand {
namespace {

constexpr int kMaxLocalIterations = 8;
constexpr int kMaxLocalHalvings = 5;
// A first factorisation of `minimise` may take this multiple of its `most_operations`.
constexpr double kMostOperations = 2;
constexpr double kLocalArmijo = 1e-4;
constexpr double kSmallMove = 1e-6;  // m and rad; it changes contact forces by 12 mN

// Fraction of the first residual at which the condensed problem is solved. The tissue's nonlinearity leaves more.
constexpr double kConverged = 1e-2;
// Time of an operation of the dense factorisation, in operations of a sparse factorisation in float. And of all else
// that an iteration does with an entry of the dense matrix.
constexpr double kDenseOperation = 0.6;
constexpr double kDenseEntry = 20;
// The same for an evaluation of the terms with kinks, per block that moves.
constexpr double kBlockOperations = 12'000;
// The factor of the dense matrix serves again if the part with kinks has changed by less than this fraction.
constexpr double kSmallChange = 0.001;
// But not after an iteration that left more than this fraction of the residual, because there are few iterations.
constexpr double kSlow = 0.1;
// Nor is the problem solved after such an iteration if something moved by more (m, rad). Where tissue is much softer
// than contact, a small residual force can be a long way.
constexpr double kSmallStep = 1e-4;
// Blocks of terms with kinks with which the factor can serve again. A power grasp has 700.
constexpr std::size_t kMaxFactored = 4096;
// A new `Compliance` may cost at most this work, in fast steps. It needs so many operations per pair of blocks.
constexpr double kMostCompliance = 2.5;
constexpr double kPairOperations = 15'000;
// The search along a condensed step: its trials, and limits of the slope at its end, as in LineSearch. The slopes of
// the trials cost no more than their energies.
constexpr int kMaxTrials = 8;
constexpr double kLocalLevel = 0.5, kLocalShort = 0.05;

constexpr int kMaxRows =
    3 * std::max(LocalNewton::kMaxBlocks, LocalNewton::kMaxCondensedBlocks) + LocalNewton::kMaxModes;

}  // namespace

LocalNewton::LocalNewton(DofLayout layout)
    : layout_(layout),
      place_(static_cast<std::size_t>(layout.block_count()), -1),
      order_(kMaxBlocks),
      neighbours_(kMaxBlocks),
      first_(kMaxBlocks, 0),
      modes_(kMaxModes, VectorX::Zero(layout.dof_count())),
      force_(layout.dof_count()),
      product_(layout.dof_count()),
      half_(layout.dof_count()),
      smooth_(kMaxRows, kMaxRows),
      factor_(kMaxRows, kMaxRows),
      dense_(kMaxCondensedBlocks),
      forces_(kMaxRows),
      smooth_gradient_(kMaxRows),
      smooth_slope_(kMaxRows),
      smooth_change_(kMaxRows),
      local_gradient_(kMaxRows),
      step_(kMaxRows),
      total_(kMaxRows),
      trial_total_(kMaxRows),
      kinked_gradient_(layout.dof_count()) {
  blocks_.reserve(static_cast<std::size_t>(layout.block_count()));
  patches_.reserve(kMaxBlocks + 1);
  factored_blocks_.reserve(blocks_.capacity());
  factored_.reserve(kMaxFactored);
  added_.reserve(static_cast<std::size_t>(layout.block_count()));
  trial_ = empty_state(layout);
}

int LocalNewton::condensed_room(double per_operation) {
  const double pairs = kMostCompliance / (kPairOperations * per_operation);
  return static_cast<int>(std::min<double>(kMaxCondensedBlocks, std::sqrt(pairs)));
}

void LocalNewton::forget_blocks() {
  for (const std::int32_t block : blocks_) place_[static_cast<std::size_t>(block)] = -1;
  blocks_.clear();
}

int LocalNewton::touched_blocks(const BlockMatrix& hessian) {
  forget_blocks();
  include_journal(hessian);
  return static_cast<int>(
      std::count_if(blocks_.begin(), blocks_.end(), [&](std::int32_t block) { return block < hessian.core_count(); }));
}

// Adds the rows and columns of the blocks in the journal to those that move.
void LocalNewton::include_journal(const BlockMatrix& hessian) {
  const auto include = [this](std::int32_t block) {
    std::int32_t& place = place_[static_cast<std::size_t>(block)];
    if (place >= 0) return;
    place = static_cast<std::int32_t>(blocks_.size());
    blocks_.push_back(block);
  };
  for (const std::int32_t stored : hessian.journal()) {
    const auto [row, column] = hessian.position(stored);
    include(column);
    include(row);
  }
}

// Calls visit(stored, place of the row, place of the column) for the stored blocks between blocks that move.
template <typename Visit>
void LocalNewton::for_each_pair(const BlockMatrix& hessian, Visit&& visit) const {
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    const auto column = static_cast<std::size_t>(blocks_[i]);
    if (blocks_[i] >= hessian.core_count()) continue;
    for (std::int32_t k = hessian.column_start()[column]; k < hessian.column_start()[column + 1]; ++k) {
      const std::int32_t j = place_[static_cast<std::size_t>(hessian.row()[static_cast<std::size_t>(k)])];
      if (j >= 0) visit(k, j, static_cast<std::int32_t>(i));
    }
  }
  for (const std::span<const std::int32_t> others : {hessian.border_in_use(), hessian.loose_in_use()}) {
    for (const std::int32_t stored : others) {
      const auto [row, column] = hessian.position(stored);
      const std::int32_t j = place_[static_cast<std::size_t>(row)], i = place_[static_cast<std::size_t>(column)];
      if (i >= 0 && j >= 0) visit(stored, j, i);
    }
  }
}

// Orders the blocks so that the factor's envelope is small. Nodes of one patch of skin are adjacent, in the order of
// Cuthill and McKee (1969). Bodies come last. Fingers are coupled only through the object.
void LocalNewton::order_blocks(const BlockMatrix& hessian) {
  std::sort(blocks_.begin(), blocks_.end());
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    place_[static_cast<std::size_t>(blocks_[i])] = static_cast<std::int32_t>(i);
    neighbours_[i].reset();
  }
  for_each_pair(hessian, [&](std::int32_t, std::int32_t j, std::int32_t i) {
    neighbours_[static_cast<std::size_t>(j)].set(static_cast<std::size_t>(i));
    neighbours_[static_cast<std::size_t>(i)].set(static_cast<std::size_t>(j));
  });
  const auto nodes =
      static_cast<std::size_t>(std::lower_bound(blocks_.begin(), blocks_.end(), layout_.node_count) - blocks_.begin());
  std::bitset<kMaxBlocks> waiting;
  for (std::size_t i = 0; i < nodes; ++i) waiting.set(i);
  const auto degree = [this](std::size_t i) { return neighbours_[i].count(); };
  std::size_t ordered = 0;
  while (ordered < nodes) {
    std::size_t first = nodes;
    for (std::size_t i = 0; i < nodes; ++i) {
      if (waiting[i] && (first == nodes || degree(i) < degree(first))) first = i;
    }
    const std::int32_t patch = blocks_[first];
    order_[ordered] = {patch, blocks_[first]};
    waiting.reset(first);
    for (std::size_t head = ordered++; head < ordered; ++head) {
      const std::size_t from = ordered;
      const auto& near = neighbours_[static_cast<std::size_t>(place_[static_cast<std::size_t>(order_[head].second)])];
      for (std::size_t i = 0; i < nodes; ++i) {
        if (!waiting[i] || !near[i]) continue;
        order_[ordered++] = {patch, blocks_[i]};
        waiting.reset(i);
      }
      std::sort(order_.begin() + static_cast<std::ptrdiff_t>(from),
                order_.begin() + static_cast<std::ptrdiff_t>(ordered), [&](const auto& a, const auto& b) {
                  const std::size_t one = degree(static_cast<std::size_t>(place_[static_cast<std::size_t>(a.second)])),
                                    other =
                                        degree(static_cast<std::size_t>(place_[static_cast<std::size_t>(b.second)]));
                  return one != other ? one < other : a.second < b.second;
                });
    }
  }
  for (std::size_t i = nodes; i < blocks_.size(); ++i) order_[i] = {layout_.node_count, blocks_[i]};
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    blocks_[i] = order_[i].second;
    place_[static_cast<std::size_t>(blocks_[i])] = static_cast<std::int32_t>(i);
    first_[i] = static_cast<Eigen::Index>(i);
  }
  for_each_pair(hessian, [&](std::int32_t, std::int32_t j, std::int32_t i) {
    Eigen::Index& first = first_[static_cast<std::size_t>(std::max(i, j))];
    first = std::min<Eigen::Index>(first, std::min(i, j));
  });
}

// The whole symmetric matrix of the blocks that move.
void LocalNewton::gather(const BlockMatrix& hessian, Dense& dense) const {
  dense.topLeftCorner(size_, size_).setZero();
  for_each_pair(hessian, [&](std::int32_t stored, std::int32_t j, std::int32_t i) {
    const Eigen::Map<const Matrix3> block(hessian.values().data() + 9 * static_cast<std::ptrdiff_t>(stored));
    dense.block<3, 3>(3 * j, 3 * i) = block;
    dense.block<3, 3>(3 * i, 3 * j) = block.transpose();
  });
}

// Modes of the patches with the largest residual forces. The last mode is that of the forces on all blocks that do not
// move, and of the other patches.
void LocalNewton::make_modes(const VectorX& gradient, int most_modes, LinearSolver& factor) {
  patches_.clear();
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    if (blocks_[i] >= layout_.node_count) continue;
    const std::int32_t patch = order_[i].first;
    if (patches_.empty() || patches_.back().second != patch) patches_.push_back({0.0, patch});
    patches_.back().first -= gradient.segment<3>(3 * blocks_[i]).squaredNorm();
  }
  std::sort(patches_.begin(), patches_.end());
  mode_count_ = std::min({most_modes, kMaxModes, static_cast<int>(patches_.size()) + 1});
  for (int m = 0; m < mode_count_; ++m) {
    const bool is_rest = m + 1 == mode_count_;
    if (is_rest) {
      force_ = -gradient;
    } else {
      force_.setZero();
    }
    for (std::size_t i = 0; i < blocks_.size(); ++i) {
      const auto patch = std::find_if(patches_.begin(), patches_.begin() + (mode_count_ - 1),
                                      [&](const auto& p) { return p.second == order_[i].first; });
      const bool has_own_mode = patch != patches_.begin() + (mode_count_ - 1);
      auto force = force_.segment<3>(3 * blocks_[i]);
      if (is_rest && has_own_mode) force.setZero();
      if (!is_rest && has_own_mode && patch - patches_.begin() == m) force = -gradient.segment<3>(3 * blocks_[i]);
    }
    VectorX& mode = modes_[static_cast<std::size_t>(m)];
    factor.solve(force_, mode);
    for (const std::int32_t block : blocks_) mode.segment<3>(3 * block).setZero();
  }
}

// The rows of the modes in `smooth_` and `smooth_gradient_`. `hessian` is without the terms with kinks.
void LocalNewton::gather_modes(const BlockMatrix& hessian, const VectorX& gradient) {
  const auto local = 3 * static_cast<Eigen::Index>(blocks_.size());
  for (int m = 0; m < mode_count_; ++m) {
    const VectorX& mode = modes_[static_cast<std::size_t>(m)];
    hessian.multiply(mode, product_);
    const Eigen::Index row = local + m;
    for (std::size_t i = 0; i < blocks_.size(); ++i)
      smooth_.row(row).segment<3>(3 * static_cast<Eigen::Index>(i)) = product_.segment<3>(3 * blocks_[i]);
    for (int other = 0; other < mode_count_; ++other)
      smooth_(row, local + other) = inner_product(layout_, product_, modes_[static_cast<std::size_t>(other)]);
    smooth_.col(row).head(local) = smooth_.row(row).head(local);
    smooth_gradient_[row] = inner_product(layout_, mode, gradient);
  }
}

Eigen::Index LocalNewton::first_column(Eigen::Index row) const {
  return row < 3 * static_cast<Eigen::Index>(blocks_.size()) ? 3 * first_[static_cast<std::size_t>(row / 3)] : 0;
}

// Computes the Cholesky factor within the envelope: a row stores no entry before its first one. Returns false if the
// matrix is not positive definite.
bool LocalNewton::factorise(double& operations) {
  for (Eigen::Index i = 0; i < size_; ++i) {
    const Eigen::Index begin = first_column(i);
    for (Eigen::Index j = begin; j <= i; ++j) {
      const Eigen::Index from = std::max(begin, first_column(j)), count = std::max<Eigen::Index>(j - from, 0);
      const double rest = factor_(i, j) - factor_.row(i).segment(from, count).dot(factor_.row(j).segment(from, count));
      operations += 2.0 * static_cast<double>(count + 1);
      if (j < i) {
        factor_(i, j) = rest / factor_(j, j);
      } else if (rest > 0) {
        factor_(i, i) = std::sqrt(rest);
      } else {
        return false;
      }
    }
  }
  return true;
}

// Upper bound for a factorisation of the blocks without modes.
double LocalNewton::expected_operations() const {
  double operations = 0;
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    const double width = 3.0 * static_cast<double>(static_cast<Eigen::Index>(i) - first_[i] + 1);
    operations += 3 * width * width;
  }
  return operations;
}

void LocalNewton::solve(Eigen::Ref<VectorX> step) const {
  for (Eigen::Index i = 0; i < size_; ++i) {
    const Eigen::Index begin = first_column(i);
    step[i] = (step[i] - factor_.row(i).segment(begin, i - begin).dot(step.segment(begin, i - begin))) / factor_(i, i);
  }
  for (Eigen::Index i = size_; i-- > 0;) {
    const Eigen::Index begin = first_column(i);
    step[i] /= factor_(i, i);
    step.segment(begin, i - begin) -= step[i] * factor_.row(i).segment(begin, i - begin).transpose();
  }
}

double LocalNewton::kinked_energy(std::span<Energy* const> kinked, const State& state) {
  kinked_gradient_.setZero();
  condensed_operations_ += kBlockOperations * static_cast<double>(blocks_.size());
  double energy = 0;
  for (const Energy* term : kinked) energy += term->add_gradient(state, kinked_gradient_);
  return energy;
}

// `trial_` becomes `state` moved by an increment of the moving blocks. In all other blocks it already equals `state`.
void LocalNewton::move_to(const State& state, const Eigen::Ref<const VectorX>& move) {
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    const std::int32_t block = blocks_[i];
    const Vector3 own = move.segment<3>(3 * static_cast<Eigen::Index>(i));
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
      pose.orientation = increment(start, Vector3::Zero(), own).orientation;
    }
  }
}

LocalNewton::Result LocalNewton::minimise(const State& state, std::span<Energy* const> kinked, Curvature curvature,
                                          const VectorX& gradient, BlockMatrix& hessian, int most_modes,
                                          double most_operations, LinearSolver& factor, VectorX& direction) {
  Result result;
  const auto renew_kinked = [&](const State& at) {
    hessian.take_back();
    for (const Energy* term : kinked) term->add_hessian(at, hessian, curvature);
  };
  forget_blocks();
  // Blocks of both states are needed: a contact may act at only one of them.
  include_journal(hessian);
  renew_kinked(state);
  include_journal(hessian);
  if (blocks_.empty() || blocks_.size() > kMaxBlocks) return result;
  order_blocks(hessian);
  if (expected_operations() > kMostOperations * most_operations) return result;
  make_modes(gradient, most_modes, factor);
  result.modes = mode_count_;
  const Eigen::Index local = 3 * static_cast<Eigen::Index>(blocks_.size());
  const Eigen::Index size = size_ = local + mode_count_;
  const auto smooth = smooth_.topLeftCorner(size, size);
  auto smooth_gradient = smooth_gradient_.head(size), local_gradient = local_gradient_.head(size),
       step = step_.head(size), total = total_.head(size), trial_total = trial_total_.head(size);
  const auto select = [this](const VectorX& full, auto part) {
    for (std::size_t i = 0; i < blocks_.size(); ++i)
      part.template segment<3>(3 * static_cast<Eigen::Index>(i)) = full.segment<3>(3 * blocks_[i]);
  };
  hessian.take_back();
  gather(hessian, smooth_);
  trial_.node_positions = state.node_positions;
  trial_.body_poses = state.body_poses;
  double energy = kinked_energy(kinked, state);
  select(gradient, smooth_gradient);
  select(kinked_gradient_, local_gradient);
  smooth_gradient.head(local) -= local_gradient.head(local);
  gather_modes(hessian, gradient);
  total.setZero();
  for (int iteration = 0; iteration < kMaxLocalIterations && result.operations <= most_operations; ++iteration) {
    renew_kinked(trial_);
    gather(hessian, factor_);
    factor_.topLeftCorner(size, size).bottomRows(mode_count_) = smooth.bottomRows(mode_count_);
    local_gradient.setZero();
    select(kinked_gradient_, local_gradient);
    local_gradient += smooth_gradient;
    local_gradient.noalias() += smooth * total;
    if (!factorise(result.operations)) break;
    step = -local_gradient;
    solve(step);
    if (!step.allFinite()) break;
    const double slope = local_gradient.dot(step);
    bool falls = false;
    double scale = 1;
    for (int halving = 0; halving <= kMaxLocalHalvings && !falls; ++halving, scale *= 0.5) {
      trial_total = total + scale * step;
      move_to(state, trial_total);
      local_gradient.noalias() = smooth * trial_total;
      const double trial_energy =
          kinked_energy(kinked, trial_) + smooth_gradient.dot(trial_total) + 0.5 * trial_total.dot(local_gradient);
      falls = trial_energy <= energy + kLocalArmijo * scale * slope;
      if (falls) energy = trial_energy;
    }
    if (!falls) break;
    total = trial_total;
    if (step.lpNorm<Eigen::Infinity>() < kSmallMove) break;
  }
  direction.setZero();
  for (int m = 0; m < mode_count_; ++m) direction += total[local + m] * modes_[static_cast<std::size_t>(m)];
  for (std::size_t i = 0; i < blocks_.size(); ++i)
    direction.segment<3>(3 * blocks_[i]) = total.segment<3>(3 * static_cast<Eigen::Index>(i));
  result.found = direction.lpNorm<Eigen::Infinity>() > kSmallMove;
  return result;
}

// Adds a block of the border to those that move, in front of the blocks of the core.
void LocalNewton::include_border(std::int32_t block) {
  const auto begin = 3 * static_cast<Eigen::Index>(border_), end = 3 * static_cast<Eigen::Index>(blocks_.size());
  std::copy_backward(total_.data() + begin, total_.data() + end, total_.data() + end + 3);
  total_.segment<3>(begin).setZero();
  blocks_.insert(blocks_.begin() + border_, block);
  ++border_;
  for (std::size_t i = static_cast<std::size_t>(border_) - 1; i < blocks_.size(); ++i)
    place_[static_cast<std::size_t>(blocks_[i])] = static_cast<std::int32_t>(i);
}

// Adds the blocks in the journal to those that move, and blocks of the border that are coupled with them. `half_` is
// half of the free solve.
LocalNewton::Condensed LocalNewton::include_touched(const BlockMatrix& hessian, BorderedSolver& factor,
                                                    std::span<const KeptBlock> kept, Compliance& compliance) {
  const std::int32_t core = hessian.core_count();
  added_.clear();
  bool is_full = false;
  const auto touch = [&](std::int32_t block) {
    if (place_[static_cast<std::size_t>(block)] >= 0) return;
    if (block >= core) {
      is_full |= blocks_.size() == static_cast<std::size_t>(kMaxCondensedBlocks);
      if (!is_full) include_border(block);
    } else if (!compliance.has(block) && std::find(added_.begin(), added_.end(), block) == added_.end()) {
      added_.push_back(block);
    }
  };
  const auto touch_both = [&](std::int32_t stored) {
    const auto [row, column] = hessian.position(stored);
    touch(column);
    touch(row);
  };
  if (blocks_.empty()) {
    for (const KeptBlock& block : kept) touch_both(block.stored);
  }
  for (const std::int32_t stored : hessian.journal()) touch_both(stored);
  for (std::size_t before = 0; before != blocks_.size();) {
    before = blocks_.size();
    for (const std::int32_t stored : hessian.border_in_use()) {
      const auto [row, column] = hessian.position(stored);
      if (column < core || row == column) continue;
      if (place_[static_cast<std::size_t>(row)] >= 0) touch(column);
      if (place_[static_cast<std::size_t>(column)] >= 0) touch(row);
    }
  }
  // Neighbours are in one pass over the factor.
  std::sort(added_.begin(), added_.end());
  const auto border = static_cast<std::size_t>(border_), known = blocks_.size() - border;
  if (is_full || added_.size() > compliance.room() ||
      border + compliance.blocks().size() + added_.size() > static_cast<std::size_t>(kMaxCondensedBlocks)) {
    return Condensed::no_room;
  }
  if (!compliance.include(added_, factor.core())) return Condensed::not_positive;
  // At first no block moves. A block that is added later moves as the forces so far move it.
  const bool moves = known > 0 && known < compliance.blocks().size();
  if (moves) {
    product_ = half_;
    const auto from = 3 * static_cast<Eigen::Index>(known),
               end = 3 * static_cast<Eigen::Index>(compliance.blocks().size());
    forces_.segment(from, end - from).setZero();
    compliance.add_forces(forces_.head(end), product_);
  }
  for (std::size_t k = known; k < compliance.blocks().size(); ++k) {
    const std::int32_t block = compliance.blocks()[k];
    place_[static_cast<std::size_t>(block)] = static_cast<std::int32_t>(blocks_.size());
    total_.segment<3>(3 * static_cast<Eigen::Index>(blocks_.size())) =
        moves ? compliance.displacement(k, product_) : Vector3::Zero().eval();
    blocks_.push_back(block);
  }
  return Condensed::found;
}

// Calls visit(row, column, block) for both triangles of the symmetric matrix of `kept`.
template <typename Visit>
void LocalNewton::for_each_kept(const BlockMatrix& hessian, std::span<const KeptBlock> kept, Visit&& visit) const {
  for (const KeptBlock& block : kept) {
    const auto [row, column] = hessian.position(block.stored);
    const Eigen::Index j = place_[static_cast<std::size_t>(row)], i = place_[static_cast<std::size_t>(column)];
    visit(j, i, block.value);
    if (i != j) visit(i, j, block.value.transpose());
  }
}

// The forces of the model's terms with kinks on the blocks of the compliance, in its order. They include those of
// `kept`, which the factor has in addition.
void LocalNewton::find_forces(const BlockMatrix& hessian, std::span<const KeptBlock> kept) {
  step_.head(size_) = smooth_slope_.head(size_);
  for_each_kept(hessian, kept, [this](Eigen::Index row, Eigen::Index column, const auto& block) {
    step_.segment<3>(3 * row) += block * total_.segment<3>(3 * column);
  });
  const auto border = 3 * static_cast<Eigen::Index>(border_);
  forces_.head(size_ - border) = step_.segment(border, size_ - border);
}

// `smooth_` holds the blocks between blocks of the border. The terms with kinks are in the journal of `hessian`.
void LocalNewton::gather_border(const BlockMatrix& hessian) {
  smooth_.topLeftCorner(3 * border_, 3 * border_).setZero();
  const auto write = [&](std::int32_t stored, const auto& block) {
    const auto [row, column] = hessian.position(stored);
    if (column < hessian.core_count()) return;
    const Eigen::Index j = 3 * place_[static_cast<std::size_t>(row)], i = 3 * place_[static_cast<std::size_t>(column)];
    if (i < 0 || j < 0) return;
    smooth_.block<3, 3>(j, i) = block;
    smooth_.block<3, 3>(i, j) = block.transpose();
  };
  for (const std::int32_t stored : hessian.border_in_use())
    write(stored, Eigen::Map<const Matrix3>(hessian.values().data() + 9 * static_cast<std::ptrdiff_t>(stored)));
  for (std::size_t k = 0; k < hessian.journal().size(); ++k) write(hessian.journal()[k], hessian.previous(k));
}

// `product` = the Hessian of the condensed model's smooth terms times `move`.
void LocalNewton::multiply_smooth(const BlockMatrix& hessian, std::span<const KeptBlock> kept,
                                  const Compliance& compliance, const VectorX& move, VectorX& product) const {
  const auto border = 3 * static_cast<Eigen::Index>(border_), core = size_ - border;
  product.head(border).noalias() = smooth_.topLeftCorner(border, border) * move.head(border);
  product.segment(border, core).noalias() =
      compliance.stiffness().topLeftCorner(core, core) * move.segment(border, core);
  for_each_kept(hessian, kept, [&](Eigen::Index row, Eigen::Index column, const auto& block) {
    product.segment<3>(3 * row) -= block * move.segment<3>(3 * column);
  });
}

// `smooth_`, `smooth_gradient_` and `smooth_slope_` of the condensed model. The terms with kinks are in the journal of
// `hessian`.
void LocalNewton::condense(const BlockMatrix& hessian, std::span<const KeptBlock> kept, const Compliance& compliance) {
  size_ = 3 * static_cast<Eigen::Index>(blocks_.size());
  gather_border(hessian);
  const auto border = 3 * static_cast<Eigen::Index>(border_), core = size_ - border;
  for (Eigen::Index i = 0; i < border; i += 3)
    smooth_gradient_.segment<3>(i) = -force_.segment<3>(3 * blocks_[static_cast<std::size_t>(i / 3)]);
  // The displacement of the touched blocks without terms with kinks.
  for (std::size_t k = 0; k < compliance.blocks().size(); ++k)
    trial_total_.segment<3>(3 * static_cast<Eigen::Index>(k)) = compliance.displacement(k, half_);
  smooth_gradient_.segment(border, core).noalias() =
      -compliance.stiffness().topLeftCorner(core, core) * trial_total_.head(core);
  smooth_slope_.head(size_) = smooth_gradient_.head(size_);
  if (total_.head(size_).isZero(0)) return;
  multiply_smooth(hessian, kept, compliance, total_, smooth_change_);
  smooth_slope_.head(size_) += smooth_change_.head(size_);
}

// Whether the factor of the dense matrix serves the terms with kinks in the journal of `hessian`. It does if the same
// blocks touch each other and hardly any stiffness has changed. An object's blocks sum all its contacts and would hide
// the change of one, so they are not compared.
bool LocalNewton::serves_again(const BlockMatrix& hessian) const {
  if (!has_dense_factor_ || blocks_ != factored_blocks_ || hessian.journal().size() != factored_.size()) return false;
  double change = 0, norm = 0;
  for (std::size_t k = 0; k < factored_.size(); ++k) {
    const auto& [position, block] = factored_[k];
    if (hessian.position(hessian.journal()[k]) != position) return false;
    if (position.first >= hessian.core_count()) continue;
    change += (hessian.added(k) - block).squaredNorm();
    norm += block.squaredNorm();
  }
  return change <= kSmallChange * kSmallChange * norm;
}

// Factorises the Hessian of the condensed model. The journal of `hessian` holds the terms with kinks. There is no
// factor if it is not positive definite.
void LocalNewton::factorise_condensed(const BlockMatrix& hessian, std::span<const KeptBlock> kept,
                                      const Compliance& compliance) {
  const auto border = 3 * static_cast<Eigen::Index>(border_);
  dense_.assign(smooth_, border, compliance.stiffness(), size_ - border);
  for_each_kept(hessian, kept, [this](Eigen::Index row, Eigen::Index column, const auto& block) {
    if (row >= column) dense_.add(row, column, -block);
  });
  factored_blocks_ = blocks_;
  factored_.clear();
  for (std::size_t k = 0; k < hessian.journal().size(); ++k) {
    const auto position = hessian.position(hessian.journal()[k]);
    const Matrix3 added = hessian.added(k);
    const Eigen::Index j = place_[static_cast<std::size_t>(position.first)],
                       i = place_[static_cast<std::size_t>(position.second)];
    if (j >= i) {
      dense_.add(j, i, added);
    } else {
      dense_.add(i, j, added.transpose());
    }
    if (factored_.size() < kMaxFactored) factored_.push_back({position, added});
  }
  has_dense_factor_ = dense_.factorize();
  if (has_dense_factor_) condensed_operations_ += kDenseOperation * dense_.operations();
}

// The condensed model's energy of the smooth terms after the blocks have moved by `move`, where its gradient is
// `slope`.
double LocalNewton::smooth_energy(const Eigen::Ref<const VectorX>& move, const Eigen::Ref<const VectorX>& slope) const {
  return 0.5 * move.dot(smooth_gradient_.head(size_) + slope);
}

void LocalNewton::add_kinked_gradient(Eigen::Ref<VectorX> gradient) const {
  for (std::size_t i = 0; i < blocks_.size(); ++i)
    gradient.segment<3>(3 * static_cast<Eigen::Index>(i)) += kinked_gradient_.segment<3>(3 * blocks_[i]);
}

// Adds to `total_` as much of `step_` as lowers the model's energy. `local_gradient_` is the gradient at `total_`, and
// `smooth_change_` the change of `smooth_slope_` along the step. The search ends at a kink or beyond it, so that the
// next iteration knows what changes there. Returns false, and changes nothing, if the energy does not fall.
bool LocalNewton::search(const State& state, std::span<Energy* const> kinked, double& energy) {
  auto gradient = local_gradient_.head(size_), step = step_.head(size_), total = total_.head(size_),
       trial_total = trial_total_.head(size_), smooth_slope = smooth_slope_.head(size_),
       change = smooth_change_.head(size_);
  const double slope = gradient.dot(step);
  double trial_energy = 0, there = 0;
  const auto evaluate = [&](double scale) {
    trial_total = total + scale * step;
    gradient = smooth_slope + scale * change;
    move_to(state, trial_total);
    trial_energy = kinked_energy(kinked, trial_) + smooth_energy(trial_total, gradient);
    add_kinked_gradient(gradient);
    there = gradient.dot(step);
    return trial_energy <= energy + kLocalArmijo * scale * slope;
  };
  SlopeBracket bracket(slope);
  double scale = 1, last = 1;
  for (int trial = 0; trial < kMaxTrials; ++trial) {
    const bool falls = evaluate(last = scale);
    const bool accepts =
        falls && there <= -kLocalLevel * slope && (there >= kLocalShort * slope || bracket.high() == 0);
    if (accepts) break;
    bracket.narrow(scale, there, falls);
    scale = trial + 2 == kMaxTrials && bracket.low() > 0 ? bracket.low() : bracket.next();
  }
  if (!(trial_energy < energy)) return false;
  energy = trial_energy;
  total = trial_total;
  smooth_slope += last * change;
  return true;
}

LocalNewton::Condensed LocalNewton::minimise_condensed(const State& state, std::span<Energy* const> kinked,
                                                       Curvature curvature, const VectorX& gradient, double tolerance,
                                                       BlockMatrix& hessian, BorderedSolver& factor,
                                                       std::span<const KeptBlock> kept, Compliance& compliance,
                                                       VectorX& direction) {
  forget_blocks();
  border_ = 0;
  condensed_operations_ = 0;
  mode_count_ = 0;
  trial_.node_positions = state.node_positions;
  trial_.body_poses = state.body_poses;
  double energy = kinked_energy(kinked, state);
  force_ = kinked_gradient_ - gradient;
  factor.forward(force_, half_);
  const auto renew_kinked = [&] {
    hessian.take_back();
    condensed_operations_ += kBlockOperations * static_cast<double>(blocks_.size());
    for (const Energy* term : kinked) term->add_hessian(trial_, hessian, curvature);
  };
  // Includes what `trial_` touches. New blocks move at once as the forces so far move them, and may touch more.
  const auto touch = [&] {
    while (true) {
      renew_kinked();
      const bool is_first = blocks_.empty();
      const std::size_t before = blocks_.size();
      const Condensed included = include_touched(hessian, factor, kept, compliance);
      if (included != Condensed::found || (before == blocks_.size() && !is_first)) return included;
      condense(hessian, kept, compliance);
      find_forces(hessian, kept);
      if (is_first) return included;  // nothing has moved
      move_to(state, total_.head(size_));
      energy = kinked_energy(kinked, trial_) + smooth_energy(total_.head(size_), smooth_slope_.head(size_));
    }
  };
  Condensed result = touch();
  double first_residual = 0, last_residual = std::numeric_limits<double>::infinity();
  bool converged = false, is_new = true;
  double moved = 0;
  for (int iteration = 0; result == Condensed::found && iteration < kMaxLocalIterations; ++iteration) {
    auto local_gradient = local_gradient_.head(size_), step = step_.head(size_);
    local_gradient = smooth_slope_.head(size_);
    add_kinked_gradient(local_gradient);
    const double residual = local_gradient.lpNorm<Eigen::Infinity>();
    if (iteration == 0) first_residual = residual;
    converged = residual <= std::max(kConverged * first_residual, tolerance);
    if (converged && (is_new || moved <= kSmallStep)) break;
    condensed_operations_ += kDenseEntry * static_cast<double>(size_) * static_cast<double>(size_);
    if (residual > kSlow * last_residual) forget_factor();
    is_new = !serves_again(hessian);
    last_residual = residual;
    if (is_new) factorise_condensed(hessian, kept, compliance);
    step = -local_gradient;
    if (has_dense_factor_) dense_.solve(step);
    if (!has_dense_factor_ || !step.allFinite()) {
      result = Condensed::not_positive;
      break;
    }
    multiply_smooth(hessian, kept, compliance, step_, smooth_change_);
    if (!search(state, kinked, energy)) {
      if (is_new || converged) break;
      forget_factor();
      move_to(state, total_.head(size_));
      energy = kinked_energy(kinked, trial_) + smooth_energy(total_.head(size_), smooth_slope_.head(size_));
      continue;
    }
    moved = step.lpNorm<Eigen::Infinity>();
    find_forces(hessian, kept);
    result = touch();
  }
  if (!converged) forget_factor();
  hessian.take_back();
  if (result != Condensed::found) return result;
  compliance.add_forces(forces_.head(3 * static_cast<Eigen::Index>(compliance.blocks().size())), half_);
  factor.backward(half_, direction);
  for (std::size_t i = 0; i < blocks_.size(); ++i)
    direction.segment<3>(3 * blocks_[i]) = total_.segment<3>(3 * static_cast<Eigen::Index>(i));
  return Condensed::found;
}

}  // namespace softhand
