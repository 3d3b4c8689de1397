// The tissue element by element, in plain scalars. The batched kernels (energies/tissue_kernel.hpp) are compared with
// it, in result and in speed.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "energies/corotational.hpp"
#include "energies/energy.hpp"
#include "model/hand_model.hpp"

namespace softhand::testing {

/// d2W/dF2 = identity * 1 + sum_k weight[k] q_k q_k^T, q_k = vec(direction[k]).
struct CorotationalHessian {
  double identity = 0;
  std::array<double, 5> weight{};
  std::array<Matrix3, 5> direction;
};

inline CorotationalHessian corotational_hessian(const CorotationalMaterial& material, const CorotationalState& state,
                                                Curvature curvature) {
  CorotationalHessian hessian;
  const double m = state.factor;
  const Vector3& s = state.svd.singular_values;
  hessian.identity = 2 * material.mu * m;
  hessian.weight[0] = material.lambda * m;
  hessian.direction[0] = state.rotation;
  const bool projected = curvature == Curvature::projected;
  const double floor = projected ? 1e-3 : 1e-9;
  const double numerator = 2 * (material.lambda * (s.sum() - 3.0) - 2 * material.mu);
  constexpr int pairs[3][2] = {{0, 1}, {0, 2}, {1, 2}};
  for (std::size_t k = 0; k < 3; ++k) {
    const int i = pairs[k][0], j = pairs[k][1];
    double weight = numerator / std::max(s[i] + s[j], floor);
    if (projected) weight = std::max(weight, -2 * material.mu);
    hessian.weight[k + 1] = m * weight;
    hessian.direction[k + 1] = M_SQRT1_2 * (state.svd.u.col(i) * state.svd.v.col(j).transpose() -
                                            state.svd.u.col(j) * state.svd.v.col(i).transpose());
  }
  hessian.direction[4] = state.stress_quadratic;
  hessian.weight[4] = state.stiffening;
  return hessian;
}

class ScalarTissue final : public Energy {
 public:
  explicit ScalarTissue(const HandModel& hand) {
    std::vector<CorotationalMaterial> materials;
    for (const Material& m : hand.materials) materials.push_back(corotational_material(m));
    for (std::size_t e = 0; e < hand.tetrahedra.size(); ++e) {
      Element element;
      element.nodes = hand.tetrahedra[e];
      std::sort(element.nodes.begin(), element.nodes.end());
      const auto corner = [&](std::size_t a) -> const Vector3& {
        return hand.nodes[static_cast<std::size_t>(element.nodes[a])];
      };
      Matrix3 edges;
      for (std::size_t a = 0; a < 3; ++a) edges.col(static_cast<Eigen::Index>(a)) = corner(a + 1) - corner(0);
      element.volume = std::abs(edges.determinant()) / 6.0;
      element.shape = edges.inverse().transpose();
      element.material = materials[hand.tetrahedron_material[e]];
      elements_.push_back(element);
    }
  }

  std::string_view name() const override { return "scalar tissue"; }
  void add_pattern(BlockPattern& pattern) const override {
    for (const Element& e : elements_) pattern.add_clique(e.nodes);
  }
  void bind(const BlockMatrix& matrix) override {
    for (Element& e : elements_) {
      for (std::size_t a = 0; a < 4; ++a) {
        for (std::size_t b = 0; b <= a; ++b) e.slots[slot_of(a, b)] = matrix.find(e.nodes[a], e.nodes[b]);
      }
    }
  }
  double value(const State& state) const override { return evaluate(state, nullptr, nullptr, Curvature::projected); }
  double add_gradient(const State& state, VectorX& gradient) const override {
    return evaluate(state, &gradient, nullptr, Curvature::projected);
  }
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override {
    evaluate(state, nullptr, &hessian, curvature);
  }
  double add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const override {
    return evaluate(state, &gradient, &hessian, curvature);
  }

 private:
  struct Element {
    std::array<std::int32_t, 4> nodes;  // ascending
    Matrix3 shape;                      // columns b_1, b_2, b_3
    double volume = 0;
    CorotationalMaterial material;
    std::array<BlockSlot, 10> slots;
  };
  static constexpr std::size_t slot_of(std::size_t row, std::size_t column) { return row * (row + 1) / 2 + column; }

  double evaluate(const State& state, VectorX* gradient, BlockMatrix* hessian, Curvature curvature) const {
    double energy = 0;
    for (const Element& e : elements_) {
      Matrix3 f = Matrix3::Zero();
      for (std::size_t a = 0; a < 3; ++a) {
        const Vector3 edge = state.node_positions.col(e.nodes[a + 1]) - state.node_positions.col(e.nodes[0]);
        f += edge * e.shape.col(static_cast<Eigen::Index>(a)).transpose();
      }
      const CorotationalState point = evaluate_corotational(e.material, f);
      energy += e.volume * point.density;
      if (gradient == nullptr && hessian == nullptr) continue;
      if (gradient != nullptr) {
        const Matrix3 forces = (e.volume * point.factor) * (point.stress_quadratic * e.shape);
        for (int a = 0; a < 3; ++a) gradient->segment<3>(3 * e.nodes[static_cast<std::size_t>(a) + 1]) += forces.col(a);
        gradient->segment<3>(3 * e.nodes[0]) -= forces.col(0) + forces.col(1) + forces.col(2);
      }
      if (hessian == nullptr) continue;
      const CorotationalHessian second = corotational_hessian(e.material, point, curvature);
      const Matrix3 products = (e.volume * second.identity) * (e.shape.transpose() * e.shape);
      Matrix3 block[3][3];  // (a, b), nodes 1 to 3, a >= b
      for (int a = 0; a < 3; ++a) {
        for (int b = 0; b <= a; ++b) block[a][b] = products(a, b) * Matrix3::Identity();
      }
      for (std::size_t k = 0; k < 5; ++k) {
        const double weight = e.volume * second.weight[k];
        if (weight == 0.0) continue;
        const Matrix3 w = second.direction[k] * e.shape;
        for (int a = 0; a < 3; ++a) {
          const Vector3 scaled = weight * w.col(a);
          for (int b = 0; b <= a; ++b) block[a][b] += scaled * w.col(b).transpose();
        }
      }
      const auto add = [&](std::size_t a, std::size_t b, const Matrix3& value) {
        hessian->add(e.slots[slot_of(a, b)], value);
      };
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
      // The corner is symmetric in exact arithmetic. The mean of it and its transpose is symmetric in floating point
      // too.
      add(0, 0, 0.5 * (corner + corner.transpose()));
    }
    return energy;
  }

  std::vector<Element> elements_;
};

}  // namespace softhand::testing
