#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "trackers/replay/grip.hpp"
#include "trackers/replay/posture_solver.hpp"

namespace softhand {
namespace {

constexpr double kPalmGap = 5e-3;          // between palm and cylinder, which the coupling closes
constexpr double kPlace = 30 * kPerMetre;  // of pads, against all wishes

// From the cylinder's axis, which is Y.
Vector3 radial(const Vector3& p) { return {p.x(), 0, p.z()}; }

// How deep the surface of the bone may be in the cylinder while the pads press.
double deepest(const GeneratorOptions& o) { return -o.closing_depth - 1e-3; }

struct GraspGoals {
  double radius;  // of the cylinder
  double reach;   // of the pads from its axis
  double deepest;

  void operator()(PostureSolver& s) const {
    const auto middle = s.pad(Finger::middle, 0);
    const Vector3 middle_out = radial(middle.position).normalized();
    for (int f = 0; f < kFingerCount; ++f) {
      const auto pad = s.pad(static_cast<Finger>(f), 0);
      const Vector3 out = radial(pad.position), direction = out.normalized();
      s.want(kPlace, out.norm() - reach, {by_point(0, pad.body, pad.position, direction)});
      for (int i = 0; i < 3; ++i) {
        s.want(3, pad.normal[i] + direction[i],
               {by_direction(0, pad.body, pad.normal, Vector3::Unit(i)), by_point(0, pad.body, pad.position, of_direction(out, i))});
        if (f == 0) {
          s.want(1, direction[i] + middle_out[i],
                 {by_point(0, pad.body, pad.position, of_direction(out, i)),
                  by_point(0, middle.body, middle.position, of_direction(radial(middle.position), i))});
        }
      }
    }
    wrap(s);
    s.want_apart(0, {Finger::index, Finger::middle, Finger::ring, Finger::little}, 0.5e-3);
    s.want(0.1 * kPerMetre, middle.position.y(), {by_point(0, middle.body, middle.position, Vector3::UnitY())});
    s.want_wrist_turned_little(3);
    s.want_start(0.4);
  }

 private:
  // Gradient of component i of the direction of `out` (without height) by the point.
  static Vector3 of_direction(const Vector3& out, int i) {
    const Vector3 direction = out.normalized();
    return (radial(Vector3::Unit(i)) - direction * direction[i]) / out.norm();
  }
  void wrap(PostureSolver& s) const {
    const GripHand::Sphere* palm = nullptr;
    double palm_distance = 1;
    for (const GripHand::Sphere& sphere : s.spheres(0)) {
      const Vector3 out = radial(sphere.centre);
      const double distance = out.norm() - radius - sphere.radius;
      const bool distal = sphere.body == distal_of(finger_of(sphere.body)), metacarpal = is_metacarpal(sphere.body);
      const double margin = metacarpal ? kPalmGap : distal ? deepest : 1e-3;
      const Change outwards = by_point(0, sphere.body, sphere.centre, out.normalized());
      if (metacarpal && finger_of(sphere.body) != Finger::thumb && distance < palm_distance) {
        palm_distance = distance;
        palm = &sphere;
      }
      if (distance < margin) s.want(2 * kPerMetre, distance - margin, {outwards});
      // Phalanges lie along the cylinder where they can.
      if (!distal && !metacarpal) s.want(0.05 * kPerMetre, distance - margin, {outwards});
    }
    if (palm) s.want(kPerMetre, palm_distance - kPalmGap, {by_point(0, palm->body, palm->centre, radial(palm->centre).normalized())});
  }
};

// First guess: palm along -Z, the thumb's side up, the cylinder below the knuckles.
Pose first_wrist(const HandModel& model, double radius) {
  const Vector3 thumb_side = model.side == Side::right ? Vector3(-1, 0, 0) : Vector3(1, 0, 0);
  Matrix3 in_hand;
  in_hand << thumb_side.cross(Vector3::UnitY()), thumb_side, Vector3::UnitY();
  Pose wrist;
  wrist.orientation = Quaternion(Matrix3(in_hand.transpose()));
  const auto knuckle = static_cast<std::size_t>(index_of(Joint::middle_proximal));
  const Vector3 centre = model.rest_joints[knuckle].position - Vector3(0, radius + model.joint_radii[knuckle] + kPalmGap, 0);
  wrist.position = -(wrist.orientation * centre);
  return wrist;
}

void free_all_fingers(PostureSolver& solver) {
  for (int f = 0; f < kFingerCount; ++f) solver.free_finger(static_cast<Finger>(f), {0});
}

// Fingers nearly straight, everything clear of the cylinder and of the way that it comes into the hand.
JointAngles opened(const GripHand& hand, const Pose& wrist, const JointAngles& shut, double radius, double opening) {
  JointAngles start = shut;
  for (std::size_t b = 2; b < kBodyCount; ++b) start[b] *= 0.15;
  PostureSolver solver(hand, wrist, {start});
  free_all_fingers(solver);
  solver.solve([&](PostureSolver& s) {
    for (const GripHand::Sphere& sphere : s.spheres(0)) {
      Vector3 from = radial(sphere.centre);
      if (from.z() < 0) from.z() = 0;  // the cylinder comes along +Z, as the hand sees it
      const double margin = is_metacarpal(sphere.body) ? 4e-3 : 0.5 * opening;
      const double room = from.norm() - radius - sphere.radius;
      if (room < margin) s.want(2 * kPerMetre, room - margin, {by_point(0, sphere.body, sphere.centre, from.normalized())});
    }
    s.want_start(1);
  });
  return solver.angles(0);
}

}  // namespace

Grip solve_power_grasp(const HandModel& model, const GeneratorOptions& o) {
  const GripHand hand(model);
  const double radius = 0.5 * o.object_width, reach = radius - o.closing_depth;
  JointAngles start;
  start.fill(Vector3::Zero());
  for (const Finger finger : kFourFingers) flex(start, finger, -0.8, -0.9, -0.5);
  flex(start, Finger::thumb, -0.2, -0.3, -0.4);
  PostureSolver grasp(hand, first_wrist(model, radius), {hand.limited(start)});
  grasp.free_wrist();
  free_all_fingers(grasp);
  grasp.solve(GraspGoals{radius, reach, deepest(o)});

  for (int f = 0; f < kFingerCount; ++f) {
    const double got = radial(grasp.pad(static_cast<Finger>(f), 0).position).norm();
    if (std::abs(got - reach) > 2e-3) {
      throw std::invalid_argument("generator: power_grasp of " + std::to_string(o.object_width * 1e3) + " mm: the pad of " +
                                  std::string(kFingerNames[static_cast<std::size_t>(f)]) + " comes to " + std::to_string(got * 1e3) +
                                  " mm of the axis; expected an object_width that the hand can close on");
    }
  }

  Grip grip;
  grip.wrist = grasp.wrist();
  const JointAngles& shut = grasp.angles(0);
  const JointAngles wide = opened(hand, grip.wrist, shut, radius, o.opening);
  for (std::size_t k = 0; k < kApertures; ++k) {
    const double share = static_cast<double>(k) / (kApertures - 1);
    JointAngles straight = shut;
    for (std::size_t b = 2; b < kBodyCount; ++b) straight[b] = (1 - share) * shut[b] + share * wide[b];
    // On the way no finger may cut through more of the cylinder than it does in the end.
    PostureSolver between(hand, grip.wrist, {straight});
    free_all_fingers(between);
    between.solve([&](PostureSolver& s) {
      for (const GripHand::Sphere& sphere : s.spheres(0)) {
        const Vector3 out = radial(sphere.centre);
        const double room = out.norm() - radius - sphere.radius;
        if (room < deepest(o)) s.want(kPerMetre, room - deepest(o), {by_point(0, sphere.body, sphere.centre, out.normalized())});
      }
      s.want_start(1);
    });
    grip.apertures.push_back(between.angles(0));
  }
  place_in_world(grip, o, Vector3::UnitZ());
  return grip;
}

}  // namespace softhand
