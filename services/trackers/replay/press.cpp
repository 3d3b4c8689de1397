#include <algorithm>
#include <stdexcept>

#include "trackers/replay/grip.hpp"
#include "trackers/replay/posture_solver.hpp"

namespace softhand {
namespace {

constexpr double kClearOfFace = 8e-3;  // m, of everything but the pressing finger above the face
constexpr double kSteep = 0.7;         // cosine between the pressing bone and straight down
constexpr double kPlacePad = 30 * kPerMetre;

}  // namespace

// The pad of the index finger is at the origin and looks down. The finger points down and forward (-Z). Everything else
// is above the face.
Grip solve_press(const HandModel& model, const GeneratorOptions& o) {
  const GripHand hand(model);
  JointAngles start = hand.open();
  hand.flex(start, Finger::index, -0.5, -0.3, -0.1);
  for (const Finger finger : {Finger::middle, Finger::ring, Finger::little}) hand.flex(start, finger, -1.0, -1.2, -0.6);
  hand.flex(start, Finger::thumb, -0.1, -0.2, -0.3);
  start = hand.limited(start);
  // The hand is behind the face: fingers along -Z, palm down.
  const JointFrames frames = forward_kinematics(model, Pose{}, start);
  Pose wrist;
  wrist.position = -hand.pad(Finger::index, frames).position;
  PostureSolver solver(hand, wrist, {start});
  solver.free_wrist();
  for (int f = 0; f < kFingerCount; ++f) solver.free_finger(static_cast<Finger>(f), {0});
  for (const double clear : {0.1, 1.0, 5.0}) {
    solver.solve([&](PostureSolver& s) {
      const auto pad = s.pad(Finger::index, 0);
      s.add_touch_goal(kPlacePad, 0, pad.touch(-Vector3::UnitY()), Vector3::Zero());
      s.add_direction_goal(3, 0, pad.body, pad.along, Vector3(0, -kSteep, -std::sqrt(1 - kSteep * kSteep)));
      for (const GripHand::Sphere& sphere : s.spheres(0)) {
        if (finger_of(sphere.body) == Finger::index && !is_metacarpal(sphere.body)) continue;
        const double height = sphere.centre.y() - sphere.radius - kClearOfFace;
        if (height < 0)
          s.add_residual(clear * kPerMetre, height, {by_point(0, sphere.body, sphere.centre, Vector3::UnitY())});
      }
      s.add_distance_goal(0, {Finger::index, Finger::middle, Finger::ring, Finger::little}, 1e-3);
      s.add_wrist_rotation_goal(2);
      s.add_start_goal(1);
    });
  }
  const auto pad = solver.pad(Finger::index, 0);
  const Vector3 touch = pad.touch(-Vector3::UnitY()).point;
  if (touch.norm() > 1e-3)
    throw std::invalid_argument("generator: press: the pad comes to " + std::to_string(touch.norm() * 1e3) +
                                " mm of its place, expected at most 1 mm");
  Grip grip;
  grip.wrist = solver.wrist();
  grip.apertures = {solver.angles(0), solver.angles(0)};
  place_in_world(grip, o, Vector3::UnitY());
  return grip;
}

}  // namespace softhand
