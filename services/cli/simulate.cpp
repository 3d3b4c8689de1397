#include <fmt/format.h>
#include <fmt/os.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>

#include "cli/commands.hpp"
#include "cli/hands_outcome.hpp"
#include "cli/skin_outcome.hpp"
#include "cli/soft_outcome.hpp"
#include "cli/virtual_rig.hpp"
#include "energies/skin_contact.hpp"
#include "flight/repeat.hpp"
#include "messages/convert.hpp"
#include "scene/rest_error.hpp"
#include "scene_file.hpp"

namespace softhand {
namespace {

using Json = nlohmann::ordered_json;

// Selected signals, one row per step of the hand. Columns: docs/outcome.md.
class SignalFile {
 public:
  explicit SignalFile(const std::string& path) : path_(path), out_(path) {
    if (!out_) throw std::runtime_error(path_ + ": cannot be written");
    out_ << "t_s,residual_n,iterations,work,status,contacts";
    for (std::size_t f = 0; f < kFingerCount; ++f) out_ << ',' << kFingerNames[f] << "_force_n";
    for (const char* joint : {"thumb_tip", "index_tip", "palm"})
      out_ << ',' << joint << "_x_m," << joint << "_y_m," << joint << "_z_m";
    out_ << ",object,owned,object_x_m,object_y_m,object_z_m,object_vx,object_vy,object_vz,contact_fx_n,contact_fy_n,"
            "contact_fz_n,penetration_max_mm\n";
  }
  void add(const HandStepView& view) {
    const HandOutput& o = *view.output;
    out_ << fmt::format("{:.6f},{:.3e},{},{:.3f},{},{}", static_cast<double>(view.time - VirtualRig::kStart) * 1e-9,
                        o.report.residual, o.report.iterations, o.report.work, to_string(o.report.status),
                        o.contacts.contacts.size());
    for (std::size_t f = 0; f < kFingerCount; ++f)
      out_ << fmt::format(",{:.5f}", to_vector(o.contacts.fingers[f].force).norm());
    for (const Joint joint : {Joint::thumb_tip, Joint::index_tip, Joint::palm}) {
      const Vec3& p = o.simulated.joints[static_cast<std::size_t>(index_of(joint))].position;
      out_ << fmt::format(",{:.6f},{:.6f},{:.6f}", p[0], p[1], p[2]);
    }
    double deepest = 0;
    for (const Contact& contact : o.contacts.contacts) deepest = std::max(deepest, contact.penetration);
    if (o.coupling.twins.empty()) {
      out_ << ",,,,,,,,,,,";
    } else {
      const ObjectTwin& t = o.coupling.twins[0];
      out_ << fmt::format(",{},{},{:.6f},{:.6f},{:.6f},{:.5f},{:.5f},{:.5f},{:.5f},{:.5f},{:.5f}", t.object, t.owned,
                          t.position[0], t.position[1], t.position[2], t.linear_velocity[0], t.linear_velocity[1],
                          t.linear_velocity[2], t.contact_force[0], t.contact_force[1], t.contact_force[2]);
    }
    out_ << fmt::format(",{:.4f}\n", deepest * 1e3);
  }
  void finish() {
    out_.flush();
    if (!out_) throw std::runtime_error(path_ + ": cannot be written");
  }

 private:
  std::string path_;
  std::ofstream out_;
};

Json timing_split(const std::vector<StepTiming>& timings) {
  Json json;
  const auto entry = [&json, &timings](const char* key, auto get) {
    std::vector<double> values;
    for (const StepTiming& t : timings) values.push_back(get(t) * 1e3);
    json[key] = {{"p50", percentile(values, 0.5)}, {"p99", percentile(values, 0.99)}};
  };
  entry("total_ms", [](const StepTiming& t) { return t.total(); });
  entry("contact_ms", [](const StepTiming& t) { return t.begin + t.end; });
  entry("energies_ms", [](const StepTiming& t) { return t.energies; });
  entry("assembly_ms", [](const StepTiming& t) { return t.assembly; });
  entry("factorisation_ms", [](const StepTiming& t) { return t.factorisation; });
  entry("solve_ms", [](const StepTiming& t) { return t.solve; });
  return json;
}

Json ledger_rows(const EnergyLedger& ledger) {
  Json json;
  ledger.for_each_row([&json](std::string_view name, double joules) { json[std::string(name)] = joules; });
  return json;
}

}  // namespace

int run_simulate(const SimulateArguments& arguments) {
  if (!arguments.from.empty()) {
    const RepeatResult result = repeat_flight({arguments.from, arguments.force, arguments.brief},
                                              [](const std::string& line) { fmt::print("{}\n", line); });
    return result.is_equal() ? 0 : 1;
  }
  if (arguments.scene.empty()) throw std::invalid_argument("expected a scene file, or --from with a flight file");
  std::vector<std::string> overrides = arguments.overrides;
  if (!arguments.motion.empty()) overrides.push_back("motion=" + std::filesystem::absolute(arguments.motion).string());
  if (!arguments.hand.empty()) overrides.push_back("hand.model=" + arguments.hand);
  const Scene scene = read_scene(arguments.scene, overrides);
  const HandModel hand = load_scene_hand(scene);
  const auto motion = make_scene_motion(scene, hand);
  const HandKey key{static_cast<std::uint32_t>(scene.options.user), hand.side == Side::right ? 1u : 0u};
  VirtualRig rig(scene, hand, std::make_unique<ReplayTracker>(motion, scene.options.tracker, key));
  rig.set_user(motion, scene.options.tracker.start_time, scene.options.tracker.repeat);
  rig.add_other_hands(scene, overrides);

  double seconds = arguments.seconds > 0 ? arguments.seconds : scene.options.simulate.seconds;
  if (seconds <= 0) seconds = motion->duration() - scene.options.tracker.start_time + 0.5;
  std::ofstream summary;  // a run may take long, so a wrong path is found before it
  if (!arguments.json.empty()) summary.open(arguments.json);
  if (!summary) throw std::runtime_error(arguments.json + ": cannot be written");
  std::optional<SignalFile> signals;
  if (!arguments.csv.empty()) signals.emplace(arguments.csv);
  const auto started = std::chrono::steady_clock::now();
  std::uint64_t inverted_steps = 0;
  std::vector<double> work_of_steps;
  SkinOutcome skin;
  std::optional<SoftOutcome> soft;
  if (!scene.soft_objects.empty()) soft.emplace(*scene.soft_objects.front().body);
  OutcomeFrame frame =
      outcome_frame(scene, VirtualRig::kStart - static_cast<Nanoseconds>(scene.options.tracker.start_time * 1e9));
  const auto& g = scene.options.world.gravity;
  HandsOutcome hands(frame, Vector3(g[0], g[1], g[2]).norm(), scene.options.one_process);
  rig.run(seconds, [&](const HandStepView& view) {
    hands.add(view.time, view.hand, *view.coupling, view.output->contacts,
              view.simulation->joint_pose(Joint::palm, view.in_simulation), *view.objects);
    if (view.hand != 0) return;
    work_of_steps.push_back(view.output->report.work);
    if (signals) signals->add(view);
    if (view.simulation->inverted_elements() > 0) ++inverted_steps;
    // The tracker may jump back to the start of the motion.
    if (static_cast<double>(view.time - VirtualRig::kStart) * 1e-9 <
        motion->duration() - scene.options.tracker.start_time)
      skin.add(*view.simulation);
    if (soft) {
      for (const SoftObjectState& each : view.output->soft_objects) soft->on_state(each);
      soft->on_contacts(view.output->contacts);
    }
  });
  if (signals) signals->finish();
  skin.end(rig.hand().simulation());
  const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();

  Json json;
  json["scene"] = arguments.scene;
  json["hand"] = {{"name", hand.name},
                  {"side", hand.side == Side::right ? "right" : "left"},
                  {"nodes", hand.node_count()},
                  {"tetrahedra", hand.tetrahedra.size()}};
  json["overrides"] = Json::array();
  for (const AppliedOverride& o : scene.overrides)
    json["overrides"].push_back({{"key", o.key}, {"before", o.before}, {"after", o.after}});
  json["simulated_seconds"] = seconds;
  json.update(rig.outcome().summary(frame));
  const HandSimulation& simulation = rig.hand().simulation();
  json["skin"] = skin.summary(scene.options.judge.skin, scene.options.hand.simulation.skin_friction);
  if (soft) json["soft"] = soft->summary(scene.options.judge.soft, frame);
  if (rig.hand_count() > 1) json["hands"] = hands.summary(scene.options.judge.hands);
  for (const char* part : {"skin", "soft", "hands"}) join_success(json, part);
  json["inverted_end"] = simulation.inverted_elements();
  json["inverted_steps_fraction"] =
      static_cast<double>(inverted_steps) / static_cast<double>(std::max<std::uint64_t>(1, rig.steps_of_hand()));
  const bool touches = simulation.contact_count() > 0 || simulation.skin_contact_count() > 0;
  json["rest_error_mm"] = touches ? Json(nullptr) : Json(rest_error(simulation.hand(), simulation.state()) * 1e3);
  const EnergyLedger& ledger = simulation.ledger();
  json["energy_ledger_defect"] = ledger.defect();
  json["energy_excess"] = ledger.excess();
  json["energy_ledger_j"] = ledger_rows(ledger);
  if (rig.tracking() != nullptr) {
    json["tracking_ledger_defect"] = rig.tracking()->ledger().defect();
    json["tracking_ledger_j"] = ledger_rows(rig.tracking()->ledger());
  }
  const PassivityControl& passivity = rig.haptic().feedback().passivity();
  json["passivity_energy_j"] = passivity.energy();
  json["passivity_energy_min_j"] = passivity.lowest_energy();
  json["passivity_energy_without_control_j"] = passivity.energy_without_control();
  json["passivity_control_steps"] = passivity.interventions();
  json["wrench_work_on_user_j"] = rig.work_on_user();
  json["wrench_work_on_tracked_j"] = rig.work_on_tracked();
  json["state_hash"] = rig.state_hash();
  const HandCounters& counters = rig.hand().counters();
  const WorkCounters work = simulation.work();
  json["hand_counters"] = {{"steps", rig.steps_of_hand()},
                           {"failed_steps", counters.failed_steps},
                           {"stale_steps", counters.stale_steps},
                           {"budget_steps", counters.budget_steps},
                           {"repositioned", counters.repositioned},
                           {"refused_nonfinite", counters.refused_nonfinite},
                           {"untangled_nodes", simulation.untangled_nodes()},
                           {"chord_steps", counters.chord_steps},
                           {"factorised_steps", work.factorised_steps},
                           {"tissue_elements", work.tissue_elements},
                           {"relaxing_elements", work.relaxing_elements},
                           {"soft_elements", work.soft_elements},
                           {"contact_queries", work.contact_queries},
                           {"skin_part_queries", work.skin_part_queries},
                           {"skin_queries", work.skin_queries},
                           {"patches_used", work.patches_used},
                           {"objects_without_slot", counters.objects_without_slot}};
  json["step_work"] = {{"p50", percentile(work_of_steps, 0.5)},
                       {"p90", percentile(work_of_steps, 0.9)},
                       {"p99", percentile(work_of_steps, 0.99)},
                       {"max", percentile(work_of_steps, 1)}};
  if (rig.tracking() != nullptr) {
    const TrackedInputCounters& input = rig.tracking()->input().counters();
    json["tracking_counters"] = {{"accepted", input.accepted},
                                 {"refused_nonfinite", input.refused_nonfinite},
                                 {"refused_implausible", input.refused_implausible},
                                 {"refused_order", input.refused_order},
                                 {"repositioned", input.repositioned}};
  }
  // Wall-clock figures are separate, because they differ from run to run. All figures above are the same in every run.
  json["wall"] = {{"elapsed_s", elapsed}, {"hand_step", timing_split(rig.hand_timings())}};
  // A path may be any bytes.
  const std::string text = json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
  if (arguments.json.empty()) {
    fmt::print("{}", text);
    return 0;
  }
  summary << text;
  summary.flush();
  if (!summary) throw std::runtime_error(arguments.json + ": cannot be written");
  return 0;
}

}  // namespace softhand
