// softhand-report: recomputes the evidence for docs/report.md. `softhand report` executes this program.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <functional>

#include "error_runtime/report.hpp"
#include "human/report.hpp"
#include "report/page.hpp"
#include "stress/report.hpp"
#include "verification/report.hpp"
#include "wall/report.hpp"

int main(int argc, char** argv) {
  using namespace softhand;
  CLI::App app(
      "Recompute the evidence: known answers, the stress map, error against run time, fingertips "
      "compared with people's. Without a part: compute all parts and write their page",
      "softhand report");
  app.require_subcommand(0, 1);
  app.footer(
      "Exit codes: 0 = success; 1 = failure, with one line that gives the reason; above 100 = wrong command line.\n"
      "More: docs/command-line.md");
  std::function<int()> run;
  report::ReportArguments all_parts;
  app.add_flag("--quick", all_parts.quick, "Run each part with its --quick; takes less than five minutes");
  app.add_flag("--resume", all_parts.resume, "Compute only the parts that DIR/report_data lacks");
  app.add_option("--motion", all_parts.motion,
                 "Recording for error-runtime's recorded scenes (CSV); without it they are left out")
      ->type_name("FILE");
  app.add_option("--out", all_parts.out, "Folder for report.md, images/ and report_data/")
      ->capture_default_str()
      ->type_name("DIR");
  app.callback([&] {
    if (app.get_subcommands().empty()) run = [&all_parts] { return report::run_report(all_parts); };
  });
  // Output files of a part. `pictures` is empty for a part without pictures.
  const auto outputs = [](CLI::App* part, auto& arguments, const std::string& row, const std::string& page,
                          [[maybe_unused]] const std::string& pictures = {}) {
    part->add_option("--json", arguments.json, "File for a list of rows: " + row)->type_name("FILE");
    part->add_option("--csv", arguments.csv, "The same as CSV")->type_name("FILE");
    part->add_option("--markdown", arguments.markdown, page + ", with machine, compiler and commit")->type_name("FILE");
    if constexpr (requires { arguments.plot; })
      part->add_option("--plot", arguments.plot, "Folder for " + pictures + " (needs python3-matplotlib)")
          ->type_name("DIR");
  };
  verification::VerifyArguments verify;
  CLI::App* command =
      app.add_subcommand("verify",
                         "Known answers: measured values compared with formulas, with tolerance and observed "
                         "order; exit code 1 if a value is outside its tolerance");
  command->add_flag("--quick", verify.quick, "Only the first rows of long cases; takes less than a minute");
  outputs(command, verify, "case, value, reference, tolerance, order, status", "File for the rows as a table");
  command->add_option("--case", verify.which, "Only this case; repeatable")->type_name("NAME")->allow_extra_args(false);
  command
      ->add_option("--set", verify.settings,
                   "New value of a case's parameter, e.g. --case friction_slide --set slope=0.8; repeatable; the "
                   "reference is recomputed with it")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
  command->callback([&] { run = [&verify] { return verification::run_verify(verify); }; });

  stress::StressArguments stress;
  command = app.add_subcommand("stress",
                               "Extreme inputs through the real loops, each classified by the invariants; exit "
                               "code 1 if a number that is not finite was published, or if fewer than 95 % of the "
                               "rows outside the sweep pass or are refused correctly");
  command->add_flag("--quick", stress.quick, "Only marked rows and a small sweep; takes less than a minute and a half");
  outputs(command, stress, "case, parameter, class, figure, invariant",
          "File for a summary, and the rows that did not pass with reasons",
          "stress_map.png, stress_sweep.png and stress_sweep_live.png");
  command->add_option("--case", stress.which, "Only this case; repeatable")->type_name("NAME")->allow_extra_args(false);
  command
      ->add_option("--cache", stress.cache,
                   "Folder of a cache: store computed rows and reuse rows that the same programs computed before")
      ->type_name("DIR");
  command->callback([&] { run = [&stress] { return stress::run_stress(stress); }; });

  error_runtime::ErrorRuntimeArguments error_runtime;
  command = app.add_subcommand("error-runtime",
                               "Error against run time: CPU time of every setting and its error against converged "
                               "references; exit code 1 if the default is more than "
                               "0.1 mm or 2 % off in a grasp");
  command->add_flag("--quick", error_runtime.quick, "Only the coarse hand and fewer settings; takes three minutes");
  outputs(command, error_runtime,
          "scene, knob, setting, ms_p50, ms_p99, tissue_rms_mm, force_error, class, and other norms",
          "File for the cost of the default, Pareto fronts, slopes and all rows",
          "error_runtime.png and error_runtime_total.png");
  command->add_option("--scene", error_runtime.which, "Only this scene, or peer (Bullet's soft body); repeatable")
      ->type_name("NAME")
      ->allow_extra_args(false);
  command
      ->add_option("--motion", error_runtime.motion,
                   "Recording for the scenes recorded_grasp and fist_recorded (CSV); without it they are left out")
      ->type_name("FILE");
  command->callback([&] { run = [&error_runtime] { return error_runtime::run_error_runtime(error_runtime); }; });

  human::HumanArguments human;
  command = app.add_subcommand(
      "human",
      "The index fingertips of the hands pressed by a flat plate, compared with people's; exit code 1 if a force is "
      "outside people's spread");
  command->add_option("--hand", human.hands, "Only this hand file; repeatable")
      ->type_name("FILE")
      ->allow_extra_args(false)
      ->check(CLI::ExistingFile);
  command
      ->add_option("--pulp", human.pulp,
                   "New value of youngs_modulus (Pa), limit_energy (J/m^3) or limit_ratio of the pulp; repeatable")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
  command->add_flag("--fit", human.fit,
                    "Fit one pulp material for all hands to people's force; print it and use it for the results");
  outputs(command, human, "hand, indentation, force, area, their references, status", "File for a table", "human.png");
  command->callback([&] { run = [&human] { return human::run_human(human); }; });

  human::PostureArguments postures;
  command = app.add_subcommand(
      "postures",
      "Strain of the hands' tissue and iterations per step for the flat hand, the relaxed hand and the fist; exit code "
      "1 if the skin is strained by more than 60 % or a tetrahedron is inverted");
  command->add_option("--hand", postures.hands, "Only this hand file; repeatable")
      ->type_name("FILE")
      ->allow_extra_args(false)
      ->check(CLI::ExistingFile);
  command->add_option("--markdown", postures.markdown, "File for the same table")->type_name("FILE");
  command->callback([&] { run = [&postures] { return human::run_postures(postures); }; });

  wall::WallArguments wall;
  command = app.add_subcommand(
      "wall",
      "A virtual wall through simulated haptic devices, with and without the local model; exit code 1 if a wall of "
      "five times the stiffness that is stable without it is not stable or gives energy");
  command->add_option("--markdown", wall.markdown, "File for the same tables")->type_name("FILE");
  command->callback([&] { run = [&wall] { return wall::run_wall(wall); }; });

  CLI11_PARSE(app, argc, argv);
  try {
    return run();
  } catch (const std::exception& error) {
    fmt::print(stderr, "softhand report: {}\n", error.what());
    return 1;
  }
}
