// A rig: which processes run together, and in which order they come up.
#pragma once

#include <string>
#include <vector>

#include "runtime/options.hpp"

namespace softhand {

struct RigProcess {
  std::string name;       ///< log prefix, and the module name under which the process publishes loop_status
  std::string choice;     ///< tells apart processes of one name, of which one runs
  std::string program;    ///< a file beside `softhand` itself, or a path
  std::string arguments;  ///< separated by blanks; {scene} stands for the rig's scene file
  double ready_timeout = 5;
  bool optional = false;  ///< left out, with a line that says so, where its program was not built
};
inline void describe(OptionVisitor& v, RigProcess& o) {
  v.string("name", o.name, "Log prefix, and the module name under which the process publishes loop_status.");
  v.string("choice", o.choice,
           "Of several processes with one name, one runs: the first, or the one whose choice is chosen. Empty = the "
           "only one.");
  v.string("program", o.program, "Program: a file beside softhand itself, or a path.");
  v.string("arguments", o.arguments, "Arguments, separated by blanks; {scene} stands for the rig's scene file.");
  v.flag("optional", o.optional, "Go on without the process where its program was not built.");
  v.number("ready_timeout", o.ready_timeout, "s", {0, 60},
           "How long to wait for the first loop_status before the next process is started all the same.");
}

struct RigOptions {
  std::string name = "rig";
  std::string extends;
  std::string scene;
  std::string choose;
  std::vector<RigProcess> processes;
};
inline void describe(OptionVisitor& v, RigOptions& o) {
  v.string("name", o.name, "Name of the rig.");
  v.string(
      "extends", o.extends,
      "Another rig, relative to this one: its processes come first, and its scene holds where this one names none.");
  v.string("scene", o.scene, "Scene file that the processes share, relative to the rig file.");
  v.string("choose", o.choose,
           "Choices that are made at the start, separated by blanks; messages to the module `rig` make others.");
  describe_list(v, "process", "A process, started when the one before it is ready.", o.processes);
}

/// Reads a rig and what it extends, `scene` as a path from here. Throws ConfigError, also where a choice that is made
/// is no process's, or where two processes of one name cannot be told apart.
RigOptions read_rig(const std::string& path);

/// Chooses the process `name` called `choice` over those chosen so far; false where there is none.
bool choose(RigOptions& rig, const std::string& name, const std::string& choice);

/// The processes that run, in their order.
std::vector<RigProcess> chosen_processes(const RigOptions& rig);

}  // namespace softhand
