#include "energies/relaxing_tissue.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

namespace softhand {
namespace {

const PronySeries& checked(const PronySeries& series, const TissueModel& model) {
  if (series.weights.empty()) return series;
  for (const double constant : series.time_constants) {
    if (!(constant > 0) || !std::isfinite(constant))
      throw std::invalid_argument("RelaxingTissue: time constants must be > 0 s");
  }
  if (series.weights.size() != model.materials.size())
    throw std::invalid_argument("RelaxingTissue: expected weights for each of the " +
                                std::to_string(model.materials.size()) + " materials");
  for (const PronySeries::Branches& weights : series.weights) {
    const bool is_positive = std::ranges::all_of(weights, [](double weight) { return weight >= 0; });
    if (!is_positive || !(std::accumulate(weights.begin(), weights.end(), 0.0) < 1))
      throw std::invalid_argument("RelaxingTissue: weights must be >= 0, with a sum below 1 for each material");
  }
  return series;
}

}  // namespace

std::vector<std::size_t> PronySeries::tetrahedra(const TissueModel& model, bool relaxing) const {
  std::vector<std::size_t> result;
  for (std::size_t t = 0; t < model.tetrahedra.size(); ++t) {
    const bool relaxes = !weights.empty() && weights.at(model.tetrahedron_material.at(t)) != Branches{};
    if (relaxes == relaxing) result.push_back(t);
  }
  return result;
}

RelaxingTissue::RelaxingTissue(const TissueModel& model, const PronySeries& series, InstructionSet set)
    : series_(checked(series, model)),
      elements_(model, series.tetrahedra(model, true), set),
      kernel_(relaxation_kernel(set)),
      batches_(elements_.batches().size()) {
  for (std::size_t position = 0; position < elements_.order().size(); ++position) {
    const PronySeries::Branches& weights = series_.weights[model.tetrahedron_material[elements_.order()[position]]];
    for (std::size_t i = 0; i < kRelaxationBranches; ++i)
      batches_[position / kElementBatch].weight[i][position % kElementBatch] = weights[i];
  }
  memory_.mean_stresses.assign(kMemoryBatch * batches_.size(), 0.0);
  begun_positions_.setZero(3, model.node_count());
}

void RelaxingTissue::begin_step(const State& state, double time_step) {
  in_step_ = true;
  const auto positions = state.node_positions.leftCols(begun_positions_.cols());
  if (time_step != begun_time_step_ || begun_positions_ != positions) {
    for (std::size_t i = 0; i < kRelaxationBranches; ++i) {
      const double a = time_step / series_.time_constants[i];
      const double kept = std::exp(-a), mean = a < 1e-8 ? 1 - 0.5 * a : -std::expm1(-a) / a;
      decay_[i] = {kept, 1 - mean, mean - kept};
    }
    begun_time_step_ = time_step;
    begun_positions_ = positions;
    kernel_.begin(elements_.batches().data(), batches_.data(), batches_.size(), memory_.mean_stresses.data(),
                  state.node_positions.data(), decay_);
  }
  put_in_ = memory_.fresh ? elements_.value(state) - value(state) : 0;
}

void RelaxingTissue::end_step(State& state) {
  in_step_ = false;
  stored_ = kernel_.end(elements_.batches().data(), batches_.data(), batches_.size(), memory_.mean_stresses.data(),
                        state.node_positions.data(), decay_);
  memory_.fresh = false;
  begun_positions_ = state.node_positions.leftCols(begun_positions_.cols());
}

EnergyFlow RelaxingTissue::flow(double start, double end, double taken) const {
  return {.stored = stored_, .work = put_in_, .damping = put_in_ + end - stored_, .integrator = start - end + taken};
}

void RelaxingTissue::load(const Memory& memory) {
  if (memory.mean_stresses.size() != memory_.mean_stresses.size())
    throw std::invalid_argument("RelaxingTissue: the memory is that of other tissue");
  std::copy(memory.mean_stresses.begin(), memory.mean_stresses.end(), memory_.mean_stresses.begin());
  memory_.fresh = memory.fresh;
  begun_time_step_ = 0;
}

void RelaxingTissue::reset_moved(const State& state) {
  if (begun_time_step_ == 0) return;
  for (std::size_t b = 0; b < batches_.size(); ++b) {
    const TissueBatch& batch = elements_.batches()[b];
    for (std::size_t lane = 0; lane < kElementBatch; ++lane) {
      const bool moved = std::ranges::any_of(batch.node, [&](const auto& node) {
        return begun_positions_.col(node[lane]) != state.node_positions.col(node[lane]);
      });
      if (!moved) continue;
      for (std::size_t k = lane; k < kMemoryBatch; k += kElementBatch) memory_.mean_stresses[kMemoryBatch * b + k] = 0;
    }
  }
}

void RelaxingTissue::reset() {
  std::fill(memory_.mean_stresses.begin(), memory_.mean_stresses.end(), 0.0);
  memory_.fresh = true;
  begun_time_step_ = 0;
}

}  // namespace softhand
