// The commands of `softhand`, each in a file of its own. Every command returns the exit code of the process. 0 is
// success. 1 is failure: for example, nobody answered, or a process had to be killed. kExitHeld: another rig holds the
// domain. Errors are thrown as std::exception. main prints them as one line and returns 1.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace softhand {

/// `softhand up RIG`.
struct UpArguments {
  std::string rig;
  std::string scene;                   ///< scene file; empty = the rig's
  double seconds = 0;                  ///< 0 = until interrupted
  std::string json;                    ///< summary file; empty = none
  std::vector<std::string> overrides;  ///< --set, passed on to every process
  std::string hand;                    ///< hand file for every process; empty = the scene's
  std::string flight;                  ///< folder for the flight files of every process; empty = none at the end
  bool replace = false;                ///< ask another rig on the domain to stop, and take its place
};
int run_up(const UpArguments& arguments);

/// `softhand demo`: starts the demo rig with a scene of config/scenes that has the key `watch`.
struct DemoArguments {
  std::string name;  ///< file name of the scene without .toml; empty = list the scenes
  UpArguments up;    ///< without rig and scene
};
int run_demo(const DemoArguments& arguments);

/// `softhand status`: a live table, or one snapshot.
struct StatusArguments {
  bool once = false;
  bool json = false;
};
int run_status(const StatusArguments& arguments);

/// `softhand trackers` lists the live trackers. `softhand trackers use MODULE` lets one own its hand.
struct TrackersArguments {
  std::string use;  ///< module; empty = list
};
int run_trackers(const TrackersArguments& arguments);

/// `softhand calibrate`: measures the hands of a user in guided steps.
struct CalibrateArguments {
  std::uint32_t user = 0;
  double seconds = 20;  ///< of all steps
};
int run_calibrate(const CalibrateArguments& arguments);

/// `softhand check FILE`: validates a scene, rig, network, hand or object file.
int run_check(const std::string& path);

/// `softhand doctor [DEVICE]` says what is missing for a device on this machine.
struct DoctorArguments {
  std::string device;                  ///< a driver's section, with or without its kind; empty = list the drivers
  std::string scene;                   ///< scene with the options of the driver; empty = defaults
  std::vector<std::string> overrides;  ///< --set
};
int run_doctor(const DoctorArguments& arguments);

/// `softhand cyclone`: prints the network settings for a program on Cyclone DDS.
int run_cyclone(const std::string& role);

/// `softhand send MODULE KEY VALUE`: 0 when some module applied it, 1 otherwise.
struct SendArguments {
  std::string module;
  std::string key;
  std::string value;
  double seconds = 1;  ///< s, wait for an answer; restarts after each answer
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
  double seconds = 0;  ///< 0 = the duration of the scene
  std::string json;
  std::string csv;
  std::vector<std::string> overrides;
  std::string from;    ///< flight file to repeat instead of a scene
  bool force = false;  ///< repeat a file of another build or machine
  bool brief = false;  ///< print only steps that went wrong
};
int run_simulate(const SimulateArguments& arguments);

/// `softhand render SCENE`: runs the scene on the virtual clock and draws a picture or a short animation with the
/// viewer's page.
struct RenderArguments {
  std::string scene;
  std::string hand;    ///< hand file, instead of the scene's
  std::string out;     ///< .png (animated if `seconds` > 0), or .shv: a recording for the viewer's page
  double at = 1;       ///< s, scene time of the first picture
  double seconds = 0;  ///< 0 = one picture; above 0 = length of an animation that starts at `at`
  double pictures_per_second = 15;
  int width = 1280;  ///< pixels
  int height = 800;
  std::string view;  ///< address parameters of the viewer's page, docs/viewer.md
  std::vector<std::string> overrides;
};
int run_render(const RenderArguments& arguments);

/// Replaces this process by a program that is installed beside `softhand`. `softhand bench` executes softhand-bench, a
/// separate program because it links CHOLMOD's GPL module for comparison. `softhand report` executes softhand-report.
/// Throws if the program was not built.
int run_sibling(const std::string& program, const std::vector<std::string>& arguments);

/// `softhand reference [DRIVER]`: prints the generated page of options. `driver`: a section of the scene file, or
/// empty. Throws std::runtime_error if this program does not know the driver.
int run_reference(const std::string& driver);
/// The text that run_reference("") prints: docs/reference.md. It leaves out the sections of drivers.
std::string reference_page();
/// The text that run_reference prints for a driver: the file `driver_options_file`.
std::string driver_reference_page(const std::string& driver);
/// In the folder of the driver, relative to the source tree.
std::string driver_options_file(const std::string& driver);

}  // namespace softhand
