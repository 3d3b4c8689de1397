// Rigid bodies, joints and springs over time, stepped by the solver.
#include <vector>

#include "energies/body_coupling.hpp"
#include "energies/inertia.hpp"
#include "energies/joint.hpp"
#include "math/rotation.hpp"
#include "verification/cases.hpp"

namespace softhand::verification {
namespace {

State bodies_at_rest(int count) {
  State state;
  state.node_positions.resize(3, 0);
  state.node_velocities.resize(3, 0);
  state.body_poses.resize(static_cast<std::size_t>(count));
  state.body_velocities.resize(static_cast<std::size_t>(count));
  return state;
}

// A mass on a spring of eq. 18, z = omega h. Every step multiplies the energy by 1/(1 + z^2) and turns the phase by
// atan z.
std::vector<Measurement> oscillator(const Parameters& p) {
  const double z = p["z"], mass = p["mass"], time_step = 0.01, omega = z / time_step;
  State state = bodies_at_rest(1);
  Inertia inertia({}, 1);
  inertia.set_dynamic(0, mass, mass * 1e-4 * Matrix3::Identity(), Vector3::Zero());
  CouplingGains gains;
  gains.linear_stiffness = mass * omega * omega;
  BodyCoupling spring("spring", {{0, Pose{}, gains}}, state.layout());
  spring.set_target(0, Pose{}, Twist{});
  NewtonSolver solver({&inertia, &spring}, state.layout(), converging());
  state.body_poses[0].position = Vector3(0.01, 0, 0);
  const auto energy = [&] {
    return 0.5 * mass * state.body_velocities[0].linear.squaredNorm() +
           0.5 * gains.linear_stiffness * state.body_poses[0].position.squaredNorm();
  };
  const auto phase = [&] {
    return std::atan2(-state.body_velocities[0].linear.x(), omega * state.body_poses[0].position.x());
  };
  double worst_ratio = 1 / (1 + z * z), worst_phase = std::atan(z);
  for (int step = 0; step < 20; ++step) {
    const double energy_before = energy(), phase_before = phase();
    solver.step(state, time_step);
    const double ratio = energy() / energy_before, turned = std::remainder(phase() - phase_before, 2 * M_PI);
    if (std::abs(ratio - 1 / (1 + z * z)) > std::abs(worst_ratio - 1 / (1 + z * z))) worst_ratio = ratio;
    if (std::abs(turned - std::atan(z)) > std::abs(worst_phase - std::atan(z))) worst_phase = turned;
  }
  return {{"energy ratio of a step, worst of 20", worst_ratio, 1 / (1 + z * z), 1e-12, "1", {}},
          {"phase of a step, worst of 20", worst_phase, std::atan(z), 1e-12, "rad", {}}};
}

/// A body that hangs from a fixed body by a ball joint. Its centre is `length` below the joint.
struct Hanging {
  Hanging(double length, double mass, double body_inertia, double stiffness)
      : state(bodies_at_rest(2)), inertia({}, 2), joint({site(length, stiffness)}, state.layout()) {
    inertia.set_dynamic(1, mass, body_inertia * Matrix3::Identity(), Vector3(0, -kGravity, 0));
  }
  static JointSite site(double length, double stiffness) {
    JointSite site{0, 1, Pose{}, {Vector3(0, length, 0), Quaternion::Identity()}, {}};
    site.model.kind = JointKind::ball;
    site.model.position_stiffness = stiffness;
    return site;
  }
  void tilt(double angle) {
    state.body_poses[1] =
        Pose{Vector3::Zero(), rotation_exp(Vector3(0, 0, angle))} * joint.site(0).child_from_joint.inverse();
  }
  const Vector3& bob() const { return state.body_poses[1].position; }
  State state;
  Inertia inertia;
  JointEnergy joint;
};

std::vector<Measurement> joint_stretch(const Parameters& p) {
  Hanging hanging(0.05, p["mass"], 1e-4, p["stiffness"]);
  hanging.tilt(0);
  NewtonSolver solver({&hanging.inertia, &hanging.joint}, hanging.state.layout(), converging());
  for (int i = 0; i < 2000; ++i) solver.step(hanging.state, 0.1);
  const double reference = p["mass"] * kGravity / p["stiffness"];
  return {{"stretch under a hanging weight", -(hanging.bob().y() + 0.05), reference, 1e-6 * reference, "m", {}}};
}

constexpr double kBobInertia = 1e-9;     // kg m^2, of a bob of 0.1 kg: practically a point mass
constexpr double kPivotStiffness = 1e7;  // N/m

std::vector<Measurement> conical_pendulum(const Parameters& p) {
  const double length = p["length"], angle = p["degrees"] * M_PI / 180,
               reference = std::sqrt(kGravity / (length * std::cos(angle)));
  const auto rate = [&](double time_step) {
    Hanging pendulum(length, 0.1, kBobInertia, kPivotStiffness);
    pendulum.tilt(angle);
    const Vector3 spin(0, reference, 0);
    pendulum.state.body_velocities[1] = {spin.cross(pendulum.bob()), spin};
    NewtonSolver solver({&pendulum.inertia, &pendulum.joint}, pendulum.state.layout(), converging());
    double turned = 0;
    const int steps = static_cast<int>(std::lround(p["seconds"] / time_step));
    for (int i = 0; i < steps; ++i) {
      const Vector3 last = pendulum.bob();
      solver.step(pendulum.state, time_step);
      turned += std::atan2(pendulum.bob().x() * last.z() - pendulum.bob().z() * last.x(),
                           pendulum.bob().x() * last.x() + pendulum.bob().z() * last.z());
    }
    return std::abs(turned) / p["seconds"];
  };
  return {time_limit("angular rate", reference, "rad/s", p["time_step"], rate)};
}

// The period is 4 sqrt(L/g) K(sin(theta/2)). The arithmetic-geometric mean gives the complete elliptic integral K.
std::vector<Measurement> plane_pendulum(const Parameters& p) {
  const double length = p["length"], angle = p["degrees"] * M_PI / 180;
  double a = 1, b = std::cos(angle / 2);
  for (int i = 0; i < 8; ++i) {
    const double mean = 0.5 * (a + b);
    b = std::sqrt(a * b);
    a = mean;
  }
  const double reference = 2 * M_PI * std::sqrt(length / kGravity) / a;
  const auto period = [&](double time_step) {
    Hanging pendulum(length, 0.1, kBobInertia, kPivotStiffness);
    pendulum.tilt(angle);
    NewtonSolver solver({&pendulum.inertia, &pendulum.joint}, pendulum.state.layout(), converging());
    // The second passage through the lowest point is at three quarters of the period.
    int passages = 0;
    for (int i = 1; i * time_step < 2 * reference; ++i) {
      const double last = pendulum.bob().x();
      solver.step(pendulum.state, time_step);
      const double now = pendulum.bob().x();
      if (last * now < 0 && ++passages == 2) return time_step * (i - now / (now - last)) * 4 / 3;
    }
    throw std::runtime_error("the pendulum did not swing back");
  };
  return {time_limit("period", reference, "s", p["time_step"], period)};
}

/// A free body with principal inertias `moments` and initial angular velocity `spin` in body axes.
struct Top {
  Top(const Vector3& principal, const Vector3& spin)
      : moments(principal), state(bodies_at_rest(1)), inertia({}, 1), solver({&inertia}, state.layout(), converging()) {
    inertia.set_dynamic(0, 1, principal.asDiagonal(), Vector3::Zero());
    state.body_velocities[0].angular = spin;
  }
  Vector3 moments;
  State state;
  Inertia inertia;
  NewtonSolver solver;
};

Vector3 three(const Parameters& p, const std::string& key) { return {p[key + "1"], p[key + "2"], p[key + "3"]}; }

std::vector<Measurement> symmetric_top(const Parameters& p) {
  Top top(three(p, "inertia"), three(p, "spin"));
  const Vector3 momentum = top.moments.cwiseProduct(three(p, "spin"));
  const Vector3 axis = momentum.normalized();
  const double reference = momentum.norm() / top.moments[0], time_step = p["time_step"];
  const auto across = [&] {
    const Vector3 pointer = top.state.body_poses[0].orientation * Vector3::UnitZ();
    return Vector3((pointer - axis * axis.dot(pointer)).normalized());
  };
  double turned = 0;
  Vector3 last = across();
  const int steps = static_cast<int>(std::lround(2 / time_step));
  for (int i = 0; i < steps; ++i) {
    top.solver.step(top.state, time_step);
    const Vector3 now = across();
    turned += std::atan2(axis.dot(last.cross(now)), last.dot(now));
    last = now;
  }
  return {{"rate of precession", turned / (steps * time_step), reference, 0.01 * reference, "rad/s", {}}};
}

/// Times at which the spin about the middle axis changes its sign. Euler's equations are integrated by fourth-order
/// Runge-Kutta.
std::vector<double> reference_flips(const Vector3& moments, const Vector3& spin, double seconds) {
  const auto rate = [&moments](const Vector3& w) {
    return Vector3(moments.cwiseProduct(w).cross(w).cwiseQuotient(moments));
  };
  constexpr double h = 1e-3;
  std::vector<double> flips;
  Vector3 w = spin;
  for (int i = 1; i * h < seconds; ++i) {
    const double last = w.y();
    const Vector3 k1 = rate(w), k2 = rate(w + h / 2 * k1), k3 = rate(w + h / 2 * k2), k4 = rate(w + h * k3);
    w += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    if (last * w.y() < 0) flips.push_back(h * (i - w.y() / (w.y() - last)));
  }
  return flips;
}

std::vector<Measurement> tumbling(const Parameters& p) {
  Top top(three(p, "inertia"), three(p, "spin"));
  const std::vector<double> expected = reference_flips(top.moments, three(p, "spin"), p["seconds"]);
  std::vector<double> flips;
  double last = top.state.body_velocities[0].angular.y();
  for (int i = 1; i * p["time_step"] < p["seconds"]; ++i) {
    top.solver.step(top.state, p["time_step"]);
    const double middle = (top.state.body_poses[0].orientation.conjugate() * top.state.body_velocities[0].angular).y();
    if (middle * last < 0) flips.push_back(p["time_step"] * (i - middle / (middle - last)));
    last = middle;
  }
  if (expected.size() < 3 || flips.size() < 3) throw std::runtime_error("fewer than three flips");
  return {{"first flip", flips[0], expected[0], 0.01 * expected[0], "s", {}},
          {"first to second flip",
           flips[1] - flips[0],
           expected[1] - expected[0],
           0.01 * (expected[1] - expected[0]),
           "s",
           {}},
          {"second to third flip",
           flips[2] - flips[1],
           expected[2] - expected[1],
           0.01 * (expected[2] - expected[1]),
           "s",
           {}}};
}

}  // namespace

std::vector<Case> body_cases() {
  std::vector<Parameters> oscillators;
  for (const double z : {0.1, 0.2, 1.0}) oscillators.push_back({{"z", z}, {"mass", 0.02}});
  return {
      {"oscillator", "backward Euler: energy x 1/(1 + z^2) and phase atan z per step, z = omega h", oscillators,
       oscillator},
      {"joint_stretch", "F/k", {{{"mass", 0.3}, {"stiffness", 1e3}}}, joint_stretch},
      {"conical_pendulum",
       "sqrt(g/(L cos theta))",
       {{{"length", 0.05}, {"degrees", 30}, {"seconds", 0.4}, {"time_step", 1e-4}}},
       conical_pendulum},
      {"plane_pendulum",
       "4 sqrt(L/g) K(sin(theta/2))",
       {{{"length", 0.1}, {"degrees", 90}, {"time_step", 1e-4}}},
       plane_pendulum},
      {"symmetric_top",
       "|L|/I_1",
       {{{"inertia1", 1},
         {"inertia2", 1},
         {"inertia3", 2},
         {"spin1", 1},
         {"spin2", 0},
         {"spin3", 10},
         {"time_step", 1e-3}}},
       symmetric_top},
      {"tumbling_body",
       "Euler's equations, integrated to 1e-9",
       {{{"inertia1", 1},
         {"inertia2", 2},
         {"inertia3", 3},
         {"spin1", 0.01},
         {"spin2", 1},
         {"spin3", 0.01},
         {"time_step", 2e-3},
         {"seconds", 55}}},
       tumbling},
  };
}

}  // namespace softhand::verification
