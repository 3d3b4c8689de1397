#include "energies/tissue_elements.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "energies/corotational.hpp"

namespace softhand {
namespace {

[[noreturn]] void refuse(std::size_t element, const char* what) {
  throw std::invalid_argument("Tissue: tetrahedron " + std::to_string(element) + ": " + what);
}

// Splits elements by a plane: 0 and 1 have all nodes on one side, 2 is crossed by the plane. The plane is normal to
// an axis and goes through the median node. The axis with the fewest crossed elements is chosen.
std::vector<std::uint8_t> halves(const TissueModel& model, const std::vector<std::size_t>& elements) {
  std::vector<std::uint8_t> best;
  std::size_t fewest = 0;
  if (elements.empty()) return best;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> heights;
    for (const std::size_t e : elements) {
      for (const std::int32_t n : model.tetrahedra[e])
        heights.push_back(model.nodes[static_cast<std::size_t>(n)][axis]);
    }
    const auto middle = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
    std::nth_element(heights.begin(), middle, heights.end());
    std::vector<std::uint8_t> groups;
    for (const std::size_t e : elements) {
      const auto& nodes = model.tetrahedra[e];
      const auto above = std::count_if(nodes.begin(), nodes.end(), [&](std::int32_t n) {
        return model.nodes[static_cast<std::size_t>(n)][axis] > *middle;
      });
      groups.push_back(above == 0 ? 0 : above == 4 ? 1 : 2);
    }
    const auto crossed = static_cast<std::size_t>(std::count(groups.begin(), groups.end(), 2));
    if (!best.empty() && crossed >= fewest) continue;
    fewest = crossed;
    best = std::move(groups);
  }
  return best;
}

}  // namespace

TissueElements::TissueElements(const TissueModel& model, const std::vector<std::size_t>& elements, InstructionSet set)
    : kernel_(tissue_kernel(set)), all_elements_(model.tetrahedra.size()) {
  if (model.tetrahedron_material.size() != model.tetrahedra.size())
    throw std::invalid_argument("Tissue: one material per tetrahedron expected");
  std::vector<CorotationalMaterial> materials;
  for (const Material& m : model.materials) materials.push_back(corotational_material(m));
  for (const std::size_t e : elements) {
    std::array<std::int32_t, 4> nodes = model.tetrahedra[e];
    if (std::any_of(nodes.begin(), nodes.end(), [&model](std::int32_t n) { return n < 0 || n >= model.node_count(); }))
      refuse(e, "node out of range");
    if (model.tetrahedron_material[e] >= materials.size()) refuse(e, "material out of range");
    std::sort(nodes.begin(), nodes.end());
    nodes_.push_back(nodes);
  }
  const std::size_t count = elements.size();
  const std::vector<std::uint8_t> groups = halves(model, elements);
  std::vector<std::size_t> places;  // as `order_`, of the elements of this object
  position_.resize(count);
  for (std::size_t g = 0; g < 3; ++g) {
    for (std::size_t e = 0; e < count; ++e) {
      if (groups[e] != g) continue;
      position_[e] = static_cast<std::int32_t>(places.size());
      places.push_back(e);
    }
    while (places.size() % kElementBatch != 0) places.push_back(places.back());
    group_[g + 1] = places.size() / kElementBatch;
  }
  batches_.resize(places.size() / kElementBatch);
  for (std::size_t position = 0; position < places.size(); ++position) {
    const std::size_t place = places[position], e = elements[place];
    order_.push_back(e);
    const std::array<std::int32_t, 4>& nodes = nodes_[place];
    Matrix3 edges;
    for (int a = 0; a < 3; ++a) {
      edges.col(a) = model.nodes[static_cast<std::size_t>(nodes[static_cast<std::size_t>(a) + 1])] -
                     model.nodes[static_cast<std::size_t>(nodes[0])];
    }
    const double volume = std::abs(edges.determinant()) / 6.0;
    const double longest = edges.colwise().norm().maxCoeff();
    if (!(volume > 1e-12 * longest * longest * longest) || !std::isfinite(volume)) refuse(e, "no volume");
    TissueBatch& batch = batches_[position / kElementBatch];
    const std::size_t lane = position % kElementBatch;
    if (position_[place] == static_cast<std::int32_t>(position)) ++batch.count;
    std::array<double, 9> inverse;
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(inverse.data()) = edges.inverse();
    batch.set(lane, nodes, inverse);
    batch.volume[lane] = volume;
    const CorotationalMaterial& m = materials[model.tetrahedron_material[e]];
    batch.mu[lane] = m.mu;
    batch.lambda[lane] = m.lambda;
    batch.limit_energy[lane] = m.strain_limit_energy;
    batch.limit_stiffness[lane] = m.strain_limit_stiffness;
    batch.limit_ramp[lane] = m.strain_limit_ramp;
    batch.ramp_rate[lane] = m.strain_limit_ramp > 0 ? 0.5 / m.strain_limit_ramp : 0;
  }
  const auto node_count = static_cast<std::size_t>(model.node_count());
  first_around_.assign(node_count + 1, 0);
  for (const auto& nodes : nodes_) {
    for (const std::int32_t node : nodes) ++first_around_[static_cast<std::size_t>(node) + 1];
  }
  std::partial_sum(first_around_.begin(), first_around_.end(), first_around_.begin());
  around_.resize(4 * count);
  std::vector<std::int32_t> next = first_around_;
  for (std::size_t e = 0; e < count; ++e) {
    for (const std::int32_t node : nodes_[e])
      around_[static_cast<std::size_t>(next[static_cast<std::size_t>(node)]++)] = static_cast<std::int32_t>(e);
  }
  place_.assign(node_count, -1);
  gradient_around_.assign(3 * node_count, 0.0);
  is_chosen_.assign(count, 0);
  chosen_.reserve(count);
}

void TissueElements::add_pattern(BlockPattern& pattern) const {
  for (const TissueBatch& batch : batches_) batch.add_pattern(pattern);
}

void TissueElements::bind(const BlockMatrix& matrix) {
  for (TissueBatch& batch : batches_) batch.bind(matrix);
}

double TissueElements::evaluate(const State& state, const ElementOutput& output,
                                const RelaxationBatch* relaxation) const {
  evaluated_ += count();
  const auto energy_of = [&](std::size_t group) {
    return kernel_(batches_.data() + group_[group], relaxation == nullptr ? nullptr : relaxation + group_[group],
                   group_[group + 1] - group_[group], state.node_positions.data(), output);
  };
  double one = 0, other = 0;
  run_halves(
      helper_, [&] { one = energy_of(0); }, [&] { other = energy_of(1); });
  return one + other + energy_of(2);
}

double TissueElements::value(const State& state, const RelaxationBatch* relaxation) const {
  return evaluate(state, {}, relaxation);
}

double TissueElements::add_gradient(const State& state, VectorX& gradient, const RelaxationBatch* relaxation) const {
  return evaluate(state, {.gradient = gradient.data()}, relaxation);
}

void TissueElements::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature,
                                 const RelaxationBatch* relaxation) const {
  evaluate(state, {.blocks = hessian.values().data(), .projected = curvature == Curvature::projected}, relaxation);
}

double TissueElements::add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature,
                               const RelaxationBatch* relaxation) const {
  return evaluate(state,
                  {.gradient = gradient.data(),
                   .blocks = hessian.values().data(),
                   .projected = curvature == Curvature::projected,
                   .single_blocks = single_hessian_},
                  relaxation);
}

Energy::Around TissueElements::add_around(std::span<const std::int32_t> nodes, const State& state, double* gradient,
                                          double* blocks, const RelaxationBatch* relaxation) const {
  chosen_.clear();
  for (std::size_t place = 0; place < nodes.size(); ++place) {
    const auto node = static_cast<std::size_t>(nodes[place]);
    if (node >= place_.size()) continue;
    place_[node] = static_cast<std::int32_t>(place);
    for (std::int32_t k = first_around_[node]; k < first_around_[node + 1]; ++k) {
      const std::int32_t element = around_[static_cast<std::size_t>(k)];
      std::uint8_t& is_chosen = is_chosen_[static_cast<std::size_t>(element)];
      if (is_chosen == 0) chosen_.push_back(element);
      is_chosen = 1;
    }
  }
  const auto scratch_block = static_cast<std::int32_t>(nodes.size() * (nodes.size() + 1) / 2);
  Energy::Around result;
  for (std::size_t first = 0; first < chosen_.size(); first += kElementBatch) {
    batch_around_.count = std::min(kElementBatch, chosen_.size() - first);
    for (std::size_t lane = 0; lane < kElementBatch; ++lane) {
      const auto from = static_cast<std::size_t>(
          position_[static_cast<std::size_t>(chosen_[first + std::min(lane, batch_around_.count - 1)])]);
      const std::size_t batch = from / kElementBatch, from_lane = from % kElementBatch;
      batch_around_.copy_lane(lane, batches_[batch], from_lane);
      if (relaxation != nullptr) relaxation_around_.copy_step(lane, relaxation[batch], from_lane);
      std::size_t slot = 0;
      for (std::size_t a = 0; a < 4; ++a) {
        const std::int32_t row = place_[static_cast<std::size_t>(batch_around_.node[a][lane])];
        for (std::size_t b = 0; b <= a; ++b, ++slot) {
          const std::int32_t column = place_[static_cast<std::size_t>(batch_around_.node[b][lane])];
          batch_around_.slot[slot][lane] = row < 0 || column < 0 ? scratch_block : row * (row + 1) / 2 + column;
        }
      }
    }
    result.energy +=
        kernel_(&batch_around_, relaxation == nullptr ? nullptr : &relaxation_around_, 1, state.node_positions.data(),
                {.gradient = gradient_around_.data(), .blocks = blocks, .single_blocks = single_hessian_});
  }
  evaluated_ += chosen_.size();
  result.share = static_cast<double>(chosen_.size()) / static_cast<double>(all_elements_);
  for (const std::int32_t element : chosen_) {
    is_chosen_[static_cast<std::size_t>(element)] = 0;
    for (const std::int32_t node : nodes_[static_cast<std::size_t>(element)]) {
      double* const from = &gradient_around_[3 * static_cast<std::size_t>(node)];
      const std::int32_t place = place_[static_cast<std::size_t>(node)];
      for (std::int32_t k = 0; k < 3 && place >= 0; ++k) gradient[3 * place + k] += from[k];
      std::fill_n(from, 3, 0.0);
    }
  }
  for (const std::int32_t node : nodes) {
    if (static_cast<std::size_t>(node) < place_.size()) place_[static_cast<std::size_t>(node)] = -1;
  }
  return result;
}

}  // namespace softhand
