#include "cli/rig.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <set>
#include <sstream>

#include "messages/messages.hpp"
#include "runtime/config.hpp"

namespace softhand {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> words(const std::string& text) {
  std::istringstream in(text);
  return {std::istream_iterator<std::string>(in), {}};
}

std::string program_path(const RigProcess& process) {
  // An absolute path replaces the folder.
  return fs::read_symlink("/proc/self/exe").parent_path() / process.program;
}

RigOptions read(const std::string& path, std::set<fs::path>& seen) {
  if (!seen.insert(fs::weakly_canonical(path)).second) throw ConfigError(path + ": extends: extends itself");
  RigOptions rig;
  read_toml(rig, path);
  const fs::path folder = fs::path(path).parent_path();
  if (!rig.scene.empty()) rig.scene = (folder / rig.scene).lexically_normal().string();
  for (RigProcess& process : rig.processes) {
    if (process.program.find('/') != std::string::npos)
      process.program = fs::absolute(folder / process.program).lexically_normal().string();
  }
  if (rig.extends.empty()) return rig;
  RigOptions base = read((folder / rig.extends).lexically_normal().string(), seen);
  base.name = rig.name;
  base.part = rig.part;
  if (!rig.scene.empty()) base.scene = rig.scene;
  base.choose += " " + rig.choose;
  base.processes.insert(base.processes.end(), rig.processes.begin(), rig.processes.end());
  return base;
}

}  // namespace

RigOptions read_rig(const std::string& path) {
  std::set<fs::path> seen;
  RigOptions rig = read(path, seen);
  if (rig.scene.empty()) throw ConfigError(path + ": scene: expected a scene file");
  if (full_name(rig).size() >= sizeof(ShortText) || rig.part.size() > 58)
    throw ConfigError(path + ": name: expected at most 63 characters with its part, and 58 in the part");
  if (rig.name.find('/') != std::string::npos || rig.part.find('/') != std::string::npos)
    throw ConfigError(path + ": name: expected a name and a part without '/'");
  for (const RigProcess& process : rig.processes) {
    if (process.name.empty() || process.name.size() >= sizeof(ShortText))
      throw ConfigError(path + ": process: name '" + process.name + "': expected 1 to 63 characters");
    if (process.choice.size() >= sizeof(ShortText))
      throw ConfigError(path + ": process: choice '" + process.choice + "': expected at most 63 characters");
    // `choose` separates choices by spaces.
    if (std::any_of(process.choice.begin(), process.choice.end(), [](unsigned char c) { return std::isspace(c); }))
      throw ConfigError(path + ": process: choice '" + process.choice + "': expected no spaces");
  }
  std::set<std::pair<std::string, std::string>> known;
  for (const RigProcess& process : rig.processes) {
    const auto same_name = [&process](const RigProcess& other) { return other.name == process.name; };
    const bool alone = std::count_if(rig.processes.begin(), rig.processes.end(), same_name) == 1;
    if (!known.insert({process.name, process.choice}).second || (!alone && process.choice.empty()))
      throw ConfigError(path + ": process: several processes have the name '" + process.name +
                        "'; expected a different choice for each");
  }
  // If several choices have the same name, the last one applies.
  for (const std::string& choice : words(rig.choose)) {
    bool is_known = false;
    for (const RigProcess& process : rig.processes) {
      if (process.choice != choice) continue;
      rig.chosen[process.name] = choice;
      is_known = true;
    }
    if (!is_known)
      throw ConfigError(path + ": choose: no process has the choice '" + choice +
                        "'; expected the choice of a process");
  }
  return rig;
}

void check_programs(const RigOptions& rig, const std::string& path) {
  for (const RigProcess& process : rig.processes) {
    const std::string program = program_path(process);
    if (process.optional && !fs::exists(program)) continue;
    const bool is_folder = fs::is_directory(program);
    if (!is_folder && access(program.c_str(), X_OK) == 0) continue;
    throw ConfigError(fmt::format(
        "{}: process '{}': program {}: {}; expected a program in the folder of softhand, or a path with a '/'", path,
        process.name, program, std::strerror(is_folder ? EISDIR : errno)));
  }
}

std::vector<std::string> command_of(const RigProcess& process, const std::string& scene,
                                    const std::vector<std::string>& overrides) {
  constexpr std::string_view kScene = "{scene}";
  std::vector<std::string> command{program_path(process)};
  for (std::string& word : words(process.arguments)) {
    for (std::size_t at = 0; (at = word.find(kScene, at)) != std::string::npos; at += scene.size())
      word.replace(at, kScene.size(), scene);
    command.push_back(word);
  }
  for (const std::string& assignment : overrides) command.insert(command.end(), {"--set", assignment});
  return command;
}

std::string full_name(const RigOptions& rig) { return rig.part.empty() ? rig.name : rig.name + "/" + rig.part; }

bool share_domain(std::string_view one, std::string_view other) {
  const std::size_t slash = one.find('/');
  return slash != std::string_view::npos && one != other && other.substr(0, slash + 1) == one.substr(0, slash + 1);
}

bool choose(RigOptions& rig, const std::string& name, const std::string& choice) {
  const auto is_it = [&](const RigProcess& process) {
    return process.name == name && process.choice == choice && !choice.empty();
  };
  if (std::none_of(rig.processes.begin(), rig.processes.end(), is_it)) return false;
  rig.chosen[name] = choice;
  return true;
}

std::vector<RigProcess> chosen_processes(const RigOptions& rig) {
  std::vector<RigProcess> chosen;
  for (const RigProcess& process : rig.processes) {
    const auto same_name = [&process](const RigProcess& other) { return other.name == process.name; };
    const auto known = std::find_if(chosen.begin(), chosen.end(), same_name);
    const auto wanted = rig.chosen.find(process.name);
    if (known == chosen.end())
      chosen.push_back(process);
    else if (wanted != rig.chosen.end() && wanted->second == process.choice)
      *known = process;
  }
  return chosen;
}

}  // namespace softhand
