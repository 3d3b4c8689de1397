#include "device/taxel_map.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kReachOfPitch = 1.5;  // neighbours share the skin between them
constexpr double kHandExtent = 1;      // m
constexpr double kAxisError = 1e-6;

// The palm has the metacarpals.
int part_of(Body body) { return static_cast<int>(is_metacarpal(body) ? Finger::palm : finger_of(body)); }

// Whether a hand can have it. NaN is refused too.
bool is_plausible(const SkinRegion& region) {
  constexpr double kMostTraction = 1e8;  // Pa
  constexpr double kFastest = 1e3;       // m/s
  const double normal = to_vector(region.normal).norm();
  return to_vector(region.place).norm() < kHandExtent && std::abs(region.pressure) < kMostTraction &&
         to_vector(region.shear).norm() < kMostTraction && to_vector(region.slip_velocity).norm() < kFastest &&
         region.area >= 0 && region.area < 1 && std::isfinite(region.area_rate) &&
         (region.area > 0 ? std::abs(normal - 1) < 1e-3 : normal < 1.001);
}

// The distal phalanx of a finger. The radius changes evenly from the joint to the tip.
struct Fingertip {
  Body body;
  double length, radius, taper;

  Fingertip(const HandModel& hand, Finger finger) : body(distal_of(finger)) {
    const std::size_t joint = slot_of(joint_of(body)), tip = slot_of(tip_of(finger));
    length = (hand.rest_joints[tip].position - hand.rest_joints[joint].position).norm();
    radius = hand.joint_radii[joint];
    taper = (hand.joint_radii[tip] - radius) / length;
  }
  double radius_at(double along) const { return radius + taper * along; }
  // `along`: m from the joint. `around`: rad from the pad towards +X.
  Taxel at(double along, double around, double reach) const {
    const Vector3 normal(std::sin(around), -std::cos(around), 0);
    return {body, Vector3(0, 0, -along) + radius_at(along) * normal, normal, -Vector3::UnitZ(), reach};
  }
};

// Distance of place `i` of `count` from their middle.
double offset(int i, int count, double pitch) { return (i - 0.5 * (count - 1)) * pitch; }

Taxel palm_at(const HandModel& hand, double right, double ahead, double reach) {
  const std::size_t palm = slot_of(Joint::palm);
  const Pose from_palm = hand.rest_joints[slot_of(Joint::wrist)].inverse() * hand.rest_joints[palm];
  return {Body::carpus, from_palm * Vector3(right, -hand.joint_radii[palm], -ahead),
          from_palm.orientation * -Vector3::UnitY(), from_palm.orientation * -Vector3::UnitZ(), reach};
}

}  // namespace

std::vector<Taxel> digit_taxels(const HandModel& hand, std::size_t count) {
  std::vector<Taxel> taxels;
  for (std::size_t f = 0; f < std::min<std::size_t>(count, kFingerCount); ++f) {
    const Fingertip tip(hand, static_cast<Finger>(f));
    taxels.push_back(tip.at(0.5 * tip.length, 0, kHandExtent));
  }
  if (count > kFingerCount) taxels.push_back(palm_at(hand, 0, 0, kHandExtent));
  return taxels;
}

std::vector<Taxel> fingertip_grid(const HandModel& hand, Finger finger, int rows, int columns, double pitch) {
  const Fingertip tip(hand, finger);
  std::vector<Taxel> taxels;
  for (int row = 0; row < rows; ++row) {
    const double along = 0.5 * tip.length + offset(row, rows, pitch);
    for (int column = 0; column < columns; ++column)
      taxels.push_back(tip.at(along, offset(column, columns, pitch) / tip.radius_at(along), kReachOfPitch * pitch));
  }
  return taxels;
}

std::vector<Taxel> fingertip_ring(const HandModel& hand, Finger finger, int count) {
  const Fingertip tip(hand, finger);
  const double along = 0.5 * tip.length, angle = 2 * M_PI / count;
  std::vector<Taxel> taxels;
  for (int i = 0; i < count; ++i)
    taxels.push_back(tip.at(along, i * angle, kReachOfPitch * angle * tip.radius_at(along)));
  return taxels;
}

std::vector<Taxel> palm_grid(const HandModel& hand, int rows, int columns, double pitch) {
  std::vector<Taxel> taxels;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column)
      taxels.push_back(palm_at(hand, offset(column, columns, pitch), offset(row, rows, pitch), kReachOfPitch * pitch));
  }
  return taxels;
}

TaxelMap::TaxelMap(const HandModel& hand, const std::vector<Taxel>& taxels)
    : shares_(taxels.size()), sums_(taxels.size()), touches_(taxels.size()) {
  for (std::size_t b = 0; b < kBodyCount; ++b) rest_[b] = hand.rest_joints[slot_of(joint_of(static_cast<Body>(b)))];
  for (std::size_t i = 0; i < taxels.size(); ++i) {
    const Taxel& taxel = taxels[i];
    Matrix3 axes;
    axes << taxel.tangent.transpose(), taxel.normal.cross(taxel.tangent).transpose(), taxel.normal.transpose();
    if (!(taxel.reach > 0) || !taxel.place.allFinite() ||
        !((axes * axes.transpose() - Matrix3::Identity()).norm() < kAxisError))
      throw std::invalid_argument("taxel " + std::to_string(i) + ": expected a reach > 0 and orthonormal axes");
    const Pose& joint = rest_[slot_of(taxel.body)];
    places_.push_back({part_of(taxel.body), joint * taxel.place,
                       axes * joint.orientation.conjugate().toRotationMatrix(), taxel.reach});
  }
}

bool TaxelMap::add(const SkinRegion& region) {
  if (region.body >= kBodyCount || !is_plausible(region)) return false;
  const int part = part_of(static_cast<Body>(region.body));
  const Pose& joint = rest_[region.body];
  const Vector3 place = joint * to_vector(region.place);
  double sum = 0;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const Place& taxel = places_[i];
    shares_[i] = taxel.part == part ? std::max(0.0, 1 - (taxel.place - place).norm() / taxel.reach) : 0;
    sum += shares_[i];
  }
  if (!(sum > 0)) return true;
  const double press = static_cast<double>(region.area) * region.pressure;
  const Vector3 force =
      joint.orientation * Vector3(region.area * to_vector(region.shear) - press * to_vector(region.normal));
  const Vector3 slip = joint.orientation * to_vector(region.slip_velocity);
  for (std::size_t i = 0; i < places_.size(); ++i) {
    if (shares_[i] == 0) continue;
    const double share = shares_[i] / sum;
    Sum& of = sums_[i];
    of.force += share * force;
    of.slip += share * press * slip;
    of.press += share * press;
    of.area += share * region.area;
    of.area_rate += share * region.area_rate;
    if (share * press > of.largest) {
      of.largest = share * press;
      of.object = region.object;
    }
  }
  return true;
}

std::span<const TaxelTouch> TaxelMap::feel(const SkinTraction& input) {
  std::fill(sums_.begin(), sums_.end(), Sum{});
  for (const SkinRegion& region : input.regions)
    if (!add(region)) ++refused_;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const Sum& sum = sums_[i];
    const Vector3 force = places_[i].axes * sum.force;
    const Vector3 slip = sum.press > 0 ? Vector3(places_[i].axes * (sum.slip / sum.press)) : Vector3::Zero();
    touches_[i] = {
        {force.x(), force.y(), force.z()}, sum.press, {slip.x(), slip.y()}, sum.area, sum.area_rate, sum.object};
  }
  return touches_;
}

}  // namespace softhand
