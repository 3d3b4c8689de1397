#include "energies/tissue.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace softhand {
namespace {

constexpr std::size_t slot_of(std::size_t row, std::size_t column) { return row * (row + 1) / 2 + column; }

}  // namespace

Tissue::Tissue(const HandModel& hand) {
  const std::size_t count = hand.tetrahedra.size();
  if (hand.tetrahedron_material.size() != count) throw std::invalid_argument("Tissue: one material per tetrahedron expected");
  std::vector<CorotationalMaterial> materials;
  for (const Material& m : hand.materials) {
    materials.push_back(corotational_material(m.youngs_modulus, m.poisson_ratio, m.strain_limit_energy, m.strain_limit_stiffness));
  }
  for (auto& array : node_) array.resize(count);
  for (auto& array : shape_) array.resize(count);
  for (auto& array : constants_) array.resize(count);
  for (auto& array : slot_) array.assign(count, -1);
  volume_.resize(count);
  for (std::size_t e = 0; e < count; ++e) {
    const auto refuse = [e](const char* what) { throw std::invalid_argument("Tissue: tetrahedron " + std::to_string(e) + ": " + what); };
    std::array<std::int32_t, 4> nodes = hand.tetrahedra[e];
    std::sort(nodes.begin(), nodes.end());
    if (nodes[0] < 0 || nodes[3] >= hand.node_count()) refuse("node out of range");
    if (hand.tetrahedron_material[e] >= materials.size()) refuse("material out of range");
    Matrix3 edges;
    for (int a = 0; a < 3; ++a) {
      edges.col(a) = hand.nodes[static_cast<std::size_t>(nodes[static_cast<std::size_t>(a) + 1])] - hand.nodes[static_cast<std::size_t>(nodes[0])];
    }
    const double volume = std::abs(edges.determinant()) / 6.0;
    const double longest = edges.colwise().norm().maxCoeff();
    if (!(volume > 1e-12 * longest * longest * longest) || !std::isfinite(volume)) refuse("no volume");
    const Matrix3 inverse = edges.inverse();
    for (std::size_t a = 0; a < 4; ++a) node_[a][e] = nodes[a];
    for (std::size_t k = 0; k < 9; ++k) shape_[k][e] = inverse(static_cast<Eigen::Index>(k / 3), static_cast<Eigen::Index>(k % 3));
    volume_[e] = volume;
    const CorotationalMaterial& m = materials[hand.tetrahedron_material[e]];
    constants_[0][e] = m.mu;
    constants_[1][e] = m.lambda;
    constants_[2][e] = m.strain_limit_energy;
    constants_[3][e] = m.strain_limit_stiffness;
  }
}

void Tissue::add_pattern(BlockPattern& pattern) const {
  for (std::size_t e = 0; e < volume_.size(); ++e) {
    const std::array<int, 4> blocks{node_[0][e], node_[1][e], node_[2][e], node_[3][e]};
    pattern.add_clique(blocks);
  }
}

void Tissue::bind(const BlockMatrix& matrix) {
  for (std::size_t e = 0; e < volume_.size(); ++e) {
    for (std::size_t a = 0; a < 4; ++a) {
      for (std::size_t b = 0; b <= a; ++b) slot_[slot_of(a, b)][e] = matrix.find(node_[a][e], node_[b][e]).index;
    }
  }
}

CorotationalMaterial Tissue::material(std::size_t e) const { return {constants_[0][e], constants_[1][e], constants_[2][e], constants_[3][e]}; }

Matrix3 Tissue::deformation_gradient(const State& state, std::size_t e) const {
  const Vector3 origin = state.node_positions.col(node_[0][e]);
  Matrix3 f = Matrix3::Zero();
  for (std::size_t a = 0; a < 3; ++a) {
    const Vector3 edge = state.node_positions.col(node_[a + 1][e]) - origin;
    for (std::size_t j = 0; j < 3; ++j) f.col(static_cast<Eigen::Index>(j)) += shape_[3 * a + j][e] * edge;
  }
  return f;
}

double Tissue::evaluate(const State& state, VectorX* gradient, BlockMatrix* hessian, Curvature curvature) const {
  double energy = 0;
  for (std::size_t e = 0; e < volume_.size(); ++e) {
    const CorotationalMaterial constants = material(e);
    const CorotationalState point = evaluate_corotational(constants, deformation_gradient(state, e));
    const double volume = volume_[e];
    energy += volume * point.density;
    if (gradient == nullptr && hessian == nullptr) continue;
    Matrix3 shape;  // columns b_1, b_2, b_3
    for (std::size_t k = 0; k < 9; ++k) shape(static_cast<Eigen::Index>(k % 3), static_cast<Eigen::Index>(k / 3)) = shape_[k][e];
    if (gradient != nullptr) {
      const Matrix3 forces = (volume * point.factor) * (point.stress_quadratic * shape);
      for (int a = 0; a < 3; ++a) gradient->segment<3>(3 * node_[static_cast<std::size_t>(a) + 1][e]) += forces.col(a);
      gradient->segment<3>(3 * node_[0][e]) -= forces.col(0) + forces.col(1) + forces.col(2);
    }
    if (hessian == nullptr) continue;
    const CorotationalHessian second = corotational_hessian(constants, point, curvature);
    const Matrix3 products = (volume * second.identity) * (shape.transpose() * shape);
    Matrix3 block[3][3];  // (a, b), nodes 1 to 3, a >= b
    for (int a = 0; a < 3; ++a) {
      for (int b = 0; b <= a; ++b) block[a][b] = products(a, b) * Matrix3::Identity();
    }
    for (std::size_t k = 0; k < 5; ++k) {
      const double weight = volume * second.weight[k];
      if (weight == 0.0) continue;
      const Matrix3 w = second.direction[k] * shape;
      for (int a = 0; a < 3; ++a) {
        const Vector3 scaled = weight * w.col(a);
        for (int b = 0; b <= a; ++b) block[a][b] += scaled * w.col(b).transpose();
      }
    }
    const auto add = [&](std::size_t a, std::size_t b, const Matrix3& value) { hessian->add({slot_[slot_of(a, b)][e], false}, value); };
    // Rows of the element's Hessian sum to zero: (a, 0) = -sum_b (a, b).
    Matrix3 corner = Matrix3::Zero();
    for (int a = 0; a < 3; ++a) {
      Matrix3 to_first = Matrix3::Zero();
      for (int b = 0; b < 3; ++b) {
        if (b <= a) {
          to_first -= block[a][b];
        } else {
          to_first -= block[b][a].transpose();
        }
      }
      const auto row = static_cast<std::size_t>(a) + 1;
      for (int b = 0; b <= a; ++b) add(row, static_cast<std::size_t>(b) + 1, block[a][b]);
      add(row, 0, to_first);
      corner -= to_first;
    }
    // The corner is symmetric in exact arithmetic; half of it and its transpose is in floating point too.
    add(0, 0, 0.5 * (corner + corner.transpose()));
  }
  return energy;
}

double Tissue::value(const State& state) const { return evaluate(state, nullptr, nullptr, Curvature::projected); }

void Tissue::add_gradient(const State& state, VectorX& gradient) const { evaluate(state, &gradient, nullptr, Curvature::projected); }

void Tissue::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const { evaluate(state, nullptr, &hessian, curvature); }

double Tissue::add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const {
  return evaluate(state, &gradient, &hessian, curvature);
}

int Tissue::inverted_elements(const State& state) const {
  int count = 0;
  for (std::size_t e = 0; e < volume_.size(); ++e) count += deformation_gradient(state, e).determinant() < 0.0 ? 1 : 0;
  return count;
}

double Tissue::energy_density(const State& state, int element) const {
  const auto e = static_cast<std::size_t>(element);
  return evaluate_corotational(material(e), deformation_gradient(state, e)).density;
}

double Tissue::von_mises_stress(const State& state, int element) const {
  const auto e = static_cast<std::size_t>(element);
  const CorotationalMaterial constants = material(e);
  const CorotationalState point = evaluate_corotational(constants, deformation_gradient(state, e));
  const Vector3 principal = 2 * constants.mu * point.factor * (point.svd.singular_values.array() - 1.0);
  const Vector3 deviator = principal.array() - principal.mean();
  return std::sqrt(1.5) * deviator.norm();
}

}  // namespace softhand
