// Finds postures of a hand: wrist and joint angles that meet goals as well as possible within the ranges of the joints.
// Goals are pads on faces, or bones clear of obstacles. It is a small bounded least-squares solver with exact
// derivatives. It runs at load and is deterministic.
#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <initializer_list>
#include <span>
#include <vector>

#include "model/hand_model.hpp"
#include "model/kinematics.hpp"

namespace softhand {

inline constexpr double kPerMetre = 1e3;  ///< weight with which 1 mm counts like 1 rad
inline constexpr std::array<Finger, 4> kFourFingers{Finger::index, Finger::middle, Finger::ring, Finger::little};

/// A joint angle that the solver may change. `axis`: 0 = flexion, 1 = abduction.
struct JointAxis {
  Body body;
  int axis;
};
/// The axes of a finger: flexion and abduction of its first moving joint, flexion of the other two.
std::array<JointAxis, 4> axes_of(Finger finger);

/// Derivative of a number when a body of a posture moves, as a wrench about the origin (virtual work).
struct Change {
  std::size_t posture;
  Body body;
  Vector3 force;
  Vector3 torque;
};
/// The change of a number that has `gradient` with respect to a body-fixed point or a body-fixed direction.
inline Change by_point(std::size_t posture, Body body, const Vector3& point, const Vector3& gradient) {
  return {posture, body, gradient, point.cross(gradient)};
}
inline Change by_direction(std::size_t posture, Body body, const Vector3& direction, const Vector3& gradient) {
  return {posture, body, Vector3::Zero(), direction.cross(gradient)};
}

/// The hand model of the solver: pads, joint ranges, and round bones that must keep clear of obstacles. `model` must
/// outlive it.
class GripHand {
 public:
  explicit GripHand(const HandModel& model);
  const HandModel& model() const { return model_; }

  /// Where the skin of a distal phalanx touches a face first. The face does not move with the finger.
  struct Touch {
    Body body;
    Vector3 point;
    /// The change of `point` that has `gradient`, when the finger moves and rolls on the face.
    Change change(std::size_t posture, const Vector3& gradient) const {
      return {posture, body, gradient, middle.cross(gradient) + rolling * gradient};
    }
    Vector3 middle;   ///< of the skin that touches
    Matrix3 rolling;  ///< torque of a gradient because other skin touches when the finger turns
  };
  struct Pad {
    Body body;
    Vector3 position;
    Vector3 normal;  ///< of the flat part of the pad, outward
    Vector3 along;   ///< from the joint to the tip of the bone
    Vector3 centre;  ///< in the finger, `radius` below the skin
    double radius;
    Pose joint;
    std::span<const Vector3> skin;  ///< of the distal phalanx, in the frame `joint`
    /// Where the skin touches a face that looks along -`towards` (unit length).
    Touch touch(const Vector3& towards) const;
  };
  Pad pad(Finger finger, const JointFrames& frames) const;

  const JointAngles& open() const { return open_; }
  /// Sets the flexion of a finger relative to the open hand, radians (negative = flexed), from its first moving joint
  /// to its last.
  void flex(JointAngles& angles, Finger finger, double first, double second, double distal) const;
  /// Interpolates from the open hand (0) to `angles` (1).
  JointAngles from_open(double share, const JointAngles& angles) const;

  /// The allowed angle nearest to `angle`, in radians.
  double limited(const JointAxis& which, double angle) const;
  JointAngles limited(JointAngles angles) const;

  struct Sphere {
    Body body;
    double along;  ///< position along the bone: 0 at its own joint, 1 at its end
    double radius;
    Vector3 centre;
  };
  static constexpr int kSpheresPerBone = 4;
  /// Spheres along every bone from metacarpals to tips, in the order of bodies, `kSpheresPerBone` each.
  std::vector<Sphere> spheres(const JointFrames& frames) const;
  /// Updates `spheres` from an earlier call, without allocation.
  void move(std::vector<Sphere>& spheres, const JointFrames& frames) const;

 private:
  const HandModel& model_;
  JointAngles open_;
  // In the frames of the distal joints.
  std::array<Vector3, kFingerCount> pads_, normals_;
  std::array<std::vector<Vector3>, kFingerCount> skin_;
};

/// Solves one or more postures with a common wrist together. First declare the free values, then solve.
class PostureSolver {
 public:
  PostureSolver(const GripHand& hand, const Pose& wrist, std::vector<JointAngles> postures);

  /// The wrist may move by 0.5 m along each axis and rotate about the origin.
  void free_wrist();
  /// The finger may move. It has the same angles in all `postures`, and they start at the angles of the first one.
  void free_finger(Finger finger, std::initializer_list<std::size_t> postures);

  /// States the goals with the functions below. Their squares add up. Called again for every posture that is tried.
  using Goals = std::function<void(PostureSolver&)>;
  /// Descends from the present values to the nearest minimum. Returns the sum of squares there.
  double solve(const Goals& goals);

  const Pose& wrist() const { return wrist_; }
  const JointAngles& angles(std::size_t posture) const { return posed_[posture].angles; }
  const JointFrames& frames(std::size_t posture) const { return posed_[posture].frames; }
  GripHand::Pad pad(Finger finger, std::size_t posture) const { return hand_.pad(finger, posed_[posture].frames); }
  std::span<const GripHand::Sphere> spheres(std::size_t posture) const { return posed_[posture].spheres; }

  /// Goal: weight * value is zero.
  void add_residual(double weight, double value, std::initializer_list<Change> changes);
  /// Goal: a point fixed to a body is at `goal`, or a direction fixed to a body equals `goal`.
  void add_point_goal(double weight, std::size_t posture, Body body, const Vector3& point, const Vector3& goal);
  void add_direction_goal(double weight, std::size_t posture, Body body, const Vector3& direction, const Vector3& goal);
  /// Goal: the skin touches its face at `goal`.
  void add_touch_goal(double weight, std::size_t posture, const GripHand::Touch& touch, const Vector3& goal);
  /// Goal: at least `margin` (m) between thumb and the phalanges of `fingers`. Also keeps index and middle finger
  /// apart.
  void add_distance_goal(std::size_t posture, std::initializer_list<Finger> fingers, double margin);
  /// Goal: every free angle keeps its start value.
  void add_start_goal(double weight);
  /// Goal: the wrist keeps its start orientation.
  void add_wrist_rotation_goal(double weight);

  /// The sum of squares at given free values, and its gradient. For tests of the derivatives.
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
    std::array<std::vector<int>, kBodyCount> moved_by;  // indices into `values_`, without those of the wrist
    std::vector<Vector3> turn_axis, turn_about;         // per value, world
  };
  void pose(const VectorX& values);
  void evaluate(const VectorX& values, const Goals& goals);
  void add_entry(int index, double value);
  void finish_row(double value);
  int first_angle() const { return wrist_is_free_ ? 6 : 0; }

  const GripHand& hand_;
  Pose wrist_start_, wrist_;
  bool wrist_is_free_ = false;
  Matrix3 turn_jacobian_ = Matrix3::Identity();  // derivative of the world rotation by the wrist's rotation vector
  std::vector<Posed> posed_;
  std::vector<Free> free_;
  VectorX values_, lower_, upper_;
  VectorX values_under_test_;
  // For the posture under evaluation: cost, half its gradient, half its Gauss-Newton matrix.
  double cost_ = 0;
  VectorX gradient_;
  Eigen::MatrixXd normal_;
  VectorX row_;
  std::vector<int> entries_;  // indices of nonzero entries of `row_`
  std::vector<char> entered_;
};

}  // namespace softhand
