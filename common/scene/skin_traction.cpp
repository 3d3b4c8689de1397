#include "scene/skin_traction.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "contact/skin_patches.hpp"
#include "math/index.hpp"
#include "math/low_pass.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kNearTriangle = 4e-3;  // m beyond a triangle: half the distance of contact points on the palm
// N: gives a normal to a region with friction only. A contact that ended within the step has such a force.
constexpr double kLeastWeight = 1e-12;
constexpr double kLeastRate = 0.1;  // 1/s, of the region's area; a slower change is none

}  // namespace

SkinTractionReport::SkinTractionReport(const HandModel& hand, int first_node, int first_body)
    : hand_(&hand), first_node_(first_node), first_body_(static_cast<std::size_t>(first_body)) {
  for (const SkinPoint& point : hand.contact_points) {
    const Body body = static_cast<Body>(point.body);
    const Pose& joint = hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(body)))];
    regions_.push_back({point.body, to_floats(joint.inverse() * hand.position_of(point)), point.area});
  }
  list_near_points();
  sums_.resize(regions_.size());
  touched_.reserve(regions_.size());
  listed_.reserve(regions_.size());
  memory_.touched.resize(regions_.size());
  memory_.rates.resize(regions_.size());
}

// A force on a triangle must not go to another finger that lies beside it.
void SkinTractionReport::list_near_points() {
  const HandModel& hand = *hand_;
  std::vector<Vector3> places;
  for (const SkinPoint& point : hand.contact_points) places.push_back(hand.position_of(point));
  for (const auto& corners : hand.surface) {
    first_near_.push_back(near_.size());
    Vector3 centre = Vector3::Zero();
    for (const std::int32_t node : corners) centre += hand.nodes[at(node)] / 3;
    double radius = 0;
    for (const std::int32_t node : corners) radius = std::max(radius, (hand.nodes[at(node)] - centre).norm());
    const auto is_of_part = [&](std::size_t point) {
      return std::any_of(corners.begin(), corners.end(), [&](std::int32_t node) {
        return skin_part(hand.node_body[at(node)]) == skin_part(hand.contact_points[point].body);
      });
    };
    std::size_t nearest = 0;
    double best = HUGE_VAL;
    for (std::size_t point = 0; point < places.size(); ++point) {
      const double away = (places[point] - centre).norm();
      if (away >= std::max(best, radius + kNearTriangle) || !is_of_part(point)) continue;
      if (away < radius + kNearTriangle) near_.push_back(static_cast<std::int32_t>(point));
      if (away < best) {
        best = away;
        nearest = point;
      }
    }
    if (near_.size() == first_near_.back() && !places.empty()) near_.push_back(static_cast<std::int32_t>(nearest));
  }
  first_near_.push_back(near_.size());
}

Vector3 SkinTractionReport::position(std::size_t point) const {
  const SkinPoint& p = hand_->contact_points[point];
  const auto& corners = hand_->tetrahedra[at(p.tetrahedron)];
  Vector3 sum = Vector3::Zero();
  for (std::size_t k = 0; k < 4; ++k) sum += p.weights[k] * state_->node_positions.col(first_node_ + corners[k]);
  return sum;
}

void SkinTractionReport::begin(const State& state) {
  state_ = &state;
  for (const std::int32_t region : touched_) sums_[at(region)] = {};
  touched_.clear();
}

void SkinTractionReport::add(std::size_t point, const SkinForce& of) {
  const double size = of.force.norm();
  if (!(size > 0)) return;
  Sum& sum = sums_[point];
  if (sum.largest < 0) touched_.push_back(static_cast<std::int32_t>(point));
  const double weight = std::max(-of.normal.dot(of.force), kLeastWeight);
  // Friction acts against the slip.
  const Vector3 across = of.force - of.normal.dot(of.force) * of.normal;
  const double friction = across.norm();
  sum.force += of.force;
  sum.normal += weight * of.normal;
  if (friction > 0) sum.slip -= weight * of.slip_speed / friction * across;
  sum.weight += weight;
  if (size > sum.largest) {
    sum.largest = size;
    sum.object = of.object;
  }
}

void SkinTractionReport::add(std::size_t triangle, const Vector3& place, const SkinForce& of) {
  std::int32_t nearest = -1;
  double best = HUGE_VAL;
  for (std::size_t i = first_near_[triangle]; i < first_near_[triangle + 1]; ++i) {
    const double away = (position(at(near_[i])) - place).squaredNorm();
    if (away < best) {
      best = away;
      nearest = near_[i];
    }
  }
  if (nearest >= 0) add(at(nearest), of);
}

// Lists the regions of the message, by their number.
void SkinTractionReport::select() {
  listed_.clear();
  for (std::size_t i = 0; i < regions_.size(); ++i)
    if (sums_[i].largest >= 0 || memory_.rates[i] != 0) listed_.push_back(static_cast<std::int32_t>(i));
  if (listed_.size() <= kMaxSkinRegions) return;
  dropped_ += listed_.size() - kMaxSkinRegions;
  const auto last = listed_.begin() + kMaxSkinRegions;
  std::nth_element(listed_.begin(), last, listed_.end(), [this](std::int32_t a, std::int32_t b) {
    return sums_[at(a)].force.squaredNorm() > sums_[at(b)].force.squaredNorm();
  });
  listed_.erase(last, listed_.end());
  std::sort(listed_.begin(), listed_.end());
}

void SkinTractionReport::write(double time_step, SkinTraction& out) {
  const double gain = low_pass_gain(area_cutoff, time_step);
  for (std::size_t i = 0; i < regions_.size(); ++i) {
    const bool touches = sums_[i].largest >= 0, touched = memory_.any ? memory_.touched[i] != 0 : touches;
    const double change = regions_[i].area * (static_cast<int>(touches) - static_cast<int>(touched)) / time_step;
    double rate = memory_.any ? memory_.rates[i] : 0.0;
    rate += gain * (change - rate);
    memory_.rates[i] = std::abs(rate) < kLeastRate * regions_[i].area ? 0.0f : static_cast<float>(rate);
    memory_.touched[i] = touches ? 1 : 0;
  }
  memory_.any = true;
  select();

  std::array<Quaternion, kBodyCount> to_joint;
  for (std::size_t b = 0; b < kBodyCount; ++b)
    to_joint[b] =
        (state_->body_poses[first_body_ + b] * hand_->bodies[b].joint_from_body.inverse()).orientation.conjugate();
  out.regions.clear();
  for (const std::int32_t i : listed_) {
    const Region& region = regions_[at(i)];
    const Sum& sum = sums_[at(i)];
    SkinRegion of;
    of.region = static_cast<std::uint32_t>(i);
    of.body = region.body;
    of.place = region.place;
    of.area_rate = memory_.rates[at(i)];
    if (sum.largest >= 0) {
      // The normals of opposite contacts may cancel.
      const double length = sum.normal.norm();
      const Vector3 normal = length > 0 ? Vector3(sum.normal / length) : Vector3::UnitY();
      const double pressure = -normal.dot(sum.force) / region.area;
      const Vector3 slip = sum.slip / sum.weight;
      const Quaternion& turn = to_joint[region.body];
      of.object = sum.object;
      of.normal = to_floats(turn * normal);
      of.pressure = static_cast<float>(pressure);
      of.shear = to_floats(turn * (sum.force / region.area + pressure * normal));
      of.slip_velocity = to_floats(turn * Vector3(slip - normal.dot(slip) * normal));
      of.area = static_cast<float>(region.area);
    }
    out.regions.push_back(of);
  }
}

void SkinTractionReport::load(const Memory& memory) {
  if (memory.touched.size() != regions_.size() || memory.rates.size() != regions_.size())
    throw std::invalid_argument("the memory of the traction is that of another hand");
  // A rate that is not finite would stay for ever.
  if (!std::all_of(memory.rates.begin(), memory.rates.end(), [](double rate) { return std::isfinite(rate); }))
    throw std::invalid_argument("the memory of the traction has a rate that is not finite");
  memory_ = memory;
}

}  // namespace softhand
