#include "trackers/replay/generator.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
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

constexpr double kPerMetre = 1e3;          // a millimetre counts like a radian
constexpr double kPlace = 30 * kPerMetre;  // of pads, against all wishes
constexpr std::array<Finger, 4> kFingers{Finger::index, Finger::middle, Finger::ring, Finger::little};

using Residual = std::vector<double>;

void append(const Vector3& v, double weight, Residual& residual) {
  for (int i = 0; i < 3; ++i) residual.push_back(weight * v[i]);
}

// Damped Gauss-Newton with differences: minimises the sum of squares of what `evaluate` appends, inside the bounds. Deterministic; runs at
// load only.
VectorX minimised(VectorX x, const VectorX& lower, const VectorX& upper, const std::function<void(const VectorX&, Residual&)>& evaluate) {
  const auto residual = [&](const VectorX& at) {
    Residual r;
    evaluate(at, r);
    return VectorX(Eigen::Map<const VectorX>(r.data(), static_cast<Eigen::Index>(r.size())));
  };
  x = x.cwiseMax(lower).cwiseMin(upper);
  VectorX current = residual(x);
  double damping = 1e-2;
  for (int iteration = 0; iteration < 120; ++iteration) {
    Eigen::MatrixXd jacobian(current.size(), x.size());
    constexpr double kStep = 1e-7;
    for (Eigen::Index c = 0; c < x.size(); ++c) {
      VectorX moved = x;
      moved[c] += kStep;
      jacobian.col(c) = (residual(moved) - current) / kStep;
    }
    const VectorX gradient = jacobian.transpose() * current;
    Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
    // Values that rest on a bound and would leave it take no part in the step.
    for (Eigen::Index c = 0; c < x.size(); ++c) {
      if ((gradient[c] > 0 && x[c] <= lower[c]) || (gradient[c] < 0 && x[c] >= upper[c])) {
        normal.row(c).setZero();
        normal.col(c).setZero();
        normal(c, c) = 1e12;
      }
    }
    bool done = true;
    for (int attempt = 0; attempt < 12; ++attempt) {
      Eigen::MatrixXd damped = normal;
      damped.diagonal() *= 1 + damping;
      damped.diagonal().array() += 1e-9;
      const VectorX change = -damped.ldlt().solve(gradient);
      const VectorX next = (x + change.cwiseMax(-0.3).cwiseMin(0.3)).cwiseMax(lower).cwiseMin(upper);
      const VectorX tried = residual(next);
      if (tried.squaredNorm() < current.squaredNorm()) {
        done = current.squaredNorm() - tried.squaredNorm() < 1e-7 * current.squaredNorm();
        x = next;
        current = tried;
        damping = std::max(1e-9, damping * 0.3);
        break;
      }
      damping *= 5;
    }
    if (done) break;
  }
  return x;
}

void flex(JointAngles& angles, Finger finger, double proximal, double intermediate, double distal) {
  const std::size_t last = index(distal_of(finger));
  angles[last - 2].x() = proximal;
  angles[last - 1].x() = intermediate;
  angles[last].x() = distal;
}

// A joint angle that a solve may choose.
struct Variable {
  Body body;
  int axis;  // 0 flexion, 1 abduction
};
std::vector<Variable> variables_of(Finger finger) {
  const int last = index_of(distal_of(finger));
  const Body first = static_cast<Body>(last - 2);
  return {{first, 0}, {first, 1}, {static_cast<Body>(last - 1), 0}, {static_cast<Body>(last), 0}};
}

// The hand as the solves see it: pads, joint limits, and spheres along its bones that must keep clear of things.
class GripHand {
 public:
  explicit GripHand(const HandModel& hand) : hand_(hand) {
    for (int f = 0; f < kFingerCount; ++f) pads_[static_cast<std::size_t>(f)] = pad_in_distal(hand, static_cast<Finger>(f));
  }
  const HandModel& model() const { return hand_; }

  struct Pad {
    Vector3 position;
    Vector3 normal;  // the direction it presses in
    Vector3 along;   // from its joint to its tip
    Vector3 centre;  // in the finger, `radius` behind the skin
    double radius;
    /// Where the round finger touches a face that looks along -`towards`: the pad itself where it is flat on the face.
    Vector3 touch(const Vector3& towards) const { return centre + radius * towards; }
  };
  Pad pad(Finger finger, const JointFrames& frames) const {
    const Pose& distal = frames[index(joint_of(distal_of(finger)))];
    const Vector3& pad = pads_[static_cast<std::size_t>(finger)];
    const Vector3 normal = distal.orientation * Vector3(0, -1, 0);
    return {distal * pad, normal, distal.orientation * Vector3(0, 0, -1), distal * Vector3(pad.x(), 0, pad.z()), -pad.y()};
  }

  double limited(const Variable& v, double angle) const {
    const JointModel& joint = hand_.bodies[index(v.body)].joint;
    const std::array<double, 2>& range = v.axis == 0 ? joint.flexion_range : joint.abduction_range;
    return std::clamp(angle, range[0], range[1]);
  }
  JointAngles limited(JointAngles angles) const {
    for (std::size_t b = 2; b < kBodyCount; ++b) {
      for (int axis = 0; axis < 2; ++axis) angles[b][axis] = limited({static_cast<Body>(b), axis}, angles[b][axis]);
    }
    return angles;
  }

  struct Sphere {
    Body body;
    double along;  // of the bone, 0 at its own joint
    Vector3 centre;
    double radius;
  };
  /// Along every bone from metacarpals to tips.
  std::vector<Sphere> spheres(const JointFrames& frames) const {
    std::vector<Sphere> out;
    out.reserve(4 * kBodyCount);
    for (std::size_t b = 2; b < kBodyCount; ++b) {
      const Body body = static_cast<Body>(b);
      const std::size_t from = index(joint_of(body)), to = index(end_joint_of(body));
      for (const double s : {0.0, 1.0 / 3, 2.0 / 3, 1.0}) {
        out.push_back({body, s, (1 - s) * frames[from].position + s * frames[to].position,
                       (1 - s) * hand_.joint_radii[from] + s * hand_.joint_radii[to]});
      }
    }
    return out;
  }
  /// Thumb against the phalanges of `fingers`, and index against middle finger: what lies closer than `margin` is penalised.
  static void keep_apart(const std::vector<Sphere>& spheres, std::initializer_list<Finger> fingers, double margin, Residual& residual) {
    const auto distance = [&](const Sphere& s, Finger other) {
      double least = 1;
      for (const Sphere& o : spheres) {
        if (finger_of(o.body) == other && !is_metacarpal(o.body))
          least = std::min(least, (s.centre - o.centre).norm() - s.radius - o.radius);
      }
      return least;
    };
    for (const Sphere& s : spheres) {
      if (is_metacarpal(s.body)) continue;
      for (const Finger finger : fingers) {
        if (finger_of(s.body) == finger) residual.push_back(kPerMetre * std::max(0.0, margin - distance(s, Finger::thumb)));
      }
      // Neighbours lie side by side; only beyond the knuckles can they cross.
      if (finger_of(s.body) == Finger::index && s.body != Body::index_proximal)
        residual.push_back(kPerMetre * std::max(0.0, -1.5e-3 - distance(s, Finger::middle)));
    }
  }

 private:
  const HandModel& hand_;
  std::array<Vector3, kFingerCount> pads_;
};

// The unknowns of a solve, in one vector: a wrist about a first guess, and chosen joint angles of one or more postures.
class Unknowns {
 public:
  Unknowns(const GripHand& hand, const Pose* free_wrist) : hand_(hand) {
    if (free_wrist) {
      wrist_ = *free_wrist;
      x_.assign(6, 0.0);
      lower_.assign(6, -0.5);
      upper_.assign(6, 0.5);
      for (std::size_t i = 3; i < 6; ++i) lower_[i] = -2.5, upper_[i] = 2.5;
    }
  }
  /// Appends angles that start at `start`.
  void add(std::vector<JointAngles*> where, const std::vector<Variable>& variables, const JointAngles& start) {
    for (const Variable& v : variables) {
      chosen_.push_back({where, v, start[index(v.body)][v.axis]});
      x_.push_back(start[index(v.body)][v.axis]);
      lower_.push_back(hand_.limited(v, -10));
      upper_.push_back(hand_.limited(v, 10));
    }
  }
  Pose wrist(const VectorX& x) const {
    // Turned about the grip's middle, which hardly moves the pads.
    return Pose{x.head<3>(), rotation_exp(x.segment<3>(3))} * wrist_;
  }
  void write(const VectorX& x) const {
    const Eigen::Index first = x.size() - static_cast<Eigen::Index>(chosen_.size());
    for (std::size_t i = 0; i < chosen_.size(); ++i) {
      for (JointAngles* angles : chosen_[i].where)
        (*angles)[index(chosen_[i].variable.body)][chosen_[i].variable.axis] = x[first + static_cast<Eigen::Index>(i)];
    }
  }
  /// Holds every angle to where it started.
  void append_start(const VectorX& x, double weight, Residual& residual) const {
    const Eigen::Index first = x.size() - static_cast<Eigen::Index>(chosen_.size());
    for (std::size_t i = 0; i < chosen_.size(); ++i)
      residual.push_back(weight * (x[first + static_cast<Eigen::Index>(i)] - chosen_[i].start));
  }
  /// From `first` (null: the start) to the minimum.
  VectorX solve(const std::function<void(const VectorX&, Residual&)>& residual, const VectorX* first = nullptr) const {
    const auto vector = [](const std::vector<double>& v) {
      return VectorX(Eigen::Map<const VectorX>(v.data(), static_cast<Eigen::Index>(v.size())));
    };
    const VectorX x = minimised(first ? *first : vector(x_), vector(lower_), vector(upper_), [&](const VectorX& at, Residual& r) {
      write(at);
      residual(at, r);
    });
    write(x);
    return x;
  }

 private:
  struct Chosen {
    std::vector<JointAngles*> where;
    Variable variable;
    double start;
  };
  const GripHand& hand_;
  Pose wrist_;
  std::vector<double> x_, lower_, upper_;
  std::vector<Chosen> chosen_;
};

// How the hand takes the object: joint angles from closed (first) to open (last), and where its wrist is then. Solved in the grip's frame:
// origin at the grip's middle, +Y up, -Z along the grip's direction.
struct Grip {
  std::vector<JointAngles> apertures;
  Pose wrist;               // world, fingers at the object in its first place
  Vector3 approach_offset;  // from there to where the hand comes from, world
};

void place(Grip& grip, const GeneratorOptions& o, const Vector3& approach) {
  const Pose world{to_vector(o.object_position), Quaternion(Eigen::AngleAxisd(o.yaw, Vector3::UnitY()))};
  grip.wrist = world * grip.wrist;
  grip.approach_offset = world.orientation * (o.approach_distance * approach);
}

// Signed distance to a cube about the origin.
double outside_cube(const Vector3& point, double half) {
  const Vector3 q = point.cwiseAbs() - Vector3::Constant(half);
  return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0);
}

// Thumb (+Z) against index (-Z) on the faces of a cube that stands on a table: wrist, grip and widest opening are sought together, so that
// one place of the wrist serves both; then the way between them with the wrist at rest.
Grip solve_pinch(const HandModel& model, const GeneratorOptions& o) {
  const GripHand hand(model);
  const double half = 0.5 * o.object_width;
  const double closed = half - o.closing_depth, open = half + o.opening;
  constexpr double kClear = 4.5e-3;
  constexpr double kAbove = 2e-3;  // pads a little above the middle: room for the fingertips

  // Where pads of that distance face each other best, whatever else is there: it gives the grip's place in the hand.
  JointAngles facing;
  facing.fill(Vector3::Zero());
  flex(facing, Finger::index, -0.6, -0.5, -0.3);
  flex(facing, Finger::thumb, -0.1, -0.2, -0.2);
  facing = hand.limited(facing);
  Pose in_grip;
  {
    const JointAngles start = facing;
    Unknowns unknowns(hand, nullptr);
    for (const Finger f : {Finger::thumb, Finger::index}) unknowns.add({&facing}, variables_of(f), start);
    unknowns.solve([&](const VectorX& x, Residual& r) {
      const JointFrames at = forward_kinematics(model, Pose{}, facing);
      const auto t = hand.pad(Finger::thumb, at), i = hand.pad(Finger::index, at);
      const Vector3 between = i.position - t.position, axis = between.normalized();
      r.push_back(kPerMetre * (between.norm() - 2 * closed));
      append(t.normal - axis, 12, r);
      append(i.normal + axis, 12, r);
      append(i.along - t.along, 2, r);
      unknowns.append_start(x, 10, r);
    });
    const JointFrames frames = forward_kinematics(model, Pose{}, facing);
    const Vector3 thumb = hand.pad(Finger::thumb, frames).position, finger = hand.pad(Finger::index, frames).position;
    const Vector3 axis = (thumb - finger).normalized(), middle = 0.5 * (thumb + finger);
    const Vector3 up = (-middle + axis * axis.dot(middle)).normalized();
    Matrix3 in_hand;
    in_hand << up.cross(axis), up, axis;
    in_grip.orientation = Quaternion(Matrix3(in_hand.transpose()));
    in_grip.position = -(in_grip.orientation * middle);
  }

  // Fingers that take no part are either curled or stretched out, and the hand may lean: what clears best.
  constexpr std::array<std::array<double, 3>, 2> kPostures{{{-0.9, -1.2, -0.7}, {0.3, -0.2, -0.1}}};
  JointAngles a, b;
  double exact = 0, clear = 0;  // weights of the pads' places and of clearance
  const Vector3 down = Eigen::AngleAxisd(o.tilt, -Vector3::UnitZ()) * Vector3::UnitY();
  const auto attempt = [&](const Pose& wrist_start, const JointAngles& closed_start, const JointAngles& open_start,
                           std::initializer_list<std::array<double, 2>> weights, Pose& wrist_out) {
    Unknowns unknowns(hand, &wrist_start);
    for (const Finger f : {Finger::thumb, Finger::index}) unknowns.add({&a}, variables_of(f), closed_start);
    for (const Finger f : {Finger::thumb, Finger::index}) unknowns.add({&b}, variables_of(f), open_start);
    for (const Finger f : {Finger::middle, Finger::ring, Finger::little}) unknowns.add({&a, &b}, variables_of(f), closed_start);
    const auto residual = [&](const VectorX& x, Residual& r) {
      const Pose wrist = unknowns.wrist(x);
      for (const bool gripping : {true, false}) {
        const JointFrames at = forward_kinematics(model, wrist, gripping ? a : b);
        const auto t = hand.pad(Finger::thumb, at), i = hand.pad(Finger::index, at);
        const double reach = gripping ? closed : open;
        const Vector3 thumb_at = t.touch(-Vector3::UnitZ()), index_at = i.touch(Vector3::UnitZ());
        r.push_back(exact * (thumb_at.z() - reach));
        r.push_back(exact * (index_at.z() + reach));
        const double across = gripping ? exact : 0.1 * kPerMetre;
        r.push_back(across * thumb_at.x());
        r.push_back(across * index_at.x());
        r.push_back(across * (thumb_at.y() - index_at.y()));
        r.push_back((gripping ? 1.0 : 0.3) * kPerMetre * (0.5 * (thumb_at.y() + index_at.y()) - kAbove));
        const double flat = gripping ? 9 : 1.0;
        append(t.normal + Vector3::UnitZ(), flat, r);
        append(i.normal - Vector3::UnitZ(), flat, r);
        // Fingertips down, or they would cross.
        append(t.along + down, gripping ? 2 : 1, r);
        append(i.along + down, gripping ? 3 : 1, r);
        const auto spheres = hand.spheres(at);
        for (const auto& s : spheres) {
          const Finger whose = finger_of(s.body);
          // The tracked pads are as deep in the cube as they would press; so is what lies behind them, and a flat pad takes its joint
          // along.
          const bool grips = gripping && (whose == Finger::thumb || whose == Finger::index);
          const bool touches =
              grips && (s.body == distal_of(whose) || (end_joint_of(s.body) == joint_of(distal_of(whose)) && s.along == 1));
          const double margin = grips ? 1e-3 - o.closing_depth : kClear;
          const double table = s.centre.y() + half - s.radius - o.lower_depth, cube = outside_cube(s.centre, half) - s.radius;
          r.push_back(clear * std::max(0.0, kClear - table));
          r.push_back(touches ? 0.0 : clear * std::max(0.0, margin - cube));
        }
        GripHand::keep_apart(spheres, {Finger::middle, Finger::ring, Finger::little}, 2e-3, r);
      }
      const Vector3 from_above = Eigen::AngleAxisd(o.tilt, Vector3::UnitZ()) * wrist.position.normalized();
      r.push_back(from_above.x());
      unknowns.append_start(x, 2, r);
    };
    VectorX x;
    for (const auto& weight : weights) {
      exact = weight[0] * kPerMetre;
      clear = weight[1] * kPerMetre;
      x = unknowns.solve(residual, x.size() > 0 ? &x : nullptr);
    }
    wrist_out = unknowns.wrist(x);
    Residual r;
    residual(x, r);
    double cost = 0;
    for (const double e : r) cost += e * e;
    return cost;
  };
  Grip grip;
  JointAngles shut, wide;
  double best = std::numeric_limits<double>::infinity();
  for (const auto& posture : kPostures) {
    for (const double lean : {-1.2, -0.8, -0.4, 0.0, 0.4, 0.8, 1.2}) {
      a = facing;
      for (const Finger finger : {Finger::middle, Finger::ring, Finger::little}) flex(a, finger, posture[0], posture[1], posture[2]);
      a = hand.limited(a);
      b = a;
      for (const Finger finger : {Finger::index, Finger::thumb}) {
        for (const Variable& v : variables_of(finger)) b[index(v.body)][v.axis] *= 0.4;
      }
      const JointAngles closed_start = a, open_start = b;
      const Quaternion turn(Eigen::AngleAxisd(o.tilt + lean, -Vector3::UnitZ()));
      Pose wrist;
      const double cost =
          attempt(Pose{Vector3::Zero(), turn} * in_grip, closed_start, open_start, {{0.3, 0.03}, {1, 0.2}, {3, 1}, {10, 2}}, wrist);
      if (cost >= best) continue;
      best = cost;
      shut = a;
      wide = b;
      grip.wrist = wrist;
    }
  }
  {
    const JointAngles closed_start = shut, open_start = wide;
    const Pose start = grip.wrist;
    attempt(start, closed_start, open_start, {{30, 2}}, grip.wrist);
    shut = a;
    wide = b;
  }

  const auto pads_of = [&](const JointAngles& angles) {
    const JointFrames frames = forward_kinematics(model, grip.wrist, angles);
    return std::pair{hand.pad(Finger::thumb, frames).touch(-Vector3::UnitZ()), hand.pad(Finger::index, frames).touch(Vector3::UnitZ())};
  };
  const auto [thumb_shut, index_shut] = pads_of(shut);
  const auto [thumb_wide, index_wide] = pads_of(wide);
  // Only the way open may fall short: a smaller opening still grips.
  const double missed = std::max(
      {std::abs(thumb_shut.z() - closed), std::abs(index_shut.z() + closed), half + 1e-3 - thumb_wide.z(), half + 1e-3 + index_wide.z()});
  if (missed > 1e-3) {
    throw std::invalid_argument("generator: pinch of " + std::to_string(o.object_width * 1e3) + " mm: the pads reach from " +
                                std::to_string((thumb_shut.z() - index_shut.z()) * 1e3) + " to " +
                                std::to_string((thumb_wide.z() - index_wide.z()) * 1e3) +
                                " mm; expected an object_width that the hand can span");
  }
  JointAngles angles = shut;
  for (std::size_t k = 0; k < kApertures; ++k) {
    const double s = static_cast<double>(k) / (kApertures - 1);
    const Vector3 thumb_goal = (1 - s) * thumb_shut + s * thumb_wide;
    const Vector3 index_goal = (1 - s) * index_shut + s * index_wide;
    JointAngles between = shut;
    for (std::size_t n = 2; n < kBodyCount; ++n) between[n] = (1 - s) * shut[n] + s * wide[n];
    Unknowns unknowns(hand, nullptr);
    for (const Finger f : {Finger::thumb, Finger::index}) unknowns.add({&angles}, variables_of(f), between);
    unknowns.solve([&](const VectorX& x, Residual& r) {
      const auto [thumb, finger] = pads_of(angles);
      append(thumb - thumb_goal, kPlace, r);
      append(finger - index_goal, kPlace, r);
      unknowns.append_start(x, 0.5, r);
    });
    grip.apertures.push_back(angles);
  }
  place(grip, o, Vector3::UnitY());
  return grip;
}

// All fingers around an upright cylinder in the palm, thumb on its other side and above. The palm looks along the grip's direction.
Grip solve_power_grasp(const HandModel& model, const GeneratorOptions& o) {
  const GripHand hand(model);
  const double radius = 0.5 * o.object_width, reach = radius - o.closing_depth;
  constexpr double kPalmGap = 5e-3;
  const auto radial = [](const Vector3& p) { return Vector3(p.x(), 0, p.z()); };

  JointAngles shut;
  shut.fill(Vector3::Zero());
  for (const Finger finger : kFingers) flex(shut, finger, -0.8, -0.9, -0.5);
  flex(shut, Finger::thumb, -0.2, -0.3, -0.4);
  shut = hand.limited(shut);
  const JointAngles start = shut;
  // First guess: palm along -Z, the thumb's side up, the cylinder below the knuckles.
  const Vector3 thumb_side = model.side == Side::right ? Vector3(-1, 0, 0) : Vector3(1, 0, 0);
  Matrix3 in_hand;
  in_hand << thumb_side.cross(Vector3::UnitY()), thumb_side, Vector3::UnitY();
  Pose guess;
  guess.orientation = Quaternion(Matrix3(in_hand.transpose()));
  const std::size_t knuckle = index(Joint::middle_proximal);
  const Vector3 centre = model.rest_joints[knuckle].position - Vector3(0, radius + model.joint_radii[knuckle] + kPalmGap, 0);
  guess.position = -(guess.orientation * centre);

  std::vector<Variable> variables;
  for (int f = 0; f < kFingerCount; ++f) {
    for (const Variable& v : variables_of(static_cast<Finger>(f))) variables.push_back(v);
  }
  Unknowns unknowns(hand, &guess);
  unknowns.add({&shut}, variables, start);
  const VectorX x = unknowns.solve([&](const VectorX& at, Residual& r) {
    const JointFrames frames = forward_kinematics(model, unknowns.wrist(at), shut);
    const Vector3 opposite = radial(hand.pad(Finger::middle, frames).position).normalized();
    for (int f = 0; f < kFingerCount; ++f) {
      const auto pad = hand.pad(static_cast<Finger>(f), frames);
      const Vector3 out = radial(pad.position);
      r.push_back(kPlace * (out.norm() - reach));
      append(pad.normal + out.normalized(), 3, r);
      if (f == 0) append(out.normalized() + opposite, 1, r);
    }
    const auto spheres = hand.spheres(frames);
    double palm = 1;
    for (const auto& s : spheres) {
      const double distance = radial(s.centre).norm() - radius - s.radius;
      const bool distal = s.body == distal_of(finger_of(s.body));
      const double margin = is_metacarpal(s.body) ? kPalmGap : distal ? -o.closing_depth - 1e-3 : 1e-3;
      if (is_metacarpal(s.body) && finger_of(s.body) != Finger::thumb) palm = std::min(palm, distance);
      r.push_back(2 * kPerMetre * std::max(0.0, margin - distance));
      // Phalanges lie along the cylinder where they can.
      r.push_back(distal || is_metacarpal(s.body) ? 0.0 : 0.05 * kPerMetre * (distance - margin));
    }
    r.push_back(kPerMetre * (palm - kPalmGap));
    GripHand::keep_apart(spheres, {Finger::index, Finger::middle, Finger::ring, Finger::little}, 0.5e-3, r);
    r.push_back(0.1 * kPerMetre * hand.pad(Finger::middle, frames).position.y());
    append(at.segment<3>(3), 3, r);
    unknowns.append_start(at, 0.4, r);
  });
  Grip grip;
  grip.wrist = unknowns.wrist(x);
  {
    const JointFrames frames = forward_kinematics(model, grip.wrist, shut);
    for (int f = 0; f < kFingerCount; ++f) {
      const double got = radial(hand.pad(static_cast<Finger>(f), frames).position).norm();
      if (std::abs(got - reach) > 2e-3) {
        throw std::invalid_argument("generator: power_grasp of " + std::to_string(o.object_width * 1e3) + " mm: the pad of " +
                                    std::string(kFingerNames[static_cast<std::size_t>(f)]) + " comes to " + std::to_string(got * 1e3) +
                                    " mm of the axis; expected an object_width that the hand can close on");
      }
    }
  }

  // Open: fingers nearly straight, everything clear of the cylinder and of the way that it comes into the hand.
  JointAngles wide = shut;
  for (std::size_t b = 2; b < kBodyCount; ++b) wide[b] *= 0.15;
  const JointAngles open_start = wide;
  Unknowns opening(hand, nullptr);
  opening.add({&wide}, variables, open_start);
  opening.solve([&](const VectorX& at, Residual& r) {
    const auto spheres = hand.spheres(forward_kinematics(model, grip.wrist, wide));
    for (const auto& s : spheres) {
      Vector3 from = radial(s.centre);
      if (from.z() < 0) from.z() = 0;  // the cylinder comes along +Z, as the hand sees it
      const double margin = is_metacarpal(s.body) ? 4e-3 : 0.5 * o.opening;
      r.push_back(2 * kPerMetre * std::max(0.0, margin - (from.norm() - radius - s.radius)));
    }
    opening.append_start(at, 1, r);
  });
  for (std::size_t k = 0; k < kApertures; ++k) {
    const double s = static_cast<double>(k) / (kApertures - 1);
    JointAngles angles = shut;
    for (std::size_t b = 2; b < kBodyCount; ++b) angles[b] = (1 - s) * shut[b] + s * wide[b];
    // On the way no finger may cut through more of the cylinder than it does in the end.
    Unknowns between(hand, nullptr);
    const JointAngles straight = angles;
    between.add({&angles}, variables, straight);
    between.solve([&](const VectorX& at, Residual& r) {
      for (const auto& sphere : hand.spheres(forward_kinematics(model, grip.wrist, angles))) {
        const double distance = radial(sphere.centre).norm() - radius - sphere.radius;
        r.push_back(kPerMetre * std::max(0.0, -o.closing_depth - 1e-3 - distance));
      }
      between.append_start(at, 1, r);
    });
    grip.apertures.push_back(angles);
  }
  place(grip, o, Vector3::UnitZ());
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

// How far each finger flexes before it meets the palm, and the thumb that then lies across the fingers.
JointAngles solve_fist(const HandModel& model) {
  const GripHand hand(model);
  JointAngles fist;
  fist.fill(Vector3::Zero());
  for (const Finger finger : kFingers) {
    for (double s = 0.05; s <= 1; s += 0.01) {
      JointAngles tried = fist;
      flex(tried, finger, -1.25 * s, -1.45 * s, -0.9 * s);
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
  const JointAngles start = fist;
  Unknowns unknowns(hand, nullptr);
  unknowns.add({&fist}, variables_of(Finger::thumb), start);
  unknowns.solve([&](const VectorX& x, Residual& r) {
    const JointFrames frames = forward_kinematics(model, Pose{}, fist);
    const Vector3 over = 0.5 * (frames[index(Joint::index_intermediate)].position + frames[index(Joint::index_distal)].position);
    append(hand.pad(Finger::thumb, frames).position - over, 0.1 * kPerMetre, r);
    GripHand::keep_apart(hand.spheres(frames), {Finger::index, Finger::middle, Finger::ring, Finger::little}, 1e-3, r);
    unknowns.append_start(x, 0.5, r);
  });
  return fist;
}

// Opens and closes, or wanders about with every joint in motion; no object. Starts and ends at rest.
class FreeMotion : public Motion {
 public:
  FreeMotion(const HandModel& hand, const GeneratorOptions& options) : hand_(hand), options_(options), fist_(solve_fist(hand)) {}
  double duration() const override { return options_.free_time; }
  const std::array<double, kJointCount>& radii() const override { return hand_.joint_radii; }
  JointFrames at(double time) const override {
    const double t = std::clamp(time, 0.0, options_.free_time);
    const double window = smooth(t) * smooth(options_.free_time - t);  // swells and fades over a second
    const bool fist = options_.motion == "fist";
    Pose wrist{to_vector(options_.object_position), Quaternion::Identity()};
    if (!fist) {
      wrist.position += window * Vector3(0.08 * std::sin(1.3 * t), 0.05 * std::sin(1.9 * t), 0.06 * std::sin(1.1 * t));
      wrist.orientation = rotation_exp(window * Vector3(0.35 * std::sin(0.9 * t), 0.4 * std::sin(1.2 * t), 0.5 * std::sin(0.7 * t)));
    }
    JointAngles angles = fist_;
    for (int f = 0; f < kFingerCount; ++f) {
      const bool thumb = f == 0;
      // A wave through the fingers; the thumb closes over them last and opens first.
      const double beat = 0.5 - 0.5 * std::cos(2 * M_PI * t / 4);
      const double share = fist ? window * (thumb ? smooth(2 * beat - 1) : smooth(beat / 0.8))
                                : window * (thumb ? 0.15 - 0.15 * std::cos(1.4 * t) : 0.3 - 0.3 * std::cos(1.7 * t - 0.5 * f));
      for (const Variable& v : variables_of(static_cast<Finger>(f))) angles[index(v.body)][v.axis] *= share;
    }
    return forward_kinematics(hand_, wrist, angles);
  }

 private:
  HandModel hand_;
  GeneratorOptions options_;
  JointAngles fist_;
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
