// Boxes of tissue for tests and benchmarks: nodes, tetrahedra and one material, no skeleton.
#pragma once

#include <array>
#include <random>
#include <vector>

#include "model/hand_model.hpp"
#include "model/state.hpp"

namespace softhand::testing {

/// A box from the origin to `size` (m) in cells[0] x cells[1] x cells[2] bricks of six tetrahedra each.
inline HandModel box_mesh(std::array<int, 3> cells, const Vector3& size, const Material& material) {
  HandModel box;
  box.name = "box";
  box.materials.push_back(material);
  const auto node = [&cells](int i, int j, int k) { return (i * (cells[1] + 1) + j) * (cells[2] + 1) + k; };
  for (int i = 0; i <= cells[0]; ++i) {
    for (int j = 0; j <= cells[1]; ++j) {
      for (int k = 0; k <= cells[2]; ++k)
        box.nodes.emplace_back(size[0] * i / cells[0], size[1] * j / cells[1], size[2] * k / cells[2]);
    }
  }
  // Six tetrahedra per brick around its main diagonal (Kuhn). They match across neighbouring bricks.
  constexpr int orders[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
  for (int i = 0; i < cells[0]; ++i) {
    for (int j = 0; j < cells[1]; ++j) {
      for (int k = 0; k < cells[2]; ++k) {
        for (int o = 0; o < 6; ++o) {
          std::array<int, 3> corner{i, j, k};
          std::array<std::int32_t, 4> tetrahedron{node(i, j, k), 0, 0, 0};
          for (int step = 0; step < 3; ++step) {
            ++corner[static_cast<std::size_t>(orders[o][step])];
            tetrahedron[static_cast<std::size_t>(step) + 1] = node(corner[0], corner[1], corner[2]);
          }
          const bool odd = o == 1 || o == 2 || o == 5;
          if (odd) std::swap(tetrahedron[2], tetrahedron[3]);
          box.tetrahedra.push_back(tetrahedron);
          box.tetrahedron_material.push_back(0);
        }
      }
    }
  }
  return box;
}

inline State rest_state(const HandModel& hand) {
  State state;
  state.node_positions.resize(3, hand.node_count());
  for (int n = 0; n < hand.node_count(); ++n) state.node_positions.col(n) = hand.nodes[static_cast<std::size_t>(n)];
  state.node_velocities = Eigen::Matrix3Xd::Zero(3, hand.node_count());
  return state;
}

/// Uniform in [-1, 1), the same on every platform.
class Random {
 public:
  explicit Random(std::uint64_t seed) : generator_(seed) {}
  double operator()() { return 2.0 * static_cast<double>(generator_() >> 11) * 0x1p-53 - 1.0; }
  Vector3 vector() {
    const double x = (*this)(), y = (*this)(), z = (*this)();
    return {x, y, z};
  }
  Matrix3 rotation() {
    const double w = (*this)(), x = (*this)(), y = (*this)(), z = (*this)();
    return Quaternion(w, x, y, z).normalized().toRotationMatrix();
  }

 private:
  std::mt19937_64 generator_;
};

}  // namespace softhand::testing
