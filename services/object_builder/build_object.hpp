// Makes an object from meshes and a description.
#pragma once

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

struct ObjectSource {
  std::string name;
  std::string notice;
  double scale = 1;              ///< m per unit of the mesh files
  std::size_t most_pieces = 32;  ///< convex pieces per link
  std::size_t most_piece_vertices = 64;
  double piece_tolerance = 0.05;  ///< excess of the pieces at which cutting stops, fraction of the volume
  std::vector<LinkSource> links;
  std::vector<LinkJoint> joints;
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

/// Reads the meshes, unites the meshes of each link, rounds them as the object file does, and checks them: closed,
/// outward, no self-intersections, walls of at least two cells on 98 % of the surface. Then mass properties and convex
/// pieces. Throws std::runtime_error with file or link, and what was expected.
ObjectModel build_object(const ObjectSource& source, std::vector<LinkReport>& reports);

}  // namespace softhand::builder
