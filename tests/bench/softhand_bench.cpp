// softhand-bench measures the cost of a step and its ratio to other costs. It prints a table and writes JSON by name.
// `softhand bench` runs it.
//
// It is a separate program because it links CHOLMOD's supernodal module (GPL) for comparison. `softhand` and the
// services do not link this module. Times are the thread's own CPU time, so other load on the machine has little
// effect. Compare only ratios nevertheless. Compared programs take turns in the same run.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "bench/factor_turns.hpp"
#include "bench/pressing_costs.hpp"
#include "bench/service_cost.hpp"
#include "bench/tissue_sample.hpp"
#include "cli/virtual_rig.hpp"
#include "energies/tissue.hpp"
#include "error_runtime/peer.hpp"
#include "error_runtime/scenes.hpp"
#include "error_runtime/trial.hpp"
#include "messages/convert.hpp"
#include "report/report.hpp"
#include "solver/cholmod_solver.hpp"
#include "support/count_allocations.hpp"
#include "support/scalar_tissue.hpp"
#include "trackers/replay/replay_tracker.hpp"

namespace softhand::bench {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

constexpr double kGraspFrom = 3.4, kGraspTo = 5.4;  // s of pinch_lift.toml; the cube is lifted and held

// s of the recording; the fist is closed around the cylinder
constexpr double kRecordedFistFrom = 2, kRecordedFistTo = 4;

constexpr double kClosedFrom = 1.6, kClosedTo = 2.4;  // s of fist.toml; the fist is closed

constexpr int kPeerSteps = 15;

struct Size {
  int file;  ///< config/hands/right_<file>.hand.json
  int key;   ///< number in the names of its figures
};
constexpr Size kSizes[] = {{400, 400}, {750, 750}, {1450, 1450}, {3000, 3080}};

constexpr const char* kFreeMotion = SOFTHAND_SOURCE_DIR "/tests/bench/free_motion.toml";
std::string scene_path(const std::string& name) { return std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/" + name; }
std::string hand_name(int file) { return fmt::format("right_{}.hand.json", file); }

struct GraspCost {
  int nodes = 0, tetrahedra = 0;
  std::vector<double> steps;   ///< s, default mode, while holding
  std::vector<double> whole;   ///< s, default mode, the whole run except the first tenth of a second
  std::vector<double> fast;    ///< s, the method's fast mode with one iteration, from the same states
  std::vector<double> shared;  ///< like `fast` with two threads; empty if there is only one core
  int touching = 0;            ///< smallest number of contacts in a measured step
};

// A loop of the rig's hand with other options. It steps from the present state of the rig's loop.
class Follower {
 public:
  Follower(const Scene& scene, const HandModel& hand, const HandOptions& options, const VirtualRig& rig)
      : loop_(hand, options, hand_key(scene), object_spring(scene.options.world)) {
    for (const ObjectDescription& description : rig.world().descriptions()) loop_.describe_object(description);
  }
  /// Steps to `time` from the rig's state. Returns the step's time, s.
  double step(const VirtualRig& rig, Nanoseconds time) {
    loop_.take_state(rig.hand());
    return seconds_of([&] { loop_.step(time, {}, {false, false, false}); });
  }

 private:
  HandLoop loop_;
};

GraspCost measure_grasp(const Size& size) {
  const Scene scene = read_scene(scene_path("pinch_lift.toml"), {"hand.model=" + hand_name(size.file)});
  const HandModel hand = load_scene_hand(scene);
  VirtualRig rig(
      scene, hand,
      std::make_unique<ReplayTracker>(make_scene_motion(scene, hand), scene.options.tracker, hand_key(scene)));
  HandOptions fast_options = scene.options.hand;
  fast_options.simulation.solver.max_iterations = 1;
  fast_options.simulation.solver.measure_result = false;
  HandOptions shared_options = fast_options;
  shared_options.simulation.threads = 2;
  Follower usual(scene, hand, scene.options.hand, rig), fast(scene, hand, fast_options, rig);
  std::optional<Follower> shared;
  if (HelperThread().present()) shared.emplace(scene, hand, shared_options, rig);

  GraspCost cost;
  cost.nodes = hand.node_count();
  cost.tetrahedra = static_cast<int>(hand.tetrahedra.size());
  cost.touching = std::numeric_limits<int>::max();
  const auto period = static_cast<Nanoseconds>(1e9 / scene.options.hand.rate_hz);
  rig.run(kGraspTo, [&](const HandStepView& view) {
    const double time = static_cast<double>(view.time - VirtualRig::kStart) * 1e-9;
    if (time < 0.1 || (time < kGraspFrom && size.key != 1450)) return;
    cost.whole.push_back(usual.step(rig, view.time + period));
    if (time < kGraspFrom) return;
    cost.steps.push_back(cost.whole.back());
    cost.fast.push_back(fast.step(rig, view.time + period));
    if (shared) cost.shared.push_back(shared->step(rig, view.time + period));
    cost.touching = std::min(cost.touching, static_cast<int>(view.output->contacts.contacts.size()));
  });
  return cost;
}

std::string hand_setting(int file) { return "hand.model=" SOFTHAND_SOURCE_DIR "/config/hands/" + hand_name(file); }

// A rig that is compared with others, and the steps of its hands from `from` seconds of the scene on. The time of a
// step is the CPU time of the thread.
class Side {
 public:
  // One scene for each hand, as its process reads it.
  Side(const std::vector<Scene>& hands, double from) : steps(hands.size()), time_(from) {
    for (Scene scene : hands) {
      scene.options.hand.simulation.solver.clock = thread_seconds;
      const HandModel hand = load_scene_hand(scene);
      auto tracker =
          std::make_unique<ReplayTracker>(make_scene_motion(scene, hand), scene.options.tracker, hand_key(scene));
      if (rig_) {
        rig_->add_hand(scene, hand, std::move(tracker));
      } else {
        rig_ = std::make_unique<VirtualRig>(scene, hand, std::move(tracker));
      }
    }
    rig_->run(from, {});
  }
  void go_on(double seconds) {
    rig_->run(time_ += seconds, [this](const HandStepView& view) {
      steps[view.hand].push_back(view.output->report);
      least_contacts_ = std::min(least_contacts_, view.output->contacts.contacts.size());
    });
  }
  double median_seconds(std::size_t hand = 0) const {
    std::vector<double> seconds;
    for (const StepReport& step : steps[hand]) seconds.push_back(step.timing.total());
    return median(seconds);
  }
  std::size_t least_contacts() const { return least_contacts_; }  // of a hand in a step
  const VirtualRig& rig() const { return *rig_; }

  std::vector<std::vector<StepReport>> steps;  // by hand

 private:
  std::size_t least_contacts_ = std::numeric_limits<std::size_t>::max();
  double time_;  // s of the scene
  std::unique_ptr<VirtualRig> rig_;
};

// The sides take turns, so that other load affects all of them alike.
void take_turns(std::initializer_list<Side*> sides, double seconds, double turn = 0.1) {
  for (long turns = std::lround(seconds / turn); turns > 0; --turns) {
    for (Side* side : sides) side->go_on(turn);
  }
}

// Median step in free motion over the median step of a held grasp.
double idle_hand_cost_fraction(const Size& size) {
  constexpr double kFreeFrom = 0.5;  // s
  Side held({read_scene(scene_path("pinch_lift.toml"), {hand_setting(size.file)})}, kGraspFrom),
      free({read_scene(kFreeMotion, {hand_setting(size.file)})}, kFreeFrom);
  take_turns({&held, &free}, kGraspTo - kGraspFrom);
  return free.median_seconds() / held.median_seconds();
}

// Median step of a scene with contact of skin with skin over the median step without it, from `from` to `to` seconds of
// the scene.
double skin_cost_ratio(const std::string& file, const std::vector<std::string>& overrides, double from, double to) {
  const auto side = [&](const char* skin_contact) {
    std::vector<std::string> settings = overrides;
    settings.push_back(std::string("hand.simulation.skin_contact=") + skin_contact);
    settings.push_back(hand_setting(1450));
    return Side({read_scene(file, settings)}, from);
  };
  Side with = side("true"), without = side("false");
  take_turns({&with, &without}, to - from);
  return with.median_seconds() / without.median_seconds();
}

// Median step while a hand holds the ball of sponge.toml, over the same with a rigid ball. `motion` overrides both
// scenes. NaN if it loses a ball.
double soft_ball_cost_ratio(std::vector<std::string> motion) {
  motion.push_back(hand_setting(1450));
  const Scene soft = read_scene(scene_path("sponge.toml"), motion),
              rigid = read_scene(SOFTHAND_SOURCE_DIR "/tests/bench/rigid_ball.toml", motion);
  const auto phases = make_scene_motion(soft, load_scene_hand(soft))->phases();
  const auto hold = std::find_if(phases.begin(), phases.end(), [](const auto& each) { return each.name == "hold"; });
  Side on_soft({soft}, hold->begin), on_rigid({rigid}, hold->begin);
  take_turns({&on_soft, &on_rigid}, hold->end - hold->begin);
  const bool valid = on_soft.least_contacts() > 0 && on_rigid.least_contacts() > 0;
  return valid ? on_soft.median_seconds() / on_rigid.median_seconds() : std::nan("");
}

struct SecondHandCost {
  double work = 0;      ///< in turns of one step: each hand finds in the caches what other hands have left there
  double one_core = 0;  ///< in turns of a tenth of a second: a hand alone has the caches for itself
};
// Of two hands, 0.6 m apart and each told the other's contacts, over the mean of both hands alone in the same scene. It
// takes two seconds of the scene from `from` s on. NaN if a step does not end at the residual of the same step alone,
// or if a hand has done something for the other.
SecondHandCost second_hand_cost(const std::string& file, double from) {
  const auto hand = [&file](const char* side, double x, bool other_hands) {
    return read_scene(file, {fmt::format("hand.side={}", side), hand_setting(1450), "simulate.hand_phase=0",
                             fmt::format("generator.object_position=[{}, 0.026, 0]", x),
                             fmt::format("hand.simulation.other_hands={}", other_hands)});
  };
  Side two({hand("right", 0.3, true), hand("left", -0.3, true)}, from), right({hand("right", 0.3, false)}, from),
      left({hand("left", -0.3, false)}, from);
  const auto same = [](const StepReport& a, const StepReport& b) { return a.residual == b.residual; };
  const auto ratio = [&](double turn) {
    for (Side* side : {&two, &right, &left}) {
      for (auto& steps : side->steps) steps.clear();
    }
    take_turns({&two, &right, &left}, 1, turn);
    bool valid = true;
    for (const std::size_t h : {0u, 1u}) {
      const auto& alone = (h == 0 ? right : left).steps[0];
      valid &= std::equal(two.steps[h].begin(), two.steps[h].end(), alone.begin(), alone.end(), same);
      valid &= two.rig().hand(h).simulation().work().patches_used == 0;
    }
    const double both = two.median_seconds(0) + two.median_seconds(1);
    return valid ? 2 * both / (right.median_seconds() + left.median_seconds()) : std::nan("");
  };
  const double work = ratio(1.0 / 90);
  return {work, ratio(0.1)};
}

// Median default step of the solver over CHOLMOD's factorisation and solve of the same Hessian, without the objects.
// They take turns. CHOLMOD has the better of two orders.
double step_over_cholmod(const std::string& scene_file, const Size& size, double from, double to) {
  constexpr int kStepsATurn = 8;
  Scene scene = read_scene(
      scene_file, {std::string("hand.model=") + SOFTHAND_SOURCE_DIR + "/config/hands/" + hand_name(size.file)});
  scene.options.hand.simulation.solver.clock = thread_seconds;
  const HandModel hand = load_scene_hand(scene);
  VirtualRig rig(
      scene, hand,
      std::make_unique<ReplayTracker>(make_scene_motion(scene, hand), scene.options.tracker, hand_key(scene)));
  rig.run(from, {});
  std::array<CholmodSolver, 2> solvers{CholmodSolver(CholmodSolver::Order::minimum_degree),
                                       CholmodSolver(CholmodSolver::Order::nested_dissection)};
  std::array<std::vector<double>, 2> cholmod;
  std::vector<double> steps;
  VectorX x;
  rig.run(to, [&](const HandStepView& view) {
    steps.push_back(view.output->report.timing.total());
    if (steps.size() % kStepsATurn != 1) return;
    const BlockMatrix& hessian = view.simulation->hessian();
    const VectorX ones = VectorX::Ones(3 * hessian.core_count());
    for (std::size_t k = 0; k < solvers.size(); ++k) {
      if (cholmod[k].empty()) solvers[k].analyze(hessian);
      x = ones;
      cholmod[k].push_back(seconds_of([&] {
        solvers[k].load(hessian);
        solvers[k].factorize();
        solvers[k].solve(ones, x);
      }));
    }
  });
  return median(steps) / std::min(median(cholmod[0]), median(cholmod[1]));
}

// Work of the steps of a scene in default mode, in fast steps, from `from` to `to` seconds.
std::vector<double> work_of_steps(const std::string& scene_name, const std::vector<std::string>& overrides, double from,
                                  double to) {
  std::vector<std::string> all{"hand.model=" + hand_name(1450)};
  all.insert(all.end(), overrides.begin(), overrides.end());
  const Scene scene = read_scene(scene_path(scene_name), all);
  const HandModel hand = load_scene_hand(scene);
  VirtualRig rig(
      scene, hand,
      std::make_unique<ReplayTracker>(make_scene_motion(scene, hand), scene.options.tracker, hand_key(scene)));
  std::vector<double> work;
  rig.run(to, [&](const HandStepView& view) {
    if (static_cast<double>(view.time - VirtualRig::kStart) * 1e-9 >= from) work.push_back(view.output->report.work);
  });
  return work;
}

double scene_step_seconds(const error_runtime::Scene& scene) {
  const HandModel hand = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_1450.hand.json");
  error_runtime::Player player(scene, hand, scene.motion(hand), error_runtime::options_of(scene, {}));
  player.settle();
  return 1e-3 * median(error_runtime::play(scene, player).step_ms);
}

double allocations_per_step() {
#ifdef SOFTHAND_COUNT_MALLOC
  counting = true;
  ::operator delete(::operator new(64));
  counting = false;
  if (std::exchange(allocations, 0) != 1) return std::nan("");
  Pressing hand(5, 20);
  hand.settle();
  constexpr int kSteps = 30;
  for (int i = 0; i < kSteps; ++i) {
    hand.step([](auto&& work) {
      counting = true;
      work();
      counting = false;
    });
  }
  return hand.touched_objects() > 0 ? static_cast<double>(std::exchange(allocations, 0)) / kSteps : std::nan("");
#else
  return std::nan("");
#endif
}

/// Cost of a world's step after its hundred boxes on a table have come to rest, over the cost of a step while they
/// settle.
double settled_world_cost_ratio() {
  std::vector<ObjectOptions> objects(101);
  objects[0].half_extents = {0.5, 0.02, 0.5};
  objects[0].position = {0, -0.02, 0};
  for (int i = 0; i < 100; ++i) {
    ObjectOptions& box = objects[static_cast<std::size_t>(i) + 1];
    box.name = fmt::format("box{}", i);
    box.half_extents = {0.012, 0.012, 0.012};
    box.mass = 0.05;
    box.position = {-0.3 + 0.06 * (i % 10), 0.0121, -0.3 + 0.06 * (i / 10)};
  }
  const WorldOptions options;
  WorldLoop world(options, objects, 1.0 / 90);
  const WorldInput nobody;
  const double step = 1 / options.rate_hz;
  std::vector<double> settling, settled;
  for (int k = 0; k * step < 5; ++k) {
    const double seconds = seconds_of([&] { world.step(std::llround(1e9 * step * (k + 1)), nobody); });
    if (k * step > 0.5 && k * step < 1.5) settling.push_back(seconds);
    if (k * step > 4) settled.push_back(seconds);
  }
  return median(settled) / median(settling);
}

double kernel_seconds(Energy& term, TissueSample& sample) {
  sample.bind(term);
  std::vector<double> times;
  for (int run = 0; run < 15; ++run) times.push_back(seconds_of([&] { sample.all(term); }));
  return median(times);
}

Json run() {
  Json json;
  const auto put = [&json](const std::string& key, double value, const char* meaning) {
    json[key] = std::isfinite(value) ? Json(value) : Json(nullptr);
    fmt::print("  {:44} {:>10.4g}  {}\n", key, value, meaning);
    std::fflush(stdout);
  };
  const std::string processor = report::provenance().processor;
  json["machine"] = processor;
  fmt::print("{}; medians of the thread's CPU time\n\n", processor);

  fmt::print("factorisation\n");
  std::vector<std::pair<double, double>> factor_by_nodes;
  std::map<int, double> saved_by_factor;  // s, saving of the default's float factorisation against CHOLMOD
  for (const Size& size : kSizes) {
    FactorTurns turns(size.file);
    for (int i = 0; i < 15; ++i) turns.turn(false);
    put(fmt::format("factor_solve_speedup_over_cholmod_{}", size.key), turns.cholmod() / turns.block(),
        "double against double");
    put(fmt::format("factor_solve_speedup_over_simplicial_ldlt_{}", size.key), turns.eigen() / turns.block(),
        "Eigen's, double");
    put(fmt::format("float_factor_solve_speedup_over_cholmod_{}", size.key), turns.cholmod() / turns.single(),
        "float against double");
    put(fmt::format("factor_solve_ms_{}", size.key), 1e3 * turns.block(), "double, with loading of the values");
    put(fmt::format("factor_fraction_of_peak_{}", size.key), turns.fraction_of_peak(), "of dgemm's rate, double");
    factor_by_nodes.emplace_back(size.key, turns.block());
    saved_by_factor[size.key] = turns.cholmod() - turns.single();
  }

  fmt::print("tissue\n");
  TissueSample sample;
  testing::ScalarTissue scalar(sample.box);
  Tissue tissue(sample.box);
  const double scalar_seconds = kernel_seconds(scalar, sample);
  put("tissue_simd_speedup", scalar_seconds / kernel_seconds(tissue, sample),
      "energy, gradient and Hessian, double, over scalar");
  tissue.use_single_hessian();
  put("tissue_simd_float_speedup", scalar_seconds / kernel_seconds(tissue, sample),
      "the same with the Hessian's products in float");

  fmt::print("step of the hand in a grasp\n");
  std::map<int, GraspCost> grasps;
  std::vector<std::pair<double, double>> by_nodes, fast_by_nodes, fast_by_tetrahedra;
  for (const Size& size : kSizes) {
    const GraspCost& cost = grasps[size.key] = measure_grasp(size);
    if (cost.touching == 0) fmt::print("  (size {}: not in a grasp during the whole measurement)\n", size.key);
    put(fmt::format("step_ms_{}", size.key), cost.touching > 0 ? 1e3 * median(cost.steps) : std::nan(""),
        "default mode");
    put(fmt::format("fast_step_ms_{}", size.key), 1e3 * median(cost.fast), "one iteration, one thread");
    put(fmt::format("fast_step_two_threads_ms_{}", size.key),
        cost.shared.empty() ? std::nan("") : 1e3 * median(cost.shared), "the same on two cores");
    put(fmt::format("fast_step_cholmod_ms_{}", size.key), 1e3 * (median(cost.fast) + saved_by_factor.at(size.key)),
        "fast step with CHOLMOD's factor and solve (see above)");
    by_nodes.emplace_back(cost.nodes, median(cost.steps));
    fast_by_nodes.emplace_back(cost.nodes, median(cost.fast));
    fast_by_tetrahedra.emplace_back(cost.tetrahedra, median(cost.fast));
  }
  const GraspCost& reference = grasps.at(1450);
  put("step_p99_over_p50", quantile(reference.fast, 0.99) / median(reference.fast),
      "fast step in a grasp, 1,450 nodes");
  put("default_step_p99_over_p50", quantile(reference.whole, 0.99) / median(reference.whole),
      "1,450 nodes, approach to hold, iterations not limited");
  put("allocations_per_step", allocations_per_step(), "five objects touched");

  fmt::print("default step over CHOLMOD's factorisation and solve of the same Hessian\n");
  put("step_over_cholmod_grasp_3080", step_over_cholmod(scene_path("pinch_lift.toml"), {3000, 3080}, kGraspFrom, 4.9),
      "held pinch");
  put("step_over_cholmod_motion_3080", step_over_cholmod(kFreeMotion, {3000, 3080}, 0.5, 2), "in the air");
  put("step_over_cholmod_grasp_6000", step_over_cholmod(scene_path("pinch_lift.toml"), {6000, 6000}, kGraspFrom, 4.4),
      "held pinch");

  fmt::print("step in each scene of the report, default mode, 1,450 nodes\n");
  for (const error_runtime::Scene& scene : error_runtime::all_scenes()) {
    put("scene_step_ms_" + scene.name, 1e3 * scene_step_seconds(scene), scene.statement.c_str());
  }

  fmt::print("work of steps in default mode, in fast steps (docs/performance.md, \"A budget of work\"), 1,450 nodes\n");
  const std::string recording = SOFTHAND_SOURCE_DIR "/../shared/data/quest3/right.csv";
  const bool is_recorded = fs::exists(recording);
  const auto recorded_work = [&](double from, double to) {
    return work_of_steps("recorded_grasp.toml", {"motion=" + recording}, from, to);
  };
  const std::vector<std::string> fist{"generator.motion=fist", "generator.object_position=[0,0.5,0]"};
  put("work_tail_pinch_lift", quantile(work_of_steps("pinch_lift.toml", {}, 0.1, 8), 0.99), "p99");
  put("work_tail_power_grasp", quantile(work_of_steps("power_grasp.toml", {}, 0.1, 8), 0.99), "p99");
  put("work_tail_recorded_grasp", is_recorded ? quantile(recorded_work(0.1, 8.4), 0.99) : std::nan(""),
      "p99; null without the recording");
  put("work_tail_fist", quantile(work_of_steps("pinch_lift.toml", fist, 0.1, 4), 0.99),
      "p99; the fist closes in the air and opens");
  put("recorded_step_over_pinch_step",
      is_recorded ? median(recorded_work(kRecordedFistFrom, kRecordedFistTo)) /
                        median(work_of_steps("pinch_lift.toml", {}, kGraspFrom, kGraspTo))
                  : std::nan(""),
      "median work of the closed recorded fist over a held pinch");

  fmt::print("contact of skin with skin, 1,450 nodes\n");
  const std::string closing = scene_path("fist.toml");
  put("fist_contact_cost_ratio",
      skin_cost_ratio(closing, {"hand.simulation.solver.chord_tolerance=0"}, kClosedFrom, kClosedTo),
      "step of a closed fist over the same without it, both to the same residual");
  put("fist_contact_over_chord_cost_ratio", skin_cost_ratio(closing, {}, kClosedFrom, kClosedTo),
      "the same if the hand without it takes chord steps, which end at a movement");
  put("free_skin_cost_ratio", skin_cost_ratio(kFreeMotion, {}, 0.5, 2.5),
      "step of a wandering hand whose fingers touch now and then, over the same without it");
  put("pinch_skin_cost_ratio", skin_cost_ratio(scene_path("pinch_lift.toml"), {}, 0.5, kGraspTo),
      "step of a pinch, where no skin touches skin, over the same without it");

  put("soft_ball_cost_ratio", soft_ball_cost_ratio({}),
      "step while a hand squeezes a soft ball of 516 nodes to half, over the same with a rigid ball, 1,450 nodes");
  put("lifted_soft_ball_cost_ratio",
      soft_ball_cost_ratio({"generator.closing_depth=0.0035", "generator.lift_height=0.1", "generator.lift_time=0.6"}),
      "the same if the hand lifts both balls, each with the grip that holds the rigid one");

  fmt::print("two hands far from each other over one hand, each step to the same residual, 1,450 nodes\n");
  const SecondHandCost moving = second_hand_cost(kFreeMotion, 0.5),
                       holding = second_hand_cost(SOFTHAND_SOURCE_DIR "/tests/bench/two_cubes.toml", kGraspFrom);
  put("second_hand_cost_ratio", moving.work, "in free motion, caches equally cold");
  put("second_hand_holding_cost_ratio", holding.work, "the same, each hand holds a cube of its own");
  put("second_hand_one_core_cost_ratio", moving.one_core,
      "in free motion, in turns on a core; the hand alone has the core's caches for itself");
  put("second_hand_holding_one_core_cost_ratio", holding.one_core, "the same, each hand holds a cube of its own");

  fmt::print("the same tetrahedra in Bullet's deformable bodies\n");
  for (const Size& size : kSizes) {
    const error_runtime::PeerSteps peer = error_runtime::compare_steps(fmt::format("right_{}", size.file), kPeerSteps);
    put(fmt::format("step_speedup_over_bullet_{}", size.key), peer.bullet_seconds / peer.own_seconds,
        "soft fingers fall, no bones, no contact, both engines with default settings");
    put(fmt::format("peer_error_mm_{}", size.key), peer.own_rms_mm, "our RMS skin error against the converged run");
    put(fmt::format("peer_error_mm_bullet_{}", size.key), peer.bullet_rms_mm, "Bullet's RMS skin error");
  }

  fmt::print("cost of parts that a scene does not need\n");
  put("idle_hand_cost_fraction", idle_hand_cost_fraction({1450, 1450}),
      "step in free motion over step in a grasp, 1,450 nodes");
  const auto clutter = measure_pressing({{5, 0}, {5, 95}}, 60);
  const bool all_touched = clutter[0].touched == 5 && clutter[1].touched == 5;
  if (!all_touched) fmt::print("  (touched {} and {} of 5 objects)\n", clutter[0].touched, clutter[1].touched);
  put("clutter_cost_ratio", all_touched ? clutter[1].step / clutter[0].step : std::nan(""),
      "step with 100 near objects, 5 touched, over step with these 5 alone");
  put("slot_cost_ratio", slot_cost_ratio(),
      "fast step with 16 near, untouched objects in slots over step without them");
  const RelaxationCost relaxation = relaxation_cost_ratio({});
  put("relaxation_cost_ratio", relaxation.seconds,
      "mean step of a pressing hand with relaxation over mean step without it, over whole sways");
  put("relaxation_iteration_ratio", relaxation.iterations, "iterations of these steps");
  HandOptions fast;
  fast.simulation.solver.max_iterations = 1;
  put("relaxation_fast_step_ratio", relaxation_cost_ratio(fast).seconds, "the cost with one iteration a step");
  put("settled_world_cost_ratio", settled_world_cost_ratio(),
      "step with 100 boxes at rest on a table over step while they settle");

  fmt::print("exponents\n");
  put("factor_exponent_nodes", exponent(factor_by_nodes), "double factor and solve");
  put("step_exponent_nodes", exponent(by_nodes), "default mode");
  put("fast_step_exponent_nodes", exponent(fast_by_nodes), "");
  put("fast_step_exponent_tetrahedra", exponent(fast_by_tetrahedra), "");
  const auto touching = measure_pressing({{1, 0}, {2, 0}, {3, 0}, {4, 0}, {5, 0}}, 40);
  std::vector<std::pair<double, double>> by_contacts;
  for (const PressingCost& cost : touching) {
    if (cost.contacts > 0) by_contacts.emplace_back(cost.contacts, cost.contact);
  }
  put("contact_exponent_contacts", by_contacts.size() > 1 ? exponent(by_contacts) : std::nan(""),
      "detection and anchors, by number of touching nodes");
  const auto crowd = measure_pressing({{0, 12}, {0, 25}, {0, 50}, {0, 100}}, 40);
  std::vector<std::pair<double, double>> by_objects;
  for (std::size_t k = 0; k < crowd.size(); ++k) by_objects.emplace_back(std::array{12, 25, 50, 100}[k], crowd[k].step);
  put("step_exponent_objects", exponent(by_objects), "near objects, none touched");
  put("step_exponent_hands", exponent(by_hands()),
      "1 to 8 hands that touch 5 objects each, one hand after another on a core");

  fmt::print("the hand's service\n");
  const ServiceCost service = measure_service(scene_path("pinch_lift.toml"));
  put("start_to_first_hand_seconds", service.start_seconds,
      "from exec to the first simulated skeleton, wall-clock time");
  put("hand_service_megabytes", service.megabytes, "resident, 1,450 nodes");
  return json;
}

}  // namespace
}  // namespace softhand::bench

int main(int argc, char** argv) {
  CLI::App app(
      "Measures the hand's step, its parts and its service in about two minutes. On one core (taskset -c 1) two "
      "threads "
      "are not measured",
      "softhand bench");
  std::string path;
  app.add_option("--json", path, "File for the figures")->type_name("FILE");
  CLI11_PARSE(app, argc, argv);
  try {
    const auto json = softhand::bench::run();
    if (path.empty()) return 0;
    std::ofstream out(path);
    out << json.dump(2) << '\n';
    out.flush();
    if (!out) throw std::runtime_error(path + ": cannot be written");
    return 0;
  } catch (const std::exception& error) {
    fmt::print(stderr, "softhand bench: {}\n", error.what());
    return 1;
  }
}
