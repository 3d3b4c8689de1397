#include "error_runtime/errors.hpp"

#include <algorithm>
#include <cmath>

#include "cli/outcome.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand::error_runtime {
namespace {

constexpr double kLeastForce = 0.1;  // N; smaller forces are no reference for a relative error

const Sample* at_tick(const Trajectory& trajectory, std::int64_t tick) {
  const auto found = std::lower_bound(trajectory.samples.begin(), trajectory.samples.end(), tick,
                                      [](const Sample& s, std::int64_t t) { return s.tick < t; });
  return found != trajectory.samples.end() && found->tick == tick ? &*found : nullptr;
}

Vector3 force(const Sample& sample, std::size_t finger) { return to_vector(sample.fingers[finger].force); }

// Compares the contacts of two samples. Returns (nodes that differ, nodes that touch in either sample).
std::pair<std::size_t, std::size_t> touch_difference(const Sample& one, const Sample& two) {
  std::size_t differ = 0, either = 0;
  for (std::size_t n = 0; n < one.touch.size(); ++n) {
    if (one.touch[n] == 0 && two.touch[n] == 0) continue;
    ++either;
    if (one.touch[n] != two.touch[n]) ++differ;
  }
  return {differ, either};
}

}  // namespace

std::vector<double> skin_weights(const HandModel& hand) {
  const Eigen::Matrix3Xd rest =
      Eigen::Map<const Eigen::Matrix3Xd>(hand.nodes.front().data(), 3, static_cast<Eigen::Index>(hand.nodes.size()));
  std::vector<Vector3> places;
  for (std::size_t v = 0; v < hand.skin_vertices.size(); ++v) places.push_back(embedded(hand, v, rest));
  std::vector<double> weights(places.size(), 0.0);
  double total = 0;
  for (const auto& triangle : hand.skin_triangles) {
    const auto place = [&](std::size_t k) { return places[static_cast<std::size_t>(triangle[k])]; };
    const double area = 0.5 * (place(1) - place(0)).cross(place(2) - place(0)).norm();
    for (const std::int32_t v : triangle) weights[static_cast<std::size_t>(v)] += area / 3;
    total += area;
  }
  for (double& weight : weights) weight /= total;
  return weights;
}

Errors difference(const Trajectory& trajectory, const Trajectory& reference, const std::vector<double>& weights) {
  Errors errors;
  const auto area = Eigen::Map<const Eigen::VectorXd>(weights.data(), static_cast<Eigen::Index>(weights.size()));
  double tissue = 0, soft = 0, stress = 0, stress_reference = 0, bones = 0, turns = 0, force_difference = 0,
         force_reference = 0, centres = 0, centre_weight = 0;
  std::size_t differ = 0, either = 0;
  bool same_mesh = true;
  const bool has_soft = !reference.samples.empty() && reference.samples.front().soft.size() > 0;
  std::vector<double> net;
  for (const Sample& a : trajectory.samples) {
    const Sample* b = at_tick(reference, a.tick);
    if (b == nullptr) continue;
    ++errors.times;
    const Eigen::VectorXd squares = (a.skin - b->skin).colwise().squaredNorm();
    const double mean_square = squares.dot(area);
    tissue += mean_square;
    errors.tissue_worst_rms_mm = std::max(errors.tissue_worst_rms_mm, 1e3 * std::sqrt(mean_square));
    errors.tissue_max_mm = std::max(errors.tissue_max_mm, 1e3 * std::sqrt(squares.maxCoeff()));
    if (has_soft) soft += (a.soft - b->soft).colwise().squaredNorm().mean();
    if (a.stress.size() > 0 && a.stress.size() == b->stress.size()) {
      stress += (a.stress - b->stress).cwiseAbs2().dot(area);
      stress_reference += b->stress.cwiseAbs2().dot(area);
    }
    for (std::size_t j = 0; j < kJointCount; ++j) {
      bones += (a.joints[j].position - b->joints[j].position).squaredNorm() / kJointCount;
      turns += rotation_log(a.joints[j].orientation * b->joints[j].orientation.conjugate()).squaredNorm() / kJointCount;
    }
    Vector3 sum = Vector3::Zero(), sum_reference = Vector3::Zero();
    for (std::size_t f = 0; f < a.fingers.size(); ++f) {
      const Vector3 mine = force(a, f), its = force(*b, f);
      force_difference += (mine - its).squaredNorm();
      force_reference += its.squaredNorm();
      sum += mine;
      sum_reference += its;
      if (mine.norm() < kLeastForce || its.norm() < kLeastForce) continue;
      centres += its.norm() * (to_vector(a.fingers[f].centre) - to_vector(b->fingers[f].centre)).squaredNorm();
      centre_weight += its.norm();
    }
    net.push_back((sum - sum_reference).norm() / std::max(sum_reference.norm(), kLeastForce));
    same_mesh = same_mesh && !a.touch.empty() && a.touch.size() == b->touch.size();
    if (same_mesh) {
      const auto [d, e] = touch_difference(a, *b);
      differ += d;
      either += e;
    }
  }
  const double n = static_cast<double>(std::max<std::size_t>(errors.times, 1));
  errors.tissue_rms_mm = 1e3 * std::sqrt(tissue / n);
  if (has_soft) errors.soft_rms_mm = 1e3 * std::sqrt(soft / n);
  errors.bone_mm = 1e3 * std::sqrt(bones / n);
  errors.bone_degrees = 180 / M_PI * std::sqrt(turns / n);
  errors.force_error = std::sqrt(force_difference / n) / std::max(std::sqrt(force_reference / n), kLeastForce);
  errors.net_force_error_p95 = net.empty() ? 0 : percentile(net, 0.95);
  errors.stress_error = stress_reference > 0 ? std::sqrt(stress / stress_reference) : 0;
  errors.pressure_centre_mm = centre_weight > 0 ? 1e3 * std::sqrt(centres / centre_weight) : 0;
  if (same_mesh) errors.touch_disagreement = either > 0 ? static_cast<double>(differ) / static_cast<double>(either) : 0;
  if (errors.times == 0 || !std::isfinite(errors.tissue_rms_mm)) {
    for (double* value :
         {&errors.tissue_rms_mm, &errors.tissue_worst_rms_mm, &errors.tissue_max_mm, &errors.bone_mm,
          &errors.bone_degrees, &errors.force_error, &errors.stress_error, &errors.net_force_error_p95}) {
      *value = std::numeric_limits<double>::infinity();
    }
    if (has_soft) errors.soft_rms_mm = std::numeric_limits<double>::infinity();
  }
  return errors;
}

Trajectory combined(const std::vector<std::pair<double, const Trajectory*>>& parts) {
  Trajectory sum;
  for (const Sample& first : parts.front().second->samples) {
    Sample sample = first;
    sample.touch.clear();
    sample.skin.setZero();
    sample.stress.setZero();
    sample.soft.setZero();
    std::array<Vector3, kJointCount> places, turns;
    places.fill(Vector3::Zero());
    turns.fill(Vector3::Zero());
    std::array<Vector3, 6> forces;
    forces.fill(Vector3::Zero());
    bool everywhere = true;
    for (const auto& [factor, trajectory] : parts) {
      const Sample* s = at_tick(*trajectory, first.tick);
      if (s == nullptr) {
        everywhere = false;
        break;
      }
      sample.skin += factor * s->skin;
      sample.soft += factor * s->soft;
      if (sample.stress.size() > 0) sample.stress += factor * s->stress;
      for (std::size_t j = 0; j < kJointCount; ++j) {
        places[j] += factor * s->joints[j].position;
        turns[j] += factor * rotation_log(s->joints[j].orientation * first.joints[j].orientation.conjugate());
      }
      for (std::size_t f = 0; f < forces.size(); ++f) forces[f] += factor * force(*s, f);
    }
    if (!everywhere) continue;
    for (std::size_t j = 0; j < kJointCount; ++j)
      sample.joints[j] = {places[j], rotation_exp(turns[j]) * first.joints[j].orientation};
    for (std::size_t f = 0; f < forces.size(); ++f) sample.fingers[f].force = to_wire(forces[f]);
    sum.samples.push_back(std::move(sample));
  }
  return sum;
}

}  // namespace softhand::error_runtime
