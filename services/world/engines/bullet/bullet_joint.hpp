// A joint between two bodies as rows of Bullet's constraint solver. Bullet's own constraints have no screw and no dry
// friction that holds. They integrate springs explicitly. Only bullet_engine.cpp includes this header.
//
// A row of a step is J v = c with an impulse between bounds. These are the rows.
// - Held offsets and axes: c removes half of the error in a step. The impulse has no bounds. J is that of the start. So
//   a turn by w dt moves the end of an arm l by l (w dt)^2/2 off its tangent. If the parent is static, c also removes
//   this error. If both bodies move, the speeds at the start predict it too badly. Then chains gain energy. The engine
//   divides a step in which this error is large.
// - Limits: q may not pass its limit within the step. The row is one-sided.
// - Dry friction: v = 0, and the impulse is within +-B dt. B uses the reaction force of the last step.
// - Spring, damping and detents: their force at the start of the step acts as an external force. A row with the
//   compliance 1/(dt^2 U'' + dt b) adds the change over the step. So the sum is the force at the end of the step, for
//   any stiffness.
//
// The solver visits row by row. Rows of the same joint would disturb each other: at the end of an arm a force turns the
// body. So each row is made orthogonal to the held rows before it, by Gram-Schmidt in the metric of the inverse mass.
// The solutions stay the same. Then one visit solves the held rows of a joint.
#pragma once

#include <btBulletDynamicsCommon.h>

#include <Eigen/Cholesky>
#include <array>

#include "messages/messages.hpp"
#include "world/physics_engine.hpp"

namespace softhand {

class BulletJoint final : public btTypedConstraint {
 public:
  /// `scale`: engine lengths per metre. The bodies must outlive the joint.
  BulletJoint(const EngineJoint& joint, btRigidBody& parent, btRigidBody& child, double scale);

  /// With the reaction of the last step, and the coordinate at its start.
  const EngineJoint& joint() const { return joint_; }
  int row_count() const { return static_cast<int>(rows_.size()); }
  void set_passive(bool passive) { passive_ = passive; }
  /// Computes the rows of the next `dt` seconds from the poses of the bodies, and applies the forces of spring and
  /// detents. Call it before each part of a step of `step` seconds.
  void prepare(double dt, double step);
  /// Compliance of a row relative to 1, in the engine's units; 0: a hard row.
  bool is_held(int row) const { return rows_[static_cast<std::size_t>(row)].meaning < lower_limit; }
  double compliance(int row) const { return rows_[static_cast<std::size_t>(row)].compliance; }

  /// Impulse of the row in the last step, as a start for the next step. Rows keep their meaning, not their place.
  /// With the rows made orthogonal, it is the force along the row's own direction plus a share of the held rows.
  double& impulse(int row) { return impulses_[static_cast<std::size_t>(rows_[static_cast<std::size_t>(row)].meaning)]; }

  /// Computes the reaction from the impulses of a step. Call it when they are known.
  void end_step(double dt);

  void getInfo1(btConstraintInfo1* info) override;
  void getInfo2(btConstraintInfo2* info) override;
  void setParam(int, btScalar, int) override {}
  btScalar getParam(int, int) const override { return 0; }

 private:
  // What a row does; also its place in `impulses_`. The first six are the held offsets and axes.
  enum Meaning { held = 0, lower_limit = 6, upper_limit, friction, drag = friction + 3, meanings = drag + 3 };
  struct Row {
    int meaning = held;
    JointRow jacobian;
    double speed = 0;  // c
    double lower = 0, upper = 0;
    double compliance = 0;
    double weight = 0;  // J M^-1 J^T
  };
  /// Makes the row orthogonal to the held rows before it.
  void add(Row row);
  void add_law(const JointRow& row, double unit, double dt);
  double inner(const JointRow& one, const JointRow& other) const;

  EngineJoint joint_;
  double scale_;
  bool passive_ = false;
  BoundedVector<Row, 16> rows_;
  std::array<double, meanings> impulses_{};
  double friction_bound_ = 0;  // N or N m, in this step
  double correction_ = 0;      // 1/s, speed at which an error goes back, per error
};

/// Bullet's solver with three additions for the rows of BulletJoint.
/// - The row's diagonal contains the compliance of the joint. Bullet leaves it out, and soft rows diverge.
/// - Impulses of joints start at those of the last step. From zero, a load on a long arm opens the joint by
///   0.2 mm. Bullet starts from zero.
/// - Each iteration begins with a dense solve of all held rows of connected bodies. Bullet solves row by row. A load
///   behind light links, or a long chain, then needs thousands of iterations and explodes.
class BulletJointSolver final : public btSequentialImpulseConstraintSolver {
 protected:
  btScalar solveSingleIteration(int iteration, btCollisionObject** bodies, int body_count,
                                btPersistentManifold** manifolds, int manifold_count, btTypedConstraint** constraints,
                                int count, const btContactSolverInfo& info, btIDebugDraw* drawer) override;
  void convertJoints(btTypedConstraint** constraints, int count, const btContactSolverInfo& info) override;
  btScalar solveGroupCacheFriendlyFinish(btCollisionObject** bodies, int count,
                                         const btContactSolverInfo& info) override;

 private:
  struct Converted {
    BulletJoint* joint = nullptr;
    int row = 0;
  };
  // The rows of 18 hinges. The held rows of more connected joints are visited one by one.
  static constexpr int kMostHeldRows = 90;
  using HeldVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostHeldRows, 1>;
  using HeldMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostHeldRows, kMostHeldRows>;
  void factor_held_rows();
  void solve_held_rows();
  HeldVector missing_speeds();  // c - J v of the held rows
  void apply(const HeldVector& impulses);

  BoundedVector<int, kMostHeldRows> held_;  // numbers of rows; empty if they are visited one by one
  HeldMatrix matrix_;                       // J M^-1 J^T of the held rows
  Eigen::LDLT<HeldMatrix> factor_;
  btAlignedObjectArray<Converted> converted_;  // the joints of this group of bodies, with their first rows
};

}  // namespace softhand
