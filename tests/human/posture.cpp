#include "human/posture.hpp"

#include <algorithm>
#include <cmath>

#include "energies/corotational.hpp"
#include "math/rotation.hpp"
#include "model/kinematics.hpp"
#include "scene/hand_simulation.hpp"
#include "trackers/replay/motion.hpp"

namespace softhand::human {
namespace {

constexpr double kDegree = M_PI / 180;
constexpr double kStep = 1.0 / 90;
constexpr int kClosing = 90, kHeld = 90;                    // steps
constexpr double kTremor = 0.5 * kDegree, kTremorRate = 3;  // rad, Hz

// Flexion of the bone against its parent at rest, rad, measured from the straight finger. It is a turn about the bone's
// own X axis.
double flexion_at_rest(const HandModel& hand, Body body) {
  const auto turn = [&hand](Body b) {
    return hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(b)))].orientation;
  };
  const Quaternion relative = turn(parent_of(body)).conjugate() * turn(body);
  return -2 * std::atan2(relative.x(), relative.w());
}

double expected_flexion(const Posture& posture, Body body) {
  const int b = index_of(body);
  if (b == index_of(Body::thumb_proximal)) return posture.thumb_mcp;
  if (b == index_of(Body::thumb_distal)) return posture.thumb_ip;
  const int k = (b - index_of(Body::index_metacarpal)) % 4;
  return k == 1 ? posture.mcp : k == 2 ? posture.pip : posture.dip;
}

JointAngles angles_of(const HandModel& hand, const Posture& posture) {
  JointAngles angles;
  angles.fill(Vector3::Zero());
  for (int b = 2; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    if (is_metacarpal(body)) continue;
    angles[static_cast<std::size_t>(b)].x() = flexion_at_rest(hand, body) - expected_flexion(posture, body) * kDegree;
  }
  return angles;
}

struct Weighted {
  double value, weight;
};
double share_below(std::vector<Weighted> values, double share) {
  std::sort(values.begin(), values.end(), [](const Weighted& a, const Weighted& b) { return a.value < b.value; });
  double total = 0, sum = 0;
  for (const Weighted& v : values) total += v.weight;
  for (const Weighted& v : values) {
    if ((sum += v.weight) >= share * total) return v.value;
  }
  return values.empty() ? 0 : values.back().value;
}

// Edges of a triangle as coordinates in the triangle's plane.
Eigen::Matrix2d in_plane(const Vector3& a, const Vector3& b, const Vector3& c) {
  const Vector3 x = (b - a).normalized(), across = (c - a) - x * x.dot(c - a);
  Eigen::Matrix2d edges;
  edges << (b - a).norm(), x.dot(c - a), 0, across.norm();
  return edges;
}

void measure(const HandModel& hand, const State& state, PostureResult& result) {
  std::vector<Vector3> nodes;
  for (int n = 0; n < hand.node_count(); ++n) nodes.push_back(state.node_positions.col(n));
  std::vector<Weighted> skin, tissue;
  for (const auto& t : hand.surface) {
    const auto of = [&t](const std::vector<Vector3>& x, std::size_t k) -> const Vector3& {
      return x[static_cast<std::size_t>(t[k])];
    };
    const Eigen::Matrix2d rest = in_plane(of(hand.nodes, 0), of(hand.nodes, 1), of(hand.nodes, 2));
    const Eigen::Matrix2d now = in_plane(of(nodes, 0), of(nodes, 1), of(nodes, 2));
    const Eigen::Matrix2d f = now * rest.inverse();
    // The larger singular value of a 2 x 2 matrix.
    const double sum = f.squaredNorm(), product = std::abs(f.determinant());
    const double stretch = std::sqrt(0.5 * (sum + std::sqrt(std::max(0.0, sum * sum - 4 * product * product))));
    skin.push_back({stretch - 1, 0.5 * rest.determinant()});
  }
  int beyond = 0;
  for (std::size_t e = 0; e < hand.tetrahedra.size(); ++e) {
    const auto edges = [&](const std::vector<Vector3>& x) {
      const auto at = [&](std::size_t k) -> const Vector3& {
        return x[static_cast<std::size_t>(hand.tetrahedra[e][k])];
      };
      Matrix3 m;
      m << at(1) - at(0), at(2) - at(0), at(3) - at(0);
      return m;
    };
    const Material& m = hand.materials[hand.tetrahedron_material[e]];
    const Matrix3 rest = edges(hand.nodes);
    const auto bent = evaluate_corotational(corotational_material(m), edges(nodes) * rest.inverse());
    beyond += bent.quadratic > m.strain_limit_energy ? 1 : 0;
    tissue.push_back({(bent.svd.singular_values.array() - 1).abs().maxCoeff(), rest.determinant() / 6});
  }
  result.skin_max = share_below(skin, 1);
  result.skin_p95 = share_below(skin, 0.95);
  result.tissue_max = share_below(tissue, 1);
  result.tissue_p95 = share_below(tissue, 0.95);
  result.beyond_limit = static_cast<double>(beyond) / static_cast<double>(hand.tetrahedra.size());
}

PostureResult hold(const HandModel& hand, const Posture& posture) {
  HandSimulation simulation(hand, SimulationOptions{}, 0, 0);
  const JointAngles goal = angles_of(hand, posture);
  PostureResult result;
  result.posture = posture.name;
  std::vector<int> iterations;
  JointFrames targets{};
  for (int step = 1; step <= kClosing + kHeld; ++step) {
    const double share = minimum_jerk(static_cast<double>(step) / kClosing);
    const double tremor = step > kClosing ? kTremor * std::sin(2 * M_PI * kTremorRate * kStep * (step - kClosing)) : 0;
    JointAngles angles = goal;
    for (int b = 2; b < kBodyCount; ++b) {
      Vector3& angle = angles[static_cast<std::size_t>(b)];
      angle *= share;
      if (!is_metacarpal(static_cast<Body>(b))) angle.x() += tremor;
    }
    targets = forward_kinematics(hand, Pose{}, angles);
    for (int b = 0; b < kBodyCount; ++b) {
      const Body body = static_cast<Body>(b);
      Pose joint = targets[static_cast<std::size_t>(index_of(joint_of(body)))];
      if (body == Body::forearm) joint = Pose{};
      simulation.set_target(body, joint, Twist{});
    }
    const StepReport report = simulation.step(kStep);
    result.inverted_most = std::max(result.inverted_most, simulation.inverted_elements());
    if (step > kClosing) iterations.push_back(report.iterations);
  }
  std::sort(iterations.begin(), iterations.end());
  result.iterations_p50 = iterations[iterations.size() / 2];
  result.iterations_most = iterations.back();
  for (int b = 2; b < kBodyCount; ++b) {
    const Joint joint = joint_of(static_cast<Body>(b));
    result.missed = std::max(result.missed, simulation.joint_pose(joint).orientation.angularDistance(
                                                targets[static_cast<std::size_t>(index_of(joint))].orientation));
  }
  measure(hand, simulation.state(), result);
  return result;
}

}  // namespace

std::vector<PostureResult> hold_postures(const HandModel& hand) {
  std::vector<PostureResult> results;
  for (const Posture& posture : kPostures) results.push_back(hold(hand, posture));
  return results;
}

}  // namespace softhand::human
