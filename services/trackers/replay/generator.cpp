#include "trackers/replay/generator.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>

#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr std::size_t kApertures = 17;  // solved between closed and open; linear in between

std::size_t index(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }
std::size_t index(Body body) { return static_cast<std::size_t>(index_of(body)); }

// Minimum jerk: 0 to 1 with zero velocity and acceleration at both ends.
double smooth(double s) {
  s = std::clamp(s, 0.0, 1.0);
  return s * s * s * (10 + s * (6 * s - 15));
}

// A joint angle that the inverse kinematics may choose.
struct Variable {
  Body body;
  int axis;        // 0 flexion, 1 abduction
  double nominal;  // radians from rest; where nothing else decides
};

// Damped Gauss-Newton with differences, inside the ranges of motion. Deterministic; runs at load only.
class InverseKinematics {
 public:
  InverseKinematics(const HandModel& hand, std::vector<Variable> variables) : hand_(hand), variables_(std::move(variables)) {}

  std::size_t size() const { return variables_.size(); }
  JointAngles start() const {
    JointAngles angles;
    angles.fill(Vector3::Zero());
    for (const Variable& v : variables_) angles[index(v.body)][v.axis] = limited(v, v.nominal);
    return angles;
  }
  void append_nominal(const JointAngles& angles, double weight, std::vector<double>& residual) const {
    for (const Variable& v : variables_) residual.push_back(weight * (angles[index(v.body)][v.axis] - v.nominal));
  }
  /// Minimises the sum of squares of what `residual` appends.
  JointAngles solve(JointAngles angles, const std::function<void(const JointAngles&, std::vector<double>&)>& residual) const {
    const auto evaluate = [&](const JointAngles& a) {
      std::vector<double> r;
      residual(a, r);
      return r;
    };
    const auto cost = [](const std::vector<double>& r) {
      double sum = 0;
      for (const double x : r) sum += x * x;
      return sum;
    };
    const auto n = static_cast<Eigen::Index>(size());
    std::vector<double> current = evaluate(angles);
    double damping = 1e-2;
    for (int iteration = 0; iteration < 200; ++iteration) {
      const auto rows = static_cast<Eigen::Index>(current.size());
      Eigen::MatrixXd jacobian(rows, n);
      constexpr double kStep = 1e-6;
      for (Eigen::Index c = 0; c < n; ++c) {
        const Variable& v = variables_[static_cast<std::size_t>(c)];
        JointAngles up = angles, down = angles;
        up[index(v.body)][v.axis] += kStep;
        down[index(v.body)][v.axis] -= kStep;
        const std::vector<double> a = evaluate(up), b = evaluate(down);
        for (Eigen::Index r = 0; r < rows; ++r)
          jacobian(r, c) = (a[static_cast<std::size_t>(r)] - b[static_cast<std::size_t>(r)]) / (2 * kStep);
      }
      const Eigen::Map<const Eigen::VectorXd> r(current.data(), rows);
      const Eigen::VectorXd gradient = jacobian.transpose() * r;
      Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
      // Angles that rest on a limit and would leave it take no part in the step.
      for (Eigen::Index c = 0; c < n; ++c) {
        const Variable& v = variables_[static_cast<std::size_t>(c)];
        const double at = angles[index(v.body)][v.axis];
        if (limited(v, at - 1e-9 * gradient[c] / (std::abs(gradient[c]) + 1e-300)) !=
            at - 1e-9 * gradient[c] / (std::abs(gradient[c]) + 1e-300)) {
          normal.row(c).setZero();
          normal.col(c).setZero();
          normal(c, c) = 1e12;
        }
      }
      const Eigen::VectorXd diagonal = normal.diagonal();
      normal.diagonal() += damping * diagonal;
      const Eigen::VectorXd change = -normal.ldlt().solve(gradient);
      JointAngles next = angles;
      for (Eigen::Index c = 0; c < n; ++c) {
        const Variable& v = variables_[static_cast<std::size_t>(c)];
        double& angle = next[index(v.body)][v.axis];
        angle = limited(v, angle + std::clamp(change[c], -0.3, 0.3));
      }
      const std::vector<double> tried = evaluate(next);
      if (cost(tried) < cost(current)) {
        const bool done = cost(current) - cost(tried) < 1e-14 * (1 + cost(current));
        angles = next;
        current = tried;
        damping = std::max(1e-9, damping * 0.3);
        if (done) break;
      } else {
        damping *= 5;
        if (damping > 1e9) break;
      }
    }
    return angles;
  }

 private:
  double limited(const Variable& v, double angle) const {
    const JointModel& joint = hand_.bodies[index(v.body)].joint;
    const std::array<double, 2>& range = v.axis == 0 ? joint.flexion_range : joint.abduction_range;
    return std::clamp(angle, range[0], range[1]);
  }
  const HandModel& hand_;
  std::vector<Variable> variables_;
};

// A pad's place and the direction it presses in, in the wrist's frame.
struct Pad {
  Vector3 position;
  Vector3 normal;
};
Pad pad_of(const HandModel& hand, Finger finger, const JointFrames& frames) {
  const Pose& distal = frames[index(joint_of(distal_of(finger)))];
  return {distal * pad_in_distal(hand, finger), distal.orientation * Vector3(0, -1, 0)};
}

void append(const Vector3& v, double weight, std::vector<double>& residual) {
  for (int i = 0; i < 3; ++i) residual.push_back(weight * v[i]);
}

void flex(JointAngles& angles, Finger finger, double proximal, double intermediate, double distal) {
  const std::size_t last = index(distal_of(finger));
  angles[last - 2].x() = proximal;
  angles[last - 1].x() = intermediate;
  angles[last].x() = distal;
}

// How the hand takes the object: joint angles from closed (first) to open (last), and where its wrist is then.
struct Grip {
  std::vector<JointAngles> apertures;
  Pose wrist;               // world, fingers at the object in its first place
  Vector3 approach_offset;  // from there to where the hand comes from, world
};

constexpr double kPerMetre = 1e3;  // a millimetre counts like a radian

// A distal phalanx in the wrist's frame, as the pinch uses it: the side of the pulp that faces the other finger presses.
struct Phalanx {
  Vector3 centre;     // on its axis, under the pad
  Vector3 direction;  // towards the tip
  Vector3 normal;     // palmar
};

Grip solve_pinch(const HandModel& hand, const GeneratorOptions& o) {
  const double side = hand.side == Side::right ? 1 : -1;  // abduction changes its sign in a mirror
  const InverseKinematics ik(hand, {{Body::index_proximal, 0, -1.1},
                                    {Body::index_proximal, 1, -0.2 * side},
                                    {Body::index_intermediate, 0, -0.05},
                                    {Body::index_distal, 0, 0.05},
                                    {Body::thumb_metacarpal, 0, 0},
                                    {Body::thumb_metacarpal, 1, 0.4 * side},
                                    {Body::thumb_proximal, 0, -0.3},
                                    {Body::thumb_proximal, 1, 0.2 * side},
                                    {Body::thumb_distal, 0, -0.05}});
  const Vector3 thumb_pad = pad_in_distal(hand, Finger::thumb), index_pad = pad_in_distal(hand, Finger::index);
  const double thumb_radius = -thumb_pad.y(), index_radius = -index_pad.y();
  const double closed = o.object_width - 2 * o.closing_depth, open = o.object_width + 2 * o.opening;
  const auto phalanx = [](const Pose& distal, const Vector3& pad) {
    return Phalanx{distal * Vector3(0, 0, pad.z()), distal.orientation * Vector3(0, 0, -1), distal.orientation * Vector3(0, -1, 0)};
  };
  struct Pinch {
    Phalanx thumb, finger;
    Vector3 knuckle;  // of the index finger
  };
  const auto pinch_of = [&](const JointAngles& angles) {
    const JointFrames frames = forward_kinematics(hand, Pose{}, angles);
    return Pinch{phalanx(frames[index(Joint::thumb_distal)], thumb_pad), phalanx(frames[index(Joint::index_distal)], index_pad),
                 frames[index(Joint::index_proximal)].position};
  };
  // First where thumb and index meet best at the object's own width, both upright beside it and the knuckle well above: the grip's axis and middle in
  // the hand follow from it.
  JointAngles at_width = ik.solve(ik.start(), [&](const JointAngles& angles, std::vector<double>& r) {
    const auto [thumb, finger, knuckle] = pinch_of(angles);
    const Vector3 between = finger.centre - thumb.centre;
    const Vector3 axis = between.normalized();
    const Vector3 middle = 0.5 * (thumb.centre + finger.centre);
    Vector3 up = knuckle - middle;
    up -= axis * axis.dot(up);
    const double height = up.norm();
    up /= height;
    r.push_back(kPerMetre * (between.norm() - o.object_width - thumb_radius - index_radius));
    r.push_back(0.17 * kPerMetre * std::max(0.0, 0.055 - height));
    for (const Phalanx& each : {thumb, finger}) {
      r.push_back(2.4 * each.direction.dot(axis));
      r.push_back(1.4 * (each.direction.dot(up) + 1));
    }
    append(thumb.normal - axis, 0.8, r);
    append(finger.normal + axis, 0.8, r);
    ik.append_nominal(angles, 0.2, r);
  });
  const Pinch pinch = pinch_of(at_width);
  const Vector3 axis = (pinch.finger.centre - pinch.thumb.centre).normalized();
  const Vector3 middle = 0.5 * (pinch.thumb.centre + thumb_radius * axis + pinch.finger.centre - index_radius * axis);

  // Fingers that take no part get out of the way of object and table.
  constexpr std::array<std::array<double, 3>, 5> kPostures{
      {{0.25, 0, 0}, {0, 0, 0}, {-0.35, -0.5, -0.3}, {-1.0, -1.3, -0.7}, {-1.35, -1.55, -0.9}}};
  const Vector3 to_knuckle = pinch.knuckle - middle;
  const Vector3 up_in_hand = (Quaternion(Eigen::AngleAxisd(-o.tilt, axis)) * Vector3(to_knuckle - axis * axis.dot(to_knuckle))).normalized();
  double best = -1e9;
  std::array<double, 3> posture{};
  for (const auto& candidate : kPostures) {
    JointAngles angles = at_width;
    for (const Finger finger : {Finger::middle, Finger::ring, Finger::little})
      flex(angles, finger, candidate[0], candidate[1], candidate[2]);
    const JointFrames frames = forward_kinematics(hand, Pose{}, angles);
    double clearance = 1e9;
    for (std::size_t j = index(Joint::middle_intermediate); j < kJointCount; ++j) {
      if (is_metacarpal(body_of(static_cast<Joint>(j)))) continue;
      const Vector3 from_middle = frames[j].position - middle;
      clearance = std::min({clearance, from_middle.dot(up_in_hand) - hand.joint_radii[j] + 0.5 * o.object_width,
                            from_middle.norm() - hand.joint_radii[j] - 0.7 * o.object_width});
    }
    if (clearance <= best) continue;
    best = clearance;
    posture = candidate;
  }

  Grip grip;
  JointAngles angles = at_width;
  for (std::size_t i = 0; i < kApertures; ++i) {
    const double aperture = closed + (open - closed) * static_cast<double>(i) / (kApertures - 1);
    const Vector3 thumb_goal = middle - (0.5 * aperture + thumb_radius) * axis, index_goal = middle + (0.5 * aperture + index_radius) * axis;
    angles = ik.solve(angles, [&](const JointAngles& a, std::vector<double>& r) {
      const Pinch now = pinch_of(a);
      append(now.thumb.centre - thumb_goal, 100 * kPerMetre, r);
      append(now.finger.centre - index_goal, 100 * kPerMetre, r);
      for (const Phalanx& each : {now.thumb, now.finger}) {
        r.push_back(2.4 * each.direction.dot(axis));
        r.push_back(1.4 * (each.direction.dot(up_in_hand) + 1));
      }
      for (std::size_t b = 2; b <= index(Body::index_distal); ++b) append(a[b] - at_width[b], 0.3, r);
    });
    const Pinch now = pinch_of(angles);
    const double error = std::max((now.thumb.centre - thumb_goal).norm(), (now.finger.centre - index_goal).norm());
    // Only the way open may fall short: a smaller opening still grips.
    if (error > 1e-3 && aperture <= o.object_width + 2e-3) {
      throw std::invalid_argument("generator: pinch of " + std::to_string(aperture * 1e3) + " mm: the pads reach " +
                                  std::to_string(((now.finger.centre - now.thumb.centre).norm() - thumb_radius - index_radius) * 1e3) +
                                  " mm; expected an object_width that the hand can span");
    }
    if (error > 1e-3) break;
    JointAngles whole = angles;
    for (const Finger f : {Finger::middle, Finger::ring, Finger::little}) flex(whole, f, posture[0], posture[1], posture[2]);
    grip.apertures.push_back(whole);
  }

  const Vector3 forward = Quaternion(Eigen::AngleAxisd(o.yaw, Vector3::UnitY())) * Vector3(0, 0, -1);
  Matrix3 in_hand, in_world;
  in_hand << axis, up_in_hand, axis.cross(up_in_hand);
  in_world << forward, Vector3::UnitY(), forward.cross(Vector3::UnitY());
  grip.wrist.orientation = Quaternion(Matrix3(in_world * in_hand.transpose())).normalized();
  grip.wrist.position = to_vector(o.object_position) - grip.wrist.orientation * middle;
  grip.approach_offset = Vector3(0, o.approach_distance, 0);
  return grip;
}

Grip solve_power_grasp(const HandModel& hand, const GeneratorOptions& o) {
  const double radius = 0.5 * o.object_width;
  const double reach = radius - o.closing_depth;
  // The cylinder lies across the palm, just distal of the knuckles' row and clear of their skin.
  Vector3 centre = Vector3::Zero();
  for (const Joint joint : {Joint::index_proximal, Joint::middle_proximal, Joint::ring_proximal, Joint::little_proximal}) {
    centre += 0.25 * hand.rest_joints[index(joint)].position;
  }
  centre += Vector3(0, -(radius + hand.joint_radii[index(Joint::middle_proximal)] + 0.004), -0.004);
  const Vector3 axis = Vector3::UnitX();
  const auto radial = [&](const Vector3& p) { return Vector3((p - centre) - axis * axis.dot(p - centre)); };

  JointAngles closed;
  closed.fill(Vector3::Zero());
  for (const Finger finger : {Finger::index, Finger::middle, Finger::ring, Finger::little}) {
    double best = 1e9, chosen = 0;
    for (double s = 0; s <= 1.6; s += 0.002) {
      JointAngles angles = closed;
      flex(angles, finger, -0.9 * s, -1.0 * s, -0.6 * s);
      const double distance = radial(pad_of(hand, finger, forward_kinematics(hand, Pose{}, angles)).position).norm() - reach;
      if (std::abs(distance) < best) {
        best = std::abs(distance);
        chosen = s;
      }
      if (distance <= 0) break;  // the first touch, not one from beyond
    }
    flex(closed, finger, -0.9 * chosen, -1.0 * chosen, -0.6 * chosen);
  }
  const InverseKinematics thumb_ik(
      hand,
      {{Body::thumb_metacarpal, 0, -0.2}, {Body::thumb_metacarpal, 1, 0}, {Body::thumb_proximal, 0, -0.4}, {Body::thumb_distal, 0, -0.4}});
  JointAngles thumb_start = closed;
  for (const Body body : {Body::thumb_metacarpal, Body::thumb_proximal, Body::thumb_distal})
    thumb_start[index(body)] = thumb_ik.start()[index(body)];
  closed = thumb_ik.solve(thumb_start, [&](const JointAngles& angles, std::vector<double>& r) {
    const Pad pad = pad_of(hand, Finger::thumb, forward_kinematics(hand, Pose{}, angles));
    const Vector3 out = radial(pad.position);
    r.push_back(kPerMetre * (out.norm() - reach));
    append(pad.normal + out.normalized(), 4, r);
    thumb_ik.append_nominal(angles, 0.3, r);
  });

  Grip grip;
  for (std::size_t i = 0; i < kApertures; ++i) {
    const double open = static_cast<double>(i) / (kApertures - 1);
    JointAngles angles = closed;
    for (std::size_t b = 2; b < kBodyCount; ++b) angles[b] *= 1 - 0.85 * open;
    grip.apertures.push_back(angles);
  }
  // Upright cylinder, thumb above: the thumb's side of the hand up, the palm facing along the grip's direction.
  const Vector3 forward = Quaternion(Eigen::AngleAxisd(o.yaw, Vector3::UnitY())) * Vector3(0, 0, -1);
  const Vector3 thumb_side = hand.side == Side::right ? Vector3(-1, 0, 0) : Vector3(1, 0, 0);
  const Vector3 palm(0, -1, 0);
  Matrix3 in_hand, in_world;
  in_hand << palm, thumb_side, palm.cross(thumb_side);
  in_world << forward, Vector3::UnitY(), forward.cross(Vector3::UnitY());
  grip.wrist.orientation = Quaternion(Matrix3(in_world * in_hand.transpose())).normalized();
  grip.wrist.position = to_vector(o.object_position) - grip.wrist.orientation * centre;
  grip.approach_offset = -o.approach_distance * forward;
  return grip;
}

class GraspMotion : public Motion {
 public:
  GraspMotion(const HandModel& hand, const GeneratorOptions& options)
      : hand_(hand), options_(options), grip_(options.motion == "pinch" ? solve_pinch(hand, options) : solve_power_grasp(hand, options)) {
    double end = 0;
    const auto phase = [&](const char* name, double duration) {
      if (duration <= 0) return;
      phases_.push_back({name, end, end + duration});
      end += duration;
    };
    const GeneratorOptions& o = options;
    phase("approach", o.approach_time);
    phase("close", o.close_time);
    phase("settle", o.settle_time);
    phase("lift", o.lift_time);
    phase("hold", o.hold_time);
    phase("shake", o.shake_time);
    phase("turn", o.turn_time);
    phase("lower", o.lower_time);
    phase("place", o.place_time);
    phase("release", o.release_time);
    phase("retreat", o.retreat_time);
    duration_ = end;
  }

  double duration() const override { return duration_; }
  std::vector<MotionPhase> phases() const override { return phases_; }
  const std::array<double, kJointCount>& radii() const override { return hand_.joint_radii; }

  JointFrames at(double time) const override {
    const GeneratorOptions& o = options_;
    const double openness = 1 - progress("close", time) + progress("release", time);
    const double away = 1 - progress("approach", time) + progress("retreat", time);
    const double height = o.lift_height * progress("lift", time) - (o.lift_height + o.lower_depth) * progress("lower", time);
    const Vector3 centre = to_vector(o.object_position);
    const Vector3 turn = o.turn_angle * progress("turn", time) * to_vector(o.turn_axis).normalized();
    Pose wrist = Pose{centre, rotation_exp(turn)} * Pose{grip_.wrist.position - centre, grip_.wrist.orientation};
    wrist.position += away * grip_.approach_offset + Vector3(0, height, 0) + shake(time);

    const double place = openness * static_cast<double>(grip_.apertures.size() - 1);
    const auto lower = std::min(static_cast<std::size_t>(std::max(place, 0.0)), grip_.apertures.size() - 2);
    const double fraction = place - static_cast<double>(lower);
    JointAngles angles;
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      angles[b] = grip_.apertures[lower][b] + fraction * (grip_.apertures[lower + 1][b] - grip_.apertures[lower][b]);
    }
    return forward_kinematics(hand_, wrist, angles);
  }

 private:
  // 0 before the phase, 1 after it.
  double progress(std::string_view name, double time) const {
    for (const MotionPhase& p : phases_) {
      if (p.name == name) return smooth((time - p.begin) / (p.end - p.begin));
    }
    return name == "approach" || name == "close" ? 1.0 : 0.0;
  }
  Vector3 shake(double time) const {
    for (const MotionPhase& p : phases_) {
      if (p.name != "shake" || time <= p.begin || time >= p.end) continue;
      // Swells and fades over a period, so that the hand starts and ends at rest.
      const double ramp = 1 / options_.shake_frequency;
      const double window = smooth((time - p.begin) / ramp) * smooth((p.end - time) / ramp);
      return options_.shake_amplitude * window * std::sin(2 * M_PI * options_.shake_frequency * (time - p.begin)) *
             to_vector(options_.shake_axis).normalized();
    }
    return Vector3::Zero();
  }

  HandModel hand_;
  GeneratorOptions options_;
  Grip grip_;
  std::vector<MotionPhase> phases_;
  double duration_ = 0;
};

// Opens and closes, or wanders about with every joint in motion; no object.
class FreeMotion : public Motion {
 public:
  FreeMotion(const HandModel& hand, const GeneratorOptions& options) : hand_(hand), options_(options) {}
  double duration() const override { return options_.free_time; }
  const std::array<double, kJointCount>& radii() const override { return hand_.joint_radii; }
  JointFrames at(double time) const override {
    const double t = std::clamp(time, 0.0, options_.free_time);
    const bool fist = options_.motion == "fist";
    Pose wrist{to_vector(options_.object_position), Quaternion::Identity()};
    if (!fist) {
      wrist.position += Vector3(0.15 * std::sin(2.1 * t), 0.08 * std::sin(3.3 * t), 0.1 * std::sin(1.7 * t));
      wrist.orientation = rotation_exp(Vector3(0.5 * std::sin(1.3 * t), 0.6 * std::sin(1.9 * t), 0.7 * std::sin(1.1 * t)));
    }
    JointAngles angles;
    angles.fill(Vector3::Zero());
    for (int f = 1; f < kFingerCount; ++f) {
      const double s = fist ? 0.5 - 0.5 * std::cos(2 * M_PI * t / 4) : 0.35 - 0.35 * std::cos(3 * t - 0.6 * f);
      flex(angles, static_cast<Finger>(f), -1.2 * s, -1.4 * s, -0.8 * s);
    }
    const double thumb = fist ? 0.5 - 0.5 * std::cos(2 * M_PI * t / 4) : 0.3 - 0.3 * std::cos(2.3 * t);
    angles[index(Body::thumb_proximal)].x() = -0.5 * thumb;
    angles[index(Body::thumb_distal)].x() = -0.7 * thumb;
    return forward_kinematics(hand_, wrist, angles);
  }

 private:
  HandModel hand_;
  GeneratorOptions options_;
};

}  // namespace

std::unique_ptr<Motion> make_motion(const HandModel& hand, const GeneratorOptions& options) {
  if (options.motion == "pinch" && 2 * options.closing_depth >= options.object_width) {
    throw std::invalid_argument("generator: closing_depth: expected less than half of object_width");
  }
  for (const auto& [axis, key] : {std::pair{options.turn_axis, "turn_axis"}, std::pair{options.shake_axis, "shake_axis"}}) {
    if (!(to_vector(axis).norm() > 1e-6))
      throw std::invalid_argument(std::string("generator: ") + key + ": expected a vector that is not zero");
  }
  if (options.motion == "pinch" || options.motion == "power_grasp") return std::make_unique<GraspMotion>(hand, options);
  return std::make_unique<FreeMotion>(hand, options);
}

}  // namespace softhand
