// A held object, through all loops on the virtual clock. Its weight and its inertia must be those of the object.
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "cli/virtual_rig.hpp"
#include "messages/convert.hpp"
#include "trackers/replay/replay_tracker.hpp"
#include "verification/cases.hpp"

namespace softhand::verification {
namespace {

double outcome_of(const std::vector<std::string>& overrides, double seconds, const char* figure) {
  std::vector<std::string> all{"hand.model=right_400.hand.json"};
  all.insert(all.end(), overrides.begin(), overrides.end());
  const Scene scene = read_scene(std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch_lift.toml", all);
  const HandModel hand = load_scene_hand(scene);
  const auto motion = make_scene_motion(scene, hand);
  VirtualRig rig(scene, hand, std::make_unique<ReplayTracker>(motion, scene.options.tracker, hand_key(scene)));
  rig.run(seconds > 0 ? seconds : motion->duration(), [](const HandStepView&) {});
  const auto value = rig.outcome().summary(outcome_frame(scene, VirtualRig::kStart))[figure];
  return value.is_number() ? value.get<double>() : std::nan("");
}

std::string setting(const std::string& key, double value) { return key + "=" + std::to_string(value); }

std::vector<Measurement> held_weight(const Parameters& p) {
  const std::vector<std::string> overrides{setting("objects.cube.mass", p["mass"]), setting("generator.hold_time", 2)};
  return {{"carried weight / m g", outcome_of(overrides, 0, "carried_weight_ratio"), 1, 0.02, "1", {}}};
}

// The lower bound for slow loops allows for backward Euler's own lag of a step at 3 Hz.
std::vector<Measurement> held_inertia(const Parameters& p) {
  const std::vector<std::string> overrides{setting("objects.cube.mass", p["mass"]), setting("generator.shake_time", 2),
                                           setting("generator.hold_time", 0.3),
                                           setting("hand.rate_hz", p["hand_rate"])};
  const double least = p["hand_rate"] < 240 ? 0.94 : 0.98;
  return {{"in-phase force / m a at 3 Hz",
           outcome_of(overrides, 6, "inertia_ratio"),
           0.5 * (least + 1.02),
           0.5 * (1.02 - least),
           "1",
           {}}};
}

// A hand pinches a cube of 45 g with about 1.8 N per finger, lifts it and holds it still. The grip is more than five
// times the 0.32 N that mu = 0.7 needs.
std::vector<Measurement> held_creep(const Parameters& p) {
  constexpr double kHeldFrom = 8, kHeldUntil = 13;  // s of the scene; the cube is lifted at 3.3 s
  const std::vector<std::string> overrides{
      "hand.model=right_" + std::to_string(p.whole("nodes")) + ".hand.json",
      "hand.simulation.solver.max_iterations=" + std::to_string(p.whole("iterations")),
      setting("objects.cube.mass", p["mass"]),
      setting("objects.cube.friction", p["friction"]),
      "tracker.position_noise=0",
      "tracker.rotation_noise=0",
      "generator.hold_time=12"};
  const Scene scene = read_scene(std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch_lift.toml", overrides);
  const HandModel hand = load_scene_hand(scene);
  VirtualRig rig(
      scene, hand,
      std::make_unique<ReplayTracker>(make_scene_motion(scene, hand), scene.options.tracker, hand_key(scene)));
  std::optional<Vector3> start;
  Vector3 last = Vector3::Constant(std::nan(""));
  rig.run(kHeldUntil, [&](const HandStepView& view) {
    if (static_cast<double>(view.time - VirtualRig::kStart) * 1e-9 < kHeldFrom || view.output->coupling.twins.empty())
      return;
    last = to_vector(view.output->coupling.twins[0].position);
    if (!start) start = last;
  });
  if (!start || start->y() < 0.15) throw std::runtime_error("the cube was not lifted");
  return {{"creep", (last - *start).norm() / (kHeldUntil - kHeldFrom), 0, 1e-6, "m/s", {}}};
}

}  // namespace

std::vector<Case> grasp_cases() {
  std::vector<Parameters> holds;
  for (const double nodes : {400.0, 1450.0}) {
    for (const double iterations : {2.0, 1.0, 3.0, 5.0, 10.0, 200.0}) {
      holds.push_back({{"nodes", nodes}, {"iterations", iterations}, {"mass", 0.045}, {"friction", 0.7}});
    }
  }
  return {
      {"held_weight", "the carried weight is m g within 2 %", {{{"mass", 0.05}}}, held_weight},
      {"held_inertia",
       "0.94 to 1.02 at 90 Hz, 0.98 to 1.02 at 240 Hz",
       {{{"mass", 0.05}, {"hand_rate", 90}}, {{"mass", 0.05}, {"hand_rate", 240}}},
       held_inertia,
       0},
      {"held_creep", "<= 1 um/s for a pinched cube, at every iteration limit", holds, held_creep, 2},
  };
}

}  // namespace softhand::verification
