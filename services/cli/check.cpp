#include <fmt/format.h>
#include <toml++/toml.h>

#include <filesystem>
#include <string>

#include "cli/commands.hpp"
#include "cli/rig.hpp"
#include "model/hand_model.hpp"
#include "runtime/config.hpp"
#include "scene_file.hpp"

namespace softhand {
namespace {

void check_hand(const std::string& path) {
  const HandModel hand = load_hand(path);
  double volume = 0;
  for (const auto& t : hand.tetrahedra) {
    const auto x = [&hand, &t](std::size_t k) { return hand.nodes[static_cast<std::size_t>(t[k])]; };
    volume += (x(1) - x(0)).dot((x(2) - x(0)).cross(x(3) - x(0))) / 6.0;
  }
  fmt::print("{}: a {} hand, {} nodes, {} tetrahedra, {:.0f} ml, {} attachments, {} skin vertices\n", path, hand.side == Side::left ? "left" : "right",
             hand.node_count(), hand.tetrahedra.size(), volume * 1e6, hand.attachments.size(), hand.skin_vertices.size());
}

void check_rig(const std::string& path) {
  RigOptions rig;
  read_toml(rig, path);
  const auto scene_path = std::filesystem::path(path).parent_path() / rig.scene;
  const Scene scene = read_scene(scene_path.string());
  fmt::print("{}: a rig of {} processes on scene {}\n", path, rig.processes.size(), scene_path.lexically_normal().string());
}

void check_scene(const std::string& path) {
  const Scene scene = read_scene(path);
  const HandModel hand = load_scene_hand(scene);
  fmt::print("{}: a scene of {} objects, hand {} ({} nodes), {:g} s\n", path, scene.options.objects.size(), hand.name, hand.node_count(), scene.options.simulate.seconds);
}

}  // namespace

int run_check(const std::string& path) {
  try {
    if (path.ends_with(".json")) {
      check_hand(path);
    } else if (const auto table = toml::parse_file(path); table.contains("process")) {
      check_rig(path);
    } else {
      check_scene(path);
    }
    return 0;
  } catch (const toml::parse_error& error) {
    fmt::print(stderr, "{}:{}: {}\n", path, error.source().begin.line, error.description());
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}\n", error.what());
  }
  return 1;
}

}  // namespace softhand
