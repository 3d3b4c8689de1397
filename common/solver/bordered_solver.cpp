#include "solver/bordered_solver.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "math/index.hpp"

namespace softhand {
namespace {

using Index = std::int32_t;

// A group of columns of W has two blocks, which are usually one body: its fronts are those above the nodes that touch
// it.
constexpr int kGroupBlocks = 2, kGroupColumns = 3 * kGroupBlocks;
static_assert(kGroupColumns <= kColumns);

int groups_of(int blocks) { return (blocks + kGroupBlocks - 1) / kGroupBlocks; }

using Ranges = std::vector<std::pair<Index, Index>>;

// Calls visit(begin, end) for the common parts of two lists of ascending ranges.
template <typename Visit>
void for_each_common(const Ranges& a, const Ranges& b, Visit&& visit) {
  for (auto i = a.begin(), j = b.begin(); i != a.end() && j != b.end();) {
    const Index begin = std::max(i->first, j->first), end = std::min(i->second, j->second);
    if (begin < end) visit(begin, end);
    if (i->second < j->second) {
      ++i;
    } else {
      ++j;
    }
  }
}

}  // namespace

void BorderedSolver::analyze(const BlockMatrix& matrix) {
  core_->analyze(matrix);
  core_count_ = matrix.core_count();
  border_count_ = matrix.border_count();
  const std::size_t border = at(border_count_);
  root_.assign(border, 0);
  order_.assign(border, 0);
  place_.assign(border, 0);
  is_coupled_.assign(border, 0);
  component_end_.reserve(border);
  couplings_.reserve(border * at(core_count_));
  rows_.reserve(at(core_count_));
  row_of_.assign(at(core_count_), -1);
  half_columns_.resize(at(groups_of(border_count_)));
  for (HalfColumns& columns : half_columns_) {
    columns.values.setZero(3 * core_count_, kColumns);
    columns.ranges.reserve(at(core_count_));
  }
  schur_.setZero(3 * border_count_, 3 * border_count_);
  border_.setZero(3 * border_count_);
  half_.setZero(3 * core_count_);
}

void BorderedSolver::load(const BlockMatrix& matrix) {
  core_->load(matrix);
  matrix_ = &matrix;
}

bool BorderedSolver::factorize() { return core_->factorize() && factorize_border(); }

bool BorderedSolver::refactorize(std::span<const std::int32_t> changed) {
  return core_->refactorize(changed) && factorize_border();
}

Eigen::Map<const Matrix3> BorderedSolver::block(std::int32_t stored) const {
  return Eigen::Map<const Matrix3>(matrix_->values().data() + 9 * static_cast<std::ptrdiff_t>(stored));
}

std::int32_t BorderedSolver::root_of(std::int32_t border) const {
  while (root_[at(border)] != border) border = root_[at(border)];
  return border;
}

void BorderedSolver::find_components() {
  for (Index b = 0; b < border_count_; ++b) root_[at(b)] = b;
  std::fill(is_coupled_.begin(), is_coupled_.end(), 0);
  couplings_.clear();
  for (const Index stored : matrix_->border_in_use()) {
    const auto [row, column] = matrix_->position(stored);
    if (block(stored).isZero(0)) continue;
    if (column < core_count_) {
      couplings_.push_back({row - core_count_, column, stored});
    } else {
      // The smaller index becomes the root.
      const Index a = root_of(row - core_count_), b = root_of(column - core_count_);
      root_[at(std::max(a, b))] = std::min(a, b);
    }
  }
  // The result must not depend on the order of first use.
  std::sort(couplings_.begin(), couplings_.end(),
            [](const Coupling& a, const Coupling& b) { return a.stored < b.stored; });
  for (const Coupling& coupling : couplings_) is_coupled_[at(root_of(coupling.border))] = 1;
  Index next = 0;
  component_end_.clear();
  for (Index b = 0; b < border_count_; ++b) {
    if (is_coupled_[at(root_of(b))] != 0) order_[at(next++)] = b;
  }
  coupled_count_ = next;
  if (next > 0) component_end_.push_back(next);
  for (Index root = 0; root < border_count_; ++root) {
    if (root_[at(root)] != root || is_coupled_[at(root)] != 0) continue;
    for (Index b = root; b < border_count_; ++b) {
      if (root_of(b) == root) order_[at(next++)] = b;
    }
    component_end_.push_back(next);
  }
  for (Index k = 0; k < border_count_; ++k) place_[at(order_[at(k)])] = k;
}

// The rows of B in this group of columns.
void BorderedSolver::gather_rows(int group) {
  rows_.clear();
  for (const Coupling& coupling : couplings_) {
    if (place_[at(coupling.border)] / kGroupBlocks != group) continue;
    Index& place = row_of_[at(coupling.core)];
    if (place < 0) {
      place = static_cast<Index>(rows_.size());
      rows_.push_back({coupling.core, Eigen::Matrix<double, 3, kColumns>::Zero()});
    }
    const Index first = 3 * (place_[at(coupling.border)] % kGroupBlocks);
    rows_[at(place)].values.middleCols<3>(first) += block(coupling.stored).transpose();
  }
  for (const ColumnsRow& row : rows_) row_of_[at(row.block)] = -1;
}

// Number of columns in a group.
int BorderedSolver::width_of(int group) const {
  return 3 * std::min(kGroupBlocks, coupled_count_ - kGroupBlocks * group);
}

bool BorderedSolver::factorize_border() {
  border_operations_ = 0;
  if (border_count_ == 0) return true;
  find_components();
  schur_.setZero();
  for (Index b = 0; b < border_count_; ++b) {
    const Index row = 3 * place_[at(b)];
    schur_.block<3, 3>(row, row) = block(matrix_->find(core_count_ + b, core_count_ + b).index);
  }
  for (const Index stored : matrix_->border_in_use()) {
    const auto [row, column] = matrix_->position(stored);
    if (column < core_count_ || row == column) continue;
    const Index r = 3 * place_[at(row - core_count_)], c = 3 * place_[at(column - core_count_)];
    schur_.block<3, 3>(r, c) = block(stored);
    schur_.block<3, 3>(c, r) = block(stored).transpose();
  }
  for (int g = 0; g < groups_of(coupled_count_); ++g) {
    gather_rows(g);
    HalfColumns& own = half_columns_[at(g)];
    core_->forward_columns(rows_, own);
    double rows = 0;
    for (const auto& [begin, end] : own.ranges) rows += end - begin;
    border_operations_ += 2 * kColumns * core_->factor_entries() * rows / (3.0 * core_count_);
    for (int h = 0; h <= g; ++h) {
      const HalfColumns& other = half_columns_[at(h)];
      Eigen::Matrix<double, kColumns, kColumns> product = Eigen::Matrix<double, kColumns, kColumns>::Zero();
      for_each_common(own.ranges, other.ranges, [&](Index begin, Index end) {
        for (Index row = begin; row < end; ++row)
          product.noalias() += own.values.row(row).transpose() * other.values.row(row);
      });
      schur_.block(kGroupColumns * g, kGroupColumns * h, width_of(g), width_of(h)) -=
          product.topLeftCorner(width_of(g), width_of(h));
    }
  }
  Index begin = 0;
  for (const Index end : component_end_) {
    Eigen::Ref<Dense> own = schur_.block(3 * begin, 3 * begin, 3 * (end - begin), 3 * (end - begin));
    const Eigen::LLT<Eigen::Ref<Dense>> factor(own);  // in place
    if (factor.info() != Eigen::Success || !own.diagonal().allFinite()) return false;
    begin = end;
  }
  return true;
}

// border_ := S^-1 border_, in the order of `order_`.
void BorderedSolver::solve_border() {
  Index begin = 0;
  for (const Index end : component_end_) {
    const auto factor = schur_.block(3 * begin, 3 * begin, 3 * (end - begin), 3 * (end - begin));
    auto part = border_.segment(3 * begin, 3 * (end - begin));
    factor.triangularView<Eigen::Lower>().solveInPlace(part);
    factor.triangularView<Eigen::Lower>().transpose().solveInPlace(part);
    begin = end;
  }
}

void BorderedSolver::forward(const VectorX& rhs, VectorX& half) {
  core_->forward(rhs, half);
  half.tail(3 * border_count_) = rhs.tail(3 * border_count_);
}

void BorderedSolver::backward(const VectorX& half, VectorX& x) {
  core_->backward(half, x);
  for (Index k = 0; k < border_count_; ++k)
    border_.segment<3>(3 * k) = half.segment<3>(3 * (core_count_ + order_[at(k)]));
  solve_border();
  for (Index k = 0; k < border_count_; ++k) x.segment<3>(3 * (core_count_ + order_[at(k)])) = border_.segment<3>(3 * k);
}

void BorderedSolver::solve(const VectorX& rhs, VectorX& x) {
  if (coupled_count_ == 0) {
    core_->solve(rhs, x);
  } else {
    core_->forward(rhs, half_);
  }
  for (Index k = 0; k < border_count_; ++k)
    border_.segment<3>(3 * k) = rhs.segment<3>(3 * (core_count_ + order_[at(k)]));
  const int groups = groups_of(coupled_count_);
  for (int g = 0; g < groups; ++g) {
    const HalfColumns& columns = half_columns_[at(g)];
    Eigen::Matrix<double, kColumns, 1> sum = Eigen::Matrix<double, kColumns, 1>::Zero();
    for (const auto& [begin, end] : columns.ranges) {
      for (Index row = begin; row < end; ++row) sum += half_[row] * columns.values.row(row).transpose();
    }
    border_.segment(kGroupColumns * g, width_of(g)) -= sum.head(width_of(g));
  }
  solve_border();
  for (int g = 0; g < groups; ++g) {
    const HalfColumns& columns = half_columns_[at(g)];
    Eigen::Matrix<double, kColumns, 1> factors = Eigen::Matrix<double, kColumns, 1>::Zero();
    factors.head(width_of(g)) = border_.segment(kGroupColumns * g, width_of(g));
    for (const auto& [first, end] : columns.ranges) {
      for (Index row = first; row < end; ++row) half_[row] -= columns.values.row(row).dot(factors);
    }
  }
  if (coupled_count_ > 0) core_->backward(half_, x);
  for (Index k = 0; k < border_count_; ++k) x.segment<3>(3 * (core_count_ + order_[at(k)])) = border_.segment<3>(3 * k);
}

bool BorderedSolver::take_factor(const LinearSolver& other) {
  const auto* const same = dynamic_cast<const BorderedSolver*>(&other);
  if (same == nullptr || same->border_count_ != border_count_ || !core_->take_factor(*same->core_)) return false;
  order_ = same->order_;
  place_ = same->place_;
  component_end_ = same->component_end_;
  coupled_count_ = same->coupled_count_;
  half_columns_ = same->half_columns_;
  schur_ = same->schur_;
  return true;
}

}  // namespace softhand
