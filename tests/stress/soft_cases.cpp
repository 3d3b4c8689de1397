// Flexible objects: far softer and far stiffer than the skin, thin, and turned inside out.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "contact/contact_point.hpp"
#include "geometry/shape.hpp"
#include "stress/cases.hpp"
#include "stress/hand_events.hpp"
#include "stress/watch.hpp"
#include "support/soft_bodies.hpp"
#include "trackers/replay/motion.hpp"

namespace softhand::stress {
namespace {

using testing::soft_box;
using testing::soft_material;

constexpr double kEdge = 0.04;  // m, of the cube

const ShapeGeometry& table() {
  static const ShapeGeometry shape(box_shape({0.2, 0.02, 0.2}));
  return shape;
}

// Mean height of the object's nodes that are at `rest_height` in its own frame at rest, m.
double mean_height(const HandSimulation& simulation, double rest_height) {
  const SoftObjects& soft = *simulation.soft();
  const std::vector<Vector3>& rest = soft.object(0).body->nodes;
  double sum = 0, count = 0;
  for (std::size_t n = 0; n < rest.size(); ++n) {
    if (std::abs(rest[n].y() - rest_height) > 1e-9) continue;
    sum += simulation.state().node_positions(1, soft.first_node(0) + static_cast<Eigen::Index>(n));
    ++count;
  }
  return sum / count;
}

// The index finger presses an object on a table from 0.5 s on. From 1.5 s on it goes back. `height`: of the object at
// rest. `depth`: by which the targets of the bones pass its top, m. `least_force`: of the finger, N. `aside`: the place
// of the pad over the object's middle, m.
Findings pressed_on_table(std::shared_ptr<const SoftBody> body, double height, double depth, double least_force,
                          const Vector3& aside = Vector3::Zero(), double work_budget = 0) {
  constexpr double kGap = 2e-3, kBegin = 0.5, kEnd = 1.5, kMove = 0.3, kSeconds = 3;  // m, s
  const HandModel hand = one_finger(shipped_hand(), Finger::index);
  const Vector3 top = pad_of(hand, Finger::index) - Vector3(0, kGap, 0);
  const double table_height = top.y() - height;
  SoftObject object{"object", std::move(body), Pose{.position = top - aside - Vector3(0, 0.5 * height, 0)},
                    testing::kGravity};
  SimulationOptions options;
  options.solver.work_budget = work_budget;
  HandSimulation simulation(hand, options, 0, 1, ObjectSpring{}, 0, {std::move(object)});
  simulation.enable_ledger(true);
  simulation.set_slot(0, {.id = 1, .shape = &table(), .friction = 0.8});
  simulation.set_slot_motion(0, {.position = {top.x(), table_height - 0.02, top.z()}}, {});
  const auto down = [=](double time) {
    return (kGap + depth) * (minimum_jerk((time - kBegin) / kMove) - minimum_jerk((time - kEnd) / kMove));
  };
  const ContactPoints points(hand, lumped_masses(hand));
  HandWatch watch;
  double before = 0, force = 0, lowest = std::numeric_limits<double>::infinity();
  for (double time = 0; time < kSeconds; time += kStep) {
    constexpr double kSmall = 1e-6;  // s
    hold_bones(simulation, {Vector3(0, -down(time), 0), Vector3(0, (down(time) - down(time + kSmall)) / kSmall, 0)});
    watch.after_step(simulation, simulation.step(kStep), kStep);
    if (time < kBegin) before = mean_height(simulation, 0.5 * height) - mean_height(simulation, -0.5 * height);
    force = std::max(force, -simulation.soft()->skin_force(0).y());
    for (int i = 0; i < points.count(); ++i)
      lowest = std::min(lowest, points.at(i, simulation.state().node_positions).y() - table_height);
  }
  const double after = mean_height(simulation, 0.5 * height) - mean_height(simulation, -0.5 * height);
  Findings findings;
  watch.judge(simulation, findings);
  findings.demand_at_least("pressed", "largest force of the finger", force, least_force, "N");
  findings.demand_at_least("above the table", "lowest place of the finger's skin over the table", lowest * 1e3, -0.5,
                           "mm");
  findings.demand("recovers", "change of the object's height over the height", std::abs(after / before - 1), 0.02, "1");
  return findings;
}

// A stiff cube is pressed by less: the half-closed finger meets it with its tip, where there is little tissue.
Findings pressed_cube(double youngs_modulus, double density, const Vector3& aside = Vector3::Zero(),
                      double work_budget = 0) {
  const double depth = youngs_modulus < 5e4 ? 0.01 : 0.0025, evenly_pressed = youngs_modulus * kEdge * depth;
  return pressed_on_table(soft_box({5, 5, 5}, Vector3::Constant(kEdge), soft_material(youngs_modulus, 0.3, density)),
                          kEdge, depth, std::min(0.05 * evenly_pressed, 0.5), aside, work_budget);
}

Findings pressed_sheet(double thickness) {
  return pressed_on_table(soft_box({12, 1, 12}, {0.06, thickness, 0.06}, soft_material(1e5)), thickness, 2e-3, 0.5);
}

// Of the finest hand. Coarse meshes are too stiff, so their materials have smaller moduli.
double softest_tissue() {
  const HandModel finest = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_6000.hand.json");
  double least = std::numeric_limits<double>::infinity();
  for (const Material& material : finest.materials) least = std::min(least, material.youngs_modulus);
  return least;
}

// A cube far from the hand starts as its own mirror image. All its elements are inverted, and each edge has its length.
Findings inside_out(double youngs_modulus) {
  constexpr double kFar = 0.5;  // m
  SoftObject cube{"cube", soft_box({4, 4, 4}, Vector3::Constant(kEdge), soft_material(youngs_modulus)),
                  Pose{.position = {kFar, 0, 0}}, Vector3::Zero()};
  HandSimulation simulation(shipped_hand(), {}, 0, 0, ObjectSpring{}, 0, {std::move(cube)});
  simulation.enable_ledger(true);
  hold_bones(simulation, {});
  const SoftObjects& soft = *simulation.soft();
  State mirrored = simulation.state();
  for (int n = soft.first_node(0); n < soft.first_node(1); ++n)
    mirrored.node_positions(0, n) = 2 * kFar - mirrored.node_positions(0, n);
  simulation.restore(mirrored);
  HandWatch watch;
  for (int step = 0; step < 270; ++step) watch.after_step(simulation, simulation.step(kStep), kStep);
  const SoftBody& body = *soft.object(0).body;
  double worst = 0;
  for (const auto& tetrahedron : body.tetrahedra) {
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t j = i + 1; j < 4; ++j) {
        const auto now = [&](std::size_t k) {
          return Vector3(simulation.state().node_positions.col(soft.first_node(0) + tetrahedron[k]));
        };
        const auto rest = [&](std::size_t k) { return body.nodes[static_cast<std::size_t>(tetrahedron[k])]; };
        worst = std::max(worst, std::abs((now(i) - now(j)).norm() / (rest(i) - rest(j)).norm() - 1));
      }
    }
  }
  Findings findings;
  watch.judge(simulation, findings);
  findings.demand("G3", "largest relative change of an edge after 3 s", worst, 0.01, "1");
  return findings;
}

}  // namespace

std::vector<Case> soft_cases() {
  CaseList cases("Flexible objects");
  auto* rows = &cases.add("flexible_object", "a finger presses a cube on a table: the cube is felt and recovers");
  for (const double modulus : {1e3, 1e4, 1e5, 1e6, 1e7})
    rows->push_back({named("E", modulus, "Pa"), [=] { return pressed_cube(modulus, 100); }, {}, modulus == 1e3});
  rows =
      &cases.add("flexible_object_ratio", "the same, with a cube that is `ratio` times as stiff as the softest tissue");
  // The soft one is light, because its own weight would flatten it otherwise.
  for (const auto& [ratio, density] : {std::pair{1e-3, 1.0}, std::pair{1e3, 100.0}})
    rows->push_back(
        {named("ratio", ratio), [r = ratio, d = density] { return pressed_cube(r * softest_tissue(), d); }, {}, true});
  // As the finger leaves, the light cube follows by several millimetres a step.
  const Vector3 aside(-3e-3, 0, 0);
  rows->push_back(
      {"ratio = 0.001, beside its middle", [=] { return pressed_cube(1e-3 * softest_tissue(), 1, aside); }, {}, true});
  rows->push_back({"ratio = 0.001, beside its middle, budget",
                   [=] { return pressed_cube(1e-3 * softest_tissue(), 1, aside, 4); },
                   {Class::diverged, "a step that is cut off ends far from its minimum, in crushed tissue"}});
  rows = &cases.add("thin_sheet", "a finger presses a flexible sheet on a table: the sheet stays whole between them");
  for (const double millimetres : {1.0, 0.5})
    rows->push_back({named("thickness", millimetres, "mm"), [=] { return pressed_sheet(1e-3 * millimetres); }});
  rows = &cases.add("object_inside_out", "a flexible cube that starts as its mirror image recovers");
  for (const double modulus : {1e3, 1e5, 1e7})
    rows->push_back({named("E", modulus, "Pa"), [=] { return inside_out(modulus); }, {}, modulus == 1e5});
  return cases.take();
}

}  // namespace softhand::stress
