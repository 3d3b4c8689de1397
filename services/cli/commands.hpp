// The commands of `softhand`, each in a file of its own. Every one returns the process's exit code: 0 done; 1 it did
// not work out (nobody answered, a file is wrong, a process had to be killed). Errors are thrown as std::exception, of
// which main makes a line and exit code 1.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace softhand {

/// `softhand up RIG`.
struct UpArguments {
  std::string rig;
  double seconds = 0;                  ///< 0 = until interrupted
  std::string json;                    ///< summary file; empty = none
  std::vector<std::string> overrides;  ///< --set, passed on to every process
  std::string hand;                    ///< hand file for every process; empty = the scene's
};
int run_up(const UpArguments& arguments);

/// `softhand status`: a live table, or one snapshot.
struct StatusArguments {
  bool once = false;
  bool json = false;
};
int run_status(const StatusArguments& arguments);

/// `softhand check FILE`: validates a scene, rig or hand file.
int run_check(const std::string& path);

/// `softhand send MODULE KEY VALUE`: 0 when some module applied it, 1 otherwise.
struct SendArguments {
  std::string module;
  std::string key;
  std::string value;
  double seconds = 1;  ///< how long to wait for an answer, or for one more after the last
};
int run_send(const SendArguments& arguments);

/// `softhand record FILE` and `softhand replay FILE`.
struct RecordArguments {
  std::string path;
  double seconds = 0;               ///< 0 = until interrupted
  std::vector<std::string> topics;  ///< last parts of topic names; empty = all
};
int run_record(const RecordArguments& arguments);
struct ReplayArguments {
  std::string path;
  double speed = 1;
  std::vector<std::string> topics;
};
int run_replay(const ReplayArguments& arguments);

/// `softhand simulate SCENE`.
struct SimulateArguments {
  std::string scene;
  std::string motion;  ///< CSV of a recorded hand, instead of the scene's
  std::string hand;    ///< hand file, instead of the scene's
  double seconds = 0;  ///< 0 = the scene's
  std::string json;
  std::string csv;
  std::vector<std::string> overrides;
};
int run_simulate(const SimulateArguments& arguments);

/// `softhand render SCENE`: a picture or a short animation from the viewer's page, of the scene on the virtual clock.
struct RenderArguments {
  std::string scene;
  std::string hand;  ///< hand file, instead of the scene's
  std::string out;   ///< .png (an animated one where `seconds` > 0), or .shv, a recording that the viewer's page opens
  double at = 1;     ///< s of the scene
  double seconds = 0;  ///< > 0: an animation from `at` on
  double pictures_per_second = 15;
  int width = 1280;  ///< pixels
  int height = 800;
  std::string view;  ///< the page's address parameters, docs/viewer.md
  std::vector<std::string> overrides;
};
int run_render(const RenderArguments& arguments);

/// `softhand bench`: becomes softhand-bench, a program of its own because it links CHOLMOD's GPL module to compare
/// with. `json`: summary file; empty = none.
int run_bench(const std::string& json);

/// `softhand reference`: the generated page of options.
int run_reference();
/// What it prints: docs/reference.md.
std::string reference_page();

}  // namespace softhand
