#include "cli/check.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <stdexcept>
#include <string>

#include "bus/network.hpp"
#include "cli/commands.hpp"
#include "cli/rig.hpp"
#include "math/tetrahedron.hpp"
#include "model/hand_model.hpp"
#include "runtime/config.hpp"
#include "runtime/object_store.hpp"
#include "tracking/tracking_loop.hpp"
#include "world/world_options.hpp"

namespace softhand {
namespace {

void check_hand(const std::string& path) {
  const HandModel hand = load_hand(path);
  double volume = 0;
  for (const auto& t : hand.tetrahedra) volume += tetrahedron_volume(hand.nodes, t);
  fmt::print("{}: a {} hand, {} nodes, {} tetrahedra, {:.0f} ml, {} attachments, {} skin vertices\n", path,
             hand.side == Side::left ? "left" : "right", hand.node_count(), hand.tetrahedra.size(), volume * 1e6,
             hand.attachments.size(), hand.skin_vertices.size());
}

void check_object(const std::string& path) {
  const LoadedObject object = load_object(path);
  if (object.model.soft) {
    const SoftBody& body = *object.model.soft;
    fmt::print("{}: a flexible object of {} nodes and {} tetrahedra, Young's modulus {:g} Pa, SHA-256 {}\n", path,
               body.nodes.size(), body.tetrahedra.size(), body.material.youngs_modulus, object.sha256);
    return;
  }
  fmt::print("{}: an object of {} links and {} joints, SHA-256 {}\n", path, object.model.links.size(),
             object.model.joints.size(), object.sha256);
  for (const ObjectLink& link : object.model.links) {
    fmt::print("  link {}: {:.1f} g, {} triangles, cells of {:.2f} mm, {} convex pieces\n", link.name, 1e3 * link.mass,
               link.mesh.triangles.size(), 1e3 * link.grid_spacing, link.pieces.size());
  }
  for (const LinkJoint& joint : object.model.joints) {
    fmt::print("  {} from {} to {}\n", to_string(joint.law.kind), object.model.links[joint.parent].name,
               object.model.links[joint.child].name);
  }
}

void check_rig(const std::string& path) {
  const RigOptions rig = read_rig(path);
  read_checked_scene(rig.scene);
  check_programs(rig, path);
  fmt::print("{}: a rig of {} processes on scene {}\n", path, chosen_processes(rig).size(), rig.scene);
}

void check_scene(const std::string& path) {
  const Scene scene = read_checked_scene(path);
  const HandModel hand = load_scene_hand(scene);
  fmt::print("{}: a scene of {} objects, {} of them flexible, a {} hand ({}, {} nodes), a motion of {:.1f} s\n", path,
             scene.options.objects.size() + scene.soft_objects.size(), scene.soft_objects.size(),
             hand.side == Side::left ? "left" : "right", hand.name, hand.node_count(),
             make_scene_motion(scene, hand)->duration());
}

bool is_network(const std::string& path) {
  try {
    return toml::parse_file(path).contains("network");
  } catch (const toml::parse_error&) {
    return false;
  }
}

void check_network(const std::string& path) {
  const bus::Network network = bus::read_network(path);
  std::string addresses;
  for (const std::string& address : network.addresses) addresses += " " + address;
  fmt::print("{}: a network on{}, {} peers, {}, {}\n", path,
             network.profile.empty() ? addresses : " the interfaces of " + network.profile, network.peers.size(),
             network.security.empty() ? "not secured" : "secured by " + network.security,
             network.leaves_host() ? "clocks of other hosts are " + network.options.clock : "this host only");
}

// Runs what a process does at its start. If the process would refuse to start, throws ConfigError with `where` before
// the reason.
template <typename Start>
void try_start(const std::string& where, Start&& start) {
  try {
    start();
  } catch (const std::invalid_argument& error) {
    throw ConfigError(where + error.what());
  }
}

}  // namespace

bool is_rig(const std::string& path) {
  try {
    const toml::table file = toml::parse_file(path);
    return file.contains("process") || file.contains("extends");
  } catch (const toml::parse_error&) {
    return false;
  }
}

Scene read_checked_scene(const std::string& path, const std::vector<std::string>& overrides) {
  Scene scene = read_scene(path, overrides);
  for (const std::string& section : scene.ignored)
    fmt::print(stderr,
               "{}: [{}]: no driver of this build has this section. Only a driver from elsewhere can read it.\n", path,
               section);
  std::string wrong;
  for (const std::string& problem :
       check_world(scene.options.world, scene.options.objects, 1 / scene.options.hand.rate_hz, scene.options.joints)) {
    wrong += (wrong.empty() ? "" : "\n") + path + ": " + problem;
  }
  const HandOptions& options = scene.options.hand;
  for (const std::string& problem : check_soft_objects(scene.options.world, scene.soft_objects, 1 / options.rate_hz))
    wrong += (wrong.empty() ? "" : "\n") + path + ": " + problem;
  for (const std::string& problem :
       check_assemblies(scene.options.objects, scene.options.joints, options.mirrored_objects, options.object_joints)) {
    wrong += (wrong.empty() ? "" : "\n") + path + ": " + problem;
  }
  if (!wrong.empty()) throw ConfigError(wrong);
  const HandModel hand = load_scene_hand(scene);
  const TrackingOptions& tracking = scene.options.tracking;
  try_start(path + ": generator: ", [&] { make_scene_motion(scene, hand); });
  try_start(path + ": hand.tracked_input.", [&] { TrackedInput{options.tracked_input}; });
  if (options.direct) return scene;  // there is no intermediate layer to check
  try_start(path + ": tracking.input.", [&] { TrackedInput{tracking.input}; });
  try_start(path + ": ", [&] { check_stability(tracking, options.rate_hz, hand); });
  return scene;
}

int run_check(const std::string& path) {
  if (path.ends_with(kObjectSuffix)) {
    check_object(path);
  } else if (path.ends_with(".json")) {
    check_hand(path);
  } else if (is_network(path)) {
    check_network(path);
  } else if (is_rig(path)) {
    check_rig(path);
  } else {
    check_scene(path);
  }
  return 0;
}

}  // namespace softhand
