#include "scene/contact_patches.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kTangentOverSecant = 2;
constexpr double kLeastApproach = 2e-4;  // m; below this, the secant of the tissue is not known

// Sums over the contact points of a bone, first weighted by their normal forces.
struct Sum {
  Vector3 force = Vector3::Zero(), normal = Vector3::Zero(), point = Vector3::Zero(), rest = Vector3::Zero();
  Vector3 torque = Vector3::Zero();
  double pressure = 0, stiffness = 0, square = 0, friction = 0;
};

Vector3 rest_place(const HandModel& hand, const ContactPoints& points, int point) {
  Vector3 place = Vector3::Zero();
  const ContactPoint& p = points[point];
  for (std::size_t k = 0; k < static_cast<std::size_t>(p.node_count); ++k)
    place += p.weights[k] * hand.nodes[static_cast<std::size_t>(p.nodes[k])];
  return place;
}

double stiffness_of(const HandModel& hand, const State& state, std::size_t bone, const Sum& sum,
                    const Vector3& normal) {
  // Where the patch would be if the tissue had its rest shape.
  const Vector3 undeformed =
      state.body_poses[bone] * (hand.body_rest_pose(static_cast<Body>(bone)).inverse() * sum.rest);
  const double approach = std::max(kLeastApproach, normal.dot(undeformed - sum.point));
  const double tissue = kTangentOverSecant * sum.force.dot(normal) / approach;
  return tissue * sum.stiffness / (tissue + sum.stiffness);
}

}  // namespace

void write_patches(const HandModel& hand, const ContactSet& contacts, const State& state, int slot,
                   std::uint32_t object, BoundedVector<ContactPatch, kMaxPatches>& patches) {
  const ContactPoints& points = contacts.points();
  std::array<Sum, kBodyCount> sums{};
  const auto for_each_pressing = [&](auto&& visit) {
    for (const ContactAnchor& anchor : contacts.anchors()) {
      if (anchor.slot != slot) continue;
      const Vector3 into = -contacts.offset(anchor, state).normal, force = -anchor.force;
      const double pressure = force.dot(into);
      if (pressure > 0) visit(sums[points[anchor.point].body], anchor, into, force, pressure);
    }
  };
  for_each_pressing(
      [&](Sum& sum, const ContactAnchor& anchor, const Vector3& into, const Vector3& force, double weight) {
        sum.force += force;
        sum.normal += weight * into;
        sum.point += weight * contacts.position(anchor, state);
        sum.rest += weight * rest_place(hand, points, anchor.point);
        sum.pressure += weight;
        sum.stiffness += anchor.stiffness;
        sum.friction = anchor.friction;
      });
  for (Sum& sum : sums) {
    if (!(sum.pressure > 0)) continue;
    sum.point /= sum.pressure;
    sum.rest /= sum.pressure;
  }
  for_each_pressing([&](Sum& sum, const ContactAnchor& anchor, const Vector3&, const Vector3& force, double weight) {
    const Vector3 lever = contacts.position(anchor, state) - sum.point;
    sum.torque += lever.cross(force);
    sum.square += weight * lever.squaredNorm();
  });
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Sum& sum = sums[b];
    const double length = sum.normal.norm();
    if (!(length > 0) || !(sum.force.dot(sum.normal) > 0)) continue;
    const Vector3 normal = sum.normal / length;
    ContactPatch patch;
    patch.object = object;
    patch.body = static_cast<std::uint32_t>(b);
    patch.point = to_wire(sum.point);
    patch.normal = to_wire(normal);
    patch.force = to_wire(sum.force);
    patch.torque = to_wire(sum.torque);
    patch.stiffness = stiffness_of(hand, state, b, sum, normal);
    patch.radius = std::sqrt(sum.square / sum.pressure);
    patch.friction = sum.friction;
    if (patches.push_back(patch)) continue;
    const auto size = [](const ContactPatch& each) { return to_vector(each.force).squaredNorm(); };
    auto least =
        std::min_element(patches.begin(), patches.end(),
                         [&size](const ContactPatch& one, const ContactPatch& two) { return size(one) < size(two); });
    if (size(*least) < size(patch)) *least = patch;
  }
}

}  // namespace softhand
