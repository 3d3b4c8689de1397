#include "trackers/replay/free_motion.hpp"

#include <algorithm>
#include <cmath>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "trackers/replay/posture_solver.hpp"

namespace softhand {
namespace {

// Each finger flexes until it almost meets the palm. The thumb then lies across the fingers.
JointAngles solve_fist(const HandModel& model) {
  const GripHand hand(model);
  JointAngles fist = hand.open();
  for (const Finger finger : kFourFingers) {
    for (double s = 0.05; s <= 1; s += 0.01) {
      JointAngles tried = fist;
      hand.flex(tried, finger, -1.25 * s, -1.45 * s, -0.9 * s);
      tried = hand.limited(tried);
      const auto spheres = hand.spheres(forward_kinematics(model, Pose{}, tried));
      double gap = 1;
      for (const auto& tip : spheres) {
        if (tip.body != distal_of(finger)) continue;
        for (const auto& palm : spheres) {
          if (is_metacarpal(palm.body) && finger_of(palm.body) != Finger::thumb)
            gap = std::min(gap, (tip.centre - palm.centre).norm() - tip.radius - palm.radius);
        }
      }
      if (gap < 2e-3) break;
      fist = tried;
    }
  }
  PostureSolver solver(hand, Pose{}, {fist});
  solver.free_finger(Finger::thumb, {0});
  solver.solve([](PostureSolver& s) {
    const JointFrames& frames = s.frames(0);
    const Vector3 over =
        0.5 * (frames[slot_of(Joint::index_intermediate)].position + frames[slot_of(Joint::index_distal)].position);
    const auto thumb = s.pad(Finger::thumb, 0);
    s.add_point_goal(0.1 * kPerMetre, 0, thumb.body, thumb.position, over);
    s.add_distance_goal(0, {Finger::index, Finger::middle, Finger::ring, Finger::little}, 1e-3);
    s.add_start_goal(0.5);
  });
  return solver.angles(0);
}

// A fist that opens and closes, or a wandering hand with every joint in motion, without an object. The motion starts
// and ends in the hand's rest pose. In between it opens to the open hand.
class FreeMotion : public Motion {
 public:
  FreeMotion(const HandModel& hand, const GeneratorOptions& options)
      : hand_(hand), options_(options), open_(open_hand(hand)), fist_(solve_fist(hand)) {}
  double duration() const override { return options_.free_time; }
  const std::array<double, kJointCount>& radii() const override { return hand_.joint_radii; }
  JointFrames at(double time) const override {
    const double t = std::clamp(time, 0.0, options_.free_time);
    const double window = minimum_jerk(t) * minimum_jerk(options_.free_time - t);  // ramps up and down over 1 s
    const bool fist = options_.motion == "fist";
    Pose wrist{to_vector(options_.object_position), Quaternion::Identity()};
    if (!fist) {
      wrist.position += window * Vector3(0.08 * std::sin(1.3 * t), 0.05 * std::sin(1.9 * t), 0.06 * std::sin(1.1 * t));
      wrist.orientation =
          rotation_exp(window * Vector3(0.35 * std::sin(0.9 * t), 0.4 * std::sin(1.2 * t), 0.5 * std::sin(0.7 * t)));
    }
    JointAngles angles = fist_;
    for (int f = 0; f < kFingerCount; ++f) {
      const bool thumb = f == 0;
      // The fingers move in a wave. The thumb closes over them last and opens first.
      const double beat = 0.5 - 0.5 * std::cos(2 * M_PI * t / 4);
      const double share = fist ? (thumb ? minimum_jerk(2 * beat - 1) : minimum_jerk(beat / 0.8))
                                : (thumb ? 0.15 - 0.15 * std::cos(1.4 * t) : 0.3 - 0.3 * std::cos(1.7 * t - 0.5 * f));
      for (const JointAxis& v : axes_of(static_cast<Finger>(f))) {
        const double open = open_[slot_of(v.body)][v.axis];
        double& angle = angles[slot_of(v.body)][v.axis];
        angle = window * (open + share * (angle - open));
      }
    }
    return forward_kinematics(hand_, wrist, angles);
  }

 private:
  HandModel hand_;
  GeneratorOptions options_;
  JointAngles open_;
  JointAngles fist_;
};

// The thumb presses on the pad of the index finger and slides along it, forth and back. The motion starts and ends with
// the thumb away from the finger.
class Rub : public Motion {
 public:
  Rub(const HandModel& model, const GeneratorOptions& options) : model_(model), options_(options) {
    const GripHand hand(model_);
    JointAngles start = hand.open();
    hand.flex(start, Finger::index, -0.6, -0.5, -0.3);
    hand.flex(start, Finger::thumb, -0.3, -0.3, -0.3);
    start = hand.limited(start);
    for (std::size_t k = 0; k <= kPlaces; ++k) {
      PostureSolver one(hand, Pose{}, {k == 0 ? start : postures_.back()});
      one.free_finger(Finger::thumb, {0});
      // Posture 0 is the first place with the thumb away from the finger.
      const double place = kStroke * (static_cast<double>(k < 1 ? 0 : k - 1) / (kPlaces - 1) - 0.5);
      const double depth = k == 0 ? -kAway : options_.closing_depth;
      one.solve([&](PostureSolver& s) {
        const auto thumb = s.pad(Finger::thumb, 0), index = s.pad(Finger::index, 0);
        s.add_point_goal(kPerMetre, 0, thumb.body, thumb.centre,
                         index.centre + (index.radius + thumb.radius - depth) * index.normal + place * index.along);
        s.add_direction_goal(0.3, 0, thumb.body, thumb.normal, -index.normal);
        s.add_start_goal(0.05);
      });
      postures_.push_back(one.angles(0));
    }
  }
  double duration() const override { return options_.free_time; }
  const std::array<double, kJointCount>& radii() const override { return model_.joint_radii; }
  JointFrames at(double time) const override {
    const double t = std::clamp(time, 0.0, options_.free_time);
    const double open = minimum_jerk(t) * minimum_jerk(options_.free_time - t);
    const double pressed = minimum_jerk((t - 1) / 0.5) * minimum_jerk((options_.free_time - 1 - t) / 0.5);
    const double place = 0.5 - 0.5 * std::cos(2 * M_PI * std::max(0.0, t - 1.5) / kPeriod);
    const double at = place * (kPlaces - 1);
    const auto k = static_cast<std::size_t>(std::min(at, kPlaces - 2.0));
    JointAngles angles;
    for (std::size_t b = 0; b < angles.size(); ++b) {
      const double part = at - static_cast<double>(k);
      const Vector3 on = (1 - part) * postures_[k + 1][b] + part * postures_[k + 2][b];
      angles[b] = open * (postures_[0][b] + pressed * (on - postures_[0][b]));
    }
    return forward_kinematics(model_, Pose{to_vector(options_.object_position), Quaternion::Identity()}, angles);
  }

 private:
  static constexpr std::size_t kPlaces = 9;  // along the stroke
  static constexpr double kStroke = 0.010;   // m
  static constexpr double kAway = 0.010;     // m
  static constexpr double kPeriod = 2;       // s

  HandModel model_;
  GeneratorOptions options_;
  std::vector<JointAngles> postures_;
};

}  // namespace

std::unique_ptr<Motion> make_free_motion(const HandModel& hand, const GeneratorOptions& options) {
  if (options.motion == "rub") return std::make_unique<Rub>(hand, options);
  return std::make_unique<FreeMotion>(hand, options);
}

}  // namespace softhand
