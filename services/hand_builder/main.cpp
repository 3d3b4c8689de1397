// softhand-build-hand: makes a hand file offline. See docs/hand-builder.md.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <memory>
#include <optional>

#include "hand_builder/assemble.hpp"
#include "hand_builder/parametric_skin.hpp"
#include "hand_builder/rigged_hand.hpp"
#include "trackers/replay/recording.hpp"

namespace {

using namespace softhand;

// Whether `hand` was made from this skin.
void check_skin(const HandModel& hand, const TriangleMesh& skin, const std::string& path) {
  constexpr double kRounding = 2e-5;  // m, of a vertex by its rounded weights
  bool same = hand.skin_triangles == skin.triangles && hand.skin_vertices.size() == skin.vertices.size();
  for (std::size_t v = 0; same && v < skin.vertices.size(); ++v)
    same = (hand.position_of(hand.skin_vertices[v]) - skin.vertices[v]).norm() < kRounding;
  if (!same) throw std::runtime_error(path + ": was made from another skin; expected the one of these options");
}

// Writes skin (group "skin") and tetrahedral surface (group "surface") as an OBJ file for any viewer.
void write_preview(const HandModel& hand, const std::string& path) {
  std::ofstream out(path);
  for (const Vector3& n : hand.nodes) out << "v " << n.x() << ' ' << n.y() << ' ' << n.z() << '\n';
  for (const SkinVertex& vertex : hand.skin_vertices) {
    const Vector3 x = hand.position_of(vertex);
    out << "v " << x.x() << ' ' << x.y() << ' ' << x.z() << '\n';
  }
  const int offset = hand.node_count() + 1;
  out << "g surface\n";
  for (const auto& t : hand.surface) out << "f " << t[0] + 1 << ' ' << t[1] + 1 << ' ' << t[2] + 1 << '\n';
  out << "g skin\n";
  for (const auto& t : hand.skin_triangles)
    out << "f " << t[0] + offset << ' ' << t[1] + offset << ' ' << t[2] + offset << '\n';
  if (!out) throw std::runtime_error(path + ": cannot be written");
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Makes a hand file: skin, bones, tetrahedral tissue, attachments, joints, materials");
  builder::HandSize size;
  int nodes = 1450;
  std::string side_name = "right", output, preview, recording, gltf, notice, name, kept;
  app.add_option("--length", size.length, "Hand length from wrist to middle fingertip, metres")
      ->capture_default_str()
      ->check(CLI::Range(0.10, 0.26));
  app.add_option("--breadth", size.breadth, "Hand breadth over the metacarpal heads, metres")
      ->capture_default_str()
      ->check(CLI::Range(0.05, 0.13));
  CLI::Option* joints =
      app.add_option("--joints", recording,
                     "CSV of recorded joint poses (one row is enough); use the bone lengths and radii of this user");
  joints->check(CLI::ExistingFile);
  app.add_option("--gltf", gltf,
                 "GLB of a rigged hand of either side with WebXR's 25 joint names; use its skin and skeleton")
      ->check(CLI::ExistingFile)
      ->excludes(joints);
  app.add_option("--notice", notice, "Licence notice in the hand file; default: the copyright line of the GLB");
  app.add_option("--nodes", nodes, "Number of tetrahedral nodes")->capture_default_str()->check(CLI::Range(300, 8000));
  app.add_option("--mesh", kept, "Hand file of the same skin: keep all of it, and make only its contact points anew")
      ->check(CLI::ExistingFile);
  app.add_option("--side", side_name, "Side of the written hand and of the recording")
      ->capture_default_str()
      ->check(CLI::IsMember({"left", "right"}));
  app.add_option("--name", name, "Name of the hand");
  app.add_option("--output", output, "Hand file to write")->required();
  app.add_option("--preview", preview, "OBJ file to write with skin and tetrahedral surface");
  CLI11_PARSE(app, argc, argv);
  try {
    const Side side = side_name == "left" ? Side::left : Side::right;
    builder::RestSkeleton rest;
    std::unique_ptr<const builder::SkinShape> skin;
    TriangleMesh display;
    if (!gltf.empty()) {
      builder::RiggedHand rigged = builder::load_rigged_hand(gltf);
      rest = rigged.rest;
      skin = std::make_unique<builder::MeshSkin>(rigged.skin);
      display = std::move(rigged.skin);
      if (notice.empty())
        notice = !rigged.copyright.empty() ? rigged.copyright : "Made from " + gltf + ", whose licence applies";
    } else {
      if (recording.empty()) {
        rest = builder::natural_rest(size);
      } else {
        const Recording recorded = Recording::load(recording);
        try {
          rest = builder::natural_rest(measure_skeleton(recorded.frames(), recorded.radii()), side);
        } catch (const std::invalid_argument& error) {
          throw std::runtime_error(recording + ": " + error.what());
        }
      }
      skin = std::make_unique<builder::ParametricSkin>(rest);
      display = builder::triangulate_skin(*skin, 0.0030);
    }
    HandModel hand;
    if (!kept.empty()) {
      hand = load_hand(kept);
      const bool left = hand.side == Side::left;
      if (left) hand = mirrored(hand);
      check_skin(hand, display, kept);
      builder::add_contact_points(hand, rest, display);
      if (left) hand = mirrored(hand);
    } else {
      hand = builder::assemble_hand(
          rest, builder::mesh_skin(*skin, builder::hand_sizing(rest), nodes, builder::hand_seeds(rest, *skin)),
          display);
      hand.notice = notice;
      if (side == Side::left) hand = mirrored(hand);
      hand.name = !name.empty() ? name : side_name + "_" + std::to_string(nodes);
    }
    validate(hand, output);
    save_hand(hand, output);
    if (!preview.empty()) write_preview(hand, preview);
    const builder::TetrahedralMesh mesh{hand.nodes, hand.tetrahedra, hand.surface};
    std::printf(
        "%s: %d nodes, %zu tetrahedra, %zu attachments, %zu contact points, %zu skin vertices, smallest dihedral angle "
        "%.1f degrees, "
        "volume %.1f cm^3 (skin "
        "%.1f)\n",
        output.c_str(), hand.node_count(), hand.tetrahedra.size(), hand.attachments.size(), hand.contact_points.size(),
        hand.skin_vertices.size(), mesh.minimum_dihedral_degrees(), mesh.volume() * 1e6,
        builder::skin_volume(*skin, 0.001) * 1e6);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "softhand-build-hand: %s\n", error.what());
    return 1;
  }
  return 0;
}
