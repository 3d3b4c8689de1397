#include "world/soft_copy.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <utility>

#include "math/tetrahedron.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "messages/plausible.hpp"
#include "model/tissue_model.hpp"

namespace softhand {
namespace {

constexpr double kRest = 1e-6;  // m
constexpr double kMostExcess = 0.05;
// A creep of 0.1 mm/s must not sleep.
constexpr double kStays = 2e-5, kUntilRest = 0.5;  // m, s
constexpr Nanoseconds kHoldoff = 200'000'000;
// s between two states that are published: of an object that moves, and of one that rests.
constexpr double kPeriod = 0.01, kRestPeriod = 0.1;
constexpr std::size_t kMostParts = 64;

using Tetrahedra = std::vector<std::array<std::int32_t, 4>>;
struct Part {
  Tetrahedra tetrahedra;
  std::vector<std::int32_t> nodes;  // on its boundary
  double excess = 0;                // m^3, of the hull over the tetrahedra
};

Part part_of(const SoftBody& body, Tetrahedra tetrahedra) {
  Part part{std::move(tetrahedra), {}, 0};
  for (const auto& triangle : boundary(part.tetrahedra))
    part.nodes.insert(part.nodes.end(), triangle.begin(), triangle.end());
  std::sort(part.nodes.begin(), part.nodes.end());
  part.nodes.erase(std::unique(part.nodes.begin(), part.nodes.end()), part.nodes.end());
  std::vector<Vector3> points;
  for (const std::int32_t node : part.nodes) points.push_back(body.nodes[static_cast<std::size_t>(node)]);
  double volume = 0;
  for (const auto& t : part.tetrahedra) volume += tetrahedron_volume(body.nodes, t);
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

// Nodes of parts of the body, by part. There are as many parts as are needed, at most kMostParts. Then their convex
// hulls have no more volume than the body and kMostExcess of it.
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

}  // namespace

SoftCopy::SoftCopy(const SoftObject& object, int obstacles, const NodeSpring& spring)
    : name_(object.name),
      is_shared_(object.is_shared),
      has_spring_(spring.stiffness > 0),
      pose_(object.pose),
      parts_(convex_parts(*object.body)),
      friction_(object.body->friction) {
  for (const Vector3& node : object.body->nodes) start_.push_back(to_floats(pose_.orientation * node));
  moved_ = known_.last.offsets = known_.last.velocities = known_.offsets = known_.left = start_;
  known_.twin.offsets = known_.twin.velocities = start_;
  if (!is_shared_) return;
  body_ = std::make_unique<FreeSoftBody>(object, obstacles, spring);
  positions_ = body_->positions();
  velocities_ = body_->velocities();
  restart();
}

void SoftCopy::restart() {
  known_.is_there = true;
  known_.owned = known_.is_free = known_.sleeps = false;
  known_.last.centre = to_wire(pose_.position);
  known_.last.offsets = start_;
  known_.last.velocity = known_.hand_force = {};
  std::ranges::fill(known_.last.velocities, std::array<float, 3>{});
  known_.contact_count = known_.inverted_elements = 0;
  known_.started_at = known_.written_at = known_.twin.time = 0;
}

bool SoftCopy::take(const SoftObjectState& state) {
  if (!is_plausible(state, static_cast<int>(start_.size()))) return false;
  if (is_shared_ && (known_.started_at == 0 || state.stamp.sample_time - known_.started_at < kHoldoff)) return true;
  if (has_spring_) {
    if (state.stamp.sample_time > known_.twin.time) read(state, known_.twin);
    return true;
  }
  if (is_shared_ && state.owned == 0) {
    known_.owned = false;
    return true;
  }
  if (known_.is_there && !known_.is_free && state.stamp.sample_time <= known_.last.time) return true;
  known_.is_there = true;
  known_.owned = true;
  read(state, known_.last);
  return true;
}

void SoftCopy::read(const SoftObjectState& state, Nodes& nodes) {
  nodes.time = state.stamp.sample_time;
  nodes.centre = state.centre;
  nodes.velocity = state.linear_velocity;
  std::copy(state.nodes.begin(), state.nodes.end(), nodes.offsets.begin());
  std::copy(state.velocities.begin(), state.velocities.end(), nodes.velocities.begin());
  known_.hand_force = state.hand_force;
  known_.contact_count = state.contact_count;
  known_.inverted_elements = state.inverted_elements;
}

// Writes the nodes, in world axes, to `positions_` and `velocities_`.
void SoftCopy::scatter(const Nodes& nodes) {
  for (std::size_t node = 0; node < start_.size(); ++node) {
    const auto column = static_cast<Eigen::Index>(node);
    positions_.col(column) = to_vector(nodes.centre) + to_vector(nodes.offsets[node]);
    velocities_.col(column) = to_vector(nodes.velocity) + to_vector(nodes.velocities[node]);
  }
}

// The spring of mode symmetric. It pulls to where the hand's nodes were: nodes that go on with stale velocities make
// the springs grow faster.
void SoftCopy::pull(Nanoseconds now, double stall) {
  const std::optional<double> age = known_.twin.time == 0 ? std::nullopt : age_of(known_.twin.time, now);
  if (!age || *age > stall) {
    body_->let_go();
    return;
  }
  scatter(known_.twin);
  body_->pull_to(positions_, velocities_);
}

bool SoftCopy::simulate(Nanoseconds now, double dt, double vanished, double stall,
                        std::span<const Obstacle> obstacles) {
  if (!is_shared_) return true;
  if (known_.started_at == 0) known_.started_at = now;
  if (known_.owned && age_of(known_.last.time, now).value_or(0) > vanished) known_.owned = false;
  if (known_.owned) {
    known_.is_free = known_.sleeps = false;
    return true;
  }
  if (!has_spring_) {
    known_.hand_force = {};
    known_.contact_count = 0;
  }
  if (known_.sleeps) {
    known_.last.time = now;
    return true;
  }
  if (!std::exchange(known_.is_free, true)) {
    scatter(known_.last);
    body_->start(positions_, velocities_);
    known_.left_at = now;
    known_.left_centre = known_.last.centre;
    known_.left = known_.last.offsets;
  }
  if (has_spring_) pull(now, stall);
  for (std::size_t k = 0; k < obstacles.size(); ++k) body_->set_obstacle(static_cast<int>(k), obstacles[k]);
  if (!body_->step(dt)) {
    restart();
    return false;
  }
  Vector3 centre = Vector3::Zero(), velocity = Vector3::Zero();
  double mass = 0;
  for (std::size_t node = 0; node < start_.size(); ++node) {
    const double of_node = body_->masses()[node];
    centre += of_node * body_->positions().col(static_cast<Eigen::Index>(node));
    velocity += of_node * body_->velocities().col(static_cast<Eigen::Index>(node));
    mass += of_node;
  }
  centre /= mass;
  velocity /= mass;
  known_.last.time = now;
  known_.last.centre = to_wire(centre);
  known_.last.velocity = to_wire(velocity);
  const Vector3 shift = centre - to_vector(known_.left_centre);
  double farthest = 0;
  for (std::size_t node = 0; node < start_.size(); ++node) {
    const auto column = static_cast<Eigen::Index>(node);
    known_.last.offsets[node] = to_floats(body_->positions().col(column) - centre);
    known_.last.velocities[node] = to_floats(body_->velocities().col(column) - velocity);
    const Vector3 moved = shift + to_vector(known_.last.offsets[node]) - to_vector(known_.left[node]);
    farthest = std::max(farthest, moved.norm());
  }
  if (farthest > kStays || has_spring_) {
    known_.left_at = now;
    known_.left_centre = known_.last.centre;
    known_.left = known_.last.offsets;
  } else if (age_of(known_.left_at, now).value_or(0) > kUntilRest) {
    known_.is_free = false;
    known_.sleeps = true;
    known_.last.velocity = {};
    std::ranges::fill(known_.last.velocities, std::array<float, 3>{});
  }
  return true;
}

bool SoftCopy::write_state(Nanoseconds now, SoftObjectState& out) {
  if (!is_shared_) return false;
  const double since = age_of(known_.written_at, now).value_or(0);
  if (known_.written_at != 0 && since < (known_.sleeps ? kRestPeriod : kPeriod)) return false;
  known_.written_at = now;
  out.stamp.sample_time = known_.owned ? known_.last.time : now;
  out.owned = known_.owned ? 1 : 0;
  out.centre = known_.last.centre;
  out.linear_velocity = known_.last.velocity;
  out.hand_force = known_.hand_force;
  out.contact_count = known_.contact_count;
  out.inverted_elements =
      known_.is_free ? static_cast<std::uint32_t>(body_->inverted_elements()) : known_.inverted_elements;
  out.nodes.clear();
  out.velocities.clear();
  for (const auto& node : known_.last.offsets) out.nodes.push_back(node);
  for (const auto& node : known_.last.velocities) out.velocities.push_back(node);
  return true;
}

SoftCopy::Change SoftCopy::move(Nanoseconds now, double most_ahead, double stall) {
  const double age = age_of(known_.last.time, now).value_or(0);
  const double ahead = std::min(age, most_ahead);
  const Vector3 centre = to_vector(known_.last.centre) + ahead * to_vector(known_.last.velocity);
  const Vector3 shift = centre - to_vector(known_.centre);
  double farthest = 0;
  for (std::size_t node = 0; node < moved_.size(); ++node) {
    for (std::size_t k = 0; k < 3; ++k)
      moved_[node][k] = known_.last.offsets[node][k] + static_cast<float>(ahead) * known_.last.velocities[node][k];
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
  known_.velocity = age > stall ? Vec3{} : known_.last.velocity;
  known_.offsets = moved_;
  return Change::moved;
}

void SoftCopy::put_into(PhysicsEngine& engine, std::size_t number) {
  for (const Offsets* each : {&known_.last.offsets, &known_.last.velocities, &known_.offsets, &known_.left,
                              &known_.twin.offsets, &known_.twin.velocities})
    if (each->size() != start_.size())
      throw std::runtime_error("the saved state has a flexible object with another number of nodes");
  if (known_.is_there) place(engine, number);
  if (!known_.is_free) return;
  scatter(known_.last);
  body_->start(positions_, velocities_);
}

void SoftCopy::place(PhysicsEngine& engine, std::size_t number) const {
  engine.move_copy(number, to_vector(known_.centre), to_vector(known_.velocity), known_.offsets, known_.rests);
}

}  // namespace softhand
