#include "hand_builder/parametric_skin.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace softhand::builder {
namespace {

// Cubic smooth minimum. It equals min(a, b) if they differ by more than `blend`, and bulges by blend/6 if they are
// equal.
double smooth_minimum(double a, double b, double blend) {
  const double h = std::max(blend - std::abs(a - b), 0.0) / blend;
  return std::min(a, b) - h * h * h * blend / 6.0;
}

}  // namespace

ParametricSkin::ParametricSkin(const RestSkeleton& rest) {
  const auto position = [&rest](Joint joint) {
    return rest.joints[static_cast<std::size_t>(index_of(joint))].position;
  };
  const auto radius = [&rest](Joint joint) { return rest.radii[static_cast<std::size_t>(index_of(joint))]; };
  const auto axis = [&rest](Joint joint, int k) {
    return Vector3(rest.joints[static_cast<std::size_t>(index_of(joint))].orientation * Vector3::Unit(k));
  };
  const double scale = radius(Joint::middle_proximal) / 0.011;
  const double mm = 1e-3 * scale;
  palm_blend_ = 12 * mm;
  chain_blend_ = 1.5 * mm;
  web_blend_ = 10 * mm;
  root_blend_ = 5 * mm;

  // Palm: the four metacarpals, and pads that reach beyond their heads to the webs.
  for (int f = 1; f < kFingerCount; ++f) {
    const Joint metacarpal = static_cast<Joint>(6 + 5 * (f - 1));
    const Joint proximal = static_cast<Joint>(index_of(metacarpal) + 1);
    const Vector3 head = position(proximal);
    palm_.push_back({position(metacarpal) - 1.0 * mm * Vector3::UnitY(), head - 1.5 * mm * Vector3::UnitY(),
                     radius(metacarpal), radius(proximal)});
    if (f < 4) {
      // The web. Its edge is a good third along the proximal phalanges, nearer to the palm than to the back.
      const Joint next = static_cast<Joint>(index_of(proximal) + 5);
      const Vector3 middle = 0.5 * (head + position(next));
      const Vector3 along = -(axis(proximal, 2) + axis(next, 2)).normalized();
      const double phalanx = 0.5 * ((position(static_cast<Joint>(index_of(proximal) + 1)) - head).norm() +
                                    (position(static_cast<Joint>(index_of(next) + 1)) - position(next)).norm());
      const Vector3 down = -2.0 * mm * Vector3::UnitY();
      palm_.push_back({middle + down, middle + along * 0.36 * phalanx + down, 9.0 * mm, 5.0 * mm});
    }
  }
  // Carpus.
  const Vector3 wrist = position(Joint::wrist);
  const Vector3 wide =
      Vector3::UnitX() * (position(Joint::little_metacarpal) - position(Joint::index_metacarpal)).norm();
  palm_.push_back({wrist - 0.30 * wide + Vector3(0, -1, -4) * mm, wrist + 0.30 * wide + Vector3(0, -1, -4) * mm,
                   15.0 * mm, 14.0 * mm});

  // The hollow of the palm is shallow.
  const auto along_metacarpal = [&position](Joint metacarpal, double fraction) {
    return Vector3((1 - fraction) * position(metacarpal) +
                   fraction * position(static_cast<Joint>(index_of(metacarpal) + 1)));
  };
  palm_.push_back(
      {0.5 * (along_metacarpal(Joint::middle_metacarpal, 0.2) + along_metacarpal(Joint::ring_metacarpal, 0.2)) -
           5.0 * mm * Vector3::UnitY(),
       0.5 * (along_metacarpal(Joint::middle_metacarpal, 0.95) + along_metacarpal(Joint::ring_metacarpal, 0.95)) -
           5.0 * mm * Vector3::UnitY(),
       10.5 * mm, 9.5 * mm});

  // Thenar: from the thumb's base along its metacarpal, bulging to the palm, and the muscle web to the index
  // metacarpal.
  const Vector3 cmc = position(Joint::thumb_metacarpal);
  const Vector3 thumb_mcp = position(Joint::thumb_proximal);
  const Vector3 index_base = position(Joint::index_metacarpal);
  const Vector3 index_head = position(Joint::index_proximal);
  const Vector3 thumb_palmar = -axis(Joint::thumb_metacarpal, 1);
  palm_.push_back({cmc + 3.0 * mm * thumb_palmar + 0.10 * (thumb_mcp - cmc), thumb_mcp,
                   radius(Joint::thumb_metacarpal) + 1.5 * mm, radius(Joint::thumb_proximal)});
  palm_.push_back({cmc + 0.25 * (thumb_mcp - cmc) + 8.0 * mm * thumb_palmar + Vector3(3, -2, 0) * mm,
                   cmc + 0.60 * (thumb_mcp - cmc) + 6.0 * mm * thumb_palmar + Vector3(2, 0, 0) * mm, 11.5 * mm,
                   9.0 * mm});
  palm_.push_back({cmc + 0.50 * (thumb_mcp - cmc), index_base + 0.50 * (index_head - index_base), 9.5 * mm, 9.5 * mm});
  palm_.push_back({cmc + 0.82 * (thumb_mcp - cmc), index_base + 0.72 * (index_head - index_base), 5.5 * mm, 6.5 * mm});
  // Hypothenar: the cushion at the ulnar edge of the palm.
  const Vector3 little_base = position(Joint::little_metacarpal);
  const Vector3 little_head = position(Joint::little_proximal);
  palm_.push_back({little_base + Vector3(3, -7, 2) * mm,
                   little_base + 0.75 * (little_head - little_base) + Vector3(1.5, -4.5, 0) * mm, 11.5 * mm, 9.0 * mm});

  // Digits.
  for (int f = 0; f < kFingerCount; ++f) {
    Digit& digit = digits_[static_cast<std::size_t>(f)];
    const int first = f == 0 ? 3 : 7 + 5 * (f - 1);  // proximal joint
    const int last = 5 + 5 * f;                      // tip
    for (int j = first; j < last; ++j) {
      const Joint a = static_cast<Joint>(j);
      const Joint b = static_cast<Joint>(j + 1);
      digit.phalanges.push_back(
          {position(a), position(b), j == first && f > 0 ? radius(a) - 0.6 * mm : radius(a), radius(b)});
    }
    // The cushion of the pulp under the distal bone. It is wider than the bone's cone.
    const Joint distal = static_cast<Joint>(last - 1);
    const Joint tip = static_cast<Joint>(last);
    const Vector3 palmar = -axis(distal, 1), along = (position(tip) - position(distal)).normalized();
    const auto place = [&](double share) { return Vector3((1 - share) * position(distal) + share * position(tip)); };
    const double thickness = 0.5 * (radius(distal) + radius(tip));
    digit.cushion = {place(0.45) + 1.5 * mm * palmar, place(1) + 1.0 * mm * palmar - 0.6 * mm * along,
                     thickness + 1.8 * mm, radius(tip) + 1.6 * mm};
    // The middle of the pad lies behind the tip and looks towards it. The thumb's pad is longer and looks there less.
    const double tilt = (f == 0 ? 10 : 20) * M_PI / 180;
    const double behind = (f == 0 ? 1.38 : 0.79) * radius(tip);
    const Vector3 middle = position(tip) - behind * along + (thickness + 0.6 * mm) * palmar;
    digit.pad_radius = 31 * mm;
    digit.pad_centre = middle - digit.pad_radius * (std::cos(tilt) * palmar + std::sin(tilt) * along);
  }

  // Forearm stump: two parallel cones give its oval section.
  stump_ = rest.stump;
  for (const double side : {-1.0, 1.0}) {
    forearm_.push_back({wrist + Vector3(side * 9.5 * mm, -1.0 * mm, -4.0 * mm),
                        wrist + Vector3(side * 11.0 * mm, -1.0 * mm, 0.065), 17.0 * mm, 20.0 * mm});
  }

  low_ = Vector3::Constant(1);
  high_ = Vector3::Constant(-1);
  for (std::size_t j = 0; j < kJointCount; ++j) {
    low_ = low_.cwiseMin(rest.joints[j].position);
    high_ = high_.cwiseMax(rest.joints[j].position);
  }
  high_.z() = std::max(high_.z(), stump_);
  low_ -= Vector3::Constant(0.035 * scale);
  high_ += Vector3(0.035 * scale, 0.035 * scale, 0.006);
}

double ParametricSkin::distance(const Vector3& point) const {
  const auto cone = [&point](const Cone& c) { return rounded_cone_distance(point, c.a, c.b, c.radius_a, c.radius_b); };
  double palm = cone(palm_.front());
  for (std::size_t i = 1; i < palm_.size(); ++i) palm = smooth_minimum(palm, cone(palm_[i]), palm_blend_);
  double forearm = smooth_minimum(cone(forearm_[0]), cone(forearm_[1]), 2 * palm_blend_);
  palm = smooth_minimum(palm, forearm, 2 * palm_blend_);
  // Cut with a rounded edge.
  palm = -smooth_minimum(-palm, -(point.z() - stump_), palm_blend_);
  // Fingers blend with each other only near the palm, which rounds the web. Farther out, touching fingers stay
  // separate.
  const double web_blend = std::clamp(web_blend_ - 0.6 * palm, chain_blend_ / 5, web_blend_);
  double fingers = std::numeric_limits<double>::infinity();
  for (const Digit& digit : digits_) {
    const double flat = (point - digit.pad_centre).norm() - digit.pad_radius;
    const double end = smooth_minimum(cone(digit.phalanges.back()), cone(digit.cushion), chain_blend_);
    double finger = -smooth_minimum(-end, -flat, chain_blend_);
    for (std::size_t i = 0; i + 1 < digit.phalanges.size(); ++i)
      finger = smooth_minimum(finger, cone(digit.phalanges[i]), chain_blend_);
    fingers = std::isinf(fingers) ? finger : smooth_minimum(fingers, finger, web_blend);
  }
  return smooth_minimum(palm, fingers, root_blend_);
}

}  // namespace softhand::builder
