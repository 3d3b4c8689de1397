#include "world/soft_copy.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "messages/plausible.hpp"
#include "model/tissue_model.hpp"

namespace softhand {
namespace {

constexpr double kRest = 1e-6;  // m
constexpr double kMostExcess = 0.05;
constexpr std::size_t kMostParts = 64;

bool is_plausible(const Vec3& v) { return to_vector(v).norm() < kPlausibleLimit; }  // false for NaN, too
bool is_plausible(const std::array<float, 3>& v) { return to_vector(v).norm() < kPlausibleLimit; }

using Tetrahedra = std::vector<std::array<std::int32_t, 4>>;
struct Part {
  Tetrahedra tetrahedra;
  std::vector<std::int32_t> nodes;  // on its boundary
  double excess = 0;                // m^3, of the hull over the tetrahedra
};

Part part_of(const SoftBody& body, Tetrahedra tetrahedra) {
  Part part{std::move(tetrahedra), {}, 0};
  for (const auto& triangle : boundary(part.tetrahedra)) part.nodes.insert(part.nodes.end(), triangle.begin(), triangle.end());
  std::sort(part.nodes.begin(), part.nodes.end());
  part.nodes.erase(std::unique(part.nodes.begin(), part.nodes.end()), part.nodes.end());
  std::vector<Vector3> points;
  for (const std::int32_t node : part.nodes) points.push_back(body.nodes[static_cast<std::size_t>(node)]);
  double volume = 0;
  for (const auto& t : part.tetrahedra) {
    const auto at = [&](std::size_t k) -> const Vector3& { return body.nodes[static_cast<std::size_t>(t[k])]; };
    volume += (at(1) - at(0)).cross(at(2) - at(0)).dot(at(3) - at(0)) / 6;
  }
  part.excess = hull_solid(points).volume - volume;
  return part;
}

// Two halves, across the direction in which the part is longest.
std::array<Part, 2> halves_of(const SoftBody& body, const Part& part) {
  const auto centre_of = [&](const std::array<std::int32_t, 4>& t) {
    Vector3 sum = Vector3::Zero();
    for (const std::int32_t node : t) sum += body.nodes[static_cast<std::size_t>(node)];
    return Vector3(sum / 4);
  };
  Vector3 mean = Vector3::Zero();
  for (const auto& t : part.tetrahedra) mean += centre_of(t) / static_cast<double>(part.tetrahedra.size());
  Matrix3 spread = Matrix3::Zero();
  for (const auto& t : part.tetrahedra) spread += (centre_of(t) - mean) * (centre_of(t) - mean).transpose();
  const Vector3 axis = Eigen::SelfAdjointEigenSolver<Matrix3>(spread).eigenvectors().col(2);
  Tetrahedra sorted = part.tetrahedra;
  std::stable_sort(sorted.begin(), sorted.end(),
                   [&](const auto& a, const auto& b) { return axis.dot(centre_of(a)) < axis.dot(centre_of(b)); });
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  return {part_of(body, {sorted.begin(), middle}), part_of(body, {middle, sorted.end()})};
}

}  // namespace

std::vector<std::vector<std::int32_t>> convex_parts(const SoftBody& body) {
  std::vector<Part> parts{part_of(body, body.tetrahedra)};
  const double volume = hull_solid(body.nodes).volume - parts[0].excess;
  const auto excess = [&parts] {
    return std::accumulate(parts.begin(), parts.end(), 0.0,
                           [](double sum, const Part& each) { return sum + each.excess; });
  };
  while (parts.size() < kMostParts && excess() > kMostExcess * volume) {
    Part& worst = *std::ranges::max_element(parts, {}, &Part::excess);
    if (worst.tetrahedra.size() < 2) break;
    auto [one, other] = halves_of(body, worst);
    worst = std::move(one);
    parts.push_back(std::move(other));
  }
  std::vector<std::vector<std::int32_t>> result;
  for (Part& each : parts) result.push_back(std::move(each.nodes));
  return result;
}

SoftCopy::SoftCopy(const SoftObject& object)
    : parts_(convex_parts(*object.body)), friction_(object.body->friction) {
  for (const Vector3& node : object.body->nodes) start_.push_back(to_floats(object.pose.orientation * node));
  moved_ = known_.state_offsets = known_.state_velocities = known_.offsets = start_;
}

bool SoftCopy::take(const SoftObjectState& state) {
  if (state.nodes.size() != start_.size() || state.velocities.size() != start_.size()) return false;
  const auto all_plausible = [](const auto& list) {
    return std::all_of(list.begin(), list.end(), [](const auto& each) { return is_plausible(each); });
  };
  if (!is_plausible(state.centre) || !is_plausible(state.linear_velocity) || !all_plausible(state.nodes) ||
      !all_plausible(state.velocities))
    return false;
  if (known_.is_there && state.stamp.sample_time <= known_.time) return true;
  known_.is_there = true;
  known_.time = state.stamp.sample_time;
  known_.state_centre = state.centre;
  known_.state_velocity = state.linear_velocity;
  std::copy(state.nodes.begin(), state.nodes.end(), known_.state_offsets.begin());
  std::copy(state.velocities.begin(), state.velocities.end(), known_.state_velocities.begin());
  return true;
}

SoftCopy::Change SoftCopy::move(Nanoseconds now, double most_ahead, double stall) {
  const double age = age_of(known_.time, now).value_or(0);
  const double ahead = std::min(age, most_ahead);
  const Vector3 centre = to_vector(known_.state_centre) + ahead * to_vector(known_.state_velocity);
  const Vector3 shift = centre - to_vector(known_.centre);
  double farthest = 0;
  for (std::size_t node = 0; node < moved_.size(); ++node) {
    for (std::size_t k = 0; k < 3; ++k)
      moved_[node][k] = known_.state_offsets[node][k] + static_cast<float>(ahead) * known_.state_velocities[node][k];
    const Vector3 to_new = shift + to_vector(moved_[node]) - to_vector(known_.offsets[node]);
    farthest = std::max(farthest, to_new.squaredNorm());
  }
  if (farthest <= kRest * kRest) {
    if (known_.rests) return Change::none;
    known_.rests = true;
    known_.velocity = {};
    return Change::came_to_rest;
  }
  known_.rests = false;
  known_.centre = to_wire(centre);
  known_.velocity = age > stall ? Vec3{} : known_.state_velocity;
  known_.offsets = moved_;
  return Change::moved;
}

void SoftCopy::check() const {
  for (const Offsets* each : {&known_.state_offsets, &known_.state_velocities, &known_.offsets})
    if (each->size() != start_.size())
      throw std::runtime_error("the saved state has a flexible object with another number of nodes");
}

void SoftCopy::place(PhysicsEngine& engine, std::size_t number) const {
  engine.move_copy(number, to_vector(known_.centre), to_vector(known_.velocity), known_.offsets, known_.rests);
}

}  // namespace softhand
