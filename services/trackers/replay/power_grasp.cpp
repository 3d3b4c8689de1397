#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "trackers/replay/grip.hpp"
#include "trackers/replay/posture_solver.hpp"

namespace softhand {
namespace {

constexpr double kPalmGap = 1e-3;  // m, between the palm's round bones and the cylinder; the skin of the palm presses
constexpr double kPlace = 30 * kPerMetre;  // weight of the pad positions, above all other goals
constexpr double kLevel = 0.1 * kPerMetre;
constexpr double kBack = 5e-3;    // m, distance of the open hand's palm from its place in the grasp
constexpr double kOpposed = 3;    // weight of the goal that the thumb is opposite to the knuckles
constexpr double kBeyond = 5e-3;  // m, knuckles past the axis, so that the fingers reach around
// Depth of the other phalanges, relative to the depth of the pads. The proximal phalanges take the force with which the
// intermediate and distal phalanges press towards the palm. With a smaller depth a thin cylinder moves into the hand
// until thumb and little finger hardly touch it.
constexpr double kProximalShare = 1.2, kIntermediateShare = 0.5;
// Depth of the little finger's pad, relative to that of the others. The finger is the weakest.
constexpr double kLittleShare = 1.2;

// Component perpendicular to the cylinder's axis, which is Y.
Vector3 radial(const Vector3& p) { return {p.x(), 0, p.z()}; }

// Smallest distance (m, negative = inside) of a bone's surface from the cylinder while the pads press.
double deepest(const GeneratorOptions& o) { return -o.closing_depth - 1e-3; }

// Goal: a finger goes around the cylinder at the height of its own knuckle.
void keep_level(PostureSolver& s, Finger finger, double weight = kLevel) {
  const Body knuckle = static_cast<Body>(index_of(distal_of(finger)) - 2);
  const Vector3& at = s.frames(0)[static_cast<std::size_t>(index_of(joint_of(knuckle)))].position;
  const auto pad = s.pad(finger, 0);
  s.add_residual(weight, pad.position.y() - at.y(),
                 {by_point(0, pad.body, pad.position, Vector3::UnitY()), by_point(0, knuckle, at, -Vector3::UnitY())});
}

// Goals: every phalanx lies on the cylinder, and the palm lies behind it, so that each finger presses it into the palm.
struct GraspGoals {
  double radius;  // m, of the cylinder
  double depth;   // m, of the pads below the surface
  double deepest;
  Vector3 ahead;  // from the wrist to the knuckles

  void operator()(PostureSolver& s) const {
    for (int f = 0; f < kFingerCount; ++f) {
      const auto pad = s.pad(static_cast<Finger>(f), 0);
      const Vector3 out = radial(pad.position), direction = out.normalized();
      const double share = static_cast<Finger>(f) == Finger::little ? kLittleShare : 1;
      s.add_residual(kPlace, out.norm() - radius + share * depth, {by_point(0, pad.body, pad.position, direction)});
      for (int i = 0; i < 3; ++i) {
        s.add_residual(3, pad.normal[i] + direction[i],
                       {by_direction(0, pad.body, pad.normal, Vector3::Unit(i)),
                        by_point(0, pad.body, pad.position, of_direction(out, i))});
        if (f == 0) {
          s.add_residual(kOpposed, direction[i] + ahead[i],
                         {by_point(0, pad.body, pad.position, of_direction(out, i))});
        }
      }
    }
    wrap(s);
    level(s);
    s.add_distance_goal(0, {Finger::index, Finger::middle, Finger::ring, Finger::little}, 0.5e-3);
    s.add_wrist_rotation_goal(10);
    s.add_start_goal(0.4);
  }

 private:
  // Gradient, with respect to the point, of component i of the direction of `out` (without height).
  static Vector3 of_direction(const Vector3& out, int i) {
    const Vector3 direction = out.normalized();
    return (radial(Vector3::Unit(i)) - direction * direction[i]) / out.norm();
  }
  // Goal: the distance between the cylinder and the nearest sphere of `body` is `clearance`.
  void add_clearance_goal(PostureSolver& s, Body body, double weight, double clearance) const {
    const GripHand::Sphere* nearest = nullptr;
    double least = 1;
    for (const GripHand::Sphere& sphere : s.spheres(0)) {
      const double distance = radial(sphere.centre).norm() - radius - sphere.radius;
      if (sphere.body != body || distance >= least) continue;
      least = distance;
      nearest = &sphere;
    }
    if (nearest)
      s.add_residual(weight, least - clearance,
                     {by_point(0, body, nearest->centre, radial(nearest->centre).normalized())});
  }
  void wrap(PostureSolver& s) const {
    for (const Finger finger : kFourFingers) {
      const int distal = index_of(distal_of(finger));
      add_clearance_goal(s, static_cast<Body>(distal - 1), 2 * kPerMetre, -kIntermediateShare * depth);
      add_clearance_goal(s, static_cast<Body>(distal - 2), 2 * kPerMetre, -kProximalShare * depth);
      add_clearance_goal(s, static_cast<Body>(distal - 3), kPerMetre, kPalmGap);
    }
    add_clearance_goal(s, Body::thumb_proximal, 0.5 * kPerMetre, -kIntermediateShare * depth);
    for (const GripHand::Sphere& sphere : s.spheres(0)) {
      const Vector3 out = radial(sphere.centre);
      const double distance = out.norm() - radius - sphere.radius;
      const double margin = is_metacarpal(sphere.body) ? kPalmGap : deepest;
      if (distance < margin)
        s.add_residual(2 * kPerMetre, distance - margin, {by_point(0, sphere.body, sphere.centre, out.normalized())});
    }
  }
  // Each finger goes around at the height of its own knuckle. The thumb is between index and middle finger.
  void level(PostureSolver& s) const {
    const JointFrames& frames = s.frames(0);
    const Vector3 up = Vector3::UnitY();
    for (const Finger finger : kFourFingers) keep_level(s, finger);
    const auto thumb = s.pad(Finger::thumb, 0), index = s.pad(Finger::index, 0), middle = s.pad(Finger::middle, 0);
    s.add_residual(kLevel, thumb.position.y() - 0.5 * (index.position.y() + middle.position.y()),
                   {by_point(0, thumb.body, thumb.position, up), by_point(0, index.body, index.position, -0.5 * up),
                    by_point(0, middle.body, middle.position, -0.5 * up)});
    const Vector3& knuckle = frames[static_cast<std::size_t>(index_of(Joint::middle_proximal))].position;
    s.add_residual(0.5 * kPerMetre, knuckle.dot(ahead) - kBeyond,
                   {by_point(0, Body::middle_metacarpal, knuckle, ahead)});
    const auto ring = s.pad(Finger::ring, 0);
    s.add_residual(
        kLevel, 0.5 * (middle.position.y() + ring.position.y()),
        {by_point(0, middle.body, middle.position, 0.5 * up), by_point(0, ring.body, ring.position, 0.5 * up)});
  }
};

// The hand's palm looks along -Z and its thumb side up. So the knuckles of a right hand are ahead of its wrist along X.
Vector3 ahead(const HandModel& model) { return (model.side == Side::right ? 1 : -1) * Vector3::UnitX(); }

// First guess: palm along -Z, thumb side up, cylinder below the knuckles.
Pose first_wrist(const HandModel& model, double radius) {
  const Vector3 thumb_side = model.side == Side::right ? Vector3(-1, 0, 0) : Vector3(1, 0, 0);
  Matrix3 in_hand;
  in_hand << thumb_side.cross(Vector3::UnitY()), thumb_side, Vector3::UnitY();
  Pose wrist;
  wrist.orientation = Quaternion(Matrix3(in_hand.transpose()));
  const auto knuckle = static_cast<std::size_t>(index_of(Joint::middle_proximal));
  const Vector3 centre =
      model.rest_joints[knuckle].position - Vector3(0, radius + model.joint_radii[knuckle] + kPalmGap, 0);
  wrist.position = -(wrist.orientation * centre);
  return wrist;
}

void free_all_fingers(PostureSolver& solver) {
  for (int f = 0; f < kFingerCount; ++f) solver.free_finger(static_cast<Finger>(f), {0});
}

// Fingers nearly straight. Everything is clear of the cylinder and of its path into the hand.
JointAngles opened(const GripHand& hand, const Pose& wrist, const JointAngles& shut, double radius, double opening) {
  PostureSolver solver(hand, wrist, {hand.limited(hand.from_open(0.15, shut))});
  free_all_fingers(solver);
  solver.solve([&](PostureSolver& s) {
    for (const GripHand::Sphere& sphere : s.spheres(0)) {
      Vector3 from = radial(sphere.centre);
      if (from.z() < 0) from.z() = 0;  // in the frame of the hand the cylinder arrives along +Z
      const double margin = is_metacarpal(sphere.body) ? kBack : 0.5 * opening;
      const double clearance = from.norm() - radius - sphere.radius;
      if (clearance < margin)
        s.add_residual(2 * kPerMetre, clearance - margin, {by_point(0, sphere.body, sphere.centre, from.normalized())});
    }
    // Use a large weight. Otherwise an open little finger would clear the cylinder by hanging below it, through the
    // table.
    for (const Finger finger : kFourFingers) keep_level(s, finger, 10 * kLevel);
    s.add_start_goal(1);
  });
  return solver.angles(0);
}

constexpr double kOpen = 0.25;  // rad, approximate flexion of the open hand's joints

// First guess: the middle of each phalanx touches the cylinder.
JointAngles around(const GripHand& hand, double radius) {
  const HandModel& model = hand.model();
  const JointFrames& rest = model.rest_joints;
  JointAngles angles = hand.open();
  for (const Finger finger : kFourFingers) {
    const auto knuckle = static_cast<std::size_t>(index_of(tip_of(finger))) - 3;
    std::array<double, 4> half;  // half of the angle around the cylinder along each bone; index 0 is the palm
    for (std::size_t k = 1; k < 4; ++k) {
      const double length = (rest[knuckle + k].position - rest[knuckle + k - 1].position).norm();
      half[k] = std::atan(0.5 * length / (radius + model.joint_radii[knuckle + k - 1]));
    }
    half[0] = 0.5 * half[1];
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t body = static_cast<std::size_t>(index_of(distal_of(finger))) - 2 + k;
      angles[body].x() = hand.open()[body].x() + kOpen - half[k] - half[k + 1];
    }
  }
  hand.flex(angles, Finger::thumb, -0.2, -0.3, -0.4);
  return hand.limited(angles);
}

struct Grasp {
  Pose wrist;
  JointAngles shut;
};

// Start with a cylinder that fits the hand. Then change its radius in small steps to the requested one. From a distant
// start the thumb would be caught on the wrong side.
Grasp closed(const GripHand& hand, const GeneratorOptions& o) {
  constexpr double kFitting = 25e-3, kStep = 2.5e-3;  // m, radii
  const double radius = 0.5 * o.object_width;
  const int steps = static_cast<int>(std::ceil(std::abs(radius - kFitting) / kStep));
  Grasp grasp{first_wrist(hand.model(), kFitting), around(hand, kFitting)};
  for (int k = 0; k <= steps; ++k) {
    const double now = steps == 0 ? radius : kFitting + (radius - kFitting) * k / steps;
    PostureSolver solver(hand, grasp.wrist, {grasp.shut});
    solver.free_wrist();
    free_all_fingers(solver);
    solver.solve(GraspGoals{now, o.closing_depth, -o.closing_depth - 1e-3, ahead(hand.model())});
    grasp = {solver.wrist(), solver.angles(0)};
  }
  return grasp;
}

}  // namespace

Grip solve_power_grasp(const HandModel& model, const GeneratorOptions& o) {
  const GripHand hand(model);
  const double radius = 0.5 * o.object_width, reach = radius - o.closing_depth;
  const Grasp grasp = closed(hand, o);
  const JointFrames frames = forward_kinematics(model, grasp.wrist, grasp.shut);
  for (int f = 0; f < kFingerCount; ++f) {
    const double got = radial(hand.pad(static_cast<Finger>(f), frames).position).norm();
    if (std::abs(got - reach) > 2e-3) {
      throw std::invalid_argument("generator: power_grasp of " + std::to_string(o.object_width * 1e3) +
                                  " mm: the pad of " + std::string(kFingerNames[static_cast<std::size_t>(f)]) +
                                  " comes to " + std::to_string(got * 1e3) +
                                  " mm of the axis; expected an object_width that the hand can close on");
    }
  }

  Grip grip;
  grip.wrist = grasp.wrist;
  const JointAngles& shut = grasp.shut;
  grip.open_offset = kBack * Vector3::UnitZ();
  const auto wrist_at = [&](double share) {
    return Pose{grip.wrist.position + palm_back(share) * grip.open_offset, grip.wrist.orientation};
  };
  const JointAngles wide = opened(hand, wrist_at(1), shut, radius, o.opening);
  for (std::size_t k = 0; k < kApertures; ++k) {
    const double share = static_cast<double>(k) / (kApertures - 1);
    JointAngles straight = shut;
    for (std::size_t b = 2; b < kBodyCount; ++b) straight[b] = (1 - share) * shut[b] + share * wide[b];
    // During the motion no finger may be deeper in the cylinder than in the closed grasp.
    PostureSolver between(hand, wrist_at(share), {straight});
    free_all_fingers(between);
    between.solve([&](PostureSolver& s) {
      for (const GripHand::Sphere& sphere : s.spheres(0)) {
        const Vector3 out = radial(sphere.centre);
        const double clearance = out.norm() - radius - sphere.radius;
        if (clearance < deepest(o))
          s.add_residual(kPerMetre, clearance - deepest(o),
                         {by_point(0, sphere.body, sphere.centre, out.normalized())});
      }
      s.add_start_goal(1);
    });
    grip.apertures.push_back(between.angles(0));
  }
  place_in_world(grip, o, Vector3::UnitZ());
  return grip;
}

}  // namespace softhand
