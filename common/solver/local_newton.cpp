#include "solver/local_newton.hpp"

#include <algorithm>
#include <cmath>

namespace softhand {
namespace {

constexpr int kMaxLocalIterations = 8;
constexpr int kMaxLocalHalvings = 5;
// A first factorisation may take this multiple of `most_operations`.
constexpr double kMostOperations = 2;
constexpr double kLocalArmijo = 1e-4;
constexpr double kSmallMove = 1e-6;  // m and rad; it changes contact forces by 12 mN
constexpr int kMaxLocalRows = 3 * LocalNewton::kMaxBlocks + LocalNewton::kMaxModes;

}  // namespace

LocalNewton::LocalNewton(DofLayout layout)
    : layout_(layout),
      blocks_(layout),
      order_(kMaxBlocks),
      neighbours_(kMaxBlocks),
      first_(kMaxBlocks, 0),
      modes_(kMaxModes, VectorX::Zero(layout.dof_count())),
      force_(layout.dof_count()),
      product_(layout.dof_count()),
      smooth_(kMaxLocalRows, kMaxLocalRows),
      factor_(kMaxLocalRows, kMaxLocalRows),
      smooth_gradient_(kMaxLocalRows),
      local_gradient_(kMaxLocalRows),
      step_(kMaxLocalRows),
      total_(kMaxLocalRows),
      trial_total_(kMaxLocalRows) {
  patches_.reserve(kMaxBlocks + 1);
}

// Calls visit(stored, place of the row, place of the column) for the stored blocks between blocks that move.
template <typename Visit>
void LocalNewton::for_each_pair(const BlockMatrix& hessian, Visit&& visit) const {
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    const auto column = static_cast<std::size_t>(blocks_[i]);
    if (blocks_[i] >= hessian.core_count()) continue;
    for (std::int32_t k = hessian.column_start()[column]; k < hessian.column_start()[column + 1]; ++k) {
      const std::int32_t j = blocks_.place(hessian.row()[static_cast<std::size_t>(k)]);
      if (j >= 0) visit(k, j, static_cast<std::int32_t>(i));
    }
  }
  for (const std::span<const std::int32_t> others : {hessian.border_in_use(), hessian.loose_in_use()}) {
    for (const std::int32_t stored : others) {
      const auto [row, column] = hessian.position(stored);
      const std::int32_t j = blocks_.place(row), i = blocks_.place(column);
      if (i >= 0 && j >= 0) visit(stored, j, i);
    }
  }
}

// Orders the blocks so that the factor's envelope is small. Nodes of one patch of skin are adjacent, in the order of
// Cuthill and McKee (1969). Bodies come last. Fingers are coupled only through the object.
void LocalNewton::order_blocks(const BlockMatrix& hessian) {
  blocks_.sort();
  for (std::size_t i = 0; i < blocks_.size(); ++i) neighbours_[i].reset();
  for_each_pair(hessian, [&](std::int32_t, std::int32_t j, std::int32_t i) {
    neighbours_[static_cast<std::size_t>(j)].set(static_cast<std::size_t>(i));
    neighbours_[static_cast<std::size_t>(i)].set(static_cast<std::size_t>(j));
  });
  const auto nodes = static_cast<std::size_t>(
      std::lower_bound(blocks_.list().begin(), blocks_.list().end(), layout_.node_count) - blocks_.list().begin());
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
      const auto& near = neighbours_[static_cast<std::size_t>(blocks_.place(order_[head].second))];
      for (std::size_t i = 0; i < nodes; ++i) {
        if (!waiting[i] || !near[i]) continue;
        order_[ordered++] = {patch, blocks_[i]};
        waiting.reset(i);
      }
      std::sort(order_.begin() + static_cast<std::ptrdiff_t>(from),
                order_.begin() + static_cast<std::ptrdiff_t>(ordered), [&](const auto& a, const auto& b) {
                  const std::size_t one = degree(static_cast<std::size_t>(blocks_.place(a.second))),
                                    other = degree(static_cast<std::size_t>(blocks_.place(b.second)));
                  return one != other ? one < other : a.second < b.second;
                });
    }
  }
  for (std::size_t i = nodes; i < blocks_.size(); ++i) order_[i] = {layout_.node_count, blocks_[i]};
  blocks_.reorder([this](std::size_t i) { return order_[i].second; });
  for (std::size_t i = 0; i < blocks_.size(); ++i) first_[i] = static_cast<Eigen::Index>(i);
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
    for (const std::int32_t block : blocks_.list()) mode.segment<3>(3 * block).setZero();
  }
}

// The rows of the modes in `smooth_` and `smooth_gradient_`. `hessian` is without the terms with kinks.
void LocalNewton::gather_modes(const BlockMatrix& hessian, const VectorX& gradient) {
  const Eigen::Index local = blocks_.rows();
  for (int m = 0; m < mode_count_; ++m) {
    const VectorX& mode = modes_[static_cast<std::size_t>(m)];
    hessian.multiply(mode, product_);
    const Eigen::Index row = local + m;
    blocks_.select(product_, smooth_.row(row).head(local).transpose());
    for (int other = 0; other < mode_count_; ++other)
      smooth_(row, local + other) = inner_product(layout_, product_, modes_[static_cast<std::size_t>(other)]);
    smooth_.col(row).head(local) = smooth_.row(row).head(local);
    smooth_gradient_[row] = inner_product(layout_, mode, gradient);
  }
}

Eigen::Index LocalNewton::first_column(Eigen::Index row) const {
  return row < blocks_.rows() ? 3 * first_[static_cast<std::size_t>(row / 3)] : 0;
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

LocalNewton::Result LocalNewton::minimise(const State& state, std::span<Energy* const> kinked, Curvature curvature,
                                          const VectorX& gradient, BlockMatrix& hessian, bool objects_only,
                                          int most_modes, double most_operations, LinearSolver& factor,
                                          VectorX& direction) {
  Result result;
  blocks_.start(state);
  // Blocks of both states are needed: a contact may act at only one of them.
  blocks_.add_journal(hessian);
  MovingBlocks::renew_kinked(kinked, state, curvature, hessian);
  blocks_.add_journal(hessian);
  if (objects_only) blocks_.keep_from(hessian.core_count());
  if (blocks_.size() == 0 || blocks_.size() > kMaxBlocks) return result;
  order_blocks(hessian);
  if (expected_operations() > kMostOperations * most_operations) return result;
  make_modes(gradient, most_modes, factor);
  result.modes = mode_count_;
  const Eigen::Index local = blocks_.rows();
  const Eigen::Index size = size_ = local + mode_count_;
  const auto smooth = smooth_.topLeftCorner(size, size);
  auto smooth_gradient = smooth_gradient_.head(size), local_gradient = local_gradient_.head(size),
       step = step_.head(size), total = total_.head(size), trial_total = trial_total_.head(size);
  hessian.take_back();
  gather(hessian, smooth_);
  double energy = blocks_.kinked_energy(kinked, state);
  blocks_.select(gradient, smooth_gradient);
  blocks_.select(blocks_.kinked_gradient(), local_gradient);
  smooth_gradient.head(local) -= local_gradient.head(local);
  gather_modes(hessian, gradient);
  total.setZero();
  for (int iteration = 0; iteration < kMaxLocalIterations && result.operations <= most_operations; ++iteration) {
    MovingBlocks::renew_kinked(kinked, blocks_.trial(), curvature, hessian);
    gather(hessian, factor_);
    factor_.topLeftCorner(size, size).bottomRows(mode_count_) = smooth.bottomRows(mode_count_);
    local_gradient.setZero();
    blocks_.select(blocks_.kinked_gradient(), local_gradient);
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
      blocks_.move_to(state, trial_total);
      local_gradient.noalias() = smooth * trial_total;
      const double trial_energy = blocks_.kinked_energy(kinked, blocks_.trial()) + smooth_gradient.dot(trial_total) +
                                  0.5 * trial_total.dot(local_gradient);
      falls = trial_energy <= energy + kLocalArmijo * scale * slope;
      if (falls) energy = trial_energy;
    }
    if (!falls) break;
    total = trial_total;
    if (step.lpNorm<Eigen::Infinity>() < kSmallMove) break;
  }
  direction.setZero();
  for (int m = 0; m < mode_count_; ++m) direction += total[local + m] * modes_[static_cast<std::size_t>(m)];
  blocks_.spread(total, direction);
  result.found = direction.lpNorm<Eigen::Infinity>() > kSmallMove;
  return result;
}

}  // namespace softhand
