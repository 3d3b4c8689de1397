#include "cli/demo.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <filesystem>
#include <stdexcept>

#include "cli/commands.hpp"

namespace softhand {
namespace {

namespace fs = std::filesystem;

// Empty if the file is not TOML. The whole scene is read when it starts.
std::string watch_of(const fs::path& scene) {
  try {
    return toml::parse_file(scene.string())["watch"].value_or(std::string());
  } catch (const toml::parse_error&) {
    return {};
  }
}

}  // namespace

std::vector<Demo> find_demos(const std::string& folder) {
  std::vector<Demo> demos;
  std::error_code missing;
  for (const auto& entry : fs::directory_iterator(folder, missing)) {
    if (entry.path().extension() != ".toml") continue;
    if (const std::string watch = watch_of(entry.path()); !watch.empty())
      demos.push_back({entry.path().stem().string(), watch, entry.path().string()});
  }
  if (demos.empty()) throw std::runtime_error(folder + ": expected scenes (.toml) with the key `watch`");
  std::sort(demos.begin(), demos.end(), [](const Demo& a, const Demo& b) { return a.name < b.name; });
  return demos;
}

const Demo& find_demo(const std::vector<Demo>& demos, const std::string& name) {
  const auto is_it = [&name](const Demo& demo) { return demo.name == name; };
  const auto found = std::find_if(demos.begin(), demos.end(), is_it);
  if (found != demos.end()) return *found;
  std::string names;
  for (const Demo& demo : demos) names += (names.empty() ? "" : ", ") + demo.name;
  throw std::runtime_error("no demonstration is called '" + name + "'; expected one of: " + names);
}

std::string demo_list(const std::vector<Demo>& demos) {
  std::size_t width = 0;
  for (const Demo& demo : demos) width = std::max(width, demo.name.size());
  std::string list;
  for (const Demo& demo : demos) list += fmt::format("{:{}}  {}\n", demo.name, width, demo.watch);
  return list + "\nStart one with `softhand demo NAME`. The line of the viewer in the log has the page's address.\n";
}

int run_demo(const DemoArguments& arguments) {
  const fs::path config = SOFTHAND_CONFIG_DIR;
  const std::vector<Demo> demos = find_demos((config / "scenes").string());
  if (arguments.name.empty()) {
    fmt::print("{}", demo_list(demos));
    return 0;
  }
  const Demo& demo = find_demo(demos, arguments.name);
  fmt::print("{}: {}\n", demo.name, demo.watch);
  UpArguments up = arguments.up;
  up.rig = (config / "rigs/demo.toml").string();
  up.scene = demo.scene;
  return run_up(up);
}

}  // namespace softhand
