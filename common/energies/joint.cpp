#include "energies/joint.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "math/rotation.hpp"

namespace softhand {
namespace {

// Width of the ramp over which a limit's stiffness grows, rad. Beyond it the moment is stiffness times excess.
constexpr double kRamp = 0.02;
constexpr double kUnlimited = std::numeric_limits<double>::infinity();

// Geometry of a joint in the current poses of its two bodies.
struct JointGeometry {
  Vector3 parent_arm, child_arm;  // from the centres of mass, world axes
  Vector3 gap;                    // parent's point minus child's
  Quaternion parent_frame;
  Vector3 angles;
};

JointGeometry geometry_of(const JointSite& site, const State& state) {
  const Pose& parent = state.body_poses[static_cast<std::size_t>(site.parent)];
  const Pose& child = state.body_poses[static_cast<std::size_t>(site.child)];
  JointGeometry g;
  g.parent_arm = parent.orientation * site.parent_from_joint.position;
  g.child_arm = child.orientation * site.child_from_joint.position;
  g.gap = parent.position - child.position + g.parent_arm - g.child_arm;
  g.parent_frame = parent.orientation * site.parent_from_joint.orientation;
  g.angles = rotation_log(g.parent_frame.conjugate() * (child.orientation * site.child_from_joint.orientation));
  return g;
}

}  // namespace

std::vector<JointSite> hand_joints(const HandModel& hand) {
  std::vector<JointSite> sites;
  for (int b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    const BodyModel& child = hand.bodies[static_cast<std::size_t>(b)];
    if (child.joint.kind == JointKind::free) continue;
    const Body parent = parent_of(body);
    const Pose& joint = hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(body)))];
    const Pose parent_rest = hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(parent)))] *
                             hand.bodies[static_cast<std::size_t>(index_of(parent))].joint_from_body;
    sites.push_back({index_of(parent), b, parent_rest.inverse() * joint, child.joint_from_body.inverse(), child.joint});
  }
  return sites;
}

JointEnergy::JointEnergy(const std::vector<JointSite>& sites, DofLayout layout) {
  joints_.reserve(sites.size());
  for (const JointSite& site : sites) {
    const JointModel& m = site.model;
    const auto refuse = [&site](const std::string& what) {
      throw std::invalid_argument("joint of body " + std::to_string(site.child) + ": " + what);
    };
    if (!(m.position_stiffness >= 0) || !(m.orientation_stiffness >= 0) || !(m.limit_stiffness >= 0))
      refuse("a stiffness is negative or NaN, expected >= 0");
    if (!(m.flexion_range[0] <= 0 && m.flexion_range[1] >= 0)) refuse("flexion_range: expected min <= 0 <= max");
    if (!(m.abduction_range[0] <= 0 && m.abduction_range[1] >= 0)) refuse("abduction_range: expected min <= 0 <= max");
    const AxisLaw held{m.orientation_stiffness, 0, 0};
    const AxisLaw loose{0, -kUnlimited, kUnlimited};
    const AxisLaw flexion{m.limit_stiffness, m.flexion_range[0], m.flexion_range[1]};
    const AxisLaw abduction{m.limit_stiffness, m.abduction_range[0], m.abduction_range[1]};
    JointData joint;
    joint.site = site;
    switch (m.kind) {
      case JointKind::free:
        joint.axes = {loose, loose, loose};
        break;
      case JointKind::ball:
        joint.axes = {held, held, held};
        break;
      case JointKind::saddle:
        joint.axes = {flexion, abduction, held};
        break;
      case JointKind::hinge:
        joint.axes = {flexion, held, held};
        break;
    }
    joint.blocks = Clique<4>({layout.body_translation_block(site.parent), layout.body_rotation_block(site.parent),
                              layout.body_translation_block(site.child), layout.body_rotation_block(site.child)});
    joints_.push_back(joint);
  }
}

JointEnergy::Response JointEnergy::AxisLaw::at(double angle) const {
  const double outside = angle > maximum ? angle - maximum : angle < minimum ? angle - minimum : 0.0;
  if (minimum == maximum) return {0.5 * stiffness * outside * outside, stiffness * outside, stiffness};
  const double depth = std::abs(outside), x = depth / kRamp;
  if (x < 1) {
    return {stiffness * depth * depth * (2.0 / 3 - x / 4) * x, stiffness * outside * (2 - x) * x,
            stiffness * (4 - 3 * x) * x};
  }
  return {stiffness * (0.5 * depth * depth - kRamp * kRamp / 12), stiffness * outside, stiffness};
}

Vector3 JointEnergy::angles(int joint, const State& state) const { return geometry_of(site(joint), state).angles; }

int JointEnergy::needed_bodies() const {
  int bodies = 0;
  for (const JointData& joint : joints_) bodies = std::max({bodies, joint.site.parent + 1, joint.site.child + 1});
  return bodies;
}

void JointEnergy::add_pattern(BlockPattern& pattern) const {
  for (const JointData& joint : joints_) joint.blocks.add_pattern(pattern);
}

void JointEnergy::bind(const BlockMatrix& matrix) {
  for (JointData& joint : joints_) joint.blocks.bind(matrix);
}

double JointEnergy::value(const State& state) const {
  double energy = 0;
  for (const JointData& joint : joints_) {
    const JointGeometry g = geometry_of(joint.site, state);
    energy += 0.5 * joint.site.model.position_stiffness * g.gap.squaredNorm();
    for (int i = 0; i < 3; ++i) {
      energy += joint.axes[static_cast<std::size_t>(i)].at(g.angles[i]).energy;
    }
  }
  return energy;
}

double JointEnergy::add_gradient(const State& state, VectorX& gradient) const {
  double energy = 0;
  for (const JointData& joint : joints_) {
    const JointGeometry g = geometry_of(joint.site, state);
    Vector3 moment;  // dU/dphi
    for (int i = 0; i < 3; ++i) {
      const Response response = joint.axes[static_cast<std::size_t>(i)].at(g.angles[i]);
      moment[i] = response.moment;
      energy += response.energy;
    }
    // The derivative of phi is J^-1 Q_a^T (w_child - w_parent).
    const Vector3 torque = g.parent_frame * left_jacobian_inverse_transpose(g.angles, moment);
    const Vector3 pull = joint.site.model.position_stiffness * g.gap;
    energy += 0.5 * pull.dot(g.gap);
    Clique<4>::Gradient local;
    local << pull, g.parent_arm.cross(pull) - torque, -pull, torque - g.child_arm.cross(pull);
    joint.blocks.add(gradient, local);
  }
  return energy;
}

void JointEnergy::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  for (const JointData& joint : joints_) {
    const JointGeometry g = geometry_of(joint.site, state);
    const double k = joint.site.model.position_stiffness;
    Vector3 moment, stiffness;
    for (int i = 0; i < 3; ++i) {
      const Response response = joint.axes[static_cast<std::size_t>(i)].at(g.angles[i]);
      moment[i] = response.moment;
      stiffness[i] = response.stiffness;
    }
    const Matrix3 frame = g.parent_frame.toRotationMatrix();
    const Matrix3 jacobian = left_jacobian_inverse(g.angles);
    Matrix3 core = jacobian.transpose() * stiffness.asDiagonal() * jacobian;
    if (curvature == Curvature::exact) core += log_second_derivative(g.angles, moment);
    const Matrix3 turn = frame * core * frame.transpose();

    // The gap's Jacobian: [I, -[arm_a], -I, [arm_b]].
    const Matrix3 parent_lever = -skew(g.parent_arm);
    const Matrix3 child_lever = skew(g.child_arm);
    Clique<4>::Hessian local;
    local.block<3, 3>(0, 0) = k * Matrix3::Identity();
    local.block<3, 3>(3, 0) = k * parent_lever.transpose();
    local.block<3, 3>(3, 3) = k * parent_lever.transpose() * parent_lever + turn;
    local.block<3, 3>(6, 0) = -k * Matrix3::Identity();
    local.block<3, 3>(6, 3) = -k * parent_lever;
    local.block<3, 3>(6, 6) = k * Matrix3::Identity();
    local.block<3, 3>(9, 0) = k * child_lever.transpose();
    local.block<3, 3>(9, 3) = k * child_lever.transpose() * parent_lever - turn;
    local.block<3, 3>(9, 6) = -k * child_lever.transpose();
    local.block<3, 3>(9, 9) = k * child_lever.transpose() * child_lever + turn;
    if (curvature == Curvature::exact) {
      const Vector3 pull = k * g.gap;
      local.block<3, 3>(3, 3) += rotated_arm_second_derivative(g.parent_arm, pull);
      local.block<3, 3>(9, 9) -= rotated_arm_second_derivative(g.child_arm, pull);
      // exp(-w_a) exp(w_b) = exp(w_b - w_a - (w_a x w_b)/2 + ...): contribution of the torque to the mixed derivative.
      const Vector3 torque = frame * (jacobian.transpose() * moment);
      local.block<3, 3>(9, 3) -= 0.5 * skew(torque);
    }
    joint.blocks.add(hessian, local);
  }
}

}  // namespace softhand
