// Finds postures of a hand: wrist and joint angles that meet goals (pads on faces, bones clear of things) as well as
// they can, inside the joints' ranges. A small bounded least-squares solver with exact derivatives. Runs at load;
// deterministic.
#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <initializer_list>
#include <span>
#include <vector>

#include "model/hand_model.hpp"
#include "trackers/replay/kinematics.hpp"

namespace softhand {

inline constexpr double kPerMetre = 1e3;  ///< weight by which a millimetre counts like a radian
inline constexpr std::array<Finger, 4> kFourFingers{Finger::index, Finger::middle, Finger::ring, Finger::little};

/// A joint angle that a solve may choose: `axis` 0 flexion, 1 abduction.
struct JointAxis {
  Body body;
  int axis;
};
/// What moves a finger: flexion and abduction of its first moving joint, flexion of the other two.
std::array<JointAxis, 4> axes_of(Finger finger);

/// A hand as solves see it: pads, joint ranges, and round bones that must keep clear of things. `model` must outlive
/// it.
class GripHand {
 public:
  explicit GripHand(const HandModel& model);
  const HandModel& model() const { return model_; }

  struct Pad {
    Body body;
    Vector3 position;
    Vector3 normal;  ///< the direction it presses in
    Vector3 along;   ///< from its joint to its tip
    Vector3 centre;  ///< in the finger, `radius` behind the skin
    double radius;
    /// Where the round finger touches a face that looks along -`towards`: the pad itself where it is flat on the face.
    Vector3 touch(const Vector3& towards) const { return centre + radius * towards; }
  };
  Pad pad(Finger finger, const JointFrames& frames) const;

  const JointAngles& open() const { return open_; }
  /// Sets a finger's flexion from the open hand, radians (negative = flexed), from its first moving joint to its last.
  void flex(JointAngles& angles, Finger finger, double first, double second, double distal) const;
  /// From the open hand (0) to `angles` (1).
  JointAngles from_open(double share, const JointAngles& angles) const;

  /// The allowed angle nearest to `angle`, radians.
  double limited(const JointAxis& which, double angle) const;
  JointAngles limited(JointAngles angles) const;

  struct Sphere {
    Body body;
    double along;  ///< of the bone, 0 at its own joint, 1 at its end
    double radius;
    Vector3 centre;
  };
  static constexpr int kSpheresPerBone = 4;
  /// Along every bone from metacarpals to tips, in the order of bodies, `kSpheresPerBone` each.
  std::vector<Sphere> spheres(const JointFrames& frames) const;
  /// The same where `spheres` came from before, without allocation.
  void move(std::vector<Sphere>& spheres, const JointFrames& frames) const;

 private:
  const HandModel& model_;
  JointAngles open_;
  std::array<Vector3, kFingerCount> pads_;  // in the distal joints' frames
};

/// How a number changes when a body of a posture moves: its virtual work, as a wrench about the origin.
struct Change {
  std::size_t posture;
  Body body;
  Vector3 force;
  Vector3 torque;
};
/// Of a number with `gradient` by a point that is fixed to the body, or by a direction that is.
inline Change by_point(std::size_t posture, Body body, const Vector3& point, const Vector3& gradient) {
  return {posture, body, gradient, point.cross(gradient)};
}
inline Change by_direction(std::size_t posture, Body body, const Vector3& direction, const Vector3& gradient) {
  return {posture, body, Vector3::Zero(), direction.cross(gradient)};
}

/// One or more postures with a common wrist that are sought together. First say what is free, then solve.
class PostureSolver {
 public:
  PostureSolver(const GripHand& hand, const Pose& wrist, std::vector<JointAngles> postures);

  /// The wrist may move by half a metre along each axis and turn about the origin.
  void free_wrist();
  /// The finger may move, by the same angles in each of `postures`, which start at those of the first.
  void free_finger(Finger finger, std::initializer_list<std::size_t> postures);

  /// States its goals by the functions below, as squares that add up; called anew for every posture tried.
  using Goals = std::function<void(PostureSolver&)>;
  /// From where it is to the nearest minimum. Returns the sum of squares there.
  double solve(const Goals& goals);

  const Pose& wrist() const { return wrist_; }
  const JointAngles& angles(std::size_t posture) const { return posed_[posture].angles; }
  const JointFrames& frames(std::size_t posture) const { return posed_[posture].frames; }
  GripHand::Pad pad(Finger finger, std::size_t posture) const { return hand_.pad(finger, posed_[posture].frames); }
  std::span<const GripHand::Sphere> spheres(std::size_t posture) const { return posed_[posture].spheres; }

  /// weight * value should be zero.
  void want(double weight, double value, std::initializer_list<Change> changes);
  /// A point that is fixed to a body should be at `goal`; a direction should be `goal`.
  void want_point(double weight, std::size_t posture, Body body, const Vector3& point, const Vector3& goal);
  void want_direction(double weight, std::size_t posture, Body body, const Vector3& direction, const Vector3& goal);
  /// Thumb against the phalanges of `fingers`, and index against middle finger: nothing closer than `margin`, metres.
  void want_apart(std::size_t posture, std::initializer_list<Finger> fingers, double margin);
  /// Every free angle should stay where it started.
  void want_start(double weight);
  /// The wrist should not turn from where it started.
  void want_wrist_turned_little(double weight);

  /// The sum of squares at values of what is free, and its gradient; for tests of the derivatives.
  double evaluate(const VectorX& values, const Goals& goals, VectorX& gradient);
  const VectorX& values() const { return values_; }

 private:
  struct Free {
    JointAxis axis;
    std::vector<std::size_t> postures;
    double start;
  };
  struct Posed {
    JointAngles angles;
    JointFrames frames;
    std::vector<GripHand::Sphere> spheres;
    std::array<std::vector<int>, kBodyCount> moved_by;  // indices into `values_`, without the wrist's
    std::vector<Vector3> turn_axis, turn_about;         // of each such value, world
  };
  void pose(const VectorX& values);
  void evaluate(const VectorX& values, const Goals& goals);
  void add_entry(int index, double value);
  void finish_row(double value);
  int first_angle() const { return wrist_is_free_ ? 6 : 0; }

  const GripHand& hand_;
  Pose wrist_start_, wrist_;
  bool wrist_is_free_ = false;
  Matrix3 turn_jacobian_ = Matrix3::Identity();  // world turn by the wrist's rotation vector
  std::vector<Posed> posed_;
  std::vector<Free> free_;
  VectorX values_, lower_, upper_;
  VectorX values_under_test_;
  // Of the posture under evaluation: cost, half its gradient, half its Gauss-Newton matrix.
  double cost_ = 0;
  VectorX gradient_;
  Eigen::MatrixXd normal_;
  VectorX row_;
  std::vector<int> entries_;  // that are not zero in `row_`
  std::vector<char> entered_;
};

}  // namespace softhand
