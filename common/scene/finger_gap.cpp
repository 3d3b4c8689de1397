#include "scene/finger_gap.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <vector>

namespace softhand {
namespace {

struct Axis {
  Finger finger;
  Vector3 begin, along;
  double radius;
};

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

}  // namespace

double finger_gap(const HandModel& hand, const State& state) {
  std::array<Axis, kBodyCount> axes;
  std::size_t count = 0;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    if (finger_of(body) == Finger::palm || is_metacarpal(body)) continue;
    const BodyModel& model = hand.bodies[b];
    const Pose joint = state.body_poses[b] * model.joint_from_body.inverse();
    axes[count++] = {finger_of(body), joint * model.bone_start,
                     joint.orientation * Vector3(model.bone_end - model.bone_start),
                     std::min(model.bone_start_radius, model.bone_end_radius)};
  }
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      if (axes[i].finger != axes[k].finger)
        least = std::min(least, distance(axes[i], axes[k]) - axes[i].radius - axes[k].radius);
    }
  }
  return least;
}

}  // namespace softhand
