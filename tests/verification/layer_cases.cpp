// Couplings: eq. 18 alone, and the chain tracked - intermediate - simulated of the real loops at their real rates.
#include <memory>

#include "cli/virtual_rig.hpp"
#include "energies/body_coupling.hpp"
#include "energies/inertia.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "support/block_hand.hpp"
#include "support/box_mesh.hpp"
#include "tracking/tracking_loop.hpp"
#include "verification/cases.hpp"

namespace softhand::verification {
namespace {

// A turn by `angle` about x, then a small turn about y. The case measures the second derivative of 1/2 k |log R|^2
// across the stretch.
std::vector<Measurement> transverse_stiffness(const Parameters& p) {
  const double angle = p["degrees"] * M_PI / 180, stiffness = p["stiffness"];
  State state;
  state.node_positions.resize(3, 0);
  state.node_velocities.resize(3, 0);
  state.body_poses = {Pose{Vector3::Zero(), rotation_exp(Vector3(angle, 0, 0))}};
  state.body_velocities.resize(1);
  CouplingGains gains;
  gains.angular_stiffness = stiffness;
  BodyCoupling coupling("coupling", {{0, Pose{}, gains}}, state.layout());
  BlockPattern pattern(state.layout().block_count());
  coupling.add_pattern(pattern);
  BlockMatrix matrix(pattern);
  coupling.bind(matrix);
  coupling.set_target(0, Pose{}, Twist{});
  coupling.begin_step(state, 1.0 / 90);
  coupling.add_hessian(state, matrix, Curvature::exact);
  const auto dense = matrix.dense();
  const double half = angle / 2, reference = stiffness * (half > 0 ? half * std::cos(half) / std::sin(half) : 1);
  return {{"across the turn", dense(4, 4), reference, 1e-9 * stiffness, "N m/rad", {}},
          {"along the turn", dense(3, 3), stiffness, 1e-9 * stiffness, "N m/rad", {}}};
}

Skeleton skeleton_of(const std::array<Pose, kJointCount>& joints, std::uint64_t sequence, Nanoseconds time) {
  Skeleton out;
  out.stamp.sequence = sequence;
  out.stamp.epoch = 1;
  out.stamp.sample_time = out.stamp.publish_time = time;
  out.confidence = 1;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    out.joints[j].position = to_wire(joints[j].position);
    out.joints[j].orientation = to_wire(joints[j].orientation);
    out.joints[j].flags = kJointValid | kJointTracked;
  }
  return out;
}

/// A tracker that reports a motionless hand at 90 Hz.
class StillTracker final : public TrackerSource {
 public:
  explicit StillTracker(const std::array<Pose, kJointCount>& joints) : joints_(joints) {}
  void poll(Nanoseconds now, TrackerSink& out) override {
    const auto due = static_cast<std::uint64_t>((now - VirtualRig::kStart) * 90 / 1'000'000'000) + 1;
    if (due <= sequence_) return;
    sequence_ = due;
    out.hand(skeleton_of(joints_, sequence_, now));
  }

 private:
  std::array<Pose, kJointCount> joints_;
  std::uint64_t sequence_ = 0;
};

// The hand sinks under its own weight. Each bone sinks by f (1/k_2 + r/k_1), and the couplings' sum is the weight.
// - f: Force of the bone's coupling.
// - k_2: Stiffness in the hand file.
// - k_1: Stiffness to the tracker, 15 k_2.
// - r: Share of f that comes back to the intermediate skeleton. r = 1 is the text's symmetric chain.
std::vector<Measurement> series(const Parameters& p) {
  const HandModel hand = testing::block_hand();
  Scene scene;
  scene.options.hand.rate_hz = p["hand_rate"];
  scene.options.hand.simulation.gravity = true;
  scene.options.tracking.feedback_ratio = p["feedback_ratio"];
  scene.options.tracking.stiffness_ratio = p["stiffness_ratio"];
  VirtualRig rig(scene, hand, std::make_unique<StillTracker>(hand.rest_joints));
  std::array<Vector3, kBodyCount> force{}, offset{};
  rig.run(p["seconds"], [&](const HandStepView& view) {
    for (std::size_t b = 1; b < kBodyCount; ++b) {
      const Body body = static_cast<Body>(b);
      const Joint joint = joint_of(body);
      force[b] = view.simulation->coupling_wrench(body).force;
      offset[b] = view.simulation->joint_pose(joint).position -
                  hand.rest_joints[static_cast<std::size_t>(index_of(joint))].position;
    }
    force[0] = view.simulation->coupling_wrench(Body::forearm).force;
  });
  double weight = 0, total = 0;
  for (const double mass : lumped_masses(hand)) weight += mass * kGravity;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    weight += hand.bodies[b].mass * kGravity;
    total += force[b].y();
  }
  const auto distal = static_cast<std::size_t>(Body::middle_distal);
  const double k2 = hand.bodies[distal].coupling_linear_stiffness, k1 = p["stiffness_ratio"] * k2;
  const double reference = force[distal].y() * (1 / k2 + p["feedback_ratio"] / k1);
  double worst = 0;
  for (std::size_t b = 1; b < kBodyCount; ++b) {
    const Vector3 expected = force[b] * (1 / k2 + p["feedback_ratio"] / k1);
    worst = std::max(worst, (offset[b] + expected).norm() / expected.norm());
  }
  return {{"sum of all couplings", total, weight, 0.01 * weight, "N", {}},
          {"offset of the middle finger's last bone", -offset[distal].y(), reference, 0.01 * reference, "m", {}},
          {"offset, worst bone: distance from F (1/k_2 + r/k_1) over that", worst, 0, 0.01, "1", {}}};
}

// The simulated skeleton repeatedly takes the place of the intermediate skeleton, each time at rest. Both approach the
// tracked skeleton by a factor k_f/(k_1 + k_f) per exchange. k_f = feedback_ratio k_2 and k_1 = stiffness_ratio k_2.
std::vector<Measurement> exchange(const Parameters& p) {
  const HandModel hand = testing::block_hand();
  TrackingOptions options;
  options.stiffness_ratio = p["stiffness_ratio"];
  options.feedback_ratio = p["feedback_ratio"];
  options.mass_fraction = p["mass_fraction"];
  options.input.reposition_distance = 10;
  TrackingLoop loop(options, p["hand_rate"], hand, {});
  constexpr double kStart = 0.002;  // m, below every cap
  const auto joint = static_cast<std::size_t>(Joint::middle_distal);
  std::array<Pose, kJointCount> simulated = hand.rest_joints;
  for (Pose& pose : simulated) pose.position.y() += kStart;
  Nanoseconds now = VirtualRig::kStart;
  std::uint64_t sequence = 0;
  double offset = kStart;
  std::vector<double> ratios;
  for (int exchange = 0; exchange < 8; ++exchange) {
    Vec3 reached{};
    for (int step = 0; step < p.whole("steps"); ++step) {
      const Skeleton tracked = skeleton_of(hand.rest_joints, ++sequence, now);
      const Skeleton copy = skeleton_of(simulated, sequence, now);
      TrackingInput input;
      input.tracked = &tracked;
      input.simulated = &copy;
      reached = loop.step(now, input).intermediate.joints[joint].position;
      now += static_cast<Nanoseconds>(1e9 / options.rate_hz);
    }
    const double next = reached[1] - hand.rest_joints[joint].position.y();
    ratios.push_back(next / offset);
    offset = next;
    for (std::size_t j = 0; j < kJointCount; ++j) simulated[j].position.y() = hand.rest_joints[j].position.y() + offset;
  }
  const double reference = p["feedback_ratio"] / (p["stiffness_ratio"] + p["feedback_ratio"]);
  return {{"contraction of an exchange, the last of 8", ratios.back(), reference, 1e-3 * reference, "1", {}}};
}

// The text's springs alone, at rest at every exchange. A body hangs between a fixed copy (k_1) and its own last
// position, which the other process returns (k_2).
std::vector<Measurement> symmetric_exchange(const Parameters& p) {
  State state;
  state.node_positions.resize(3, 0);
  state.node_velocities.resize(3, 0);
  state.body_poses.resize(1);
  state.body_velocities.resize(1);
  Inertia inertia({}, 1);
  inertia.set_dynamic(0, 0.02, 1e-6 * Matrix3::Identity(), Vector3::Zero());
  const auto spring = [](double stiffness) {
    CouplingGains gains;
    gains.linear_stiffness = stiffness;
    gains.angular_stiffness = 1;
    return std::vector<CouplingSite>{{0, Pose{}, gains}};
  };
  BodyCoupling to_tracked("to tracked", spring(p["near"]), state.layout()),
      to_simulated("to simulated", spring(p["far"]), state.layout());
  to_tracked.set_target(0, Pose{}, Twist{});
  NewtonSolver solver({&inertia, &to_tracked, &to_simulated}, state.layout(), converging());
  constexpr double kStart = 0.002;  // m
  state.body_poses[0].position.y() = kStart;
  constexpr int exchanges = 20;
  for (int i = 0; i < exchanges; ++i) {
    to_simulated.set_target(0, state.body_poses[0], Twist{});
    state.body_velocities[0] = Twist{};
    solver.step(state, 1e4);
  }
  const double ratio = std::pow(state.body_poses[0].position.y() / kStart, 1.0 / exchanges),
               reference = p["far"] / (p["near"] + p["far"]);
  const double time = -1 / (p["rate"] * std::log(reference));
  return {{"contraction of an exchange, mean of 20", ratio, reference, 1e-9, "1", {}},
          {"time constant", -1 / (p["rate"] * std::log(ratio)), time, 1e-6 * time, "s", {}}};
}

}  // namespace

std::vector<Case> layer_cases() {
  std::vector<Parameters> turns;
  for (const double degrees : {10.0, 90.0, 179.0, 180.0}) turns.push_back({{"degrees", degrees}, {"stiffness", 0.5}});
  return {
      {"transverse_stiffness", "k_a (t/2) cot(t/2) across a turn by t, k_a along it", turns, transverse_stiffness},
      {"couplings_in_series",
       "F (1/k_2 + r/k_1) through the three loops at 1000 Hz and 90 Hz",
       {{{"feedback_ratio", 0.1}, {"stiffness_ratio", 15}, {"hand_rate", 90}, {"seconds", 3}},
        {{"feedback_ratio", 1}, {"stiffness_ratio", 15}, {"hand_rate", 90}, {"seconds", 3}}},
       series},
      {"quasi_static_exchange",
       "k_f/(k_1 + k_f) per exchange of the tracking loop",
       {{{"stiffness_ratio", 15}, {"feedback_ratio", 0.1}, {"mass_fraction", 0.1}, {"hand_rate", 90}, {"steps", 200}},
        {{"stiffness_ratio", 1}, {"feedback_ratio", 0.4}, {"mass_fraction", 0.001}, {"hand_rate", 90}, {"steps", 200}}},
       exchange},
      {"symmetric_exchange",
       "k_2/(k_1 + k_2) per exchange: 0.909, a time constant of 117 ms at 90 Hz. The loops refuse this coupling at "
       "start",
       {{{"near", 50}, {"far", 500}, {"rate", 90}}},
       symmetric_exchange},
  };
}

}  // namespace softhand::verification
