// A rig: which processes run together, and in which order they come up.
#pragma once

#include <string>
#include <vector>

#include "runtime/options.hpp"

namespace softhand {

struct RigProcess {
  std::string name;       ///< log prefix, and the module name under which the process publishes loop_status
  std::string program;    ///< a file beside `softhand` itself, or a path
  std::string arguments;  ///< separated by blanks; {scene} stands for the rig's scene file
  double ready_timeout = 5;
  bool optional = false;  ///< left out, with a line that says so, where its program was not built
};
inline void describe(OptionVisitor& v, RigProcess& o) {
  v.string("name", o.name, "Log prefix, and the module name under which the process publishes loop_status.");
  v.string("program", o.program, "Program: a file beside softhand itself, or a path.");
  v.string("arguments", o.arguments, "Arguments, separated by blanks; {scene} stands for the rig's scene file.");
  v.flag("optional", o.optional, "Go on without the process where its program was not built.");
  v.number("ready_timeout", o.ready_timeout, "s", {0, 60}, "How long to wait for the first loop_status before the next process is started all the same.");
}

struct RigOptions {
  std::string name = "rig";
  std::string scene;
  std::vector<RigProcess> processes;
};
inline void describe(OptionVisitor& v, RigOptions& o) {
  v.string("name", o.name, "Name of the rig.");
  v.string("scene", o.scene, "Scene file that the processes share, relative to the rig file.");
  describe_list(v, "process", "A process, started when the one before it is ready.", o.processes);
}

}  // namespace softhand
