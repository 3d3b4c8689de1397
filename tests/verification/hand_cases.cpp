// A whole hand and an object: conserved momentum, Galilean invariance and Coulomb's limit of a pinch.
#include <algorithm>
#include <memory>
#include <stdexcept>

#include "cli/virtual_rig.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "scene/hand_simulation.hpp"
#include "support/block_hand.hpp"
#include "support/moving_together.hpp"
#include "support/shapes.hpp"
#include "trackers/replay/replay_tracker.hpp"
#include "verification/cases.hpp"

namespace softhand::verification {
namespace {

constexpr double kHandStep = 1.0 / 90;  // s

SimulationOptions converging_simulation() {
  SimulationOptions options;
  options.solver.max_iterations = 200;
  options.solver.keep_factor = false;
  options.solver.factor = "double";
  options.solver.residual_tolerance = 1e-9;
  options.solver.movement_tolerance = 1e-10;
  options.solver.increment_tolerance = 1e-14;
  options.solver.chord_tolerance = 0;
  return options;
}

void hold_at_rest(HandSimulation& simulation) {
  for (int b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    simulation.set_target(body, simulation.hand().rest_joints[static_cast<std::size_t>(index_of(joint_of(body)))], {});
  }
}

MirroredObject mirrored(const ShapeGeometry& shape, double mass, double friction) {
  return {7, &shape, mass, mass / shape.solid().volume * shape.solid().inertia, friction};
}

constexpr const char* kSpinLost = "change of angular momentum in 1 s";

// A box with the density of wood tumbles for a second beside a hand at rest.
std::vector<Measurement> spinning_box(const Parameters& p) {
  const double mass = p["mass"], half = 0.5 * std::cbrt(mass / 400);
  const ShapeGeometry box(testing::box_shape({half, 0.8 * half, 1.25 * half}));
  const auto lost = [&](const SimulationOptions& options) {
    HandSimulation simulation(testing::block_hand(), options, 1, 0);
    hold_at_rest(simulation);
    const MirroredObject object = mirrored(box, mass, 0.5);
    simulation.set_slot(0, object);
    const Vector3 spin = p["spin"] * Vector3(1, 2, -1).normalized();
    simulation.set_slot_motion(0, {Vector3(0, 0.2, -0.1), Quaternion::Identity()}, {Vector3::Zero(), spin});
    simulation.make_dynamic(0, Vector3::Zero());
    const auto momentum = [&] {
      const Quaternion turn = simulation.slot_pose(0).orientation;
      return Vector3(turn * (object.inertia * (turn.conjugate() * simulation.slot_velocity(0).angular)));
    };
    const Vector3 before = momentum();
    for (int i = 0; i < 90; ++i) simulation.step(kHandStep);
    return (momentum() - before).norm() / before.norm();
  };
  return {{kSpinLost, lost({}), 0, 0.01, "1", {}},
          {"the same, converged", lost(converging_simulation()), 0, 1e-6, "1", {}}};
}

// The palm is pressed on a block and dragged over it by 2 mm.
// - `normal`, `across`: common velocity of hand and block, m/s.
// - `free`: 1: the block is free on a plane that moves along. 0: its motion is given.
std::vector<Measurement> galilean_boost(const Parameters& p) {
  struct Run {
    std::vector<Vector3> forces;
    std::vector<Eigen::Matrix3Xd> nodes;
  };
  constexpr int kSteps = 90;
  const auto run = [&p](const Vector3& velocity, const SimulationOptions& options) {
    testing::MovingTogether pair(velocity, 0.001, 0.004, options, p["free"] != 0);
    Run result;
    for (int i = 0; i < kSteps; ++i) {
      pair.step(0.002 * std::clamp((i - 45) / 30.0, 0.0, 1.0));
      result.forces.push_back(pair.force());
      result.nodes.push_back(pair.nodes());
    }
    return result;
  };
  std::vector<Measurement> result;
  for (const bool converged : {false, true}) {
    const SimulationOptions options = converged ? converging_simulation() : SimulationOptions{};
    const Run resting = run(Vector3::Zero(), options), moving = run({p["across"], p["normal"], 0}, options);
    double largest = 0, force = 0, place = 0;
    for (std::size_t i = 0; i < kSteps; ++i) {
      largest = std::max(largest, resting.forces[i].norm());
      force = std::max(force, (moving.forces[i] - resting.forces[i]).norm());
      place = std::max(place, (moving.nodes[i] - resting.nodes[i]).colwise().norm().maxCoeff());
    }
    // If nothing presses, the result is 0/0 = NaN and the row fails.
    const std::string solver = converged ? ", converged" : "";
    result.push_back({"change of force / largest" + solver, force / largest, 0, converged ? 1e-6 : 0.01, "1", {}});
    result.push_back({"change of a node's place" + solver, place, 0, converged ? 1e-8 : 2e-5, "m", {}});
  }
  return result;
}

std::vector<Measurement> galilean_distance(const Parameters& p) {
  testing::MovingTogether pair({p["across"], p["normal"], 0}, p["gap"], 0, {});
  double force = 0;
  int contacts = 0;
  for (int i = 0; i < 90; ++i) {
    pair.step();
    force = std::max(force, pair.force().norm());
    contacts = std::max(contacts, pair.simulation().contact_count());
  }
  return {{"force of a block that moves along", force, 0, 0, "N", {}},
          {"its contacts", static_cast<double>(contacts), 0, 0, "1", {}}};
}

// A hand pinches a cube, lifts it and holds it still. A box then replaces the cube. The friction of the box falls until
// the box slips. It falls slowly, so that the forces with which the pads pull against each other can relax.
std::vector<Measurement> pinch_threshold(const Parameters& p) {
  constexpr double kHeldFrom = 3;    // s of the scene
  constexpr double kFall = 0.01;     // decrease per second, relative to the expected threshold
  constexpr double kApproach = 0.5;  // additional decrease per second, relative to the excess over the threshold
  constexpr int kSettle = 45;        // steps
  constexpr double kCreeps = 2e-3;   // m/s downwards; the grip is measured up to this speed
  constexpr double kSlips = 5e-3;
  constexpr std::uint32_t kCube = 2;
  const double mass = p["mass"];
  const std::vector<std::string> overrides{"hand.model=right_750.hand.json",
                                           "tracker.position_noise=0",
                                           "tracker.rotation_noise=0",
                                           "generator.approach_distance=0.04",
                                           "generator.approach_time=0.2",
                                           "generator.close_time=0.4",
                                           "generator.settle_time=0.2",
                                           "generator.lift_time=0.4",
                                           "generator.lift_height=0.05",
                                           "generator.hold_time=60",
                                           "objects.cube.mass=" + std::to_string(mass)};
  const Scene scene = read_scene(std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch_lift.toml", overrides);
  const HandModel hand = load_scene_hand(scene);
  const auto motion = make_scene_motion(scene, hand);
  VirtualRig rig(scene, hand, std::make_unique<ReplayTracker>(motion, scene.options.tracker, hand_key(scene)));
  rig.run(kHeldFrom, [](const HandStepView&) {});
  const HandSimulation& held = rig.hand().simulation();
  int slot = 0;
  while (slot < held.slot_count() && held.slot_mode(slot) != SlotMode::dynamic) ++slot;
  if (slot == held.slot_count() || held.slot_pose(slot).position.y() < 0.05) {
    throw std::runtime_error("the cube was not lifted");
  }
  // The box is taller than the cube, because it creeps down by some millimetres before it slips.
  const ShapeGeometry box(testing::box_shape({0.02, 0.04, 0.02}));
  const int mirrored_slots = static_cast<int>(scene.options.hand.mirrored_objects);
  HandSimulation trial(hand, converging_simulation(), mirrored_slots, held.slot_count() - mirrored_slots);

  trial.take_state(held);
  trial.set_planes(slot, {});
  MirroredObject object = mirrored(box, mass, 0);
  object.id = kCube;
  Contacts contacts{};
  const auto grip = [&] {  // sum over both pads, N
    trial.write_contacts(contacts);
    double force = 0;
    for (const Contact& contact : contacts.contacts) {
      force += std::max(0.0, to_vector(contact.normal).dot(to_vector(contact.force)));
    }
    return force;
  };
  double reference = 0;
  object.friction = 1;
  for (int i = 0; i < 9000; ++i) {
    const double speed = -trial.slot_velocity(slot).linear.y();
    if (speed < kCreeps) reference = mass * kGravity / grip();
    if (i > kSettle) {
      object.friction -= kHandStep * (kFall * reference + kApproach * std::max(0.0, object.friction - reference));
    }
    trial.set_slot(slot, object);
    trial.make_dynamic(slot, Vector3(0, -kGravity, 0));
    trial.step(kHandStep);
    if (i > kSettle && trial.slot_velocity(slot).linear.y() < -kSlips) {
      return {{"friction at which it slips", object.friction, reference, 0.01 * reference, "1", {}}};
    }
  }
  throw std::runtime_error("the box did not slip");
}

}  // namespace

std::vector<Case> hand_cases() {
  std::vector<Parameters> spins;
  for (const double mass : {0.0004, 0.026, 1.0}) {
    for (const double spin : {1.0, 10.0, 40.0}) spins.push_back({{"mass", mass}, {"spin", spin}});
  }
  std::vector<Parameters> boosts, distances;
  for (const double is_free : {0.0, 1.0}) {
    for (const double speed : {0.3, -0.3, 3.0, -3.0}) {
      boosts.push_back({{"free", is_free}, {"normal", speed}, {"across", 0}});
    }
    for (const double speed : {0.3, 3.0}) boosts.push_back({{"free", is_free}, {"normal", 0}, {"across", speed}});
  }
  for (const double speed : {5.0, -5.0}) distances.push_back({{"normal", speed}, {"across", 0}, {"gap", 0.010}});
  distances.push_back({{"normal", 0}, {"across", 5}, {"gap", 0.010}});
  return {
      {"spinning_box", "angular momentum is conserved", spins, spinning_box},
      {"galilean_boost", "a velocity common to hand and block changes no force", boosts, galilean_boost},
      {"galilean_distance", "no force at a distance", distances, galilean_distance},
      {"pinch_threshold", "m g/(2 N)", {{{"mass", 0.05}}, {{"mass", 0.1}}}, pinch_threshold, 1},
  };
}

}  // namespace softhand::verification
