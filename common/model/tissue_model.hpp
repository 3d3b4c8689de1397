// Tetrahedra and their skin: what the tissue of a hand and flexible objects have in common. Constant data. SI units.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "math/types.hpp"

namespace softhand {

/// Co-rotational tissue with strain limiting (eqs. 21-30).
struct Material {
  std::string name;                   ///< pulp, palm, back, knuckle
  double density = 1000;              ///< kg/m^3
  double youngs_modulus = 0;          ///< Pa
  double poisson_ratio = 0;           ///< [0, 0.5)
  double strain_limit_energy = 0;     ///< J/m^3, W_max of eq. 22; > 0
  double strain_limit_stiffness = 0;  ///< J/m^3, k_s of eq. 22 (k_c in the source); 0 = no limiting
  /// w, [0, 1]: the limit's stiffness grows while W_q/W_max goes from 1 - w to 1 + w; 0: it jumps at W_max
  double strain_limit_ramp = 0;
};

/// A point of the skin where contact happens, embedded in a tetrahedron.
struct SkinPoint {
  std::int32_t tetrahedron = 0;
  std::array<double, 4> weights{};  ///< barycentric, >= 0, sum 1
  double area = 0;                  ///< m^2 of skin around the point, > 0
  std::uint8_t body = 0;            ///< as `TissueModel::node_body`; of a hand, it determines the finger of a contact
};

struct TissueModel {
  std::vector<Vector3> nodes;                           ///< rest positions, metres
  std::vector<std::array<std::int32_t, 4>> tetrahedra;  ///< positively oriented: det[x1-x0, x2-x0, x3-x0] > 0
  std::vector<std::uint8_t> tetrahedron_material;       ///< index into `materials`
  std::vector<Material> materials;
  std::vector<std::array<std::int32_t, 3>> surface;  ///< boundary triangles of the tetrahedra, outward, node indices
  /// Nearest bone of the hand. A simulation of several owners of tissue has its own numbers: skin_patches.hpp.
  std::vector<std::uint8_t> node_body;
  std::vector<SkinPoint> contact_points;  ///< the same points of the skin for every mesh of a hand

  int node_count() const { return static_cast<int>(nodes.size()); }
  /// At rest, metres.
  Vector3 position_of(const SkinPoint& point) const {
    Vector3 sum = Vector3::Zero();
    const auto& corners = tetrahedra[static_cast<std::size_t>(point.tetrahedron)];
    for (std::size_t k = 0; k < 4; ++k) sum += point.weights[k] * nodes[static_cast<std::size_t>(corners[k])];
    return sum;
  }
};

/// Node masses in kg: each node has a quarter of the mass of each of its tetrahedra.
std::vector<double> lumped_masses(const TissueModel& model);

/// Throws std::invalid_argument with the first bad node, material or tetrahedron. The message starts with `where`.
/// Checks numbers, ranges, orientation and quality of the tetrahedra, and that every node belongs to one. Nodes must
/// lie within 1 m of the origin.
void validate_tetrahedra(const TissueModel& model, const std::string& where);

/// Boundary triangles of positively oriented tetrahedra, outward, in a fixed order.
std::vector<std::array<std::int32_t, 3>> boundary(std::span<const std::array<std::int32_t, 4>> tetrahedra);

}  // namespace softhand
