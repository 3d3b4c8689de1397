// Makes an object from meshes and a description.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "model/object_model.hpp"

namespace softhand::builder {

struct LinkSource {
  std::string name;
  std::vector<std::string> meshes;  ///< files; more than one are united
  double density = 1000;            ///< kg/m^3; ignored if `mass` is above 0
  double mass = 0;                  ///< kg; 0: from the density
  double friction = 0.5;            ///< Coulomb coefficient
  double spacing = 0.001;           ///< m, of the distance grid
};

/// A flexible object from one closed mesh without handles.
struct SoftSource {
  std::string mesh;             ///< file
  std::int64_t nodes = 500;     ///< of the tetrahedra; the mesher makes up to 7 % more
  double density = 100;         ///< kg/m^3
  double youngs_modulus = 1e4;  ///< Pa
  double poisson_ratio = 0.3;
  double strain_limit_energy = 1e9;   ///< J/m^3, W_max of eq. 22
  double strain_limit_stiffness = 0;  ///< J/m^3, k_s; 0 = no strain limit
  double strain_limit_ramp = 0;       ///< [0, 1], as in Material
  double friction = 0.8;
};

struct ObjectSource {
  std::string name;
  std::string notice;
  double scale = 1;              ///< m per unit of the mesh files
  std::size_t most_pieces = 32;  ///< convex pieces per link
  std::size_t most_piece_vertices = 64;
  double piece_tolerance = 0.05;  ///< excess of the pieces at which cutting stops, fraction of the volume
  std::vector<LinkSource> links;
  std::vector<LinkJoint> joints;
  std::optional<SoftSource> soft;  ///< then without links and joints
};

/// What the builder found out about a link.
struct LinkReport {
  double volume = 0;   ///< m^3
  double missing = 0;  ///< of the pieces, fraction of the volume
  double excess = 0;
  double thin_area = 0;  ///< fraction of the surface with walls thinner than two cells
};

/// Reads a description (JSON, docs/object-file.md). Mesh files are relative to its folder. Throws std::runtime_error
/// with file, field and what was expected.
ObjectSource load_description(const std::string& path);

/// Reads the meshes, unites those of each link, and rounds them as the object file does. They must be closed and
/// outward, have no self-intersections, and have walls of at least two cells on 98 % of the surface. Then mass
/// properties and convex pieces are computed. A flexible object gets tetrahedra instead, by the mesher of the hand
/// (hand_builder/mesher.hpp), and no report. Throws std::runtime_error with file or link, and what was expected.
ObjectModel build_object(const ObjectSource& source, std::vector<LinkReport>& reports);

}  // namespace softhand::builder
