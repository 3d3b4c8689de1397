// Contact and friction over time: three nodes of skin on a plane (eqs. 32, 33), and whole objects on the planes of the
// world.
#include <memory>
#include <vector>

#include "energies/contact.hpp"
#include "energies/friction.hpp"
#include "energies/inertia.hpp"
#include "energies/plane_contact.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "scene/hand_simulation.hpp"
#include "support/box_mesh.hpp"
#include "support/node_contact.hpp"
#include "verification/cases.hpp"

namespace softhand::verification {
namespace {

Shape shape_of(ShapeKind kind, const Vec3& size = {}) {
  Shape shape;
  shape.kind = static_cast<std::uint32_t>(kind);
  shape.size = size;
  return shape;
}

/// One triangle of skin over a fixed plane through the origin with normal +Y. The three nodes are independent masses.
/// Gravity leans by `angle` towards +X.
class SkinOnPlane {
 public:
  SkinOnPlane(double friction, double stiffness, double mass, double angle)
      : plane_(shape_of(ShapeKind::plane)),
        contacts_(testing::contact_at_nodes(triangle(), std::vector<double>(3, mass)), 3,
                  testing::contact_stiffness(triangle(), stiffness), 0, 1, 1),
        contact_(contacts_),
        friction_(contacts_),
        inertia_(std::vector<double>(3, mass), 1) {
    contacts_.set_object(0, &plane_, friction, 1, ContactObject::fixed);
    inertia_.set_node_gravity(kGravity * Vector3(std::sin(angle), -std::cos(angle), 0));
    const HandModel skin = triangle();
    state_ = testing::rest_state(skin);
    state_.body_poses.resize(1);
    state_.body_velocities.resize(1);
    solver_ = std::make_unique<NewtonSolver>(std::vector<Energy*>{&inertia_, &contact_, &friction_}, state_.layout(),
                                             converging());
  }
  void run(double seconds, double time_step) {
    const long steps = std::lround(seconds / time_step);
    for (long i = 0; i < steps; ++i) solver_->step(state_, time_step);
  }
  void set_height(double height) { state_.node_positions.row(1).setConstant(height); }
  void set_velocity(int axis, double velocity) { state_.node_velocities.row(axis).setConstant(velocity); }
  Vector3 position() const { return state_.node_positions.col(0); }
  Vector3 velocity() const { return state_.node_velocities.col(0); }

 private:
  static HandModel triangle() {
    HandModel skin;
    skin.nodes = {Vector3(0, 0, 0), Vector3(0, 0, 0.01), Vector3(0.01, 0, 0)};
    skin.surface = {{0, 1, 2}};
    skin.node_body.assign(3, static_cast<std::uint8_t>(index_of(Body::index_distal)));
    return skin;
  }
  ShapeGeometry plane_;
  ContactSet contacts_;
  ContactEnergy contact_;
  FrictionEnergy friction_;
  Inertia inertia_;
  State state_;
  std::unique_ptr<NewtonSolver> solver_;
};

constexpr double kNodeMass = 0.01;         // kg
constexpr double kContactStiffness = 500;  // N/m
constexpr double kStep = 1.0 / 90;         // s

std::vector<Measurement> rest_depth(const Parameters& p) {
  SkinOnPlane skin(0.5, p["stiffness"], p["mass"], 0);
  skin.set_height(0.002);
  skin.run(30, kStep);
  const double reference = p["mass"] * kGravity / p["stiffness"];
  return {{"depth at rest", -skin.position().y(), reference, 1e-6 * reference, "m", {}}};
}

std::vector<Measurement> impact_depth(const Parameters& p) {
  const double m = p["mass"], k = p["stiffness"], v = p["speed"], d0 = m * kGravity / k;
  const auto deepest = [&](double time_step) {
    SkinOnPlane skin(0, k, m, 0);
    skin.set_height(1e-12);
    skin.set_velocity(1, -v);
    double depth = 0, last = 0;
    for (;;) {
      skin.run(time_step, time_step);
      last = -skin.position().y();
      if (last < depth) return depth;
      depth = last;
    }
  };
  return {time_limit("deepest", d0 + std::sqrt(d0 * d0 + m * v * v / k), "m", p["time_step"], deepest)};
}

// Finds the steepest slope on which the skin comes to rest, by bisection.
std::vector<Measurement> threshold(const Parameters& p) {
  const double mu = p["friction"];
  double low = 0.9 * mu, high = 1.1 * mu;
  for (int i = 0; i < 12; ++i) {
    const double slope = 0.5 * (low + high);
    SkinOnPlane skin(mu, kContactStiffness, kNodeMass, std::atan(slope));
    skin.run(20, kStep);
    (skin.velocity().norm() < 1e-4 ? low : high) = slope;
  }
  return {{"steepest slope that sticks", 0.5 * (low + high), mu, 1e-3 * mu, "1", {}}};
}

std::vector<Measurement> slide(const Parameters& p) {
  const double angle = std::atan(p["slope"]), mu = p["friction"];
  SkinOnPlane skin(mu, kContactStiffness, kNodeMass, angle);
  skin.run(2, kStep);
  const double before = skin.velocity().x();
  skin.run(1, kStep);
  const double reference = kGravity * (std::sin(angle) - mu * std::cos(angle));
  return {{"acceleration", skin.velocity().x() - before, reference, 0.01 * reference, "m/s^2", {}}};
}

std::vector<Measurement> stop(const Parameters& p) {
  const double v = p["speed"], mu = p["friction"], reference = v * v / (2 * mu * kGravity), time_step = p["time_step"];
  const auto distance = [&](double dt) {
    SkinOnPlane skin(mu, kContactStiffness, kNodeMass, 0);
    skin.set_height(-kNodeMass * kGravity / kContactStiffness);  // starts at rest
    skin.run(2, kStep);
    const double start = skin.position().x();
    skin.set_velocity(0, v);
    skin.run(1.5 * v / (mu * kGravity), dt);
    return skin.position().x() - start;
  };
  const double fine = distance(time_step);
  return {time_limit("distance to stop", reference, "m", time_step, distance),
          {"how much backward Euler stops short", reference - fine, v * time_step / 2, 0.01 * reference, "m", {}}};
}

std::vector<Measurement> skin_creep(const Parameters& p) {
  SkinOnPlane skin(p["friction"], kContactStiffness, kNodeMass, std::atan(p["slope"]));
  skin.run(20, kStep);
  const Vector3 start = skin.position();
  skin.run(p["seconds"], kStep);
  return {{"creep", (skin.position() - start).norm() / p["seconds"], 0, 1e-6, "m/s", {}}};
}

/// An object of `mass` on a plane of the world, as the hand's twin of the object meets it.
class ObjectOnPlane {
 public:
  ObjectOnPlane(const Shape& shape, const Pose& pose, double mass, double friction, double slope,
                std::int64_t iterations)
      : shape_(shape), inertia_({1.0}, 1), planes_({1, 1}, 0, 1) {
    const double angle = std::atan(slope);
    const Vector3 gravity = kGravity * Vector3(std::sin(angle), -std::cos(angle), 0);
    state_.node_positions = Eigen::Matrix3Xd::Constant(3, 1, 10.0);
    state_.node_velocities = Eigen::Matrix3Xd::Zero(3, 1);
    state_.body_poses = {pose};
    state_.body_velocities.resize(1);
    inertia_.set_dynamic(0, mass, mass / shape_.solid().volume * shape_.solid().inertia, gravity);
    planes_.set_object(0, &shape_, mass, mass * kGravity);
    NeighbourPlane plane;
    plane.neighbour = 9;
    plane.normal = to_wire(Vector3(0, 1, 0));
    plane.friction = friction;
    planes_.set_planes(0, {&plane, 1});
    SolverOptions options = converging();
    options.max_iterations = iterations;
    solver_ = std::make_unique<NewtonSolver>(std::vector<Energy*>{&inertia_, &planes_}, state_.layout(), options);
  }
  void run(double seconds) {
    const long steps = std::lround(seconds / kStep);
    for (long i = 0; i < steps; ++i) solver_->step(state_, kStep);
  }
  Vector3 position() const { return state_.body_poses[0].position; }
  Vector3 velocity() const { return state_.body_velocities[0].linear; }

 private:
  ShapeGeometry shape_;
  Inertia inertia_;
  PlaneContact planes_;
  State state_;
  std::unique_ptr<NewtonSolver> solver_;
};

// A capsule that lies along the slope, so that it does not roll. In MuJoCo issue 3328, such a capsule of 45 g at mu 0.7
// creeps 50 to 155 um/s.
std::vector<Measurement> capsule_creep(const Parameters& p) {
  const Pose lying{Vector3(0, 0.015, 0), rotation_exp(Vector3(0, 0, M_PI / 2))};
  ObjectOnPlane capsule(shape_of(ShapeKind::capsule, {0.015, 0.04, 0}), lying, p["mass"], p["friction"], p["slope"],
                        p.whole("iterations"));
  capsule.run(20);
  const Vector3 start = capsule.position();
  capsule.run(p["seconds"]);
  return {{"creep", (capsule.position() - start).norm() / p["seconds"], 0, 1e-6, "m/s", {}}};
}

// A tile low enough not to tip.
Shape tile() { return shape_of(ShapeKind::box, {0.04, 0.005, 0.04}); }

std::vector<Measurement> object_rest_depth(const Parameters& p) {
  ObjectOnPlane object(tile(), {Vector3(0, 0.01, 0), Quaternion::Identity()}, p["mass"], 0.5, 0, 200);
  object.run(10);
  const double weight = p["mass"] * kGravity, reference = weight / std::max(1e4, (weight + 5) / 0.5e-3);
  return {{"depth at rest", 0.005 - object.position().y(), reference, 1e-6 * reference, "m", {}}};
}

std::vector<Measurement> object_slide(const Parameters& p) {
  const double angle = std::atan(p["slope"]), mu = p["friction"];
  ObjectOnPlane object(tile(), {Vector3(0, 0.005, 0), Quaternion::Identity()}, 0.05, mu, p["slope"], 200);
  object.run(2);
  const double before = object.velocity().x();
  object.run(1);
  const double reference = kGravity * (std::sin(angle) - mu * std::cos(angle));
  return {{"acceleration", object.velocity().x() - before, reference, 0.01 * reference, "m/s^2", {}}};
}

// Scales all tissue of a shipped hand along one axis about its middle. A scale of 0 collapses the tissue to a plane,
// and -1 mirrors it. The palm nearly touches a sphere of 100 g and 30 mm.
std::vector<Measurement> recovery(const Parameters& p) {
  constexpr double kGap = 1e-3, kRadius = 0.03, kMass = 0.1;  // m, m, kg
  const HandModel hand = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  const ShapeGeometry sphere(shape_of(ShapeKind::sphere, {kRadius, 0, 0}));
  HandSimulation simulation(hand, {}, 1, 1);
  for (int b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    simulation.set_target(body, hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(body)))], {});
  }
  const Eigen::Matrix3Xd rest = simulation.state().node_positions;
  const int slot = p.whole("free") != 0 ? 0 : 1;
  Vector3 place = hand.rest_joints[static_cast<std::size_t>(index_of(Joint::palm))].position - Vector3(0, 0.1, 0);
  for (int i = 0; i < 50; ++i) place.y() += (rest.colwise() - place).colwise().norm().minCoeff() - kRadius - kGap;
  simulation.set_slot(slot, {1, &sphere, kMass, 0.4 * kMass * kRadius * kRadius * Matrix3::Identity(), 0.8});
  simulation.set_slot_motion(slot, {place, Quaternion::Identity()}, {});
  if (slot == 0) simulation.make_dynamic(slot, Vector3::Zero());
  State state = simulation.state();
  const double middle = rest.row(p.whole("axis")).mean();
  state.node_positions.row(p.whole("axis")).array() =
      middle + p["scale"] * (rest.row(p.whole("axis")).array() - middle);
  const double before = (state.node_positions - rest).norm();
  simulation.restore(state);
  double fastest = 0;
  for (int i = 0; i < 90; ++i) {
    simulation.step(1.0 / 90);
    fastest = std::max(fastest, simulation.slot_velocity(slot).linear.norm());
  }
  return {{"distance left after 1 s", (simulation.state().node_positions - rest).norm() / before, 0, 0.05, "1", {}},
          {"inverted tetrahedra after 1 s", static_cast<double>(simulation.inverted_elements()), 0, 0, "1", {}},
          {"largest speed of the object", fastest, 0, 1, "m/s", {}}};
}

}  // namespace

std::vector<Case> contact_cases() {
  std::vector<Parameters> capsules;
  for (const double iterations : {1.0, 2.0, 3.0, 5.0, 10.0, 200.0}) {
    capsules.push_back(
        {{"mass", 0.045}, {"friction", 0.7}, {"slope", 0.35}, {"seconds", 20}, {"iterations", iterations}});
  }
  std::vector<Parameters> recoveries;
  for (const double free : {0.0, 1.0}) {
    for (const double scale : {0.0, -1.0}) {
      for (const double axis : {0.0, 1.0, 2.0})
        recoveries.push_back({{"free", free}, {"scale", scale}, {"axis", axis}});
    }
  }
  return {
      {"tissue_recovery", "95 % of the distance is recovered in 1 s, and an object in the palm stays below 1 m/s",
       recoveries, recovery},
      {"contact_rest_depth", "m g/k", {{{"mass", kNodeMass}, {"stiffness", kContactStiffness}}}, rest_depth},
      {"contact_impact_depth",
       "d0 + sqrt(d0^2 + m v^2/k), d0 = m g/k",
       {{{"mass", kNodeMass}, {"stiffness", kContactStiffness}, {"speed", 0.3}, {"time_step", 1e-5}}},
       impact_depth},
      {"friction_threshold",
       "sticks while tan theta < mu",
       {{{"friction", 0.5}}, {{"friction", 0.2}}, {{"friction", 1.2}}},
       threshold},
      {"friction_slide",
       "g (sin theta - mu cos theta)",
       {{{"slope", 0.5}, {"friction", 0.49}}, {{"slope", 0.8}, {"friction", 0.3}}},
       slide},
      {"friction_stop",
       "v^2/(2 mu g), with backward Euler v h/2 less",
       {{{"speed", 1}, {"friction", 0.5}, {"time_step", 1e-3}}, {{"speed", 2}, {"friction", 0.4}, {"time_step", 1e-3}}},
       stop},
      {"friction_creep", "<= 1 um/s", {{{"friction", 0.5}, {"slope", 0.49}, {"seconds", 10}}}, skin_creep},
      {"object_rest_depth",
       "m g/k_A, k_A = max(10 kN/m, (m g + 5 N)/0.5 mm)",
       {{{"mass", 0.05}}, {{"mass", 1}}},
       object_rest_depth},
      {"object_slide", "g (sin theta - mu cos theta)", {{{"slope", 0.5}, {"friction", 0.49}}}, object_slide},
      {"object_creep", "<= 1 um/s for a lying capsule, at every iteration limit", capsules, capsule_creep},
  };
}

}  // namespace softhand::verification
