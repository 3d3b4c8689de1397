// softhand: starts, monitors, messages, records and simulates the soft hand.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <functional>
#include <iterator>

#include "bus/dds_log.hpp"
#include "bus/network.hpp"
#include "cli/commands.hpp"

int main(int argc, char** argv) {
  using namespace softhand;
  using namespace std::string_literals;
  CLI::App app(
      "Real-time simulation of a soft hand: tracked fingers grasp the objects of a physics engine through simulated "
      "tissue. The processes communicate over DDS.\n"
      "All processes use the DDS domain in the environment variable SOFTHAND_DOMAIN (0 to 230, default 0). "
      "SOFTHAND_NETWORK names a file with the section [network]; without it they use the loopback interface "
      "(docs/several-hosts.md).",
      "softhand");
  app.require_subcommand(1);
  app.footer(
      "Exit codes: 0 = success; 1 = failure, with one line that gives the reason; 75 = another rig holds the domain; "
      "above 100 = wrong command line.\n"
      "More: docs/command-line.md");
  std::function<int()> run;
  // Without allow_extra_args(false), CLI11 would parse the words after a repeatable option as more values of the
  // option.
  const auto overrides = [](CLI::App* command, std::vector<std::string>& values) {
    command
        ->add_option(
            "--set", values,
            "Override one key of the scene, e.g. --set hand.rate_hz=60; repeatable. Keys: `softhand reference`")
        ->type_name("KEY=VALUE")
        ->allow_extra_args(false);
  };
  const auto topic_filter = [](CLI::App* command, std::vector<std::string>& values) {
    command
        ->add_option("--topic", values,
                     "Only this topic, given by the last part of its name, e.g. contacts; repeatable")
        ->type_name("NAME")
        ->allow_extra_args(false);
  };

  const auto up_options = [&](CLI::App* command, UpArguments& up) {
    command->add_option("--seconds", up.seconds, "Stop after this time; default: run until Ctrl-C")
        ->type_name("S")
        ->check(CLI::NonNegativeNumber);
    command->add_option("--json", up.json, "Listen to the rig and write a summary of the run (docs/outcome.md)")
        ->type_name("FILE");
    command
        ->add_option("--hand", up.hand,
                     "Hand file for every process instead of the scene's: a path, or a name in config/hands")
        ->type_name("FILE");
    command
        ->add_option("--flight", up.flight,
                     "Folder for the flight files of hand, tracking and world (docs/flight-recorder.md). Each process "
                     "writes its last minute when it stops")
        ->type_name("DIR");
    command->add_flag("--replace", up.replace,
                      "If another rig holds the domain: ask it to stop, and start when it has stopped. Without this "
                      "option, a second rig ends at once with exit code 75");
    overrides(command, up.overrides);
  };

  UpArguments up;
  CLI::App* command = app.add_subcommand(
      "up",
      "Start the processes of a rig file in order, each when the previous one is ready; restart processes that die; "
      "Ctrl-C stops all");
  command->add_option("rig", up.rig, "Rig file, e.g. config/rigs/demo.toml")->required()->type_name("FILE");
  command->add_option("--scene", up.scene, "Scene file instead of the rig's")->type_name("FILE");
  up_options(command, up);
  command->callback([&] { run = [&up] { return run_up(up); }; });

  DemoArguments demo;
  command = app.add_subcommand(
      "demo", "List the demonstrations, each with a line on what to watch; with a name: start it like `softhand up`");
  command->add_option("name", demo.name, "Name in the list, e.g. pinch");
  up_options(command, demo.up);
  command->callback([&] { run = [&demo] { return run_demo(demo); }; });

  StatusArguments status;
  command = app.add_subcommand("status",
                               "Show every running module: rates, step times, missed deadlines, input age, counters");
  command->add_flag("--once", status.once, "Print one table and end");
  command->add_flag("--json", status.json, "Print one JSON object and end");
  command->callback([&] { run = [&status] { return run_status(status); }; });

  TrackersArguments trackers;
  command = app.add_subcommand(
      "trackers", "List the live trackers with strength, health, rate, age and confidence, and who owns which hand");
  command->callback([&] { run = [&trackers] { return run_trackers(trackers); }; });
  command =
      command->add_subcommand("use", "Make a tracker stronger than all others of its user, so that it owns the hand");
  command->add_option("module", trackers.use, "Name of the tracker in the list")->required();

  CalibrateArguments calibrate;
  command = app.add_subcommand("calibrate",
                               "Measure the bone lengths and the range of motion of a user's hands in four guided "
                               "steps, and keep them for the rigs that start from now on (docs/calibration.md)");
  command->add_option("--user", calibrate.user, "User of the tracked hands")
      ->capture_default_str()
      ->check(CLI::Range(0, 15));
  command->add_option("--seconds", calibrate.seconds, "Duration of the four steps together")
      ->capture_default_str()
      ->type_name("S")
      ->check(CLI::Range(4.0, 600.0));
  command->callback([&] { run = [&calibrate] { return run_calibrate(calibrate); }; });

  std::string file;
  command =
      app.add_subcommand("check",
                         "Check a scene, rig, network (.toml), hand or object (.json) file: print what it contains, or "
                         "the errors with line, key or "
                         "field");
  command->add_option("file", file, "The file")->required()->type_name("FILE");
  command->callback([&] { run = [&file] { return run_check(file); }; });

  DoctorArguments doctor;
  command = app.add_subcommand("doctor",
                               "Say what is missing for a device on this machine: permission, port, service, library, "
                               "version. Without a name: list the devices");
  command->add_option("device", doctor.device, "Name in the list, e.g. natnet");
  command->add_option("--config", doctor.scene, "Scene with the options of its driver; default: their defaults")
      ->type_name("FILE");
  overrides(command, doctor.overrides);
  command->callback([&] { run = [&doctor] { return run_doctor(doctor); }; });

  std::string role = "client";
  command = app.add_subcommand("cyclone",
                               "Print the settings of SOFTHAND_NETWORK for a program on Cyclone DDS (CYCLONEDDS_URI)");
  command->add_option("--role", role, "Identity in a secured domain")
      ->capture_default_str()
      ->check(CLI::IsMember(std::vector<std::string>(std::begin(bus::kRoles), std::end(bus::kRoles))));
  command->callback([&] { run = [&role] { return run_cyclone(role); }; });

  SendArguments send;
  command =
      app.add_subcommand("send", "Send a named parameter to every running module and print the answer of each module");
  command->add_option("module", send.module, "Name of the module as shown by `softhand status`, or * for all")
      ->required();
  command->add_option("key", send.key, "Name of the parameter, e.g. motors")->required();
  command->add_option("value", send.value, "Value of the parameter")->required();
  command->add_option("--seconds", send.seconds, "Time to wait for an answer; starts again after each answer")
      ->capture_default_str()
      ->type_name("S")
      ->check(CLI::PositiveNumber);
  command->callback([&] { run = [&send] { return run_send(send); }; });

  RecordArguments record;
  command = app.add_subcommand(
      "record",
      "Write all topics to an MCAP file, which other tools can read too; after a crash every complete message is kept");
  command->add_option("file", record.path, "The file to write, e.g. run.mcap")->required()->type_name("FILE");
  command->add_option("--seconds", record.seconds, "Stop after this time; default: record until Ctrl-C")
      ->type_name("S")
      ->check(CLI::NonNegativeNumber);
  topic_filter(command, record.topics);
  command->callback([&] { run = [&record] { return run_record(record); }; });

  ReplayArguments replay;
  command =
      app.add_subcommand("replay", "Publish a recording again at its recorded pace, with its times shifted to now");
  command->add_option("file", replay.path, "A recording of `softhand record`")->required()->type_name("FILE");
  command->add_option("--speed", replay.speed, "Factor on the recorded pace")
      ->capture_default_str()
      ->check(CLI::Range(0.001, 1000.0));
  topic_filter(command, replay.topics);
  command->callback([&] { run = [&replay] { return run_replay(replay); }; });

  SimulateArguments simulate;
  command = app.add_subcommand(
      "simulate",
      "Run all loops of a scene in this process on a virtual clock, without DDS; every run gives the same bits");
  CLI::Option* simulated_scene =
      command->add_option("scene", simulate.scene, "Scene file, e.g. config/scenes/pinch_lift.toml")->type_name("FILE");
  CLI::Option* flight = command
                            ->add_option("--from", simulate.from,
                                         "Repeat the steps of a flight file instead of a scene, and compare every "
                                         "state (docs/flight-recorder.md)")
                            ->type_name("FILE")
                            ->excludes(simulated_scene);
  command
      ->add_flag("--force", simulate.force,
                 "With --from: repeat a file of another build or instruction set, and compare within a tolerance")
      ->needs(flight);
  command->add_flag("--brief", simulate.brief, "With --from: print only the steps that differ or failed")
      ->needs(flight);
  command->add_option("--motion", simulate.motion, "Recorded hand (CSV) instead of the scene's motion")
      ->type_name("FILE");
  command->add_option("--hand", simulate.hand, "Hand file instead of the scene's: a path, or a name in config/hands")
      ->type_name("FILE");
  command->add_option("--seconds", simulate.seconds, "Simulated time; default: the duration of the scene")
      ->type_name("S")
      ->check(CLI::NonNegativeNumber);
  command->add_option("--json", simulate.json, "File for the summary (docs/outcome.md); default: the terminal")
      ->type_name("FILE");
  command->add_option("--csv", simulate.csv, "File for signals, one row per step of the hand")->type_name("FILE");
  overrides(command, simulate.overrides);
  command->callback([&] { run = [&simulate] { return run_simulate(simulate); }; });

  RenderArguments render;
  command = app.add_subcommand(
      "render", "Draw a picture or a short animation of a scene with the viewer's page (needs node and chromium)");
  command->add_option("scene", render.scene, "Scene file, e.g. config/scenes/pinch_lift.toml")
      ->required()
      ->type_name("FILE");
  command->add_option("--at", render.at, "Scene time of the picture")
      ->capture_default_str()
      ->type_name("S")
      ->check(CLI::Range(0.0, 86400.0));
  command->add_option("--out", render.out, "The .png to write, or an .shv that the viewer's page opens")
      ->required()
      ->type_name("FILE");
  command->add_option("--seconds", render.seconds, "Duration of an animation, written as an animated .png")
      ->type_name("S")
      ->check(CLI::Range(0.0, 60.0));
  command->add_option("--rate", render.pictures_per_second, "Pictures per second of an animation")
      ->capture_default_str()
      ->check(CLI::Range(1.0, 60.0));
  command->add_option("--width", render.width, "Width in pixels")->capture_default_str()->check(CLI::Range(16, 7680));
  command->add_option("--height", render.height, "Height in pixels")
      ->capture_default_str()
      ->check(CLI::Range(16, 7680));
  command->add_option(
      "--view", render.view,
      "Content and camera, as in the address of the page, e.g. \"theme=dark&colour=pressure\" (docs/viewer.md)");
  command->add_option("--hand", render.hand, "Hand file instead of the scene's: a path, or a name in config/hands")
      ->type_name("FILE");
  overrides(command, render.overrides);
  command->callback([&] { run = [&render] { return run_render(render); }; });

  // A separate program parses the rest of the line, so that building `softhand` does not compile the studies.
  CLI::App* report = app.add_subcommand(
      "report",
      "Recompute the evidence: known answers, the stress map, error against run time, fingertips compared with "
      "people's. Runs softhand-report; see `softhand report --help`");
  report->prefix_command()->set_help_flag();
  report->callback([&] { run = [report] { return run_sibling("softhand-report", report->remaining()); }; });

  std::string bench_json;
  command = app.add_subcommand("bench",
                               "Measure the cost of a step, compared with CHOLMOD and scalar kernels in the same run "
                               "(docs/performance.md); takes about two minutes");
  command->add_option("--json", bench_json, "File for the figures by name")->type_name("FILE");
  command->callback([&] {
    run = [&bench_json] {
      return run_sibling("softhand-bench",
                         bench_json.empty() ? std::vector<std::string>{} : std::vector{"--json"s, bench_json});
    };
  });

  command = app.add_subcommand(
      "reference",
      "Print every option of scenes, rigs and networks, or of a driver, with default, unit, range and meaning");
  std::string driver;
  command->add_option("DRIVER", driver, "Section of the driver in a scene, e.g. tracker_streamer");
  command->callback([&] { run = [&] { return run_reference(driver); }; });

  CLI11_PARSE(app, argc, argv);
  bus::log_to_stderr();
  try {
    return run();
  } catch (const std::exception& error) {
    fmt::print(stderr, "softhand {}: {}\n", app.get_subcommands().front()->get_name(), error.what());
    return 1;
  }
}
