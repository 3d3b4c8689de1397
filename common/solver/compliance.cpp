#include "solver/compliance.hpp"

#include <algorithm>
#include <cmath>

namespace softhand {
namespace {

constexpr std::size_t kGroupBlocks = kColumns / 3;  // blocks in one pass over the factor
// Time of an operation of a dot product in double, relative to one of a factorisation in float.
constexpr double kDotOperation = 16;

}  // namespace

Compliance::Compliance(int core_count, int most_blocks)
    : most_blocks_(std::min(most_blocks, core_count)),
      is_known_(static_cast<std::size_t>(core_count), 0),
      factor_(Dense::Zero(3 * most_blocks_, 3 * most_blocks_)),
      inverse_(factor_),
      stiffness_(factor_) {
  blocks_.reserve(static_cast<std::size_t>(most_blocks_));
  columns_.reserve(static_cast<std::size_t>(most_blocks_));
  // A path to the root holds an eighth of all rows in the shipped hands.
  ranges_.reserve(static_cast<std::size_t>(core_count) * static_cast<std::size_t>(most_blocks_) / 8);
  values_.reserve(static_cast<std::size_t>(core_count) * static_cast<std::size_t>(most_blocks_) * 9 / 4);
  half_columns_.values.setZero(3 * core_count, kColumns);
  half_columns_.ranges.reserve(static_cast<std::size_t>(core_count));
  selection_.reserve(kGroupBlocks);
}

void Compliance::clear() {
  for (const std::int32_t block : blocks_) is_known_[static_cast<std::size_t>(block)] = 0;
  blocks_.clear();
  columns_.clear();
  ranges_.clear();
  values_.clear();
  rows_of_stiffness_ = 0;
}

bool Compliance::include(std::span<const std::int32_t> blocks, LinearSolver& factor) {
  if (blocks_.size() + blocks.size() > static_cast<std::size_t>(most_blocks_)) {
    return false;
  }
  const double entries_per_row = factor.factor_entries() / static_cast<double>(half_columns_.values.rows());
  for (std::size_t first = 0; first < blocks.size(); first += kGroupBlocks) {
    const std::size_t count = std::min(kGroupBlocks, blocks.size() - first);
    selection_.clear();
    for (std::size_t k = 0; k < count; ++k) {
      ColumnsRow& row = selection_.emplace_back();
      row.block = blocks[first + k];
      row.values.setZero();
      row.values.middleCols<3>(3 * static_cast<Eigen::Index>(k)).setIdentity();
    }
    factor.forward_columns(selection_, half_columns_);
    double rows = 0;
    for (const auto& [begin, end] : half_columns_.ranges) rows += end - begin;
    operations_ += 2 * kColumns * entries_per_row * rows;
    for (std::size_t k = 0; k < count; ++k) {
      const auto first_column = 3 * static_cast<Eigen::Index>(k);
      Columns& columns = columns_.emplace_back();
      columns.first_range = ranges_.size();
      columns.values = values_.size();
      for (const auto& [begin, end] : half_columns_.ranges) {
        // The rows before the block's own front belong to another block of the group.
        std::int32_t from = begin;
        while (from < end && half_columns_.values.row(from).segment<3>(first_column).isZero(0)) ++from;
        if (from == end) continue;
        ranges_.emplace_back(from, end);
        for (std::int32_t row = from; row < end; ++row) {
          for (int c = 0; c < 3; ++c) values_.push_back(half_columns_.values(row, first_column + c));
        }
      }
      columns.last_range = ranges_.size();
      blocks_.push_back(blocks[first + k]);
      is_known_[static_cast<std::size_t>(blocks[first + k])] = 1;
    }
  }
  if (extend()) return true;
  clear();
  return false;
}

// V_a' V_b over their common rows.
Matrix3 Compliance::product(const Columns& a, const Columns& b) {
  double sum[9] = {};
  const double* at_a = values_.data() + a.values;
  const double* at_b = values_.data() + b.values;
  for (std::size_t i = a.first_range, j = b.first_range; i < a.last_range && j < b.last_range;) {
    const auto [a_begin, a_end] = ranges_[i];
    const auto [b_begin, b_end] = ranges_[j];
    const std::int32_t begin = std::max(a_begin, b_begin), end = std::min(a_end, b_end);
    if (begin < end) {
      const double* x = at_a + 3 * (begin - a_begin);
      const double* y = at_b + 3 * (begin - b_begin);
      for (std::int32_t row = begin; row < end; ++row, x += 3, y += 3) {
        for (int c = 0; c < 3; ++c) {
          for (int r = 0; r < 3; ++r) sum[3 * c + r] += x[r] * y[c];
        }
      }
      operations_ += kDotOperation * 18.0 * (end - begin);
    }
    if (a_end < b_end) {
      at_a += 3 * (a_end - a_begin);
      ++i;
    } else {
      at_b += 3 * (b_end - b_begin);
      ++j;
    }
  }
  return Eigen::Map<const Matrix3>(sum);
}

// Extends the factor of G, its inverse and S by the blocks that were added.
bool Compliance::extend() {
  const auto known = static_cast<Eigen::Index>(rows_of_stiffness_),
             size = 3 * static_cast<Eigen::Index>(blocks_.size());
  for (std::size_t i = rows_of_stiffness_ / 3; i < blocks_.size(); ++i) {
    for (std::size_t j = 0; j <= i; ++j)
      factor_.block<3, 3>(3 * static_cast<Eigen::Index>(i), 3 * static_cast<Eigen::Index>(j)) =
          product(columns_[i], columns_[j]);
  }
  for (Eigen::Index i = known; i < size; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) {
      const double rest = factor_(i, j) - factor_.row(i).head(j).dot(factor_.row(j).head(j));
      if (j < i) {
        factor_(i, j) = rest / factor_(j, j);
      } else if (rest > 0 && std::isfinite(rest)) {
        factor_(i, i) = std::sqrt(rest);
      } else {
        return false;
      }
    }
    inverse_(i, i) = 1 / factor_(i, i);
    for (Eigen::Index j = 0; j < i; ++j)
      inverse_(j, i) = -factor_.row(i).segment(j, i - j).dot(inverse_.row(j).segment(j, i - j)) * inverse_(i, i);
  }
  for (Eigen::Index i = 0; i < size; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) {
      const Eigen::Index from = std::max(i, known), count = size - from;
      const double added = inverse_.row(i).segment(from, count).dot(inverse_.row(j).segment(from, count));
      stiffness_(i, j) = i < known ? stiffness_(i, j) + added : added;
      stiffness_(j, i) = stiffness_(i, j);
    }
  }
  rows_of_stiffness_ = static_cast<std::size_t>(size);
  operations_ +=
      kDotOperation * 3.0 * static_cast<double>(size - known) * static_cast<double>(size) * static_cast<double>(size);
  return true;
}

Vector3 Compliance::displacement(std::size_t place, const VectorX& half) const {
  const Columns& columns = columns_[place];
  const double* value = values_.data() + columns.values;
  Vector3 sum = Vector3::Zero();
  for (std::size_t i = columns.first_range; i < columns.last_range; ++i) {
    for (std::int32_t row = ranges_[i].first; row < ranges_[i].second; ++row, value += 3)
      sum += half[row] * Eigen::Map<const Vector3>(value);
  }
  return sum;
}

void Compliance::add_forces(const Eigen::Ref<const VectorX>& forces, VectorX& half) const {
  for (std::size_t place = 0; place < blocks_.size(); ++place) {
    const Columns& columns = columns_[place];
    const Vector3 force = forces.segment<3>(3 * static_cast<Eigen::Index>(place));
    if (force.isZero(0)) continue;
    const double* value = values_.data() + columns.values;
    for (std::size_t i = columns.first_range; i < columns.last_range; ++i) {
      for (std::int32_t row = ranges_[i].first; row < ranges_[i].second; ++row, value += 3)
        half[row] += force.dot(Eigen::Map<const Vector3>(value));
    }
  }
}

}  // namespace softhand
