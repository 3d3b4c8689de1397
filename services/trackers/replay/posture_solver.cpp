#include "trackers/replay/posture_solver.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "math/rotation.hpp"

namespace softhand {
namespace {

constexpr int kIterations = 120;
constexpr double kEnough = 1e-7;      // relative decrease of the cost at which the solver stops
constexpr double kLargestStep = 0.3;  // per value, because the goals are nonlinear
// Vertices of the skin lie 3 mm apart. With this depth (m) several of them touch, so that the place of a touch changes
// smoothly.
constexpr double kTouchDepth = 0.3e-3;

// The skin that touches a face at `towards`: its mean place, and its spread there (second moments).
struct Patch {
  Vector3 middle = Vector3::Zero();
  Matrix3 spread = Matrix3::Zero();
};
Patch touching(std::span<const Vector3> skin, const Vector3& towards, double depth) {
  double highest = -1, sum = 0;
  for (const Vector3& x : skin) highest = std::max(highest, x.dot(towards));
  const auto weight = [&](const Vector3& x) { return std::exp((x.dot(towards) - highest) / depth); };
  Patch patch;
  for (const Vector3& x : skin) {
    sum += weight(x);
    patch.middle += weight(x) * x;
  }
  patch.middle /= sum;
  for (const Vector3& x : skin) patch.spread += weight(x) / sum * (x - patch.middle) * (x - patch.middle).transpose();
  return patch;
}

// Normal of the flat part of a pad: its skin lies in a plane. The finger is symmetric, so the normal has no component
// to the side.
Vector3 pad_normal(std::span<const Vector3> skin) {
  constexpr double kPadDepth = 0.5e-3;    // m
  constexpr double kSteepest = M_PI / 6;  // rad, against the bone
  constexpr int kRounds = 20;
  Vector3 normal = -Vector3::UnitY();
  for (int round = 0; round < kRounds; ++round) {
    const Matrix3 spread = touching(skin, normal, kPadDepth).spread;
    // The line through the patch, seen from the side.
    const double angle = 0.5 * std::atan2(2 * spread(1, 2), spread(2, 2) - spread(1, 1));
    const double steep = std::clamp(angle, -kSteepest, kSteepest);
    normal = Vector3(0, -std::cos(steep), std::sin(steep));
  }
  return normal;
}

}  // namespace

std::array<JointAxis, 4> axes_of(Finger finger) {
  const int last = index_of(distal_of(finger));
  const Body first = static_cast<Body>(last - 2);
  return {{{first, 0}, {first, 1}, {static_cast<Body>(last - 1), 0}, {static_cast<Body>(last), 0}}};
}

GripHand::GripHand(const HandModel& model) : model_(model), open_(open_hand(model)) {
  for (std::size_t f = 0; f < kFingerCount; ++f) {
    pads_[f] = pad_in_distal(model, static_cast<Finger>(f));
    // The display skin is the same for all meshes of a hand. So all sizes make the same motion.
    skin_[f] = distal_skin(model, static_cast<Finger>(f));
    normals_[f] = skin_[f].empty() ? Vector3(-Vector3::UnitY()) : pad_normal(skin_[f]);
    if (skin_[f].empty()) skin_[f] = {pads_[f]};
  }
}

void GripHand::flex(JointAngles& angles, Finger finger, double first, double second, double distal) const {
  const std::size_t last = slot_of(distal_of(finger));
  angles[last - 2].x() = open_[last - 2].x() + first;
  angles[last - 1].x() = open_[last - 1].x() + second;
  angles[last].x() = open_[last].x() + distal;
}

JointAngles GripHand::from_open(double share, const JointAngles& angles) const {
  JointAngles out;
  for (std::size_t b = 0; b < kBodyCount; ++b) out[b] = open_[b] + share * (angles[b] - open_[b]);
  return out;
}

GripHand::Pad GripHand::pad(Finger finger, const JointFrames& frames) const {
  const Body body = distal_of(finger);
  const Pose& distal = frames[slot_of(joint_of(body))];
  const auto f = static_cast<std::size_t>(finger);
  const Vector3& pad = pads_[f];
  return {body,
          distal * pad,
          distal.orientation * normals_[f],
          distal.orientation * Vector3(0, 0, -1),
          distal * Vector3(pad.x(), 0, pad.z()),
          -pad.y(),
          distal,
          skin_[f]};
}

GripHand::Touch GripHand::Pad::touch(const Vector3& towards) const {
  const Matrix3 turn = joint.orientation.toRotationMatrix();
  const Vector3 direction = turn.transpose() * towards;
  const Patch patch = touching(skin, direction, kTouchDepth);
  const Vector3 middle = joint * patch.middle;
  // The mean of exponentially weighted skin is about one depth below the first touch.
  return {body, middle + kTouchDepth * towards, middle,
          turn * (skew(direction) * patch.spread / -kTouchDepth) * turn.transpose()};
}

double GripHand::limited(const JointAxis& which, double angle) const {
  const JointModel& joint = model_.bodies[slot_of(which.body)].joint;
  const std::array<double, 2>& range = which.axis == 0 ? joint.flexion_range : joint.abduction_range;
  return std::clamp(angle, range[0], range[1]);
}

JointAngles GripHand::limited(JointAngles angles) const {
  for (std::size_t b = 2; b < kBodyCount; ++b) {
    for (int axis = 0; axis < 2; ++axis) angles[b][axis] = limited({static_cast<Body>(b), axis}, angles[b][axis]);
  }
  return angles;
}

std::vector<GripHand::Sphere> GripHand::spheres(const JointFrames& frames) const {
  std::vector<Sphere> out;
  out.reserve(kSpheresPerBone * kBodyCount);
  for (std::size_t b = 2; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    const double from = model_.joint_radii[slot_of(joint_of(body))],
                 to = model_.joint_radii[slot_of(end_joint_of(body))];
    for (int k = 0; k < kSpheresPerBone; ++k) {
      const double along = static_cast<double>(k) / (kSpheresPerBone - 1);
      out.push_back({body, along, (1 - along) * from + along * to, Vector3::Zero()});
    }
  }
  move(out, frames);
  return out;
}

void GripHand::move(std::vector<Sphere>& spheres, const JointFrames& frames) const {
  for (Sphere& s : spheres)
    s.centre = (1 - s.along) * frames[slot_of(joint_of(s.body))].position +
               s.along * frames[slot_of(end_joint_of(s.body))].position;
}

PostureSolver::PostureSolver(const GripHand& hand, const Pose& wrist, std::vector<JointAngles> postures)
    : hand_(hand), wrist_start_(wrist), wrist_(wrist) {
  for (const JointAngles& angles : postures) {
    const JointFrames frames = forward_kinematics(hand.model(), wrist, angles);
    posed_.push_back({angles, frames, hand.spheres(frames), {}, {}, {}});
  }
}

void PostureSolver::free_wrist() {
  wrist_is_free_ = true;
  values_ = VectorX::Zero(6);
  upper_ = (VectorX(6) << 0.5, 0.5, 0.5, 2.5, 2.5, 2.5).finished();
  lower_ = -upper_;
}

void PostureSolver::free_finger(Finger finger, std::initializer_list<std::size_t> postures) {
  for (const JointAxis& axis : axes_of(finger)) {
    const Eigen::Index at = values_.size();
    const double start = posed_[*postures.begin()].angles[slot_of(axis.body)][axis.axis];
    free_.push_back({axis, postures, start});
    for (VectorX* each : {&values_, &lower_, &upper_}) each->conservativeResize(at + 1);
    lower_[at] = hand_.limited(axis, -10);
    upper_[at] = hand_.limited(axis, 10);
    values_[at] = std::clamp(start, lower_[at], upper_[at]);
    for (const std::size_t p : postures) {
      // The axis moves its own body and all bodies up to the tip.
      for (int b = index_of(axis.body); b <= index_of(distal_of(finger)); ++b)
        posed_[p].moved_by[static_cast<std::size_t>(b)].push_back(static_cast<int>(at));
    }
  }
}

void PostureSolver::pose(const VectorX& values) {
  if (wrist_is_free_) {
    const Vector3 turn = values.segment<3>(3);
    wrist_ = Pose{values.head<3>(), rotation_exp(turn)} * wrist_start_;
    turn_jacobian_ = left_jacobian_inverse(turn).inverse();
  }
  const Eigen::Index first = first_angle();
  for (std::size_t i = 0; i < free_.size(); ++i) {
    for (const std::size_t p : free_[i].postures)
      posed_[p].angles[slot_of(free_[i].axis.body)][free_[i].axis.axis] = values[first + static_cast<Eigen::Index>(i)];
  }
  for (Posed& posed : posed_) {
    posed.frames = forward_kinematics(hand_.model(), wrist_, posed.angles);
    hand_.move(posed.spheres, posed.frames);
    posed.turn_axis.resize(static_cast<std::size_t>(values.size()));
    posed.turn_about.resize(static_cast<std::size_t>(values.size()));
  }
  for (std::size_t i = 0; i < free_.size(); ++i) {
    const std::size_t at = static_cast<std::size_t>(first) + i, body = slot_of(free_[i].axis.body);
    for (const std::size_t p : free_[i].postures) {
      Posed& posed = posed_[p];
      const Pose& joint = posed.frames[slot_of(joint_of(free_[i].axis.body))];
      // Right Jacobian of the exponential map: the rotation in the body's own frame.
      posed.turn_axis[at] =
          joint.orientation *
          Vector3(left_jacobian_inverse(posed.angles[body]).transpose().inverse().col(free_[i].axis.axis));
      posed.turn_about[at] = joint.position;
    }
  }
}

void PostureSolver::add_entry(int at, double value) {
  if (!entered_[static_cast<std::size_t>(at)]) {
    entered_[static_cast<std::size_t>(at)] = 1;
    entries_.push_back(at);
  }
  row_[at] += value;
}

void PostureSolver::finish_row(double value) {
  cost_ += value * value;
  for (const int i : entries_) {
    gradient_[i] += row_[i] * value;
    for (const int j : entries_) normal_(j, i) += row_[i] * row_[j];
  }
  for (const int i : entries_) {
    row_[i] = 0;
    entered_[static_cast<std::size_t>(i)] = 0;
  }
  entries_.clear();
}

void PostureSolver::add_residual(double weight, double value, std::initializer_list<Change> changes) {
  for (const Change& change : changes) {
    const Posed& posed = posed_[change.posture];
    if (wrist_is_free_) {
      const Vector3 turn = weight * (turn_jacobian_.transpose() *
                                     (change.torque - Vector3(values_under_test_.head<3>()).cross(change.force)));
      for (int i = 0; i < 3; ++i) {
        add_entry(i, weight * change.force[i]);
        add_entry(3 + i, turn[i]);
      }
    }
    for (const int at : posed.moved_by[slot_of(change.body)]) {
      const auto k = static_cast<std::size_t>(at);
      add_entry(at, weight * posed.turn_axis[k].dot(change.torque - posed.turn_about[k].cross(change.force)));
    }
  }
  finish_row(weight * value);
}

void PostureSolver::add_point_goal(double weight, std::size_t posture, Body body, const Vector3& point,
                                   const Vector3& goal) {
  for (int i = 0; i < 3; ++i)
    add_residual(weight, point[i] - goal[i], {by_point(posture, body, point, Vector3::Unit(i))});
}

void PostureSolver::add_direction_goal(double weight, std::size_t posture, Body body, const Vector3& direction,
                                       const Vector3& goal) {
  for (int i = 0; i < 3; ++i)
    add_residual(weight, direction[i] - goal[i], {by_direction(posture, body, direction, Vector3::Unit(i))});
}

void PostureSolver::add_touch_goal(double weight, std::size_t posture, const GripHand::Touch& touch,
                                   const Vector3& goal) {
  for (int i = 0; i < 3; ++i) add_residual(weight, touch.point[i] - goal[i], {touch.change(posture, Vector3::Unit(i))});
}

void PostureSolver::add_distance_goal(std::size_t posture, std::initializer_list<Finger> fingers, double margin) {
  const std::span<const GripHand::Sphere> all = spheres(posture);
  const auto separate = [&](const GripHand::Sphere& s, Finger other, double clearance) {
    const GripHand::Sphere* nearest = nullptr;
    double least = clearance;
    for (int b = index_of(distal_of(other)) - (other == Finger::thumb ? 1 : 2); b <= index_of(distal_of(other)); ++b) {
      for (int k = 0; k < GripHand::kSpheresPerBone; ++k) {
        const GripHand::Sphere& o = all[static_cast<std::size_t>((b - 2) * GripHand::kSpheresPerBone + k)];
        const double reach = least + s.radius + o.radius, square = (s.centre - o.centre).squaredNorm();
        if (reach <= 0 || square >= reach * reach) continue;
        least = std::sqrt(square) - s.radius - o.radius;
        nearest = &o;
      }
    }
    if (!nearest) return;
    const Vector3 away = (s.centre - nearest->centre).normalized();
    add_residual(kPerMetre, clearance - least,
                 {by_point(posture, s.body, s.centre, -away), by_point(posture, nearest->body, nearest->centre, away)});
  };
  for (const GripHand::Sphere& s : all) {
    if (is_metacarpal(s.body)) continue;
    const Finger finger = finger_of(s.body);
    if (std::find(fingers.begin(), fingers.end(), finger) != fingers.end()) separate(s, Finger::thumb, margin);
    // Neighbouring fingers lie side by side. They can cross only beyond the proximal phalanges.
    if (finger == Finger::index && s.body != Body::index_proximal) separate(s, Finger::middle, -1.5e-3);
  }
}

void PostureSolver::add_start_goal(double weight) {
  for (std::size_t i = 0; i < free_.size(); ++i) {
    const std::size_t posture = free_[i].postures.front();
    add_entry(first_angle() + static_cast<int>(i), weight);
    finish_row(weight * (posed_[posture].angles[slot_of(free_[i].axis.body)][free_[i].axis.axis] - free_[i].start));
  }
}

void PostureSolver::add_wrist_rotation_goal(double weight) {
  for (int i = 3; i < 6; ++i) {
    add_entry(i, weight);
    finish_row(weight * values_under_test_[i]);
  }
}

void PostureSolver::evaluate(const VectorX& values, const Goals& goals) {
  const Eigen::Index n = values.size();
  values_under_test_ = values;
  pose(values);
  cost_ = 0;
  gradient_.setZero(n);
  normal_.setZero(n, n);
  row_.setZero(n);
  entered_.assign(static_cast<std::size_t>(n), 0);
  goals(*this);
}

double PostureSolver::evaluate(const VectorX& values, const Goals& goals, VectorX& gradient) {
  evaluate(values, goals);
  gradient = 2 * gradient_;
  return cost_;
}

// Damped Gauss-Newton method within the bounds.
double PostureSolver::solve(const Goals& goals) {
  evaluate(values_, goals);
  double cost = cost_, damping = 1e-2;
  VectorX gradient, tried;
  Eigen::MatrixXd normal, damped;
  Eigen::LDLT<Eigen::MatrixXd> factor(values_.size());
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    gradient = gradient_;
    normal = normal_;
    // A value on a bound that would leave the bound takes no part in the step.
    for (Eigen::Index c = 0; c < values_.size(); ++c) {
      if ((gradient[c] > 0 && values_[c] <= lower_[c]) || (gradient[c] < 0 && values_[c] >= upper_[c])) {
        normal.row(c).setZero();
        normal.col(c).setZero();
        normal(c, c) = 1e12;
      }
    }
    bool done = true;
    for (int attempt = 0; attempt < 12; ++attempt) {
      damped = normal;
      damped.diagonal() *= 1 + damping;
      damped.diagonal().array() += 1e-9;
      factor.compute(damped);
      tried = values_ + (-factor.solve(gradient)).cwiseMax(-kLargestStep).cwiseMin(kLargestStep);
      tried = tried.cwiseMax(lower_).cwiseMin(upper_);
      evaluate(tried, goals);
      if (cost_ < cost) {
        done = cost - cost_ < kEnough * cost;
        values_ = tried;
        cost = cost_;
        damping = std::max(1e-9, damping * 0.3);
        break;
      }
      damping *= 5;
    }
    if (done) break;
  }
  pose(values_);
  return cost;
}

}  // namespace softhand
