#include "model/tissue_model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>

#include "math/tetrahedron.hpp"

namespace softhand {
namespace {

// Beyond these limits a tetrahedron's Hessian is so ill-conditioned that the result of a step would be noise.
constexpr double kMinimumDihedralDegrees = 1.0;
constexpr double kMaximumEdgeRatio = 50.0;
constexpr double kMaximumTissueExtent = 1.0;  // m, so that files in millimetres or centimetres are refused

std::string entry(const char* field, std::size_t i) { return std::string(field) + "[" + std::to_string(i) + "]"; }

double minimum_dihedral_degrees(const std::array<Vector3, 4>& x) {
  // Outward normals of the four faces. The dihedral angle at the edge between two faces is pi minus the angle between
  // their normals.
  std::array<Vector3, 4> normals;
  for (std::size_t f = 0; f < 4; ++f) {
    const auto& v = kTetrahedronFaces[f];
    normals[f] = (x[v[1]] - x[v[0]]).cross(x[v[2]] - x[v[0]]).normalized();
  }
  double smallest = 180.0;
  for (std::size_t a = 0; a < 4; ++a) {
    for (std::size_t b = a + 1; b < 4; ++b) {
      const double angle = M_PI - std::acos(std::clamp(normals[a].dot(normals[b]), -1.0, 1.0));
      smallest = std::min(smallest, angle * 180.0 / M_PI);
    }
  }
  return smallest;
}

}  // namespace

void validate_tetrahedra(const TissueModel& model, const std::string& where) {
  const auto check = [&where](bool good, const std::string& field, const std::string& expected) {
    if (!good) throw std::invalid_argument(where + ": " + field + ": expected " + expected);
  };
  const auto number = [&check](double value, double minimum, double maximum, const std::string& field) {
    check(
        value >= minimum && value <= maximum, field,
        "a number in [" + std::to_string(minimum) + ", " + std::to_string(maximum) + "], got " + std::to_string(value));
  };
  check(model.node_count() >= 4 && model.node_count() <= 8192, "nodes", "4 to 8192 nodes");
  check(!model.materials.empty(), "materials", "at least one material");
  for (std::size_t m = 0; m < model.materials.size(); ++m) {
    const Material& material = model.materials[m];
    number(material.density, 1, 1e5, entry("materials", m) + ".density");
    number(material.youngs_modulus, 1, 1e12, entry("materials", m) + ".youngs_modulus");
    number(material.poisson_ratio, 0, 0.49999, entry("materials", m) + ".poisson_ratio");
    check(material.strain_limit_energy > 0 && std::isfinite(material.strain_limit_energy),
          entry("materials", m) + ".strain_limit_energy", "a finite number > 0");
    check(material.strain_limit_stiffness >= 0 && std::isfinite(material.strain_limit_stiffness),
          entry("materials", m) + ".strain_limit_stiffness", "a finite number >= 0");
    check(material.strain_limit_ramp >= 0 && material.strain_limit_ramp <= 1,
          entry("materials", m) + ".strain_limit_ramp", "a number in [0, 1]");
  }
  for (std::size_t n = 0; n < model.nodes.size(); ++n) {
    check(model.nodes[n].allFinite() && model.nodes[n].norm() < kMaximumTissueExtent, entry("nodes", n),
          "finite metres within 1 m of the origin");
  }
  check(!model.tetrahedra.empty(), "tetrahedra", "at least one");
  check(model.tetrahedron_material.size() == model.tetrahedra.size(), "tetrahedron_material",
        "one material for each tetrahedron");
  std::vector<bool> used(model.nodes.size(), false);
  for (std::size_t t = 0; t < model.tetrahedra.size(); ++t) {
    check(model.tetrahedron_material[t] < model.materials.size(), entry("tetrahedron_material", t),
          "an index into materials");
    std::array<Vector3, 4> x;
    for (std::size_t k = 0; k < 4; ++k) {
      const std::int32_t node = model.tetrahedra[t][k];
      check(node >= 0 && node < model.node_count(), entry("tetrahedra", t), "indices of nodes");
      used[static_cast<std::size_t>(node)] = true;
      x[k] = model.nodes[static_cast<std::size_t>(node)];
    }
    const double volume = tetrahedron_volume(x[0], x[1], x[2], x[3]);
    check(volume > 0, entry("tetrahedra", t),
          "positive volume (node order), got " + std::to_string(volume * 1e9) + " mm^3");
    double shortest = std::numeric_limits<double>::infinity();
    double longest = 0;
    for (std::size_t a = 0; a < 4; ++a) {
      for (std::size_t b = a + 1; b < 4; ++b) {
        const double length = (x[a] - x[b]).norm();
        shortest = std::min(shortest, length);
        longest = std::max(longest, length);
      }
    }
    check(longest <= kMaximumEdgeRatio * shortest, entry("tetrahedra", t),
          "edges that differ by at most a factor of 50");
    const double dihedral = minimum_dihedral_degrees(x);
    check(dihedral >= kMinimumDihedralDegrees, entry("tetrahedra", t),
          "dihedral angles of at least 1 degree, got " + std::to_string(dihedral));
  }
  for (std::size_t n = 0; n < used.size(); ++n) check(used[n], entry("nodes", n), "a node that some tetrahedron uses");
}

std::vector<double> lumped_masses(const TissueModel& model) {
  std::vector<double> masses(model.nodes.size(), 0.0);
  for (std::size_t t = 0; t < model.tetrahedra.size(); ++t) {
    const auto& n = model.tetrahedra[t];
    const double share =
        0.25 * tetrahedron_volume(model.nodes, n) * model.materials[model.tetrahedron_material[t]].density;
    for (const std::int32_t node : n) masses[static_cast<std::size_t>(node)] += share;
  }
  return masses;
}

std::vector<std::array<std::int32_t, 3>> boundary(std::span<const std::array<std::int32_t, 4>> tetrahedra) {
  std::map<std::array<std::int32_t, 3>, std::pair<int, std::array<std::int32_t, 3>>> faces;
  for (const auto& t : tetrahedra) {
    for (const auto& f : kTetrahedronFaces) {
      const std::array<std::int32_t, 3> face{t[f[0]], t[f[1]], t[f[2]]};
      auto key = face;
      std::sort(key.begin(), key.end());
      auto& entry = faces[key];
      ++entry.first;
      entry.second = face;
    }
  }
  std::vector<std::array<std::int32_t, 3>> surface;
  for (const auto& [key, entry] : faces) {
    if (entry.first == 1) surface.push_back(entry.second);
  }
  return surface;
}

}  // namespace softhand
