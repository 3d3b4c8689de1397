#include "energies/tissue.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "math/tetrahedron.hpp"

namespace softhand {
namespace {

[[noreturn]] void refuse(std::size_t element, const char* what) {
  throw std::invalid_argument("Tissue: tetrahedron " + std::to_string(element) + ": " + what);
}

// Splits the elements by a plane: 0 and 1 have all nodes on one side, 2 is crossed by the plane. The plane is normal to
// an axis and goes through the median node. The axis with the fewest crossed elements is chosen.
std::vector<std::uint8_t> halves(const TissueModel& model) {
  std::vector<std::uint8_t> best;
  std::size_t fewest = 0;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> heights;
    for (const auto& nodes : model.tetrahedra) {
      for (const std::int32_t n : nodes) heights.push_back(model.nodes[static_cast<std::size_t>(n)][axis]);
    }
    const auto middle = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
    std::nth_element(heights.begin(), middle, heights.end());
    std::vector<std::uint8_t> groups;
    for (const auto& nodes : model.tetrahedra) {
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

Tissue::Tissue(const TissueModel& model, InstructionSet set, std::string_view name)
    : name_(name), kernel_(tissue_kernel(set)) {
  const std::size_t count = model.tetrahedra.size();
  if (model.tetrahedron_material.size() != count)
    throw std::invalid_argument("Tissue: one material per tetrahedron expected");
  std::vector<CorotationalMaterial> materials;
  for (const Material& m : model.materials) materials.push_back(corotational_material(m));
  for (std::size_t e = 0; e < count; ++e) {
    const auto& nodes = model.tetrahedra[e];
    if (std::any_of(nodes.begin(), nodes.end(), [&model](std::int32_t n) { return n < 0 || n >= model.node_count(); }))
      refuse(e, "node out of range");
    if (model.tetrahedron_material[e] >= materials.size()) refuse(e, "material out of range");
  }
  element_count_ = static_cast<int>(count);
  const std::vector<std::uint8_t> groups = halves(model);
  std::vector<std::size_t>
      order;  // element of each lane; the last one of a group is repeated to the end of its last batch
  position_.resize(count);
  for (std::size_t g = 0; g < 3; ++g) {
    for (std::size_t e = 0; e < count; ++e) {
      if (groups[e] != g) continue;
      position_[e] = static_cast<std::int32_t>(order.size());
      order.push_back(e);
    }
    while (order.size() % kElementBatch != 0) order.push_back(order.back());
    group_[g + 1] = order.size() / kElementBatch;
  }
  batches_.resize(order.size() / kElementBatch);
  corners_.resize(count);
  for (std::size_t position = 0; position < order.size(); ++position) {
    const std::size_t e = order[position];
    std::array<std::int32_t, 4> nodes = model.tetrahedra[e];
    std::sort(nodes.begin(), nodes.end());
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
    if (position_[e] == static_cast<std::int32_t>(position)) ++batch.count;
    corners_[e] = nodes;
    if (edges.determinant() < 0.0) std::swap(corners_[e][2], corners_[e][3]);
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
  for (const auto& nodes : model.tetrahedra) {
    for (const std::int32_t node : nodes) ++first_around_[static_cast<std::size_t>(node) + 1];
  }
  std::partial_sum(first_around_.begin(), first_around_.end(), first_around_.begin());
  around_.resize(4 * count);
  std::vector<std::int32_t> next = first_around_;
  for (std::size_t e = 0; e < count; ++e) {
    for (const std::int32_t node : model.tetrahedra[e])
      around_[static_cast<std::size_t>(next[static_cast<std::size_t>(node)]++)] = static_cast<std::int32_t>(e);
  }
  place_.assign(node_count, -1);
  gradient_around_.assign(3 * node_count, 0.0);
  is_chosen_.assign(count, 0);
  chosen_.reserve(count);
}

void Tissue::add_pattern(BlockPattern& pattern) const {
  for (const TissueBatch& batch : batches_) batch.add_pattern(pattern);
}

void Tissue::bind(const BlockMatrix& matrix) {
  for (TissueBatch& batch : batches_) batch.bind(matrix);
}

Tissue::Place Tissue::place_of(int element) const {
  const auto position = static_cast<std::size_t>(position_[static_cast<std::size_t>(element)]);
  return {position / kElementBatch, position % kElementBatch};
}

CorotationalMaterial Tissue::material(int element) const {
  const auto [b, lane] = place_of(element);
  const TissueBatch& batch = batches_[b];
  return {batch.mu[lane], batch.lambda[lane], batch.limit_energy[lane], batch.limit_stiffness[lane],
          batch.limit_ramp[lane]};
}

Matrix3 Tissue::deformation_gradient(const State& state, int element) const {
  const auto [b, lane] = place_of(element);
  const TissueBatch& batch = batches_[b];
  const Vector3 origin = state.node_positions.col(batch.node[0][lane]);
  Matrix3 f = Matrix3::Zero();
  for (std::size_t a = 0; a < 3; ++a) {
    const Vector3 edge = state.node_positions.col(batch.node[a + 1][lane]) - origin;
    for (std::size_t j = 0; j < 3; ++j) f.col(static_cast<Eigen::Index>(j)) += batch.shape[3 * a + j][lane] * edge;
  }
  return f;
}

double Tissue::evaluate(const State& state, const ElementOutput& output) const {
  if (!is_on_) return 0;
  evaluated_elements_ += static_cast<std::uint64_t>(element_count_);
  const auto energy_of = [&](std::size_t group) {
    return kernel_(batches_.data() + group_[group], group_[group + 1] - group_[group], state.node_positions.data(),
                   output);
  };
  double one = 0, other = 0;
  run_halves(
      helper_, [&] { one = energy_of(0); }, [&] { other = energy_of(1); });
  return one + other + energy_of(2);
}

double Tissue::value(const State& state) const { return evaluate(state, {}); }

double Tissue::add_gradient(const State& state, VectorX& gradient) const {
  return evaluate(state, {.gradient = gradient.data()});
}

void Tissue::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  evaluate(state, {.blocks = hessian.values().data(), .projected = curvature == Curvature::projected});
}

double Tissue::add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const {
  return evaluate(state, {.gradient = gradient.data(),
                          .blocks = hessian.values().data(),
                          .projected = curvature == Curvature::projected,
                          .single_blocks = single_hessian_});
}

Energy::Around Tissue::add_around(std::span<const std::int32_t> nodes, const State& state, double* gradient,
                                  double* blocks) const {
  if (!is_on_) return {};
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
  Around result;
  for (std::size_t first = 0; first < chosen_.size(); first += kElementBatch) {
    batch_around_.count = std::min(kElementBatch, chosen_.size() - first);
    for (std::size_t lane = 0; lane < kElementBatch; ++lane) {
      const Place from = place_of(chosen_[first + std::min(lane, batch_around_.count - 1)]);
      batch_around_.copy_lane(lane, batches_[from.batch], from.lane);
      std::size_t slot = 0;
      for (std::size_t a = 0; a < 4; ++a) {
        const std::int32_t row = place_[static_cast<std::size_t>(batch_around_.node[a][lane])];
        for (std::size_t b = 0; b <= a; ++b, ++slot) {
          const std::int32_t column = place_[static_cast<std::size_t>(batch_around_.node[b][lane])];
          batch_around_.slot[slot][lane] = row < 0 || column < 0 ? scratch_block : row * (row + 1) / 2 + column;
        }
      }
    }
    result.energy += kernel_(&batch_around_, 1, state.node_positions.data(),
                             {.gradient = gradient_around_.data(), .blocks = blocks, .single_blocks = single_hessian_});
  }
  evaluated_elements_ += chosen_.size();
  result.share = static_cast<double>(chosen_.size()) / element_count_;
  for (const std::int32_t element : chosen_) {
    is_chosen_[static_cast<std::size_t>(element)] = 0;
    for (const std::int32_t node : corners_[static_cast<std::size_t>(element)]) {
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

// Uses the sign of the volume. Computing det F of all tetrahedra, or finding them in their batches, would take most of
// the time of a status.
int Tissue::inverted_elements(const State& state) const {
  int count = 0;
  for (const auto& corners : corners_) count += tetrahedron_volume(state.node_positions, corners) < 0.0 ? 1 : 0;
  return count;
}

bool Tissue::is_folded(const State& state, int element) const {
  if (tetrahedron_volume(state.node_positions, corners_[static_cast<std::size_t>(element)]) >= 0.0) return false;
  return energy_density(state, element) > flip_density(material(element));
}

double Tissue::energy_density(const State& state, int element) const {
  return evaluate_corotational(material(element), deformation_gradient(state, element)).density;
}

double Tissue::energy(const State& state, int element) const {
  const auto [b, lane] = place_of(element);
  return batches_[b].volume[lane] * energy_density(state, element);
}

double Tissue::von_mises_stress(const State& state, int element) const {
  const CorotationalMaterial constants = material(element);
  const CorotationalState point = evaluate_corotational(constants, deformation_gradient(state, element));
  const Vector3 principal = 2 * constants.mu * point.factor * (point.svd.singular_values.array() - 1.0);
  const Vector3 deviator = principal.array() - principal.mean();
  return std::sqrt(1.5) * deviator.norm();
}

}  // namespace softhand
