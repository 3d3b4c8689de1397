#include "error_runtime/report.hpp"

#include <fmt/format.h>
#include <sched.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "error_runtime/peer.hpp"
#include "hand/work_price.hpp"
#include "report/report.hpp"

namespace softhand::error_runtime {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kTissueBound = 0.1;  // mm
constexpr double kForceBound = 0.02;

Json row_json(const Row& row) {
  Json json{{"scene", row.scene},
            {"knob", row.knob},
            {"setting", row.setting},
            {"ms_p50", row.ms_p50},
            {"ms_p99", row.ms_p99},
            {"tissue_rms_mm", row.along.tissue_rms_mm},
            {"force_error", row.along.force_error},
            {"class", row.classification},
            {"hand", row.hand},
            {"rate_hz", row.rate_hz},
            {"reference", row.reference},
            {"default", row.is_default},
            {"on_front", row.on_front},
            {"ms_frame", row.ms_frame},
            {"steps", row.steps},
            {"soft_rms_mm", row.along.soft_rms_mm},
            {"tissue_worst_rms_mm", row.along.tissue_worst_rms_mm},
            {"tissue_max_mm", row.along.tissue_max_mm},
            {"bone_mm", row.along.bone_mm},
            {"bone_degrees", row.along.bone_degrees},
            {"net_force_error_p95", row.along.net_force_error_p95},
            {"stress_error", row.along.stress_error},
            {"pressure_centre_mm", row.along.pressure_centre_mm},
            {"touch_disagreement", row.along.touch_disagreement},
            {"one_step_tissue_rms_mm", row.one_step ? Json(row.one_step->tissue_rms_mm) : Json()},
            {"one_step_soft_rms_mm", row.one_step ? Json(row.one_step->soft_rms_mm) : Json()},
            {"one_step_force_error", row.one_step ? Json(row.one_step->force_error) : Json()},
            {"total_tissue_rms_mm", row.total.tissue_rms_mm},
            {"total_soft_rms_mm", row.total.soft_rms_mm},
            {"total_force_error", row.total.force_error},
            {"iterations", row.iterations},
            {"steps_not_converged", row.steps_not_converged},
            {"steps_cut_off", row.steps_cut_off},
            {"worst_residual", row.worst_residual},
            {"penetration_p95_mm", row.penetration_p95_mm},
            {"penetration_max_mm", row.penetration_max_mm},
            {"lag_ms", row.lag_ms},
            {"energy_defect", row.energy_defect},
            {"inverted", row.inverted}};
  for (auto& [key, value] : json.items()) {
    if (value.is_number_float() && !std::isfinite(value.get<double>())) value = nullptr;
  }
  return json;
}

Row not_built(const NotBuilt& scene) {
  Row row;
  const double nan = std::nan("");
  row.scene = scene.name;
  row.setting = scene.reason;
  row.classification = "Not built";
  for (double* value : {&row.ms_p50, &row.ms_p99, &row.ms_frame, &row.along.tissue_rms_mm, &row.along.force_error})
    *value = nan;
  return row;
}

const Row& default_of(const SceneStudy& scene) {
  return *std::find_if(scene.rows.begin(), scene.rows.end(), [](const Row& row) { return row.is_default; });
}

// The row of a knob that has the default's mesh and step. Null if the knob has no such row.
const Row* like_default(const SceneStudy& scene, const std::string& knob) {
  const Row& def = default_of(scene);
  const auto found = std::find_if(scene.rows.begin(), scene.rows.end(), [&](const Row& row) {
    return row.knob == knob && row.hand == def.hand && row.rate_hz == def.rate_hz;
  });
  return found == scene.rows.end() ? nullptr : &*found;
}

const Row& live_of(const SceneStudy& scene) {
  const auto found = std::find_if(scene.rows.begin(), scene.rows.end(), [&scene](const Row& row) {
    return row.knob == "work_budget" && std::stod(row.setting) == scene.live_budget;
  });
  if (found == scene.rows.end())
    throw std::logic_error(fmt::format("{}: no run has the live budget of {:g}", scene.scene, scene.live_budget));
  return *found;
}

std::string millimetres(double value) { return std::isfinite(value) ? fmt::format("{:.2g}", value) : "not finite"; }
std::string percent(double share) { return std::isfinite(share) ? fmt::format("{:.2g} %", 100 * share) : "not finite"; }

bool has_soft(const Row& row) { return !std::isnan(row.along.soft_rms_mm); }

std::string name_of(const Row& row) {
  return row.is_default ? "**default**" : row.knob == "combined" ? row.setting : row.knob + " " + row.setting;
}

void print(const Row& row) {
  fmt::print(
      "  {:19} {:34} {:6.2f} ms p99 {:7.2f} frame {:7.2f}  {:3} tissue {:9.3g} mm force {:9.3g}  all {:8.3g} mm  "
      "{}{}{}{}\n",
      row.knob, row.setting, row.ms_p50, row.ms_p99, row.ms_frame, row.reference, row.along.tissue_rms_mm,
      row.along.force_error, row.total.tissue_rms_mm,
      has_soft(row) ? fmt::format("flexible {:8.3g} mm  ", row.along.soft_rms_mm) : "", row.classification,
      row.is_default ? "  DEFAULT" : "", row.on_front ? "  front" : "");
}

void print(const SceneStudy& scene) {
  fmt::print("{}: {}{}\n", scene.scene, scene.statement, scene.missing.empty() ? "" : "; NOT SHOWN: " + scene.missing);
  fmt::print(
      "  R0: residual {:.2g}, {:.1f} iterations per step, at most {:.0f}; moving the input by 1 um moves the tissue by "
      "{:.2g} um\n",
      scene.r0_residual, scene.r0_iterations, scene.r0_iterations_most, scene.amplification);
  for (const Row& row : scene.rows) print(row);
  for (const Slope& slope : scene.slopes) {
    if (slope.points >= 2)
      fmt::print("  slope of {} ({}): {:.2f}, expected {:g}, {} points\n", slope.quantity, slope.knob, slope.observed,
                 slope.expected, slope.points);
  }
  std::fflush(stdout);
}

// Pins the thread to its present CPU, because the times are CPU times of one thread.
void pin_thread() {
  cpu_set_t set;
  CPU_ZERO(&set);
  const int cpu = sched_getcpu();
  if (cpu < 0) return;
  CPU_SET(static_cast<std::size_t>(cpu), &set);
  sched_setaffinity(0, sizeof set, &set);
}

bool asked_for(const ErrorRuntimeArguments& arguments, const std::string& name) {
  return arguments.which.empty() ||
         std::find(arguments.which.begin(), arguments.which.end(), name) != arguments.which.end();
}

// What a live hand shows: steps that end with the budget, against the same steps until nothing moves.
std::string live_markdown(const Study& study) {
  std::string text = fmt::format(
      "The live default: {}, 90 Hz, a budget of {:g} fast steps, or of {:g} with flexible objects. Errors against R0."
      "\n\n"
      "| scene | ms, median / p99 | steps cut off | tissue mm | force | asked | |\n"
      "| --- | --- | --- | --- | --- | --- | --- |\n",
      study.default_hand, kLiveBudget, WorkPrice::least_budget(true));
  for (const SceneStudy& scene : study.scenes) {
    const Row& row = live_of(scene);
    std::string asked = "-", met = "-";
    if (scene.live) {
      asked = millimetres(scene.live->tissue_rms_mm) + " mm";
      bool holds = row.along.tissue_rms_mm <= scene.live->tissue_rms_mm;
      if (scene.live->force_error) {
        asked += ", " + percent(*scene.live->force_error);
        holds = holds && row.along.force_error <= *scene.live->force_error;
      }
      met = holds ? "met" : "**missed**";
    }
    text += fmt::format("| {} | {:.2f} / {:.2f} | {} of {} | {} | {} | {} | {} |\n", scene.scene, row.ms_p50,
                        row.ms_p99, row.steps_cut_off, row.steps, millimetres(row.along.tissue_rms_mm),
                        percent(row.along.force_error), asked, met);
  }
  return text + "\n";
}

// Errors of flexible objects in the runs of the tables before. Empty if no scene has any.
std::string soft_markdown(const Study& study) {
  std::string rows;
  for (const SceneStudy& scene : study.scenes) {
    const Row& row = default_of(scene);
    if (!has_soft(row)) continue;
    rows += fmt::format(
        "| {} | {} | {} | {} | {} | {} | {} |\n", scene.scene, millimetres(live_of(scene).along.soft_rms_mm),
        millimetres(row.along.soft_rms_mm), millimetres(row.one_step->soft_rms_mm),
        millimetres(like_default(scene, "time_step")->along.soft_rms_mm),
        millimetres(like_default(scene, "mesh")->along.soft_rms_mm), millimetres(row.total.soft_rms_mm));
  }
  if (rows.empty()) return {};
  return "\nErrors of flexible objects in these runs: RMS over time and nodes, mm. Only the mesh of the hand changes."
         "\n\n"
         "| scene | live default | solver | one step | step | mesh of the hand | all |\n"
         "| --- | --- | --- | --- | --- | --- | --- |\n" +
         rows;
}

}  // namespace

std::string default_misses(const SceneStudy& scene) {
  const Errors& e = default_of(scene).along;
  if (!scene.grasp ||
      (e.tissue_rms_mm <= kTissueBound && !(e.soft_rms_mm > kTissueBound) && e.force_error <= kForceBound))
    return {};
  const std::string soft =
      has_soft(default_of(scene)) ? ", flexible objects by " + millimetres(e.soft_rms_mm) + " mm" : "";
  return fmt::format("{}: the default differs from R0 by {} mm and {}{}; expected at most {} mm and {}", scene.scene,
                     millimetres(e.tissue_rms_mm), percent(e.force_error), soft, kTissueBound, percent(kForceBound));
}

Json to_json(const Study& study) {
  Json list = Json::array();
  for (const SceneStudy& scene : study.scenes) {
    for (const Row& row : scene.rows) list.push_back(row_json(row));
  }
  for (const Row& row : study.peer.rows) list.push_back(row_json(row));
  for (const NotBuilt& scene : study.not_built) list.push_back(row_json(not_built(scene)));
  return list;
}

std::string to_csv(const Study& study) {
  const Json list = to_json(study);
  std::string text;
  for (const auto& [key, value] : list.front().items()) text += (text.empty() ? "" : ",") + key;
  text += '\n';
  for (const Json& row : list) {
    bool first = true;
    for (const auto& [key, value] : row.items()) {
      text += (first ? "" : ",") + (value.is_null()     ? std::string()
                                    : value.is_string() ? report::in_quotes(value.get<std::string>())
                                                        : value.dump());
      first = false;
    }
    text += '\n';
  }
  return text;
}

std::string to_markdown(const Study& study, const std::string& command, const std::string& pictures) {
  const report::Provenance from = report::provenance();
  std::string text =
      fmt::format("## Error against run time\n\n`{}` on {}, {},\ncommit {}; CPU time of one pinned thread.\n\n",
                  command, from.processor, from.compiler, from.commit);
  text += fmt::format(
      "The hand's loop plays scenes of one second. Every setting gets the same input.\n\n"
      "- Errors are of the whole run: RMS over time and over the skin, weighted by area.\n"
      "- Forces are compared finger by finger, relative to the forces of the reference.\n\n"
      "Each kind of error has its own reference:\n\n"
      "| reference | run | measures the error of |\n| --- | --- | --- |\n"
      "| R0 | same mesh and step, Newton's method until an iteration moves nothing by 1e-12 | the solver |\n"
      "| R1 | limit of steps of 1/{} s and 1/{} s | the time step |\n"
      "| R2 | finest mesh | the mesh |\n"
      "| all | R2 + R1 - R0, the best result known | everything together |\n\n",
      study.quick ? 360 : 1440, study.quick ? 180 : 720);
  text += live_markdown(study);
  text += "The default without a budget (" + study.default_hand + ", 90 Hz):\n\n";
  text +=
      "| scene | ms, median / p99 | solver: tissue mm, force | one step: tissue mm, force | step: tissue mm | mesh: "
      "tissue mm | all: tissue mm, force | within 0.1 mm and 2 % of R0 |\n";
  text += "| --- | --- | --- | --- | --- | --- | --- | --- |\n";
  for (const SceneStudy& scene : study.scenes) {
    const Row& row = default_of(scene);
    const Row *step = like_default(scene, "time_step"), *mesh = like_default(scene, "mesh");
    const auto of = [](const Row* r) { return r == nullptr ? std::string("-") : millimetres(r->along.tissue_rms_mm); };
    text += fmt::format("| {} | {:.2f} / {:.2f} | {}, {} | {}, {} | {} | {} | {}, {} | {} |\n", scene.scene, row.ms_p50,
                        row.ms_p99, millimetres(row.along.tissue_rms_mm), percent(row.along.force_error),
                        millimetres(row.one_step->tissue_rms_mm), percent(row.one_step->force_error), of(step),
                        of(mesh), millimetres(row.total.tissue_rms_mm), percent(row.total.force_error),
                        !scene.grasp                    ? "not a grasp"
                        : default_misses(scene).empty() ? "met"
                                                        : "**missed**");
  }
  for (const NotBuilt& scene : study.not_built)
    text += fmt::format("| {} | Not built: {} | | | | | | |\n", scene.name, scene.reason);
  text += soft_markdown(study);
  if (!pictures.empty()) {
    text += fmt::format(
        "\n![Error of each knob against its own reference over the CPU time of a step]({}/error_runtime.png)\n",
        pictures);
    text += fmt::format(
        "\n![Error against the best known result over CPU time, with the Pareto front]({}/error_runtime_total.png)\n",
        pictures);
  }
  text +=
      "\nThe Pareto front against \"all\" by rising cost. ms: CPU time for 1/90 s of the scene.\n\n"
      "| scene | setting | ms | tissue mm |\n| --- | --- | --- | --- |\n";
  for (const SceneStudy& scene : study.scenes) {
    std::vector<const Row*> front;
    for (const Row& row : scene.rows) {
      if (row.on_front) front.push_back(&row);
    }
    std::sort(front.begin(), front.end(), [](const Row* a, const Row* b) { return a->ms_frame < b->ms_frame; });
    for (const Row* row : front)
      text += fmt::format("| {} | {} | {:.1f} | {} |\n", row == front.front() ? scene.scene : "", name_of(*row),
                          row->ms_frame, millimetres(row->total.tissue_rms_mm));
  }
  text +=
      "\nAccuracy of the references. If the input moves by 1 um, \"amplification\" is the RMS movement of the tissue "
      "over 1 um.\nA scene is chaotic if its amplification is far above 1.\n\n";
  text +=
      "| scene | R0: residual | R0: iterations per step, mean / max | finest step from R1, mm "
      "| second finest mesh from R2, mm | amplification |\n| --- | --- | --- | --- | --- | --- |\n";
  for (const SceneStudy& scene : study.scenes) {
    text += fmt::format("| {} | {:.1e} | {:.1f} / {:.0f} | {} | {} | {:.2g} |\n", scene.scene, scene.r0_residual,
                        scene.r0_iterations, scene.r0_iterations_most, millimetres(scene.r1_uncertainty.tissue_rms_mm),
                        millimetres(scene.r2_uncertainty.tissue_rms_mm), scene.amplification);
  }
  text +=
      "\nFitted slopes, observed (expected). If contact begins, ends or slips between two steps, the time step is no "
      "longer of\nfirst order.\n\n| scene |";
  std::string line = "\n| --- |";
  if (!study.scenes.empty()) {
    for (const Slope& slope : study.scenes.front().slopes) {
      text += fmt::format(" {} |", slope.quantity);
      line += " --- |";
    }
  }
  text += line + "\n";
  for (const SceneStudy& scene : study.scenes) {
    text += "| " + scene.scene + " |";
    for (const Slope& slope : scene.slopes)
      text += slope.points >= 2 ? fmt::format(" {:.2f} ({:g}) |", slope.observed, slope.expected) : std::string(" - |");
    text += "\n";
  }
  for (const SceneStudy& scene : study.scenes) {
    if (!scene.missing.empty())
      text += fmt::format("\nScene {} does not show what its name says: {}\n", scene.scene, scene.missing);
    if (const std::string misses = default_misses(scene); !misses.empty()) text += "\n" + misses + ".\n";
  }
  if (!study.peer.rows.empty()) {
    text += "\n### Another engine on the same tetrahedra\n\n" + study.peer.statement +
            "\n\n| engine | ms, median / p99 | tissue RMS mm | worst mm | class |\n| --- | --- | --- | --- | --- |\n";
    for (const Row& row : study.peer.rows) {
      text +=
          fmt::format("| {} | {:.2f} / {:.2f} | {} | {} | {} |\n", row.setting, row.ms_p50, row.ms_p99,
                      millimetres(row.along.tissue_rms_mm), millimetres(row.along.tissue_max_mm), row.classification);
    }
    text += "\n" + study.peer.cannot + "\n";
  }
  return text;
}

std::string table_markdown(const Study& study) {
  std::string text =
      "## All runs of error against run time\n\nErrors are defined as above, against the reference in the table.\n\n"
      "- `per 1/90 s`: mean CPU time for 1/90 s of the scene, ms\n"
      "- `flexible RMS`: RMS over time and the nodes of flexible objects, mm\n"
      "- `worst time`: RMS over the skin at the worst time, mm\n"
      "- `worst point`: largest error of a vertex at any time, mm\n"
      "- `touch differs`: share of touching nodes whose contact state differs\n"
      "- `one step`: error of single steps, each from R0's state\n\n";
  text +=
      "| scene | knob | setting | ms p50 | p99 | per 1/90 s | reference | tissue RMS mm | flexible RMS mm | worst time "
      "| worst point | bones mm / deg | force | touch differs | one step mm / force | all mm | "
      "penetration p95 / max mm | lag ms | energy defect | class |\n";
  text +=
      "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | "
      "--- | --- |\n";
  for (const SceneStudy& scene : study.scenes) {
    for (const Row& row : scene.rows) {
      const Errors& e = row.along;
      text += fmt::format(
          "| {} | {} | {} | {:.2f} | {:.2f} | {:.2f} | {} | {:.2g} | {} | {:.2g} | {:.2g} | {:.2g} / {:.2g} | {:.2g} | "
          "{} | {} | {:.2g} | {:.2g} / {:.2g} | {:.2f} | {:.2g} | {} |\n",
          row.scene, row.knob, row.setting, row.ms_p50, row.ms_p99, row.ms_frame, row.reference, e.tissue_rms_mm,
          has_soft(row) ? fmt::format("{:.2g}", e.soft_rms_mm) : std::string("-"), e.tissue_worst_rms_mm,
          e.tissue_max_mm, e.bone_mm, e.bone_degrees, e.force_error,
          std::isnan(e.touch_disagreement) ? std::string("-") : fmt::format("{:.2g}", e.touch_disagreement),
          row.one_step ? fmt::format("{:.2g} / {:.2g}", row.one_step->tissue_rms_mm, row.one_step->force_error)
                       : std::string("-"),
          row.total.tissue_rms_mm, row.penetration_p95_mm, row.penetration_max_mm, row.lag_ms, row.energy_defect,
          row.classification == "Pass" ? "Pass" : "**" + row.classification + "**");
    }
  }
  return text;
}

int run_error_runtime(const ErrorRuntimeArguments& arguments) {
  const std::vector<Scene> scenes = all_scenes(arguments.motion);
  for (const std::string& name : arguments.which) {
    if (name == "peer" ||
        std::any_of(scenes.begin(), scenes.end(), [&name](const Scene& scene) { return scene.name == name; }))
      continue;
    std::string known = "peer";
    for (const Scene& scene : scenes) known += ", " + scene.name;
    throw std::invalid_argument("no scene '" + name + "'; known: " + known);
  }
  pin_thread();
  Study study;
  study.quick = arguments.quick;
  study.not_built = scenes_not_built(arguments.motion);
  study.default_hand = default_hand(arguments.quick);
  bool good = true;
  for (const Scene& scene : scenes) {
    if (!asked_for(arguments, scene.name)) continue;
    study.scenes.push_back(study_scene(scene, arguments.quick));
    print(study.scenes.back());
    const std::string misses = default_misses(study.scenes.back());
    if (!misses.empty()) fmt::print("  {}\n", misses);
    good = good && misses.empty() && study.scenes.back().missing.empty();
  }
  if (asked_for(arguments, "peer")) {
    study.peer = study_peer(study.default_hand);
    for (const Row& row : study.peer.rows) print(row);
  }
  std::string command = std::string("softhand report error-runtime") + (arguments.quick ? " --quick" : "") +
                        (arguments.motion.empty() ? "" : " --motion " + arguments.motion);
  for (const std::string& name : arguments.which) command += " --scene " + name;
  const std::string json = to_json(study).dump(1) + "\n";
  report::write_file(arguments.json, json);
  report::write_file(arguments.csv, to_csv(study));
  report::write_file(arguments.markdown, to_markdown(study, command, arguments.plot.empty() ? "" : "images") + "\n" +
                                             table_markdown(study));
  report::draw("error_runtime", json, arguments.plot);
  return good ? 0 : 1;
}

}  // namespace softhand::error_runtime
