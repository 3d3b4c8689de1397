#include "world/engines/bullet/bullet_joint.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "math/rotation.hpp"

namespace softhand {
namespace {

constexpr double kCorrection = 0.5;                    // part of an error that a step removes
constexpr int kJointType = 0x736a;                     // user constraint type of BulletJoint
constexpr double kMostTurn = 0.25 * std::numbers::pi;  // rad; Bullet turns a body by at most this in a step

Pose pose_of(const btRigidBody& body, double scale) {
  const btTransform& transform = body.getWorldTransform();
  const btQuaternion q = transform.getRotation();
  const btVector3& p = transform.getOrigin();
  return {Vector3(p.x(), p.y(), p.z()) / scale, Quaternion(q.w(), q.x(), q.y(), q.z()).normalized()};
}

btVector3 to_bullet(const Vector3& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

Matrix3 to_eigen(const btMatrix3x3& m) {
  Matrix3 out;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out(i, j) = m[i][j];
  return out;
}

void store(btScalar* out, const Vector3& v) {
  for (int k = 0; k < 3; ++k) out[k] = static_cast<float>(v[k]);
}

Twist twist_of(const btRigidBody& body, double scale) {
  const btVector3 &v = body.getLinearVelocity(), &w = body.getAngularVelocity();
  return {Vector3(v.x(), v.y(), v.z()) / scale, Vector3(w.x(), w.y(), w.z())};
}

// The pose after a step, as Bullet integrates it.
Pose advanced_by_bullet(const Pose& pose, const Twist& twist, double dt) {
  const double turn = twist.angular.norm() * dt;
  return increment(pose, dt * twist.linear, (turn > kMostTurn ? kMostTurn / turn : 1.0) * dt * twist.angular);
}

// An offset in the engine's lengths: its value and its levers.
JointRow scaled(JointRow row, double scale) {
  row.value *= scale;
  row.parent_angular *= scale;
  row.child_angular *= scale;
  return row;
}

JointRow turning(double value, const Vector3& axis) {
  JointRow row;
  row.value = value;
  row.parent_angular = -axis;
  row.child_angular = axis;
  return row;
}

// What a joint holds at 0, in m and rad: first the offsets, then the rotations.
struct HeldRows {
  BoundedVector<JointRow, 6> rows;
  std::size_t offsets = 0;
};
HeldRows held_rows(const JointLaw& law, const JointPose& pose, double q) {
  HeldRows held;
  for (int axis = 0; axis < 3; ++axis) {
    if (axis == 1 && law.kind == ObjectJointKind::slider) continue;
    JointRow offset = pose.offset(axis);
    if (axis == 1 && law.kind == ObjectJointKind::screw) {
      JointRow thread = joint_row(law, pose, q);
      offset += thread *= -law.pitch / (2 * std::numbers::pi);
    }
    held.rows.push_back(offset);
  }
  held.offsets = held.rows.size();
  if (law.turns()) {
    // The child's axis y turns towards the parent's about a x b.
    const Vector3 a = pose.parent_frame * Vector3(Vector3::UnitY()), b = pose.child_frame * Vector3(Vector3::UnitY());
    const Vector3 error = a.cross(b);
    for (const int axis : {0, 2}) {
      const Vector3 direction = pose.parent_frame * Vector3(Vector3::Unit(axis));
      held.rows.push_back(turning(direction.dot(error), direction));
    }
  } else if (law.kind != ObjectJointKind::ball) {
    const Vector3 turn = rotation_log(pose.relative);
    for (int axis = 0; axis < 3; ++axis)
      held.rows.push_back(turning(turn[axis], pose.parent_frame * Vector3(Vector3::Unit(axis))));
  }
  return held;
}

}  // namespace

BulletJoint::BulletJoint(const EngineJoint& joint, btRigidBody& parent, btRigidBody& child, double scale)
    : btTypedConstraint(D6_CONSTRAINT_TYPE, parent, child), joint_(joint), scale_(scale) {
  setUserConstraintType(kJointType);
}

double BulletJoint::inner(const JointRow& one, const JointRow& other) const {
  const auto of_body = [](const btRigidBody& body, const Vector3& linear, const Vector3& angular,
                          const Vector3& other_linear, const Vector3& other_angular) {
    return static_cast<double>(body.getInvMass()) * linear.dot(other_linear) +
           angular.dot(to_eigen(body.getInvInertiaTensorWorld()) * other_angular);
  };
  return of_body(m_rbA, one.parent_linear, one.parent_angular, other.parent_linear, other.parent_angular) +
         of_body(m_rbB, one.child_linear, one.child_angular, other.child_linear, other.child_angular);
}

void BulletJoint::add(Row row) {
  for (const Row& before : rows_) {
    if (before.meaning >= lower_limit) break;
    const double share = inner(row.jacobian, before.jacobian) / before.weight;
    JointRow part = before.jacobian;
    row.jacobian += part *= -share;
    row.speed -= share * before.speed;
  }
  row.weight = inner(row.jacobian, row.jacobian);
  rows_.push_back(row);
}

void BulletJoint::end_step(double dt) {
  Vector3 impulse = Vector3::Zero();
  for (const Row& row : rows_) impulse += impulses_[static_cast<std::size_t>(row.meaning)] * row.jacobian.child_linear;
  if (joint_.law.kind == ObjectJointKind::slider) {
    const Vector3 axis = pose_of(m_rbA, scale_).orientation * (joint_.parent_from_joint.orientation * Vector3::UnitY());
    impulse -= axis.dot(impulse) * axis;
  }
  joint_.reaction = impulse.norm() / (scale_ * dt);
}

// Limits, friction, and the change of the other forces. `unit`: engine units of a force per N, or of a torque per N m.
// The row's own speed is in engine units: `row` has been converted.
void BulletJoint::add_law(const JointRow& row, double unit, double dt) {
  const JointLaw& law = joint_.law;
  const double length = law.kind == ObjectJointKind::slider ? scale_ : 1;  // engine units of q
  const double q = row.value;
  const auto reach = [this, dt](double gap) { return gap > 0 ? gap / dt : correction_ * gap; };
  if (law.minimum > -std::numeric_limits<double>::infinity())
    add({lower_limit, row, -length * reach(q - law.minimum), 0, SIMD_INFINITY, 0});
  if (law.maximum < std::numeric_limits<double>::infinity())
    add({upper_limit, row, length * reach(law.maximum - q), -SIMD_INFINITY, 0, 0});
  if (passive_) return;
  const double bound = friction_bound_ * unit * dt;
  if (bound > 0) add({friction, row, 0, -bound, bound, 0});
  const JointLaw::Potential potential = law.potential(q);
  const double resistance = dt * dt * std::max(0.0, potential.curvature) + dt * law.damping;
  // unit/length engine forces per engine speed.
  if (resistance > 0) add({BulletJoint::drag, row, 0, -SIMD_INFINITY, SIMD_INFINITY, 1 / (resistance * unit / length)});
  if (potential.slope == 0 || (!m_rbA.isActive() && !m_rbB.isActive())) return;
  const double force = -potential.slope * unit;
  m_rbA.applyCentralForce(to_bullet(force * row.parent_linear));
  m_rbA.applyTorque(to_bullet(force * row.parent_angular));
  m_rbB.applyCentralForce(to_bullet(force * row.child_linear));
  m_rbB.applyTorque(to_bullet(force * row.child_angular));
}

void BulletJoint::prepare(double dt, double step) {
  correction_ = kCorrection / step;
  const JointLaw& law = joint_.law;
  friction_bound_ = law.friction_at(joint_.reaction);
  rows_.clear();
  const Pose parent = pose_of(m_rbA, scale_), child = pose_of(m_rbB, scale_);
  const Twist parent_twist = twist_of(m_rbA, scale_), child_twist = twist_of(m_rbB, scale_);
  const JointPose pose(parent, child, joint_.parent_from_joint, joint_.child_from_joint);
  const JointPose next(advanced_by_bullet(parent, parent_twist, dt), advanced_by_bullet(child, child_twist, dt),
                       joint_.parent_from_joint, joint_.child_from_joint);
  joint_.coordinate = joint_coordinate(law, pose, joint_.coordinate);
  const HeldRows now = held_rows(law, pose, joint_.coordinate), ahead = held_rows(law, next, joint_.coordinate);
  for (std::size_t i = 0; i < now.rows.size(); ++i) {
    const JointRow& row = now.rows[i];
    const bool offset = i < now.offsets;
    double change = -correction_ * dt * row.value;
    if (m_rbA.isStaticObject()) change -= ahead.rows[i].value - row.value - dt * row.rate(parent_twist, child_twist);
    add({static_cast<int>(i), offset ? scaled(row, scale_) : row, (offset ? scale_ : 1) * change / dt, -SIMD_INFINITY,
         SIMD_INFINITY, 0});
  }
  JointRow q;
  if (law.has_coordinate()) q = joint_row(law, pose, joint_.coordinate);
  if (law.turns()) add_law(q, scale_ * scale_, dt);
  if (law.kind == ObjectJointKind::slider) {
    const double value = q.value;
    q = scaled(q, scale_);
    q.value = value;
    add_law(q, scale_, dt);
  }
  if (law.kind != ObjectJointKind::ball) return;
  if (law.limited()) {
    const Vector3 a = pose.parent_frame * Vector3(Vector3::UnitY()), b = pose.child_frame * Vector3(Vector3::UnitY());
    const Vector3 normal = a.cross(b);
    if (normal.norm() > 1e-6) {
      const double gap = law.maximum - std::atan2(normal.norm(), a.dot(b));
      add({upper_limit, turning(0, normal.normalized()), gap > 0 ? gap / dt : correction_ * gap, -SIMD_INFINITY, 0, 0});
    }
  }
  if (passive_) return;
  const double torque = scale_ * scale_;
  // The first row lies along the relative rotation speed: the bound holds for the whole torque.
  const Vector3 spin = [this] {
    const btVector3 w = m_rbB.getAngularVelocity() - m_rbA.getAngularVelocity();
    return Vector3(w.x(), w.y(), w.z());
  }();
  const Vector3 first = spin.norm() > 1e-6 ? Vector3(spin.normalized()) : Vector3(Vector3::UnitX());
  const Vector3 second = first.unitOrthogonal();
  // Their directions change from step to step, so their impulses start at zero.
  for (int k = 0; k < 3; ++k) {
    const Vector3 axis = k == 0 ? first : k == 1 ? second : Vector3(first.cross(second));
    const double bound = friction_bound_ * torque * dt;
    impulses_[static_cast<std::size_t>(friction + k)] = impulses_[static_cast<std::size_t>(BulletJoint::drag + k)] = 0;
    if (bound > 0) add({friction + k, turning(0, axis), 0, -bound, bound, 0});
    if (law.stiffness > 0)
      add({BulletJoint::drag + k, turning(0, axis), 0, -SIMD_INFINITY, SIMD_INFINITY,
           1 / (dt * dt * law.stiffness * torque)});
  }
  if (law.stiffness > 0 && (m_rbA.isActive() || m_rbB.isActive())) {
    // The gradient of k (1 - cos) is k sin about the axis of the relative rotation.
    const Vector3 turn = rotation_log(pose.relative);
    const double angle = turn.norm();
    const Vector3 pull = angle > 0
                             ? Vector3(-law.stiffness * torque * std::sin(angle) / angle * (pose.parent_frame * turn))
                             : Vector3(Vector3::Zero());
    m_rbA.applyTorque(to_bullet(-pull));
    m_rbB.applyTorque(to_bullet(pull));
  }
}

void BulletJoint::getInfo1(btConstraintInfo1* info) {
  info->m_numConstraintRows = static_cast<int>(rows_.size());
  info->nub = 0;
}

void BulletJoint::getInfo2(btConstraintInfo2* info) {
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    const Row& row = rows_[r];
    const auto at = static_cast<std::ptrdiff_t>(r) * info->rowskip;
    store(info->m_J1linearAxis + at, row.jacobian.parent_linear);
    store(info->m_J1angularAxis + at, row.jacobian.parent_angular);
    store(info->m_J2linearAxis + at, row.jacobian.child_linear);
    store(info->m_J2angularAxis + at, row.jacobian.child_angular);
    info->m_constraintError[at] = static_cast<float>(row.speed);
    info->m_lowerLimit[at] = static_cast<float>(row.lower);
    info->m_upperLimit[at] = static_cast<float>(row.upper);
  }
}

void BulletJointSolver::convertJoints(btTypedConstraint** constraints, int count, const btContactSolverInfo& info) {
  btSequentialImpulseConstraintSolver::convertJoints(constraints, count, info);
  converted_.resize(0);
  int row = 0;
  for (int i = 0; i < count; ++i) {
    const int rows = m_tmpConstraintSizesPool[i].m_numConstraintRows;
    if (rows > 0 && constraints[i]->getUserConstraintType() == kJointType) {
      auto& joint = static_cast<BulletJoint&>(*constraints[i]);
      converted_.push_back({&joint, row});
      for (int r = 0; r < rows; ++r) {
        btSolverConstraint& target = m_tmpSolverNonContactConstraintPool[row + r];
        if (const double compliance = joint.compliance(r); compliance != 0) {
          // Bullet has 1/d with d = J M^-1 J^T, and the right-hand side times 1/d. The row needs d + compliance.
          const double before = target.m_jacDiagABInv, after = before / (1 + before * compliance);
          target.m_rhs = static_cast<float>(target.m_rhs * (after / before));
          target.m_jacDiagABInv = static_cast<float>(after);
          target.m_cfm = static_cast<float>(compliance * after);
        }
        const auto start = static_cast<float>(joint.impulse(r));
        const btScalar impulse = std::clamp(start, target.m_lowerLimit, target.m_upperLimit);
        target.m_appliedImpulse = impulse;
        btSolverBody& parent = m_tmpSolverBodyPool[target.m_solverBodyIdA];
        btSolverBody& child = m_tmpSolverBodyPool[target.m_solverBodyIdB];
        parent.internalApplyImpulse(target.m_contactNormal1 * parent.internalGetInvMass(), target.m_angularComponentA,
                                    impulse);
        child.internalApplyImpulse(target.m_contactNormal2 * child.internalGetInvMass(), target.m_angularComponentB,
                                   impulse);
      }
    }
    row += rows;
  }
  factor_held_rows();
}

void BulletJointSolver::factor_held_rows() {
  constexpr double kRegular = 1e-9;  // relative to the diagonal; loops of joints have dependent rows
  held_.clear();
  for (int i = 0; i < converted_.size(); ++i) {
    const Converted& each = converted_[i];
    for (int r = 0; r < each.joint->row_count(); ++r) {
      if (!each.joint->is_held(r) || held_.push_back(each.row + r)) continue;
      held_.clear();
      return;
    }
  }
  const auto count = static_cast<Eigen::Index>(held_.size());
  matrix_.resize(count, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const btSolverConstraint& one = m_tmpSolverNonContactConstraintPool[held_[static_cast<std::size_t>(i)]];
    for (Eigen::Index j = 0; j <= i; ++j) {
      const btSolverConstraint& other = m_tmpSolverNonContactConstraintPool[held_[static_cast<std::size_t>(j)]];
      double sum = 0;
      const auto add = [&](int body, const btVector3& linear, const btVector3& angular, int other_body,
                           const btVector3& other_linear, const btVector3& other_angular) {
        if (body != other_body) return;
        sum += static_cast<double>(m_tmpSolverBodyPool[body].internalGetInvMass().x()) * linear.dot(other_linear) +
               static_cast<double>(angular.dot(other_angular));
      };
      const auto add_all = [&](int body, const btVector3& linear, const btVector3& angular) {
        add(body, linear, angular, other.m_solverBodyIdA, other.m_contactNormal1, other.m_angularComponentA);
        add(body, linear, angular, other.m_solverBodyIdB, other.m_contactNormal2, other.m_angularComponentB);
      };
      add_all(one.m_solverBodyIdA, one.m_contactNormal1, one.m_relpos1CrossNormal);
      add_all(one.m_solverBodyIdB, one.m_contactNormal2, one.m_relpos2CrossNormal);
      matrix_(i, j) = matrix_(j, i) = i == j ? (1 + kRegular) * sum : sum;
    }
  }
  factor_.compute(matrix_);
  if (factor_.info() != Eigen::Success) held_.clear();
}

BulletJointSolver::HeldVector BulletJointSolver::missing_speeds() {
  const auto count = static_cast<Eigen::Index>(held_.size());
  HeldVector missing(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const btSolverConstraint& row = m_tmpSolverNonContactConstraintPool[held_[static_cast<std::size_t>(i)]];
    btSolverBody& parent = m_tmpSolverBodyPool[row.m_solverBodyIdA];
    btSolverBody& child = m_tmpSolverBodyPool[row.m_solverBodyIdB];
    missing[i] = row.m_rhs / row.m_jacDiagABInv - row.m_contactNormal1.dot(parent.internalGetDeltaLinearVelocity()) -
                 row.m_relpos1CrossNormal.dot(parent.internalGetDeltaAngularVelocity()) -
                 row.m_contactNormal2.dot(child.internalGetDeltaLinearVelocity()) -
                 row.m_relpos2CrossNormal.dot(child.internalGetDeltaAngularVelocity());
  }
  return missing;
}

void BulletJointSolver::apply(const HeldVector& impulses) {
  for (Eigen::Index i = 0; i < impulses.size(); ++i) {
    btSolverConstraint& row = m_tmpSolverNonContactConstraintPool[held_[static_cast<std::size_t>(i)]];
    btSolverBody& parent = m_tmpSolverBodyPool[row.m_solverBodyIdA];
    btSolverBody& child = m_tmpSolverBodyPool[row.m_solverBodyIdB];
    const auto impulse = static_cast<float>(impulses[i]);
    row.m_appliedImpulse = static_cast<btScalar>(row.m_appliedImpulse) + impulse;
    parent.internalApplyImpulse(row.m_contactNormal1 * parent.internalGetInvMass(), row.m_angularComponentA, impulse);
    child.internalApplyImpulse(row.m_contactNormal2 * child.internalGetInvMass(), row.m_angularComponentB, impulse);
  }
}

void BulletJointSolver::solve_held_rows() {
  const HeldVector before = missing_speeds();
  const HeldVector impulses = factor_.solve(before);
  const bool is_finite = impulses.allFinite();
  if (is_finite) apply(impulses);
  // In single precision the solution for a heavy body behind a very light one can be worse than none.
  if (is_finite && missing_speeds().norm() < before.norm()) return;
  if (is_finite) apply(-impulses);
  held_.clear();
}

btScalar BulletJointSolver::solveSingleIteration(int iteration, btCollisionObject** bodies, int body_count,
                                                 btPersistentManifold** manifolds, int manifold_count,
                                                 btTypedConstraint** constraints, int count,
                                                 const btContactSolverInfo& info, btIDebugDraw* drawer) {
  if (!held_.empty()) solve_held_rows();
  return btSequentialImpulseConstraintSolver::solveSingleIteration(iteration, bodies, body_count, manifolds,
                                                                   manifold_count, constraints, count, info, drawer);
}

btScalar BulletJointSolver::solveGroupCacheFriendlyFinish(btCollisionObject** bodies, int count,
                                                          const btContactSolverInfo& info) {
  for (int i = 0; i < converted_.size(); ++i) {
    const Converted& each = converted_[i];
    for (int r = 0; r < each.joint->row_count(); ++r)
      each.joint->impulse(r) = m_tmpSolverNonContactConstraintPool[each.row + r].m_appliedImpulse;
    each.joint->end_step(info.m_timeStep);
  }
  converted_.resize(0);
  held_.clear();
  return btSequentialImpulseConstraintSolver::solveGroupCacheFriendlyFinish(bodies, count, info);
}

}  // namespace softhand
