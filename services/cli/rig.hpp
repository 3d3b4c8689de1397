// A rig: which processes run together, and in which order they start.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "runtime/options.hpp"

namespace softhand {

struct RigProcess {
  std::string name;       ///< log prefix, and the module name under which the process publishes loop_status
  std::string choice;     ///< distinguishes processes of the same name; only one of them runs
  std::string program;    ///< a file in the folder of `softhand`, or an absolute path
  std::string arguments;  ///< separated by spaces; {scene} is replaced by the scene file of the rig
  double ready_timeout = 5;
  double longest_silence = 3;  ///< s
  std::string stop = "in turn";
  bool optional = false;  ///< if the program was not built: skip the process and print a line
};
inline void describe(OptionVisitor& v, RigProcess& o) {
  v.string("name", o.name,
           "Log prefix, and the module name under which the process publishes loop_status. At most 63 characters.");
  v.string("choice", o.choice,
           "Distinguishes processes of the same name. Only one of them runs: the first, or the one named in `choose`. "
           "Empty = the only process of its name. At most 63 characters, without spaces.");
  v.string("program", o.program,
           "Program: a file in the folder of softhand. With a '/', a path relative to the rig file.");
  v.string("arguments", o.arguments,
           "Arguments, separated by spaces. {scene} is replaced by the path of the rig's scene file, also within an "
           "argument.");
  v.flag("optional", o.optional, "Skip the process if its program was not built.");
  v.number("ready_timeout", o.ready_timeout, "s", {0, 60},
           "Time to wait for the first loop_status. After it the next process is started anyway.");
  v.number(
      "longest_silence", o.longest_silence, "s", {0, 600},
      "A process without loop_status for this time hangs: it is ended and started again. The first loop_status may "
      "take 30 s. 0 = the process may be silent.");
  v.choice("stop", o.stop, {"first", "in turn", "last"},
           "When `softhand up` stops the process. first: before all others (devices). in turn: alone, the last started "
           "first. last: after all others (displays).");
}

struct RigOptions {
  std::string name = "rig";
  std::string part;
  std::string extends;
  std::string scene;
  std::string choose;
  std::vector<RigProcess> processes;
  std::map<std::string, std::string> chosen;  ///< choice by process name, from `choose` and from messages
};
inline void describe(OptionVisitor& v, RigOptions& o) {
  v.string("name", o.name,
           "Name of the rig, at most 63 characters. Name and part have at most 62 characters together.");
  v.string(
      "part", o.part,
      "Name of the part of the rig that runs on this host. Parts of one rig share a domain. Empty = the rig runs on "
      "one host.");
  v.string(
      "extends", o.extends,
      "Another rig, relative to this one. Its processes come first. Its scene is used if this rig names no scene.");
  v.string("scene", o.scene, "Scene file of all processes, relative to the rig file.");
  v.string("choose", o.choose,
           "Choices of processes at the start, separated by spaces. Messages to the module `rig` can change them.");
  describe_list(v, "process", "A process. It is started when the previous one is ready.", o.processes);
}

/// Reads a rig and the rigs that it extends. The returned `scene` is relative to the working directory. Throws
/// ConfigError, also for an unknown choice, and if processes of the same name are not distinguished by their choices.
RigOptions read_rig(const std::string& path);

/// Throws ConfigError if the program of a process, also of one that is not chosen, cannot be started. A program that is
/// optional may be missing.
void check_programs(const RigOptions& rig, const std::string& path);

/// The program of the process and its arguments.
std::vector<std::string> command_of(const RigProcess& process, const std::string& scene,
                                    const std::vector<std::string>& overrides);

/// How a rig appears to others: NAME, or NAME/PART.
std::string full_name(const RigOptions& rig);
/// True if rigs with these full names share a domain: different parts of one rig.
bool share_domain(std::string_view one, std::string_view other);

/// Selects the process `name` with the choice `choice`. Returns false if there is no such process.
bool choose(RigOptions& rig, const std::string& name, const std::string& choice);

/// The processes that run, in start order.
std::vector<RigProcess> chosen_processes(const RigOptions& rig);

}  // namespace softhand
