// Joints between objects: limits, springs and detents, ratios of mass, chains in the world alone, and a hand that
// presses a joint against its end.
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "cli/virtual_rig.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "stress/cases.hpp"
#include "stress/hand_events.hpp"
#include "stress/watch.hpp"
#include "trackers/replay/replay_tracker.hpp"

namespace softhand::stress {
namespace {

constexpr double kSwinging = 2e-3;  // m, largest opening of joints of links that swing freely
constexpr double kArm = 0.1;        // m, from the base to the cube

ObjectOptions cube(const char* name, double mass, const Vector3& position, double half = 0.02) {
  ObjectOptions o;
  o.name = name;
  o.mass = mass;
  o.half_extents = {half, half, half};
  o.position = to_wire(position);
  return o;
}

JointOptions joint(const char* kind, const char* parent, const char* child, const Vector3& position,
                   const Vector3& axis) {
  JointOptions j;
  j.name = child;
  j.kind = kind;
  j.parent = parent;
  j.child = child;
  j.position = to_wire(position);
  j.axis = to_wire(axis);
  return j;
}

/// Objects and joints in a world without hands, and what is watched in each of its steps.
struct Mechanism {
  std::vector<ObjectOptions> objects;
  std::vector<JointOptions> joints;
  double gravity = 9.81;  // m/s^2, downwards
  double rate = 250;      // Hz
  double seconds = 3;
};

struct MechanismRun {
  Findings findings;
  double gap = 0;    // m, largest of all joints
  double gain = 0;   // J, largest energy above that at the start
  double scale = 0;  // J, largest kinetic energy, at least 1 mJ
  double speed = 0;  // m/s, fastest object in the last 0.2 s
};

MechanismRun run(const Mechanism& mechanism, const std::function<void(const WorldLoop&)>& after_step = {}) {
  WorldOptions options;
  options.rate_hz = mechanism.rate;
  options.gravity = {0, -mechanism.gravity, 0};
  WorldLoop world(options, mechanism.objects, kStep, mechanism.joints);
  MechanismRun result;
  result.scale = 1e-3;
  std::uint64_t nonfinite = 0;
  const double start = world.energy();
  const auto steps = static_cast<int>(std::lround(mechanism.seconds * mechanism.rate));
  for (int i = 1; i <= steps; ++i) {
    const WorldObjects& objects = world.step(static_cast<Nanoseconds>(1e9 * i / mechanism.rate), {}).objects;
    if (!all_finite(objects)) ++nonfinite;
    double kinetic = 0;
    for (const ObjectState& object : objects.objects) {
      const double speed = to_vector(object.linear_velocity).norm();
      kinetic += 0.5 * mechanism.objects[object.object - 1].mass * speed * speed;
      if (i > steps - 0.2 * mechanism.rate) result.speed = std::max(result.speed, speed);
    }
    result.scale = std::max(result.scale, kinetic);
    result.gain = std::max(result.gain, world.energy() - start);
    for (const JointOptions& each : mechanism.joints) result.gap = std::max(result.gap, world.joint_gap(each.name));
    if (after_step) after_step(world);
  }
  result.findings.demand("G1", "numbers published that are not finite",
                         static_cast<double>(nonfinite + world.counters().repaired), 0, "1", Class::diverged);
  // The published speed is that over the step. A turn by w T in a step makes its square larger by up to (w T)^2/4.
  result.findings.demand("energy", "energy gained over the largest kinetic energy", result.gain / result.scale, 0.05,
                         "1");
  return result;
}

void demand_closed(MechanismRun& result, double limit = 1e-3) {
  result.findings.demand("closed", "largest opening of a joint", result.gap * 1e3, limit * 1e3, "mm");
}
void demand_rest(MechanismRun& result) {
  result.findings.demand("rest", "fastest object at the end", result.speed * 1e3, 1, "mm/s");
}

// A cube on an arm falls and meets the limit of its joint. With the gravity of the earth it meets it at 1 m/s, with ten
// times this gravity at 4 m/s.
Findings limit(const std::string& kind, double rate, double gravity) {
  const bool slides = kind == "slider";
  Mechanism mechanism;
  mechanism.rate = rate;
  mechanism.gravity = gravity;
  mechanism.objects = {cube("base", 0, Vector3::Zero()), cube("cube", 0.05, {kArm, 0, 0})};
  JointOptions held =
      joint(kind.c_str(), "base", "cube", Vector3::Zero(), slides ? Vector3(0, 1, 0) : Vector3(0, 0, 1));
  if (kind == "ball") held.axis = {1, 0, 0};
  held.limits = kind == "ball" ? std::array{0.0, 0.7} : slides ? std::array{-0.08, 0.0} : std::array{-0.8, 0.0};
  mechanism.joints = {held};
  double beyond = 0;
  const double end = kind == "ball" ? held.limits[1] : -held.limits[0];
  MechanismRun result = run(mechanism, [&](const WorldLoop& world) {
    const Vector3 at = to_vector(world.objects().objects[1].position);
    const double fallen = slides ? -at.y() : std::atan2(-at.y(), at.x());
    beyond = std::max(beyond, (fallen - end) * (slides ? 1 : kArm));
  });
  demand_closed(result);
  demand_rest(result);
  result.findings.demand("limit", "way beyond the limit", beyond * 1e3, 1, "mm");
  return result.findings;
}

// A cube hangs on a spring that is stiffer than the step can show.
Findings stiff_spring(double stiffness, double rate) {
  Mechanism mechanism;
  mechanism.rate = rate;
  mechanism.objects = {cube("base", 0, Vector3::Zero()), cube("cube", 0.05, {0, kArm, 0})};
  JointOptions spring = joint("slider", "base", "cube", Vector3::Zero(), Vector3::UnitY());
  spring.stiffness = stiffness;
  mechanism.joints = {spring};
  double q = 0;
  MechanismRun result = run(mechanism, [&](const WorldLoop& world) { q = world.joint_coordinate("cube"); });
  demand_closed(result);
  const double exact = -0.05 * 9.81 / stiffness;
  result.findings.demand("hangs", "distance from the analytic place", std::abs(q - exact) * 1e6,
                         1e-2 * std::abs(exact) * 1e6 + 2, "um");
  return result.findings;
}

// A row of narrow wells along a slider. The cube falls into the row with 1.4 m/s and must come to rest in a well, or
// at the end.
Findings detents(double width, double rate) {
  Mechanism mechanism;
  mechanism.rate = rate;
  mechanism.objects = {cube("base", 0, Vector3::Zero()), cube("cube", 0.05, {0, 0.2, 0})};
  JointOptions rail = joint("slider", "base", "cube", Vector3::Zero(), Vector3::UnitY());
  rail.limits = {-0.15, 0};
  rail.damping = 0.2;
  rail.detents = {{-0.1, 5e-3, width, 2 * width}};
  mechanism.joints = {rail};
  MechanismRun result = run(mechanism);
  demand_closed(result);
  demand_rest(result);
  return result.findings;
}

// A heavy cube on a light one, on a hinge each, or a light one on a heavy one. They swing from the horizontal.
Findings mass_ratio(double first, double second, double rate) {
  Mechanism mechanism;
  mechanism.rate = rate;
  mechanism.objects = {cube("base", 0, Vector3::Zero()), cube("first", first, {kArm, 0, 0}),
                       cube("second", second, {2 * kArm, 0, 0})};
  mechanism.joints = {joint("hinge", "base", "first", Vector3(0.5 * kArm, 0, 0), Vector3::UnitZ()),
                      joint("hinge", "first", "second", Vector3(0.5 * kArm, 0, 0), Vector3::UnitZ())};
  MechanismRun result = run(mechanism);
  demand_closed(result, kSwinging);
  return result.findings;
}

// Links of 10 g on hinges with a load at their end, all horizontal at the start.
Findings chain(int links, double load, double rate) {
  constexpr double kPitch = 0.03;
  Mechanism mechanism;
  mechanism.rate = rate;
  mechanism.objects = {cube("base", 0, Vector3::Zero(), 0.01)};
  std::vector<std::string> names{"base"};
  for (int i = 1; i <= links; ++i) {
    names.push_back(fmt::format("link{}", i));
    mechanism.objects.push_back(cube(names.back().c_str(), i == links ? load : 0.01, Vector3(kPitch * i, 0, 0), 0.01));
    mechanism.joints.push_back(joint("hinge", names[names.size() - 2].c_str(), names.back().c_str(),
                                     Vector3(0.5 * kPitch, 0, 0), Vector3::UnitZ()));
  }
  MechanismRun result = run(mechanism);
  demand_closed(result, kSwinging);
  return result.findings;
}

// A hand works a joint in a scene and goes on when the joint is at its end.
struct Press {
  const char* scene;
  const char* joint;
  double end;  // m, the limit at which the hand goes on
  std::vector<std::string> overrides;
  double seconds;
  double least_force;  // N, of a finger
};

Findings pressed_to_the_end(const Press& press, double rate) {
  constexpr double kOpens = 0.5e-3, kBeyond = 0.5e-3;  // m
  std::vector<std::string> overrides{"hand.model=right_400.hand.json", "tracker.position_noise=0",
                                     "tracker.rotation_noise=0", fmt::format("world.rate_hz={}", rate)};
  overrides.insert(overrides.end(), press.overrides.begin(), press.overrides.end());
  const Scene scene = read_scene(std::string(SOFTHAND_SOURCE_DIR "/config/scenes/") + press.scene + ".toml", overrides);
  const HandModel hand = load_scene_hand(scene);
  VirtualRig rig(
      scene, hand,
      std::make_unique<ReplayTracker>(make_scene_motion(scene, hand), scene.options.tracker, hand_key(scene)));
  HandWatch watch;
  double world_gap = 0, hand_gap = 0, beyond = -1, force = 0;
  rig.run(press.seconds, [&](const HandStepView& view) {
    watch.after_step(*view.simulation, view.output->report, 1 / rig.hand().options().rate_hz);
    if (!all_finite(*view.objects) || !all_finite(view.output->coupling)) watch.count_nonfinite();
    const double q = rig.world().joint_coordinate(press.joint);
    beyond = std::max(beyond, press.end > 0 ? q - press.end : press.end - q);
    world_gap = std::max(world_gap, rig.world().joint_gap(press.joint));
    bool owned = false;
    for (const ObjectTwin& twin : view.output->coupling.twins) owned = owned || twin.owned != 0;
    if (owned) hand_gap = std::max(hand_gap, view.simulation->joint_gap(0));
    for (const FingerContact& finger : view.output->contacts.fingers)
      force = std::max(force, to_vector(finger.force).norm());
  });
  Findings findings;
  watch.judge(rig.hand().simulation(), findings);
  findings.demand_at_least("pressed", "largest force of a finger", force, press.least_force, "N");
  findings.demand_at_least("at the end", "way to the limit", beyond * 1e3, -0.1, "mm");
  findings.demand("limit", "way beyond the limit in the world", beyond * 1e3, kBeyond * 1e3, "mm");
  findings.demand("closed", "largest opening of the joint in the hand", hand_gap * 1e3, kOpens * 1e3, "mm");
  findings.demand("closed", "largest opening of the joint in the world", world_gap * 1e3, kOpens * 1e3, "mm");
  return findings;
}

}  // namespace

std::vector<Case> joint_cases() {
  const Known kCrushed{Class::violated,
                       "the link of 1 kg presses that of 1 g onto the base: Bullet's contact gives way"};
  CaseList cases("Joints");
  constexpr std::array kRates{60.0, 250.0, 1000.0};
  auto* rows =
      &cases.add("object_joint_limit", "a joint stops within 1 mm of its limit, opens by at most 1 mm and rests");
  for (const char* kind : {"hinge", "slider", "ball"}) {
    for (const auto& [rate, times] : {std::pair{60.0, 1.0}, {250.0, 10.0}, {1000.0, 10.0}}) {
      rows->push_back({fmt::format("{}, {:g} g, {:g} Hz", kind, times, rate),
                       [kind, r = rate, t = times] { return limit(kind, r, t * 9.81); },
                       {},
                       rate == 60});
    }
  }
  rows = &cases.add("object_joint_spring", "a cube of 50 g hangs at its analytic place within 1 % or 2 um");
  for (const double stiffness : {1e3, 1e6})
    for (const double rate : {60.0, 1000.0})
      rows->push_back({fmt::format("k = {:g} N/m, {:g} Hz", stiffness, rate),
                       [=] { return stiff_spring(stiffness, rate); },
                       {},
                       stiffness == 1e6 && rate == 60});
  rows = &cases.add("object_joint_detents", "a cube that falls along wells of 5 mJ comes to rest");
  for (const double width : {5e-3, 0.5e-3})
    for (const double rate : kRates)
      rows->push_back({fmt::format("width = {:g} mm, {:g} Hz", width * 1e3, rate),
                       [=] { return detents(width, rate); },
                       {},
                       width < 1e-3 && rate == 60});
  rows = &cases.add("object_joint_mass_ratio", "two swinging links: joints open by at most 2 mm");
  const auto ratio = [rows](double first, double second, double rate, const Known& known = {}) {
    rows->push_back({fmt::format("{:g} kg, then {:g} kg, {:g} Hz", first, second, rate),
                     [=] { return mass_ratio(first, second, rate); }, known, second == 1 && rate == 250});
  };
  ratio(1e-3, 1, 60);
  ratio(1e-3, 1, 250);
  ratio(1e-3, 100, 250);
  ratio(1, 1e-3, 250, kCrushed);
  rows =
      &cases.add("object_joint_chain", "8 swinging links of 10 g with a load at the end: joints open by at most 2 mm");
  for (const double load : {0.01, 1.0})
    for (const double rate : {250.0, 1000.0})
      rows->push_back({fmt::format("load {:g} kg, {:g} Hz", load, rate),
                       [=] { return chain(8, load, rate); },
                       {},
                       load == 0.01 || rate == 250});
  rows =
      &cases.add("object_joint_pressed", "a hand presses a joint against its end: opened and passed by at most 0.5 mm");
  const Press button{"button", "button.button", -5e-3, {"generator.lower_depth=0.02"}, 4, 8};
  const Press drawer{"drawer_box", "rail", 0.06, {"generator.lift_height=0.09"}, 3.5, 1};
  for (const double rate : {60.0, 250.0}) {
    rows->push_back({fmt::format("button pushed 15 mm too far, {:g} Hz", rate),
                     [=] { return pressed_to_the_end(button, rate); },
                     {},
                     rate == 60});
    rows->push_back(
        {fmt::format("box pulled 30 mm too far, {:g} Hz", rate), [=] { return pressed_to_the_end(drawer, rate); }});
  }
  return cases.take();
}

}  // namespace softhand::stress
