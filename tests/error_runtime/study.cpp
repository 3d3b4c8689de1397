#include "error_runtime/study.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "cli/outcome.hpp"
#include "hand/work_price.hpp"

namespace softhand::error_runtime {
namespace {

constexpr double kDiverged = 11;  // mm, error of an optical tracker (Quest 2 at the fingertips)

constexpr double kLeastGain = 0.02;  // smallest relative gain of a point on the Pareto front

// One run of a scene: the request, and the trajectory after the run.
struct Run {
  std::string knob;
  std::string setting;
  std::string hand;
  std::vector<std::string> overrides;
  std::string reference;
  Trajectory trajectory{};
};

std::string iterations(int count) { return fmt::format("simulation.solver.max_iterations={}", count); }
std::string residual(double newtons) { return fmt::format("simulation.solver.residual_tolerance={:g}", newtons); }
std::string increment(double metres) { return fmt::format("simulation.solver.increment_tolerance={:g}", metres); }
std::string rate(double hertz) { return fmt::format("rate_hz={}", hertz); }

// A chord step ends by its own tolerance, and a step with a reused factor is no Newton iteration. Only the default, the
// work budgets and some `left_out` runs use them.
const std::string kNoChord = "simulation.solver.chord_tolerance=0",
                  kNoFactorReuse = "simulation.solver.keep_factor=false";

// Switches the movement tolerance off, so that the residual alone decides.
const std::string kAnyMove = "simulation.solver.movement_tolerance=1";

// Solves so accurately that only the quantity under study shows.
std::vector<std::string> well_solved() { return {iterations(60), residual(1e-6)}; }

struct Plan {
  std::string hand;
  std::vector<std::string> meshes;  // from coarse to fine
  std::vector<int> rates;           // Hz, ascending; the last two give R1
  std::vector<double> tolerances;   // N
  std::vector<int> newton;
};

Plan plan_of(bool quick) {
  if (quick) return {"right_400", {"right_400", "right_750"}, {30, 90, 180, 360}, {1e-1, 1e-3, 1e-6}, {1, 2, 3, 5, 10}};
  return {"right_1450",
          {"right_400", "right_750", "right_1450", "right_3000", "right_6000"},
          {30, 60, 90, 180, 360, 720, 1440},
          {1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8},
          {1, 2, 3, 5, 10}};
}

std::vector<Run> runs_of(const Plan& plan, bool quick) {
  std::vector<Run> runs;
  runs.push_back({"default", "default", plan.hand, {}, "R0"});
  for (const int count : plan.newton)
    runs.push_back({"newton_iterations", fmt::format("{}", count), plan.hand, {iterations(count), residual(0)}, "R0"});
  for (const double tolerance : plan.tolerances) {
    runs.push_back({"residual_tolerance",
                    fmt::format("{:g} N", tolerance),
                    plan.hand,
                    {iterations(60), residual(tolerance), kAnyMove},
                    "R0"});
  }
  for (const double budget : {1.0, 1.5, 2.0, 4.0, 8.0}) {
    runs.push_back({"work_budget",
                    fmt::format("{:g} fast steps", budget),
                    plan.hand,
                    {fmt::format("simulation.solver.work_budget={:g}", budget)},
                    "R0"});
  }
  for (const std::string& mesh : plan.meshes)
    runs.push_back({"mesh", mesh.substr(mesh.find('_') + 1), mesh, well_solved(), "R2"});
  for (const int hertz : plan.rates) {
    std::vector<std::string> overrides = well_solved();
    overrides.push_back(rate(hertz));
    runs.push_back({"time_step", fmt::format("1/{} s", hertz), plan.hand, overrides, "R1"});
  }
  for (const std::string& mesh : plan.meshes) {
    if (mesh == plan.meshes.back()) break;
    for (const int hertz : {90, 180, 360}) {
      if (hertz == 90 && mesh == plan.hand) continue;  // already among the runs of newton_iterations
      if (quick && hertz == 360) continue;
      if (mesh == "right_3000" && hertz > 90) continue;
      runs.push_back({"combined",
                      fmt::format("{} nodes, 1/{} s, 1 iteration", mesh.substr(mesh.find('_') + 1), hertz),
                      mesh,
                      {iterations(1), rate(hertz)},
                      "all"});
    }
  }
  for (Run& run : runs) {
    if (run.knob == "default" || run.knob == "work_budget") continue;
    run.overrides.push_back(kNoChord);
    run.overrides.push_back(kNoFactorReuse);
  }
  runs.push_back({"left_out", "new factors in free motion alone", plan.hand, {kNoChord}, "R0"});
  runs.push_back({"left_out", "new factors in contact alone", plan.hand, {kNoFactorReuse}, "R0"});
  runs.push_back({"left_out", "nothing", plan.hand, {kNoChord, kNoFactorReuse}, "R0"});
  return runs;
}

// The same motion, shifted by a micrometre.
class Shifted final : public Motion {
 public:
  explicit Shifted(std::shared_ptr<const Motion> motion) : motion_(std::move(motion)) {}
  static constexpr double kShift = 1e-6;  // m
  double duration() const override { return motion_->duration(); }
  const std::array<double, kJointCount>& radii() const override { return motion_->radii(); }
  JointFrames at(double time) const override {
    JointFrames frames = motion_->at(time);
    for (Pose& frame : frames) frame.position.x() += kShift;
    return frames;
  }

 private:
  std::shared_ptr<const Motion> motion_;
};

// Loads each hand once and brings it to the scene's start once.
class Stage {
 public:
  Stage(const Scene& scene, const std::string& shape_of_motion) : scene_(scene) {
    motion_ = scene.motion(hand(shape_of_motion));
  }
  const HandModel& hand(const std::string& name) {
    const auto found = hands_.find(name);
    if (found != hands_.end()) return found->second;
    const std::string file = SOFTHAND_SOURCE_DIR "/config/hands/" + name + ".hand.json";
    return hands_.emplace(name, scene_.fitted_hand ? scene_.fitted_hand(file) : load_hand(file)).first->second;
  }
  std::unique_ptr<Player> ready(const std::string& name, const std::vector<std::string>& overrides) {
    return ready(name, overrides, motion_);
  }
  std::unique_ptr<Player> ready_shifted(const std::string& name) {
    return ready(name, {}, std::make_shared<Shifted>(motion_));
  }

 private:
  std::unique_ptr<Player> ready(const std::string& name, const std::vector<std::string>& overrides,
                                std::shared_ptr<const Motion> motion) {
    auto& settled = settled_[name];
    if (settled == nullptr) {
      settled = std::make_unique<Player>(scene_, hand(name), motion_, options_of(scene_, {}));
      settled->settle();
    }
    auto player = std::make_unique<Player>(scene_, hand(name), std::move(motion), options_of(scene_, overrides));
    player->take_state(*settled);
    return player;
  }

  const Scene& scene_;
  std::map<std::string, HandModel> hands_;
  std::shared_ptr<const Motion> motion_;
  std::map<std::string, std::unique_ptr<Player>> settled_;
};

// Runs beside R0: takes every step with each of some settings, always from R0's state before the step.
class Restarted {
 public:
  void add(std::size_t run, std::unique_ptr<Player> player) { players_.push_back({run, std::move(player), {}}); }
  void before_step(const Player& reference) {
    for (Entry& entry : players_) {
      entry.player->take_state(reference);
      entry.player->step();
      if (entry.player->at_sample()) entry.trajectory.samples.push_back(sample_of(*entry.player));
    }
  }
  const Trajectory* of(std::size_t run) const {
    const auto found = std::find_if(players_.begin(), players_.end(), [run](const Entry& e) { return e.run == run; });
    return found == players_.end() ? nullptr : &found->trajectory;
  }

 private:
  struct Entry {
    std::size_t run;
    std::unique_ptr<Player> player;
    Trajectory trajectory;
  };
  std::vector<Entry> players_;
};

std::string classify(const Trajectory& trajectory, const Errors& errors, const Trajectory& reference) {
  if (!trajectory.finite || trajectory.failed_steps > 0 || !(errors.tissue_rms_mm < kDiverged)) return "Diverged";
  return trajectory.inverted_at_end > reference.inverted_at_end ? "Inverted" : "Pass";
}

Slope slope(const std::vector<Row>& rows, const std::string& scene, const std::string& knob,
            const std::string& quantity, double expected, double (*x)(const Row&), double (*y)(const Row&)) {
  std::vector<double> xs, ys;
  for (const Row& row : rows) {
    if (row.knob != knob || row.classification != "Pass" || !(y(row) > 0)) continue;
    xs.push_back(x(row));
    ys.push_back(y(row));
  }
  return {scene, knob, quantity, fitted_slope(xs, ys), expected, xs.size()};
}

double nodes_of(const Row& row) { return std::stod(row.setting); }

}  // namespace

std::string default_hand(bool quick) { return plan_of(quick).hand; }

double fitted_slope(const std::vector<double>& x, const std::vector<double>& y) {
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (!(x[i] > 0) || !(y[i] > 0) || !std::isfinite(y[i])) continue;
    const double u = std::log(x[i]), v = std::log(y[i]);
    n += 1;
    sx += u;
    sy += v;
    sxx += u * u;
    sxy += u * v;
  }
  const double spread = n * sxx - sx * sx;
  return n >= 2 && spread > 0 ? (n * sxy - sx * sy) / spread : std::nan("");
}

std::vector<std::size_t> pareto_front(const std::vector<double>& x, const std::vector<double>& y, double gain) {
  std::vector<std::size_t> order(x.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return x[a] != x[b] ? x[a] < x[b] : y[a] < y[b]; });
  std::vector<std::size_t> front;
  for (const std::size_t i : order) {
    if (front.empty() || y[i] < (1 - gain) * y[front.back()]) front.push_back(i);
  }
  return front;
}

SceneStudy study_scene(const Scene& scene, bool quick) {
  const Plan plan = plan_of(quick);
  Stage stage(scene, plan_of(false).hand);
  std::vector<Run> runs = runs_of(plan, quick);
  SceneStudy study;
  study.scene = scene.name;
  study.statement = scene.statement;
  study.grasp = scene.grasp;
  study.live = scene.live;
  if (!scene.soft_objects.empty()) study.live_budget = WorkPrice::least_budget(true);

  // R0 with the single steps of the settings that have the same mesh and step.
  Run r0{"newton_iterations",
         "converged",
         plan.hand,
         {iterations(200), residual(0), increment(1e-12), kNoChord, kNoFactorReuse, "simulation.solver.factor=double"},
         "R0"};
  Restarted restarted;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    if (runs[i].knob == "default" || runs[i].knob == "newton_iterations")
      restarted.add(i, stage.ready(runs[i].hand, runs[i].overrides));
  }
  const auto exact = stage.ready(r0.hand, r0.overrides);
  r0.trajectory = play(scene, *exact, [&](const Player& player) {
    if (player.tick() > 0)
      study.r0_iterations_most = std::max<double>(study.r0_iterations_most, player.output().report.iterations);
    restarted.before_step(player);
  });
  study.missing = scene.missing(r0.trajectory);
  study.r0_residual = r0.trajectory.worst_residual;
  study.r0_iterations = r0.trajectory.iterations;

  for (Run& run : runs) run.trajectory = play(scene, *stage.ready(run.hand, run.overrides));
  const std::size_t own_runs = runs.size();
  runs.push_back(std::move(r0));
  const Trajectory& exact_run = runs.back().trajectory;

  const auto run_of = [&](const std::string& knob, const std::string& setting) -> const Trajectory& {
    return std::find_if(runs.begin(), runs.end(), [&](const Run& r) { return r.knob == knob && r.setting == setting; })
        ->trajectory;
  };
  const auto by_rate = [&](std::size_t from_last) -> const Trajectory& {
    return run_of("time_step", fmt::format("1/{} s", plan.rates[plan.rates.size() - 1 - from_last]));
  };
  const auto by_mesh = [&](std::size_t from_last) -> const Trajectory& {
    const std::string& mesh = plan.meshes[plan.meshes.size() - 1 - from_last];
    return run_of("mesh", mesh.substr(mesh.find('_') + 1));
  };
  const Trajectory r1 = combined({{2, &by_rate(0)}, {-1, &by_rate(1)}});
  const Trajectory& r2 = by_mesh(0);
  const Trajectory all = combined({{1, &r1}, {1, &r2}, {-1, &exact_run}});
  const std::vector<double> weights = skin_weights(stage.hand(plan.hand));
  study.r1_uncertainty = difference(by_rate(0), r1, weights);
  study.r2_uncertainty = difference(by_mesh(1), r2, weights);

  const Trajectory aside = play(scene, *stage.ready_shifted(plan.hand));
  study.amplification = difference(aside, runs.front().trajectory, weights).tissue_rms_mm * 1e-3 / Shifted::kShift;

  for (std::size_t i = 0; i < runs.size(); ++i) {
    const Run& run = runs[i];
    const Trajectory& t = run.trajectory;
    const Trajectory& reference = run.reference == "R0"   ? exact_run
                                  : run.reference == "R1" ? r1
                                  : run.reference == "R2" ? r2
                                                          : all;
    Row row;
    row.scene = scene.name;
    row.knob = run.knob;
    row.setting = run.setting;
    row.hand = run.hand;
    row.rate_hz = options_of(scene, run.overrides).rate_hz;
    row.reference = run.reference;
    row.is_default = run.knob == "default";
    row.ms_p50 = percentile(t.step_ms, 0.5);
    row.ms_p99 = percentile(t.step_ms, 0.99);
    row.steps = t.step_ms.size();
    row.ms_frame = std::accumulate(t.step_ms.begin(), t.step_ms.end(), 0.0) / (90 * scene.seconds);
    row.along = difference(t, reference, weights);
    row.total = difference(t, all, weights);
    if (const Trajectory* steps = i < own_runs ? restarted.of(i) : nullptr)
      row.one_step = difference(*steps, exact_run, weights);
    row.iterations = t.iterations;
    row.steps_not_converged = t.steps_not_converged;
    row.steps_cut_off = t.steps_cut_off;
    row.worst_residual = t.worst_residual;
    row.penetration_p95_mm = 1e3 * percentile(t.penetrations, 0.95);
    row.penetration_max_mm = 1e3 * percentile(t.penetrations, 1);
    row.lag_ms = t.lag_ms;
    row.energy_defect = t.energy_defect;
    row.inverted = t.inverted;
    row.classification = classify(t, row.total, exact_run);
    study.rows.push_back(std::move(row));
  }

  std::vector<std::size_t> passed;
  std::vector<double> cost, error;
  for (std::size_t i = 0; i < study.rows.size(); ++i) {
    const Row& row = study.rows[i];
    // The finest mesh is part of its own reference, so it is excluded.
    if (row.classification != "Pass" || row.hand == plan.meshes.back()) continue;
    passed.push_back(i);
    cost.push_back(row.ms_frame);
    error.push_back(row.total.tissue_rms_mm);
  }
  for (const std::size_t k : pareto_front(cost, error, kLeastGain)) study.rows[passed[k]].on_front = true;

  const auto step_length = [](const Row& row) { return 1 / row.rate_hz; };
  const auto size = [](const Row& row) { return std::cbrt(1 / nodes_of(row)); };
  study.slopes.push_back(slope(study.rows, scene.name, "time_step", "tissue RMS over dt", 1, step_length,
                               [](const Row& r) { return r.along.tissue_rms_mm; }));
  study.slopes.push_back(slope(study.rows, scene.name, "mesh", "tissue RMS over h", 2, size,
                               [](const Row& r) { return r.along.tissue_rms_mm; }));
  study.slopes.push_back(slope(study.rows, scene.name, "mesh", "stress over h", 1, size,
                               [](const Row& r) { return r.along.stress_error; }));
  study.slopes.push_back(slope(
      study.rows, scene.name, "residual_tolerance", "tissue RMS over tolerance", 1,
      [](const Row& r) { return std::stod(r.setting); }, [](const Row& r) { return r.along.tissue_rms_mm; }));
  return study;
}

}  // namespace softhand::error_runtime
