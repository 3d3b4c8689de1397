// softhand: starts, watches, asks, records and simulates the soft hand.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <functional>

#include "cli/commands.hpp"
#include "error_runtime/report.hpp"
#include "human/report.hpp"
#include "report/page.hpp"
#include "stress/report.hpp"
#include "verification/report.hpp"

int main(int argc, char** argv) {
  using namespace softhand;
  CLI::App app(
      "A soft hand in real time: tracked fingers grasp the objects of a physics engine through simulated tissue, over "
      "DDS.\n"
      "All processes of one machine meet on the DDS domain in the environment variable SOFTHAND_DOMAIN (0 to 230, "
      "default 0).",
      "softhand");
  app.require_subcommand(1);
  app.footer(
      "Exit codes: 0 done; 1 it did not work out, a line says why; above 100 the command line was wrong.\nMore: "
      "docs/command-line.md");
  std::function<int()> run;
  // CLI11 would take what follows a repeatable option for more of its values.
  const auto overrides = [](CLI::App* command, std::vector<std::string>& values) {
    command
        ->add_option(
            "--set", values,
            "Override one key of the scene, e.g. --set hand.rate_hz=60; repeatable. Keys: `softhand reference`")
        ->type_name("KEY=VALUE")
        ->allow_extra_args(false);
  };
  const auto topic_filter = [](CLI::App* command, std::vector<std::string>& values) {
    command->add_option("--topic", values, "Only this topic, by the last part of its name, e.g. contacts; repeatable")
        ->type_name("NAME")
        ->allow_extra_args(false);
  };

  UpArguments up;
  CLI::App* command = app.add_subcommand(
      "up",
      "Start the processes that a rig file names, in order of readiness; restart those that die; Ctrl-C stops all");
  command->add_option("rig", up.rig, "Rig file, e.g. config/rigs/demo.toml")->required()->type_name("FILE");
  command->add_option("--seconds", up.seconds, "Stop after this time; default: run until Ctrl-C")
      ->type_name("S")
      ->check(CLI::NonNegativeNumber);
  command->add_option("--json", up.json, "Listen to all topics and write a summary of the run (docs/outcome.md)")
      ->type_name("FILE");
  command
      ->add_option("--hand", up.hand,
                   "Hand file for every process instead of the scene's: a path, or a name in config/hands")
      ->type_name("FILE");
  overrides(command, up.overrides);
  command->callback([&] { run = [&up] { return run_up(up); }; });

  StatusArguments status;
  command = app.add_subcommand("status",
                               "Show every running module: rates, step times, missed deadlines, input age, counters");
  command->add_flag("--once", status.once, "Print one table and end");
  command->add_flag("--json", status.json, "Print one JSON object and end");
  command->callback([&] { run = [&status] { return run_status(status); }; });

  std::string file;
  command = app.add_subcommand(
      "check",
      "Check a scene, rig (.toml) or hand (.json) file: says what it is, or what is wrong, with line, key or field");
  command->add_option("file", file, "The file")->required()->type_name("FILE");
  command->callback([&] { run = [&file] { return run_check(file); }; });

  SendArguments send;
  command =
      app.add_subcommand("send", "Send a named parameter to every running module and print what each did with it");
  command->add_option("module", send.module, "Name of the addressed module as `softhand status` shows it, or * for all")
      ->required();
  command->add_option("key", send.key, "Name of the parameter, e.g. motors")->required();
  command->add_option("value", send.value, "Its value")->required();
  command->add_option("--seconds", send.seconds, "How long to wait for an answer, and for one more after the last")
      ->capture_default_str()
      ->type_name("S")
      ->check(CLI::PositiveNumber);
  command->callback([&] { run = [&send] { return run_send(send); }; });

  RecordArguments record;
  command = app.add_subcommand(
      "record",
      "Write all topics to an MCAP file, which other tools read too; survives a crash up to the last message");
  command->add_option("file", record.path, "The file to write, e.g. run.mcap")->required()->type_name("FILE");
  command->add_option("--seconds", record.seconds, "Stop after this time; default: record until Ctrl-C")
      ->type_name("S")
      ->check(CLI::NonNegativeNumber);
  topic_filter(command, record.topics);
  command->callback([&] { run = [&record] { return run_record(record); }; });

  ReplayArguments replay;
  command = app.add_subcommand("replay", "Publish a recording again at its own pace, with times moved to now");
  command->add_option("file", replay.path, "A recording of `softhand record`")->required()->type_name("FILE");
  command->add_option("--speed", replay.speed, "Times the recorded pace")
      ->capture_default_str()
      ->check(CLI::Range(0.001, 1000.0));
  topic_filter(command, replay.topics);
  command->callback([&] { run = [&replay] { return run_replay(replay); }; });

  SimulateArguments simulate;
  command = app.add_subcommand(
      "simulate",
      "Run all loops of a scene in this process on a virtual clock: no DDS, and the same bits on every run");
  command->add_option("scene", simulate.scene, "Scene file, e.g. config/scenes/pinch_lift.toml")
      ->required()
      ->type_name("FILE");
  command->add_option("--motion", simulate.motion, "Recorded hand (CSV) instead of the scene's motion")
      ->type_name("FILE");
  command->add_option("--hand", simulate.hand, "Hand file instead of the scene's: a path, or a name in config/hands")
      ->type_name("FILE");
  command->add_option("--seconds", simulate.seconds, "How long; default: the scene's")
      ->type_name("S")
      ->check(CLI::NonNegativeNumber);
  command->add_option("--json", simulate.json, "Where the summary goes (docs/outcome.md); default: to the terminal")
      ->type_name("FILE");
  command->add_option("--csv", simulate.csv, "Signals, a row a step of the hand")->type_name("FILE");
  overrides(command, simulate.overrides);
  command->callback([&] { run = [&simulate] { return run_simulate(simulate); }; });

  RenderArguments render;
  command = app.add_subcommand(
      "render", "Make a picture of a scene, or a short animation, with the viewer's page (needs node and chromium)");
  command->add_option("scene", render.scene, "Scene file, e.g. config/scenes/pinch_lift.toml")
      ->required()
      ->type_name("FILE");
  command->add_option("--at", render.at, "When, in the scene's time")
      ->capture_default_str()
      ->type_name("S")
      ->check(CLI::Range(0.0, 86400.0));
  command->add_option("--out", render.out, "The .png to write, or an .shv that the viewer's page opens")
      ->required()
      ->type_name("FILE");
  command->add_option("--seconds", render.seconds, "An animation of so long, as an animated .png")
      ->type_name("S")
      ->check(CLI::Range(0.0, 60.0));
  command->add_option("--rate", render.pictures_per_second, "Pictures a second of an animation")
      ->capture_default_str()
      ->check(CLI::Range(1.0, 60.0));
  command->add_option("--width", render.width, "Pixels")->capture_default_str()->check(CLI::Range(16, 7680));
  command->add_option("--height", render.height, "Pixels")->capture_default_str()->check(CLI::Range(16, 7680));
  command->add_option(
      "--view", render.view,
      "What is shown and from where, as in the page's address, e.g. \"theme=dark&colour=pressure\" (docs/viewer.md)");
  command->add_option("--hand", render.hand, "Hand file instead of the scene's: a path, or a name in config/hands")
      ->type_name("FILE");
  overrides(command, render.overrides);
  command->callback([&] { run = [&render] { return run_render(render); }; });

  CLI::App* report =
      app.add_subcommand("report",
                         "Evidence, computed anew: known answers, the stress map, error against run time, fingertips "
                         "beside people's; without a part: all of them, and the page that they make");
  report->require_subcommand(0, 1);
  report::ReportArguments all_parts;
  report->add_flag("--quick", all_parts.quick, "Under five minutes: each part's --quick");
  report->add_flag("--resume", all_parts.resume, "Compute only the parts that DIR/report_data lacks");
  report
      ->add_option("--motion", all_parts.motion,
                   "Recording for error-runtime's scene recorded_grasp (CSV); without it this scene is left out")
      ->type_name("FILE");
  report->add_option("--out", all_parts.out, "Folder of report.md, images/ and report_data/")
      ->capture_default_str()
      ->type_name("DIR");
  report->callback([&] {
    if (report->get_subcommands().empty()) run = [&all_parts] { return report::run_report(all_parts); };
  });
  // Where a part's rows and page go; pictures where it makes some.
  const auto outputs = [](CLI::App* part, auto& arguments, const std::string& row, const std::string& page,
                          [[maybe_unused]] const std::string& pictures = {}) {
    part->add_option("--json", arguments.json, "A list of rows: " + row)->type_name("FILE");
    part->add_option("--csv", arguments.csv, "The same as CSV")->type_name("FILE");
    part->add_option("--markdown", arguments.markdown, page + ", with machine, compiler and commit")->type_name("FILE");
    if constexpr (requires { arguments.plot; })
      part->add_option("--plot", arguments.plot, "Folder for " + pictures + " (needs python3-matplotlib)")
          ->type_name("DIR");
  };
  verification::VerifyArguments verify;
  command = report->add_subcommand("verify",
                                   "Known answers: measured value beside the formula's, with tolerance and observed "
                                   "order; exit code 1 where one is missed");
  command->add_flag("--quick", verify.quick, "Under a minute: the first rows of what takes long");
  outputs(command, verify, "case, value, reference, tolerance, order, status", "The same as a table");
  command->add_option("--case", verify.which, "Only this case; repeatable")->type_name("NAME")->allow_extra_args(false);
  command
      ->add_option("--set", verify.settings,
                   "Another value of a case's parameter, e.g. --case friction_slide --set slope=0.8; repeatable; its "
                   "reference is computed with it")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
  command->callback([&] { run = [&verify] { return verification::run_verify(verify); }; });

  stress::StressArguments stress;
  command = report->add_subcommand("stress",
                                   "Extreme inputs through the real loops, each classified by the invariants; exit "
                                   "code 1 where a number that is not finite was "
                                   "published, or fewer than 95 % outside the sweep pass or were rightly refused");
  command->add_flag("--quick", stress.quick, "Under a minute and a half: marked rows and a small sweep");
  outputs(command, stress, "case, parameter, class, figure, invariant", "Summary, what did not pass and why",
          "stress_map.png and stress_sweep.png");
  command->add_option("--case", stress.which, "Only this case; repeatable")->type_name("NAME")->allow_extra_args(false);
  command
      ->add_option("--cache", stress.cache,
                   "Keep computed rows there, and take those that the same programs computed before")
      ->type_name("DIR");
  command->callback([&] { run = [&stress] { return stress::run_stress(stress); }; });

  error_runtime::ErrorRuntimeArguments error_runtime;
  command = report->add_subcommand("error-runtime",
                                   "What a millisecond buys: every setting's CPU time and its error against converged "
                                   "references; exit code 1 where the default is more than "
                                   "0.1 mm or 2 % off in a grasp");
  command->add_flag("--quick", error_runtime.quick, "A minute and a half: the coarse hand, fewer settings");
  outputs(command, error_runtime,
          "scene, knob, setting, ms_p50, ms_p99, tissue_rms_mm, force_error, class, and other norms",
          "What the default costs, Pareto fronts, slopes and all rows",
          "error_runtime.png and error_runtime_total.png");
  command->add_option("--scene", error_runtime.which, "Only this scene, or peer (Bullet's soft body); repeatable")
      ->type_name("NAME")
      ->allow_extra_args(false);
  command
      ->add_option("--motion", error_runtime.motion,
                   "Recording for the scene recorded_grasp (CSV); without it this scene is left out")
      ->type_name("FILE");
  command->callback([&] { run = [&error_runtime] { return error_runtime::run_error_runtime(error_runtime); }; });

  human::HumanArguments human;
  command = report->add_subcommand(
      "human",
      "The index fingertip of the hands pressed by a flat plate, beside people's; exit code 1 outside people's spread");
  command->add_option("--hand", human.hands, "Only this hand file; repeatable")
      ->type_name("FILE")
      ->allow_extra_args(false)
      ->check(CLI::ExistingFile);
  command
      ->add_option("--pulp", human.pulp,
                   "Another value of youngs_modulus (Pa), limit_energy (J/m^3) or limit_ratio of the pulp; repeatable")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
  command->add_flag("--fit", human.fit,
                    "Fit one pulp for all the hands to people's force; print and show that material instead");
  outputs(command, human, "hand, indentation, force, area, their references, status", "A table", "human.png");
  command->callback([&] { run = [&human] { return human::run_human(human); }; });

  human::PostureArguments postures;
  command = report->add_subcommand(
      "postures",
      "Strain of the hands' tissue and iterations of a step, flat, relaxed and in a fist; exit code 1 "
      "where the skin is strained by more than 60 % or a tetrahedron is inside out");
  command->add_option("--hand", postures.hands, "Only this hand file; repeatable")
      ->type_name("FILE")
      ->allow_extra_args(false)
      ->check(CLI::ExistingFile);
  command->add_option("--markdown", postures.markdown, "The same table")->type_name("FILE");
  command->callback([&] { run = [&postures] { return human::run_postures(postures); }; });

  std::string bench_json;
  command = app.add_subcommand("bench",
                               "Measure what a step costs, against CHOLMOD and scalar kernels in the same run "
                               "(docs/performance.md); about a minute");
  command->add_option("--json", bench_json, "The figures by name")->type_name("FILE");
  command->callback([&] { run = [&bench_json] { return run_bench(bench_json); }; });

  command = app.add_subcommand(
      "reference", "Print every option of scenes and rigs with default, unit, range and meaning (docs/reference.md)");
  command->callback([&] { run = [] { return run_reference(); }; });

  CLI11_PARSE(app, argc, argv);
  try {
    return run();
  } catch (const std::exception& error) {
    fmt::print(stderr, "softhand {}: {}\n", app.get_subcommands().front()->get_name(), error.what());
    return 1;
  }
}
