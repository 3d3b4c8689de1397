#include "energies/relaxation.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

namespace softhand {
namespace {

// (1 - e^-a)/a, finite at a = 0.
double mean_decay(double a) { return a < 1e-8 ? 1 - 0.5 * a : -std::expm1(-a) / a; }

}  // namespace

RelaxationEnergy::RelaxationEnergy(const TissueModel& hand, const Branches& time_constants,
                                   const std::vector<Branches>& weights, InstructionSet set)
    : kernel_(relaxation_kernel(set)), time_constants_(time_constants) {
  for (const double constant : time_constants) {
    if (!(constant > 0) || !std::isfinite(constant))
      throw std::invalid_argument("RelaxationEnergy: time constants must be > 0 s");
  }
  if (weights.size() != hand.materials.size())
    throw std::invalid_argument("RelaxationEnergy: expected weights for each of the " +
                                std::to_string(hand.materials.size()) + " materials");
  for (const Branches& of_material : weights) {
    for (const double weight : of_material) {
      if (!(weight >= 0) || !std::isfinite(weight))
        throw std::invalid_argument("RelaxationEnergy: weights must be finite and >= 0");
    }
  }
  for (std::size_t t = 0; t < hand.tetrahedra.size(); ++t) {
    const Branches& branches = weights[hand.tetrahedron_material[t]];
    if (std::all_of(branches.begin(), branches.end(), [](double weight) { return weight == 0; })) continue;
    const std::size_t lane = static_cast<std::size_t>(element_count_++) % kElementBatch;
    if (lane == 0) batches_.emplace_back();
    std::array<std::int32_t, 4> nodes = hand.tetrahedra[t];
    std::sort(nodes.begin(), nodes.end());
    Matrix3 edges;
    for (int k = 0; k < 3; ++k)
      edges.col(k) = hand.nodes[static_cast<std::size_t>(nodes[static_cast<std::size_t>(k) + 1])] -
                     hand.nodes[static_cast<std::size_t>(nodes[0])];
    std::array<double, 9> inverse;
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(inverse.data()) = edges.inverse();
    const Material& material = hand.materials[hand.tetrahedron_material[t]];
    const double modulus =
        std::abs(edges.determinant()) / 6 * material.youngs_modulus / (2 * (1 + material.poisson_ratio));
    batches_.back().set(lane, nodes, inverse);
    for (std::size_t i = 0; i < kRelaxationBranches; ++i) batches_.back().stiffness[i][lane] = modulus * branches[i];
    // The lanes after the last element repeat it, without stiffness.
    for (std::size_t after = lane + 1; after < kElementBatch; ++after) batches_.back().set(after, nodes, inverse);
    ++batches_.back().count;
  }
  memory_.springs.resize(kSpringBatch * batches_.size());
  begun_positions_.resize(3, hand.node_count());
}

void RelaxationEnergy::load(const Memory& memory) {
  if (memory.springs.size() != memory_.springs.size())
    throw std::invalid_argument("RelaxationEnergy: the memory is that of another hand");
  std::copy(memory.springs.begin(), memory.springs.end(), memory_.springs.begin());
  begun_time_step_ = 0;
  memory_.stored = memory.stored;
  memory_.dissipated = memory.dissipated;
}

void RelaxationEnergy::reset() {
  std::fill(memory_.springs.begin(), memory_.springs.end(), 0.0);
  memory_.stored = memory_.dissipated = 0;
  begun_time_step_ = 0;
}

void RelaxationEnergy::add_pattern(BlockPattern& pattern) const {
  for (const RelaxationBatch& batch : batches_) batch.add_pattern(pattern);
}

void RelaxationEnergy::bind(const BlockMatrix& matrix) {
  for (RelaxationBatch& batch : batches_) batch.bind(matrix);
}

void RelaxationEnergy::begin_step(const State& state, double time_step) {
  const auto bytes = sizeof(double) * static_cast<std::size_t>(begun_positions_.size());
  if (time_step == begun_time_step_ && std::memcmp(begun_positions_.data(), state.node_positions.data(), bytes) == 0)
    return;
  for (std::size_t i = 0; i < kRelaxationBranches; ++i) {
    const double a = time_step / time_constants_[i], g = mean_decay(a);
    // The work on the spring less the growth of |h|^2. The mean of h is g h + (1 - g)/a (E - E_0).
    decay_[i] = {std::exp(-a), g, {-std::expm1(-2 * a), 2 * a * g * g, 2 * (1 - g) / a - g * g}};
  }
  begun_time_step_ = time_step;
  begun_positions_ = state.node_positions.leftCols(begun_positions_.cols());
  kernel_.begin(batches_.data(), batches_.size(), memory_.springs.data(), state.node_positions.data(), decay_);
}

double RelaxationEnergy::evaluate(const State& state, const ElementOutput& output) const {
  return kernel_.energy(batches_.data(), batches_.size(), state.node_positions.data(), output);
}

double RelaxationEnergy::value(const State& state) const { return evaluate(state, {}); }

double RelaxationEnergy::add_gradient(const State& state, VectorX& gradient) const {
  return evaluate(state, {.gradient = gradient.data()});
}

void RelaxationEnergy::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  evaluate(state, {.blocks = hessian.values().data(), .projected = curvature == Curvature::projected});
}

double RelaxationEnergy::add_all(const State& state, VectorX& gradient, BlockMatrix& hessian,
                                 Curvature curvature) const {
  return evaluate(state, {.gradient = gradient.data(),
                          .blocks = hessian.values().data(),
                          .projected = curvature == Curvature::projected,
                          .single_blocks = single_hessian_});
}

void RelaxationEnergy::end_step(State& state) {
  before_ = memory_.stored;
  heat_ = memory_.stored = 0;
  kernel_.end(batches_.data(), batches_.size(), memory_.springs.data(), state.node_positions.data(), decay_,
              memory_.stored, heat_);
  memory_.dissipated += heat_;
  begun_positions_ = state.node_positions.leftCols(begun_positions_.cols());
}

EnergyFlow RelaxationEnergy::flow(double, double, double taken) const {
  return {.stored = memory_.stored, .damping = heat_, .integrator = before_ - memory_.stored + taken - heat_};
}

}  // namespace softhand
