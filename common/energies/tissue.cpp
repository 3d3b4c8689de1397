#include "energies/tissue.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "math/tetrahedron.hpp"

namespace softhand {

Tissue::Tissue(const TissueModel& model, InstructionSet set, std::string_view name, const PronySeries& relaxation)
    : name_(name), elements_(model, relaxation.tetrahedra(model, false), set) {
  std::vector<CorotationalMaterial> materials;
  for (const Material& material : model.materials) materials.push_back(corotational_material(material));
  for (std::size_t e = 0; e < model.tetrahedra.size(); ++e) {
    std::array<std::int32_t, 4> corners = model.tetrahedra[e];
    std::sort(corners.begin(), corners.end());
    const auto edges = [&] {
      Matrix3 result;
      for (int a = 0; a < 3; ++a)
        result.col(a) = model.nodes[static_cast<std::size_t>(corners[static_cast<std::size_t>(a) + 1])] -
                        model.nodes[static_cast<std::size_t>(corners[0])];
      return result;
    };
    if (edges().determinant() < 0.0) std::swap(corners[2], corners[3]);
    tetrahedra_.push_back(
        {corners, materials[model.tetrahedron_material[e]], edges().determinant() / 6.0, edges().inverse()});
  }
}

Matrix3 Tissue::deformation_gradient(const State& state, int element) const {
  const Tetrahedron& tetrahedron = at(element);
  Matrix3 edges;
  for (int a = 0; a < 3; ++a)
    edges.col(a) = state.node_positions.col(tetrahedron.corners[static_cast<std::size_t>(a) + 1]) -
                   state.node_positions.col(tetrahedron.corners[0]);
  return edges * tetrahedron.inverse_edges;
}

double Tissue::value(const State& state) const { return is_on_ ? elements_.value(state) : 0; }

double Tissue::add_gradient(const State& state, VectorX& gradient) const {
  return is_on_ ? elements_.add_gradient(state, gradient) : 0;
}

void Tissue::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  if (is_on_) elements_.add_hessian(state, hessian, curvature);
}

double Tissue::add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const {
  return is_on_ ? elements_.add_all(state, gradient, hessian, curvature) : 0;
}

Energy::Around Tissue::add_around(std::span<const std::int32_t> nodes, const State& state, double* gradient,
                                  double* blocks) const {
  return is_on_ ? elements_.add_around(nodes, state, gradient, blocks) : Around{};
}

// Uses the sign of the volume. Computing det F of all tetrahedra, or finding them in their batches, would take most of
// the time of a status.
int Tissue::inverted_elements(const State& state) const {
  return static_cast<int>(std::ranges::count_if(tetrahedra_, [&](const Tetrahedron& tetrahedron) {
    return tetrahedron_volume(state.node_positions, tetrahedron.corners) < 0.0;
  }));
}

bool Tissue::is_folded(const State& state, int element) const {
  if (tetrahedron_volume(state.node_positions, at(element).corners) >= 0.0) return false;
  return energy_density(state, element) > flip_density(at(element).material);
}

double Tissue::energy_density(const State& state, int element) const {
  return evaluate_corotational(at(element).material, deformation_gradient(state, element)).density;
}

double Tissue::energy(const State& state, int element) const {
  return at(element).volume * energy_density(state, element);
}

double Tissue::von_mises_stress(const State& state, int element) const {
  const CorotationalMaterial& constants = at(element).material;
  const CorotationalState point = evaluate_corotational(constants, deformation_gradient(state, element));
  const Vector3 principal = 2 * constants.mu * point.factor * (point.svd.singular_values.array() - 1.0);
  const Vector3 deviator = principal.array() - principal.mean();
  return std::sqrt(1.5) * deviator.norm();
}

}  // namespace softhand
