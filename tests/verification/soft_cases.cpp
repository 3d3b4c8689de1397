// Flexible objects in the hand's simulation: a cube under its own weight, a beam on two fingers, and spheres in Hertz
// contact.
#include <algorithm>
#include <map>
#include <memory>
#include <vector>

#include "geometry/shape.hpp"
#include "scene/hand_simulation.hpp"
#include "support/block_hand.hpp"
#include "support/soft_bodies.hpp"
#include "verification/cases.hpp"

namespace softhand::verification {
namespace {

using testing::soft_box;
using testing::soft_material;

constexpr double kEdge = 0.04;       // m, of the cube
constexpr double kDensity = 100;     // kg/m^3
constexpr double kRadius = 0.025;    // m, of a sphere
constexpr double kThickness = 0.02;  // m, half of a plate

// A simulation whose hand is far away, with static plates in its slots.
std::unique_ptr<HandSimulation> far_from_the_hand(std::vector<SoftObject> objects, int plates,
                                                  double residual_tolerance, const char* factor = "float") {
  SimulationOptions options;
  options.solver.max_iterations = 200;
  options.solver.residual_tolerance = residual_tolerance;
  options.solver.movement_tolerance = 1;
  options.solver.increment_tolerance = 1e-13;
  options.solver.factor = factor;
  auto simulation = std::make_unique<HandSimulation>(testing::block_hand(), options, 0, plates, ObjectSpring{}, 0,
                                                     std::move(objects));
  simulation->reposition({.position = {0, 2, 0}});
  return simulation;
}

const ShapeGeometry& plate() {
  static const ShapeGeometry shape(testing::box_shape({0.2, kThickness, 0.2}));
  return shape;
}

// The plate has its middle at `height` and moves by `speed`, upwards.
void set_plate(HandSimulation& simulation, int slot, double height, double speed) {
  simulation.set_slot_motion(slot, {.position = {0, height, 0}}, {.linear = {0, speed, 0}});
}

// Mean height of the nodes that are at `rest_height` above the middle of the cube at rest.
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

std::vector<Measurement> cube_under_its_weight(const Parameters& p) {
  const double modulus = p["E"];
  SoftObject cube{"cube", soft_box({6, 6, 6}, Vector3::Constant(kEdge), soft_material(modulus, 0.0, kDensity), 0.0),
                  Pose{.position = {0, 0.5 * kEdge, 0}}, Vector3(0, -kGravity, 0)};
  const auto simulation = far_from_the_hand({cube}, 1, 1e-8);
  simulation->set_slot(0, {.id = 1, .shape = &plate(), .friction = 0});
  set_plate(*simulation, 0, -kThickness, 0);
  for (int i = 0; i < 100; ++i) simulation->step(0.05);
  const double reference = kDensity * kGravity * kEdge * kEdge / (2 * modulus);
  const double height = mean_height(*simulation, 0.5 * kEdge) - mean_height(*simulation, -0.5 * kEdge);
  const double weight = simulation->soft()->mass(0) * kGravity;
  std::vector<Measurement> rows{
      {"force on the table over the weight", -simulation->contact_wrench(0).force.y() / weight, 1, 0.01, "1", {}}};
  // The table's contact sinks by rho g h/k_c, and not evenly, because corners have less mass for their area. A
  // shortening of this size cannot be told from it.
  const double sink = kDensity * kGravity * kEdge / SimulationOptions().contact_stiffness;
  if (reference > 10 * sink) rows.push_back({"shortening", kEdge - height, reference, 0.01 * reference, "m", {}});
  return rows;
}

// A beam lies on two fixed fingers, on rows of nodes. One finger has friction, so that the beam neither slides nor
// is held along its axis. Returns the sag of its middle below the fingers, at half its height, and the fingers' share
// of the weight.
struct Sag {
  double sag, on_fingers;
};
constexpr double kSpan = 0.08, kOverhang = 0.01, kHeight = 0.01, kFinger = 0.008;  // m

Sag sag_of_beam(double modulus, int cells) {
  const double length = kSpan + 2 * kOverhang, width = 0.5 * kHeight;
  const int along = static_cast<int>(std::lround(length / kHeight)) * cells;
  // With nu = 0 nothing depends on the place across the beam, so one brick is enough there.
  const auto body = soft_box({along, cells, 1}, {length, kHeight, width}, soft_material(modulus, 0.0, kDensity));
  SoftObject beam{"beam", body, Pose{.position = {0, 0.5 * kHeight, 0}}, Vector3(0, -kGravity, 0)};
  // A float factor takes twenty times as long: bending is far softer than stretching.
  const auto simulation = far_from_the_hand({beam}, 2, 1e-7, "double");
  static const ShapeGeometry finger = [] {
    Shape shape;
    shape.kind = static_cast<std::uint32_t>(ShapeKind::capsule);
    shape.size = {kFinger, 0.02, 0};
    return ShapeGeometry(shape);
  }();
  const Quaternion across(Eigen::AngleAxisd(0.5 * M_PI, Vector3::UnitX()));
  for (int slot = 0; slot < 2; ++slot) {
    simulation->set_slot(slot, {.id = 1, .shape = &finger, .friction = slot == 0 ? 0.8 : 0});
    simulation->set_slot_motion(slot, {{(slot - 0.5) * kSpan, -kFinger, 0}, across}, {});
  }
  for (int i = 0; i < 40; ++i) simulation->step(0.05);
  const auto height = [&](double x) {
    double sum = 0, count = 0;
    for (std::size_t n = 0; n < body->nodes.size(); ++n) {
      if (std::abs(body->nodes[n].x() - x) > 1e-9 || std::abs(body->nodes[n].y()) > 1e-9) continue;
      sum += simulation->state().node_positions(1, simulation->soft()->first_node(0) + static_cast<Eigen::Index>(n));
      ++count;
    }
    return sum / count;
  };
  const double weight = simulation->soft()->mass(0) * kGravity;
  return {0.5 * (height(-0.5 * kSpan) + height(0.5 * kSpan)) - height(0),
          -(simulation->contact_wrench(0).force.y() + simulation->contact_wrench(1).force.y()) / weight};
}

std::vector<Measurement> beam_on_two_fingers(const Parameters& p) {
  const double modulus = p["E"];
  const int cells = p.whole("cells");
  const Sag coarse = sag_of_beam(modulus, cells), middle = sag_of_beam(modulus, 2 * cells),
            fine = sag_of_beam(modulus, 4 * cells);
  // Linear elements are too stiff in bending, in proportion to the square of their size. So the limit is that of 1/sag.
  const Richardson result = extrapolate(1 / coarse.sag, 1 / middle.sag, 1 / fine.sag, 2);
  // Timoshenko's beam: bending with two overhangs, and shear with kappa = 5/6 (Cowper 1966, nu = 0).
  const double load = kDensity * kGravity / (modulus * kHeight * kHeight);  // q/(12 E I) = q/(E A) / h^2, 1/m^3
  const double span2 = kSpan * kSpan, overhang2 = kOverhang * kOverhang;
  const double bending = 12 * load * span2 * (5 * span2 - 24 * overhang2) / 384;
  const double shear = load * kHeight * kHeight * span2 / (8 * (5.0 / 6) * 0.5);
  const double reference = bending + shear;
  return {{"sag between the fingers, limit of the mesh", 1 / result.limit, reference, 0.01 * reference, "m",
           Order{result.order, 2, 0.2}},
          {"force on the fingers over the weight", fine.on_fingers, 1, 0.01, "1", {}}};
}

// Layers of a subdivided icosahedron around a middle node, which is node 0. Each prism between two layers is three
// tetrahedra.
std::shared_ptr<const SoftBody> soft_sphere(int subdivisions, const Material& material) {
  const double golden = 0.5 * (1 + std::sqrt(5.0));
  std::vector<Vector3> skin;
  for (const double a : {-1.0, 1.0}) {
    for (const double b : {-golden, golden}) {
      skin.emplace_back(0, a, b);
      skin.emplace_back(a, b, 0);
      skin.emplace_back(b, 0, a);
    }
  }
  std::vector<std::array<std::int32_t, 3>> faces;
  const auto count = static_cast<std::int32_t>(skin.size());
  const auto near = [&skin](std::int32_t a, std::int32_t b) {
    return (skin[static_cast<std::size_t>(a)] - skin[static_cast<std::size_t>(b)]).norm() < 2.1;
  };
  for (std::int32_t a = 0; a < count; ++a) {
    for (std::int32_t b = a + 1; b < count; ++b) {
      for (std::int32_t c = b + 1; c < count; ++c) {
        if (near(a, b) && near(b, c) && near(a, c)) faces.push_back({a, b, c});
      }
    }
  }
  for (int level = 0; level < subdivisions; ++level) {
    std::map<std::pair<std::int32_t, std::int32_t>, std::int32_t> middles;
    const auto middle = [&](std::int32_t a, std::int32_t b) {
      const auto [found, fresh] = middles.try_emplace(std::minmax(a, b), static_cast<std::int32_t>(skin.size()));
      if (fresh)
        skin.push_back((skin[static_cast<std::size_t>(a)].normalized() + skin[static_cast<std::size_t>(b)].normalized())
                           .normalized());
      return found->second;
    };
    std::vector<std::array<std::int32_t, 3>> finer;
    for (const auto& [a, b, c] : faces) {
      const std::int32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
    faces = std::move(finer);
  }
  const std::vector<double> radii{1, 0.9, 0.79, 0.67, 0.53, 0.38, 0.22};
  auto body = std::make_shared<SoftBody>();
  body->material = material;
  body->nodes.push_back(Vector3::Zero());
  for (const double radius : radii) {
    for (const Vector3& x : skin) body->nodes.push_back(kRadius * radius * x.normalized());
  }
  const auto add = [&body](std::array<std::int32_t, 4> t) {
    if (tetrahedron_volume(body->nodes, t) < 0) std::swap(t[2], t[3]);
    body->tetrahedra.push_back(t);
  };
  const auto per_layer = static_cast<std::int32_t>(skin.size());
  for (auto face : faces) {
    std::sort(face.begin(), face.end());  // neighbouring prisms then split their common side in the same way
    for (std::int32_t layer = 0; layer + 1 < static_cast<std::int32_t>(radii.size()); ++layer) {
      std::array<std::int32_t, 3> outer{}, inner{};
      for (std::size_t k = 0; k < 3; ++k) {
        outer[k] = 1 + layer * per_layer + face[k];
        inner[k] = outer[k] + per_layer;
      }
      add({outer[0], outer[1], outer[2], inner[2]});
      add({outer[0], outer[1], inner[1], inner[2]});
      add({outer[0], inner[0], inner[1], inner[2]});
    }
    const std::int32_t last = 1 + (static_cast<std::int32_t>(radii.size()) - 1) * per_layer;
    add({0, last + face[0], last + face[1], last + face[2]});
  }
  return body;
}

// The plates in slots 0 and 1 are below and above something of this height, and press it flatter by `by`.
void press(HandSimulation& simulation, double height, double by) {
  constexpr int kSteps = 8, kRest = 8;
  constexpr double kTimeStep = 0.05;
  const double top = height + kThickness;
  set_plate(simulation, 0, -kThickness, 0);
  set_plate(simulation, 1, top, -by / (kSteps * kTimeStep));
  for (int i = 0; i < kSteps; ++i) simulation.step(kTimeStep);
  set_plate(simulation, 1, top - by, 0);
  for (int i = 0; i < kRest; ++i) simulation.step(kTimeStep);
}

// Turns a `soft_sphere` so that the middle of a triangle is on top, and of another one at the bottom. On an edge or a
// node it rolls to a softer side, and the force depends on how far it came.
Quaternion on_a_triangle() { return Quaternion::FromTwoVectors(Vector3::Ones(), Vector3::UnitY()); }

// Two plates press a sphere. Their friction keeps it from rolling. Hertz measures the approach to a far point of a
// half-space. The middle of a sphere is only R away, so it moves less, and the sphere looks stiffer by about a tenth.
std::vector<Measurement> soft_hertz(const Parameters& p) {
  const double modulus = p["E"], ratio = p["nu"], approach = p["approach"] * kRadius;
  const auto body = soft_sphere(p.whole("subdivisions"), soft_material(modulus, ratio, kDensity));
  const auto simulation =
      far_from_the_hand({{"sphere", body, Pose{{0, kRadius, 0}, on_a_triangle()}, Vector3::Zero()}}, 2, 1e-4);
  for (int slot = 0; slot < 2; ++slot) simulation->set_slot(slot, {.id = 1, .shape = &plate(), .friction = 0.5});
  press(*simulation, 2 * kRadius, 2 * approach);
  const double depth = kRadius - simulation->state().node_positions(1, simulation->soft()->first_node(0));
  const double reference = 4.0 / 3 * modulus / (1 - ratio * ratio) * std::sqrt(kRadius) * std::pow(depth, 1.5);
  const double below = -simulation->contact_wrench(0).force.y(), above = simulation->contact_wrench(1).force.y();
  return {{"force on the lower plate", below, reference, 0.15 * reference, "N", {}},
          {"force on the upper plate over it", above / below, 1, 0.001, "1", {}}};
}

// Two equal spheres, one on the other, between two plates. The lower one is turned about the upright axis, so the nodes
// do not meet. Equal spheres flatten each other like rigid plates, so Hertz's law holds for half of the approach of the
// middles.
std::vector<Measurement> two_spheres(const Parameters& p) {
  const double modulus = p["E"], ratio = p["nu"], approach = p["approach"] * kRadius;
  auto body =
      std::make_shared<SoftBody>(*soft_sphere(p.whole("subdivisions"), soft_material(modulus, ratio, kDensity)));
  body->friction = 0.5;  // one sphere does not slip off the other
  const Quaternion turned = Quaternion(Eigen::AngleAxisd(0.7, Vector3::UnitY())) * on_a_triangle();
  const auto simulation =
      far_from_the_hand({{"lower", body, Pose{.position = {0, kRadius, 0}, .orientation = turned}, Vector3::Zero()},
                         {"upper", body, Pose{{0, 3 * kRadius, 0}, on_a_triangle()}, Vector3::Zero()}},
                        2, 1e-4);
  for (int slot = 0; slot < 2; ++slot) simulation->set_slot(slot, {.id = 1, .shape = &plate(), .friction = 0.5});
  press(*simulation, 4 * kRadius, 4 * approach);
  const SoftObjects& soft = *simulation->soft();
  const auto middle = [&](int object) {
    return Vector3(simulation->state().node_positions.col(soft.first_node(object)));
  };
  const double depth = 2 * kRadius - (middle(1) - middle(0)).norm();
  const double reference =
      4.0 / 3 * modulus / (2 * (1 - ratio * ratio)) * std::sqrt(0.5 * kRadius) * std::pow(depth, 1.5);
  const double between = soft.skin_force(1).y();
  return {{"force between the spheres", between, reference, 0.15 * reference, "N", {}},
          {"force on the upper plate over it", simulation->contact_wrench(1).force.y() / between, 1, 0.001, "1", {}},
          {"approach of the middles", depth, 2 * approach, 0.1 * approach, "m", {}}};
}

}  // namespace

std::vector<Case> soft_cases() {
  // The finer spheres compute ten times as long.
  const std::vector<Parameters> spheres{{{"E", 1e5}, {"nu", 0.3}, {"approach", 0.05}, {"subdivisions", 2}},
                                        {{"E", 1e5}, {"nu", 0.3}, {"approach", 0.05}, {"subdivisions", 3}}};
  return {{"soft_cube_under_its_weight",
           "shortening = rho g h^2/(2 E) with nu = 0; force on the table = m g",
           {{{"E", 1e4}}, {{"E", 1e3}}, {{"E", 1e5}}, {{"E", 1e6}}, {{"E", 1e7}}},
           cube_under_its_weight,
           1},
          {"soft_beam_on_two_fingers",
           "sag = q s^2 (5 s^2 - 24 a^2)/(384 E I) + q s^2/(8 kappa G A), s: span, a: overhang, kappa = 5/6, nu = 0",
           {{{"E", 1e6}, {"cells", 2}}, {{"E", 1e7}, {"cells", 2}}},
           beam_on_two_fingers,
           1},
          {"soft_sphere_hertz", "F = 4/3 E/(1 - nu^2) sqrt(R) d^1.5, d: approach of the middle to the plate", spheres,
           soft_hertz, 1},
          {"two_soft_spheres_hertz", "F = 4/3 E/(2 (1 - nu^2)) sqrt(R/2) d^1.5, d: approach of the middles", spheres,
           two_spheres, 1}};
}

}  // namespace softhand::verification
