#include "scene/finger_gap.hpp"

#include <algorithm>
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

double gap(const Axis& a, const Axis& b) { return distance(a, b) - a.radius - b.radius; }

std::vector<Axis> axes_of(const HandModel& hand, int first_body, const State& state, bool with_metacarpals) {
  std::vector<Axis> axes;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    if (finger_of(body) == Finger::palm || (is_metacarpal(body) && !with_metacarpals)) continue;
    const BodyModel& model = hand.bodies[b];
    const Pose joint = state.body_poses[static_cast<std::size_t>(first_body) + b] * model.joint_from_body.inverse();
    axes.push_back({finger_of(body), joint * model.bone_start,
                    joint.orientation * Vector3(model.bone_end - model.bone_start),
                    std::min(model.bone_start_radius, model.bone_end_radius)});
  }
  return axes;
}

}  // namespace

double finger_gap(const HandModel& hand, const State& state, int first_body) {
  const std::vector<Axis> axes = axes_of(hand, first_body, state, false);
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < axes.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k)
      if (axes[i].finger != axes[k].finger) least = std::min(least, gap(axes[i], axes[k]));
  }
  return least;
}

double hands_gap(const HandModel& one, int first_body_of_one, const HandModel& two, int first_body_of_two,
                 const State& state) {
  double least = std::numeric_limits<double>::infinity();
  for (const Axis& a : axes_of(one, first_body_of_one, state, true)) {
    for (const Axis& b : axes_of(two, first_body_of_two, state, true)) least = std::min(least, gap(a, b));
  }
  return least;
}

}  // namespace softhand
