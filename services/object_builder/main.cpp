// softhand-build-object: makes an object file offline. See docs/object-file.md.
#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <filesystem>

#include "geometry/distance_grid.hpp"
#include "math/tetrahedron.hpp"
#include "object_builder/build_object.hpp"

namespace {

using namespace softhand;

// The name of a mesh file without suffix, with other characters than an object's name may have as '_'.
std::string name_of(const std::string& path) {
  std::string name = std::filesystem::path(path).stem().string().substr(0, 63);
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '-') c = '_';
  return name;
}

double mass_of(const SoftBody& body) {
  double volume = 0;
  for (const auto& t : body.tetrahedra) volume += tetrahedron_volume(body.nodes, t);
  return body.material.density * volume;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app(
      "Makes an object file from meshes: distance grid, mass properties, convex pieces, joints; or a flexible object");
  std::vector<std::string> inputs;
  std::string output;
  builder::ObjectSource source;
  builder::LinkSource link;
  app.add_option("input", inputs,
                 "One description (.json), or the meshes of one link (.obj, .stl, .glb, .gltf); several are united")
      ->required()
      ->check(CLI::ExistingFile);
  app.add_option("--output", output, "Object file to write, NAME.object.json")->required();
  std::vector<CLI::Option*> of_meshes;
  of_meshes.push_back(app.add_option("--name", source.name, "Name of the object; default: the name of the first mesh"));
  of_meshes.push_back(app.add_option("--notice", source.notice, "Licence notice of the meshes"));
  CLI::Option* density = app.add_option("--density", link.density, "Density, kg/m^3")->capture_default_str();
  CLI::Option* mass = app.add_option("--mass", link.mass, "Mass, kg; instead of the density")->excludes(density);
  for (CLI::Option* option : {density, mass}) of_meshes.push_back(option->check(CLI::PositiveNumber));
  CLI::Option* friction = app.add_option("--friction", link.friction, "Coulomb coefficient")
                              ->capture_default_str()
                              ->check(CLI::Range(0.0, 10.0));
  of_meshes.push_back(friction);
  of_meshes.push_back(app.add_option("--spacing", link.spacing, "Cell of the distance grid, m; walls need two cells")
                          ->capture_default_str()
                          ->check(CLI::Range(0.0001, 0.1)));
  of_meshes.push_back(app.add_option("--scale", source.scale, "Length of a unit of the mesh files, m")
                          ->capture_default_str()
                          ->check(CLI::PositiveNumber));
  of_meshes.push_back(app.add_option("--pieces", source.most_pieces, "Most convex pieces per link")
                          ->capture_default_str()
                          ->check(CLI::Range(std::size_t{1}, kMaxLinkPieces)));
  of_meshes.push_back(app.add_option("--piece-vertices", source.most_piece_vertices, "Most vertices per convex piece")
                          ->capture_default_str()
                          ->check(CLI::Range(std::size_t{4}, kMaxPieceVertices)));
  builder::SoftSource soft;
  CLI::Option* nodes =
      app.add_option("--soft", soft.nodes, "A flexible object of about this many nodes, from one mesh");
  CLI::Option* modulus = app.add_option("--youngs-modulus", soft.youngs_modulus, "With --soft: Young's modulus, Pa");
  CLI::Option* ratio = app.add_option("--poisson-ratio", soft.poisson_ratio, "With --soft: Poisson's ratio");
  for (CLI::Option* option : {modulus, ratio}) option->capture_default_str()->needs(nodes);
  for (CLI::Option* option : {nodes, modulus, ratio}) of_meshes.push_back(option);
  CLI11_PARSE(app, argc, argv);
  try {
    const bool described = std::filesystem::path(inputs[0]).extension() == ".json";
    if (described) {
      if (inputs.size() > 1)
        throw std::runtime_error("expected one description, found " + std::to_string(inputs.size()));
      for (const CLI::Option* option : of_meshes)
        if (option->count() > 0)
          throw std::runtime_error(option->get_name() + ": only for meshes; expected this value in " + inputs[0]);
      source = builder::load_description(inputs[0]);
    } else if (nodes->count() > 0) {
      if (inputs.size() > 1)
        throw std::runtime_error("--soft: expected one mesh, found " + std::to_string(inputs.size()));
      if (mass->count() > 0) throw std::runtime_error("--soft: expected a density instead of a mass");
      if (source.name.empty()) source.name = name_of(inputs[0]);
      soft.mesh = inputs[0];
      if (density->count() > 0) soft.density = link.density;
      if (friction->count() > 0) soft.friction = link.friction;
      source.soft = soft;
    } else {
      if (source.name.empty()) source.name = name_of(inputs[0]);
      link.name = source.name;
      link.meshes = inputs;
      source.links.push_back(link);
    }
    std::vector<builder::LinkReport> reports;
    const ObjectModel object = builder::build_object(source, reports);
    save_object(object, output);
    for (std::size_t i = 0; i < object.links.size(); ++i) {
      const ObjectLink& built = object.links[i];
      const auto start = std::chrono::steady_clock::now();
      const DistanceGrid grid(built.mesh, built.grid_spacing);
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      std::printf(
          "%s: link %s: %zu triangles, volume %.2f cm^3, mass %.1f g, %zu convex pieces (missing %.1f %%, excess %.1f "
          "%% "
          "of the volume), grid of %.2f mm with %zu blocks, %.1f MB, sampled in %.2f s, thin walls on %.1f %% of the "
          "surface\n",
          output.c_str(), built.name.c_str(), built.mesh.triangles.size(), 1e6 * reports[i].volume, 1e3 * built.mass,
          built.pieces.size(), 100 * reports[i].missing, 100 * reports[i].excess, 1e3 * built.grid_spacing,
          grid.block_count(), 1e-6 * static_cast<double>(grid.bytes()), seconds, 100 * reports[i].thin_area);
    }
    if (object.soft) {
      std::printf("%s: flexible, %zu nodes, %zu tetrahedra, mass %.1f g\n", output.c_str(), object.soft->nodes.size(),
                  object.soft->tetrahedra.size(), 1e3 * mass_of(*object.soft));
      return 0;
    }
    std::printf("%s: %zu links, %zu joints, %.1f kB\n", output.c_str(), object.links.size(), object.joints.size(),
                1e-3 * static_cast<double>(std::filesystem::file_size(output)));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "softhand-build-object: %s\n", error.what());
    return 1;
  }
  return 0;
}
