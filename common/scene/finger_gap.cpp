#include "scene/finger_gap.hpp"

#include <algorithm>
#include <limits>
#include <vector>

#include "energies/skeleton_contact.hpp"

namespace softhand {
namespace {

struct Axis {
  Vector3 begin, along;
  double radius;
};

Axis axis_of(const BoneCapsule& bone, const State& state) {
  const Vector3 begin = bone.begin_in(state);
  return {begin, bone.end_in(state) - begin, bone.radius};
}

// Ericson, Real-Time Collision Detection, 5.1.9. No axis has zero length.
double distance(const Axis& a, const Axis& b) {
  const Vector3 r = a.begin - b.begin;
  const double aa = a.along.squaredNorm(), bb = b.along.squaredNorm(), ab = a.along.dot(b.along), ar = a.along.dot(r),
               br = b.along.dot(r), denominator = aa * bb - ab * ab;
  double s = denominator > 1e-12 * aa * bb ? std::clamp((ab * br - ar * bb) / denominator, 0.0, 1.0) : 0.0;
  const double t = std::clamp((ab * s + br) / bb, 0.0, 1.0);
  s = std::clamp((ab * t - ar) / aa, 0.0, 1.0);
  return (r + s * a.along - t * b.along).norm();
}

double gap(const BoneCapsule& a, const BoneCapsule& b, const State& state) {
  return distance(axis_of(a, state), axis_of(b, state)) - a.radius - b.radius;
}

}  // namespace

double finger_gap(const HandModel& hand, const State& state, int first_body) {
  const std::vector<BoneCapsule> bones = bone_capsules(hand, first_body);
  double least = std::numeric_limits<double>::infinity();
  for (const BoneCapsule& a : bones) {
    for (const BoneCapsule& b : bones) {
      if (a.body > b.body && a.finger != b.finger && !a.is_metacarpal && !b.is_metacarpal)
        least = std::min(least, gap(a, b, state));
    }
  }
  return least;
}

double hands_gap(const HandModel& one, int first_body_of_one, const HandModel& two, int first_body_of_two,
                 const State& state) {
  const std::vector<BoneCapsule> others = bone_capsules(two, first_body_of_two);
  double least = std::numeric_limits<double>::infinity();
  for (const BoneCapsule& a : bone_capsules(one, first_body_of_one)) {
    for (const BoneCapsule& b : others) least = std::min(least, gap(a, b, state));
  }
  return least;
}

}  // namespace softhand
