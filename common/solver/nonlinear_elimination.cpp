#include "solver/nonlinear_elimination.hpp"

#include <algorithm>

#include "math/index.hpp"

namespace softhand {
namespace {

// Nodes with more than this fraction of the largest residual force move, and their neighbours. If there are more than
// `kFew`, the residual is not that of a few tetrahedra.
constexpr double kLargeForce = 0.3;
constexpr std::size_t kFew = 30;
constexpr int kMaxIterations = 8;
// Fraction of the first residual at which the nodes are in balance. Then their neighbours have larger residuals.
constexpr double kBalancedFraction = 0.02;
constexpr int kMaxShortenings = 4;
constexpr double kElementArmijo = 1e-4;
constexpr auto kMaxRows = 3 * static_cast<Eigen::Index>(NonlinearElimination::kMaxNodes);
// A node shares a term with kinks with a few others.
constexpr std::size_t kMaxOthers = 40 * NonlinearElimination::kMaxNodes;

}  // namespace

NonlinearElimination::NonlinearElimination(DofLayout layout, const BlockMatrix& hessian)
    : layout_(layout),
      place_(static_cast<std::size_t>(layout.node_count), -1),
      trial_(empty_state(layout)),
      blocks_(9 * (kMaxNodes * (kMaxNodes + 1) / 2 + 1)),
      gradient_(kMaxRows),
      other_gradient_(kMaxRows),
      moves_(kMaxRows),
      trial_moves_(kMaxRows),
      step_(kMaxRows),
      product_(kMaxRows),
      dense_(kMaxNodes) {
  std::vector<std::vector<std::int32_t>> neighbours(place_.size());
  for (int column = 0; column < layout.node_count; ++column) {
    for (std::int32_t k = hessian.column_start()[at(column)]; k < hessian.column_start()[at(column) + 1]; ++k) {
      const std::int32_t row = hessian.row()[at(k)];
      if (row == column || row >= layout.node_count) continue;
      neighbours[at(row)].push_back(column);
      neighbours[at(column)].push_back(row);
    }
  }
  for (const auto& of_node : neighbours) {
    first_neighbour_.push_back(static_cast<std::int32_t>(neighbour_.size()));
    neighbour_.insert(neighbour_.end(), of_node.begin(), of_node.end());
  }
  first_neighbour_.push_back(static_cast<std::int32_t>(neighbour_.size()));
  nodes_.reserve(kMaxNodes);
  others_.reserve(kMaxOthers);
}

// Fills `nodes_` with the nodes of large residual forces and their neighbours. None if these are more than a few.
void NonlinearElimination::select(const VectorX& gradient) {
  for (const std::int32_t node : nodes_) place_[at(node)] = -1;
  nodes_.clear();
  double largest = 0;
  for (int node = 0; node < layout_.node_count; ++node)
    largest = std::max(largest, gradient.segment<3>(3 * node).squaredNorm());
  const auto add = [this](std::int32_t node) {
    if (place_[at(node)] >= 0 || nodes_.size() == kMaxNodes) return;
    place_[at(node)] = 0;
    nodes_.push_back(node);
  };
  for (int node = 0; node < layout_.node_count; ++node) {
    if (gradient.segment<3>(3 * node).squaredNorm() > kLargeForce * kLargeForce * largest) add(node);
  }
  const std::size_t count = nodes_.size();
  if (count > kFew) {
    for (const std::int32_t node : nodes_) place_[at(node)] = -1;
    nodes_.clear();
    return;
  }
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t node = at(nodes_[k]);
    for (std::int32_t n = first_neighbour_[node]; n < first_neighbour_[node + 1]; ++n) add(neighbour_[at(n)]);
  }
  std::sort(nodes_.begin(), nodes_.end());
  for (std::size_t k = 0; k < nodes_.size(); ++k) place_[at(nodes_[k])] = static_cast<std::int32_t>(k);
}

// Returns the energy of the model after the nodes moved from `state` by `moves`. Computes `gradient_`, and the
// elements' Hessian in `blocks_`.
double NonlinearElimination::evaluate(const State& state, const VectorX& moves, const IncrementalPotential& potential,
                                      Result& result) {
  const Eigen::Index rows = 3 * static_cast<Eigen::Index>(nodes_.size());
  for (std::size_t k = 0; k < nodes_.size(); ++k)
    trial_.node_positions.col(nodes_[k]) =
        state.node_positions.col(nodes_[k]) + moves.segment<3>(3 * static_cast<Eigen::Index>(k));
  gradient_.head(rows).setZero();
  std::fill_n(blocks_.begin(), 9 * (nodes_.size() * (nodes_.size() + 1) / 2), 0.0);
  const Energy::Around around = potential.add_around(nodes_, trial_, gradient_.data(), blocks_.data());
  result.share += around.share;
  auto product = product_.head(rows);
  product.setZero();
  for (const OtherBlock& other : others_) {
    product.segment<3>(3 * other.row) += other.value * moves.segment<3>(3 * other.column);
    if (other.row != other.column)
      product.segment<3>(3 * other.column) += other.value.transpose() * moves.segment<3>(3 * other.row);
  }
  gradient_.head(rows) += other_gradient_.head(rows) + product;
  return around.energy + moves.head(rows).dot(other_gradient_.head(rows) + 0.5 * product);
}

NonlinearElimination::Result NonlinearElimination::minimise(const State& state, const IncrementalPotential& potential,
                                                            bool has_kinks, VectorX& direction) {
  Result result;
  select(potential.gradient());
  if (nodes_.empty()) return result;
  const Eigen::Index rows = 3 * static_cast<Eigen::Index>(nodes_.size());
  others_.clear();
  const BlockMatrix& hessian = potential.hessian();
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    const std::size_t column = at(nodes_[i]);
    for (std::int32_t k = hessian.column_start()[column]; k < hessian.column_start()[column + 1]; ++k) {
      const std::int32_t row = hessian.row()[at(k)];
      const std::int32_t j = row < layout_.node_count ? place_[at(row)] : -1;
      if (j < 0 || others_.size() == kMaxOthers) continue;
      const auto block = potential.other_stiffness(k);
      if (!block.isZero(0)) others_.push_back({j, static_cast<Eigen::Index>(i), block});
    }
  }
  for (std::size_t k = 0; has_kinks && k < hessian.journal().size(); ++k) {
    const auto [row, column] = hessian.position(hessian.journal()[k]);
    if (row >= layout_.node_count || column >= layout_.node_count || others_.size() == kMaxOthers) continue;
    const std::int32_t j = place_[at(row)], i = place_[at(column)];
    if (i >= 0 && j >= 0) others_.push_back({j, i, hessian.added(k)});
  }
  trial_.node_positions = state.node_positions;
  auto moves = moves_.head(rows), trial_moves = trial_moves_.head(rows), step = step_.head(rows),
       gradient = gradient_.head(rows), other_gradient = other_gradient_.head(rows);
  moves.setZero();
  other_gradient.setZero();
  double energy = evaluate(state, moves_, potential, result);
  for (std::size_t k = 0; k < nodes_.size(); ++k) {
    const auto first = 3 * static_cast<Eigen::Index>(k);
    const Vector3 whole = potential.gradient().segment<3>(3 * nodes_[k]);
    other_gradient.segment<3>(first) = whole - gradient.segment<3>(first);
    gradient.segment<3>(first) = whole;
  }
  const double balanced = kBalancedFraction * gradient.lpNorm<Eigen::Infinity>();
  for (int iteration = 0; iteration < kMaxIterations && gradient.lpNorm<Eigen::Infinity>() > balanced; ++iteration) {
    dense_.assign(blocks_, rows);
    for (const OtherBlock& other : others_) dense_.add(other.row, other.column, other.value);
    if (!dense_.factorize()) break;
    result.operations += dense_.operations();
    step = -gradient;
    dense_.solve(step);
    if (!step.allFinite()) break;
    const double slope = gradient.dot(step);
    bool falls = false;
    double scale = 1;
    for (int shortening = 0; shortening <= kMaxShortenings && !falls; ++shortening, scale *= 0.5) {
      trial_moves = moves + scale * step;
      const double trial_energy = evaluate(state, trial_moves_, potential, result);
      falls = trial_energy <= energy + kElementArmijo * scale * slope;
      if (falls) energy = trial_energy;
    }
    if (!falls) break;
    moves = trial_moves;
    result.found = true;
  }
  if (!result.found) return result;
  direction.setZero();
  for (std::size_t k = 0; k < nodes_.size(); ++k)
    direction.segment<3>(3 * nodes_[k]) = moves.segment<3>(3 * static_cast<Eigen::Index>(k));
  return result;
}

}  // namespace softhand
