#include "energies/object_joint.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

#include "math/rotation.hpp"

namespace softhand {
namespace {

constexpr double kHoldRatio = 1000;             // s, least stiffness over m/dt^2
constexpr double kLeastJointStiffness = 100e3;  // N/m
constexpr double kStickRatio = 100;             // k_f over m/dt^2
constexpr double kPreSlide = 1e-4;              // m
constexpr double kPreTurn = 2e-3;               // rad
constexpr double kAtStart = 1e-12;              // m or rad, a coordinate that moved less is at the step's start

// Gradient and Hessian of one joint, or null pointers. Blocks 0..3: parent translation and rotation, child translation
// and rotation.
struct Sink {
  Eigen::Matrix<double, 12, 1>* gradient = nullptr;
  Eigen::Matrix<double, 12, 12>* hessian = nullptr;
  bool exact = false;

  void add_block(int row, int column, const Matrix3& block) const {
    hessian->block<3, 3>(3 * row, 3 * column) += block;
    if (row != column) hessian->block<3, 3>(3 * column, 3 * row) += block.transpose();
  }
};

Eigen::Matrix<double, 12, 1> stacked(const JointRow& row) {
  Eigen::Matrix<double, 12, 1> j;
  j << row.parent_linear, row.parent_angular, row.child_linear, row.child_angular;
  return j;
}

// Adds `slope` times the second derivative of an offset.
void bend_offset(const Sink& sink, const JointPose& pose, int axis, double slope) {
  const Vector3 a = pose.parent_frame * Vector3(Vector3::Unit(axis));
  const Matrix3 cross = slope * skew(a);
  sink.add_block(1, 1, slope * rotated_arm_second_derivative(a, pose.lever));
  sink.add_block(3, 3, slope * rotated_arm_second_derivative(pose.child_arm, a));
  sink.add_block(1, 0, -cross);
  sink.add_block(2, 1, -cross);
  sink.add_block(3, 1, -skew(pose.child_arm) * cross);
}

// Adds `slope` times the second derivative of the twist.
void bend_twist(const Sink& sink, const JointPose& pose, const JointRow& twist, double slope) {
  const Matrix3 frame = pose.parent_frame.toRotationMatrix();
  const Matrix3 bend = slope * frame * pose.twist_second_derivative() * frame.transpose();
  sink.add_block(1, 1, bend);
  sink.add_block(3, 3, bend);
  sink.add_block(3, 1, -bend - 0.5 * slope * skew(twist.child_angular));
}

// Adds a term whose derivatives by one scalar are `slope` and `curvature`.
void add_scalar(const Sink& sink, const JointRow& row, double slope, double curvature) {
  const auto j = stacked(row);
  if (sink.gradient != nullptr) *sink.gradient += slope * j;
  if (sink.hessian != nullptr) {
    if (!sink.exact) curvature = std::max(curvature, 0.0);
    if (curvature != 0) *sink.hessian += curvature * j * j.transpose();
  }
}

// f = weight * sum over axes of (1 - a.b) for unit vectors a of the parent and b of the child.
struct AxisDistance {
  double f = 0;
  Eigen::Matrix<double, 6, 1> gradient = Eigen::Matrix<double, 6, 1>::Zero();   // parent rotation, child rotation
  Eigen::Matrix<double, 6, 6> hessian = Eigen::Matrix<double, 6, 6>::Zero();    // Gauss-Newton
  Eigen::Matrix<double, 6, 6> remainder = Eigen::Matrix<double, 6, 6>::Zero();  // exact minus Gauss-Newton

  void add(const Vector3& a, const Vector3& b, double weight) {
    // |a - b|^2/2 = 1 - a.b loses no digits near zero.
    f += 0.5 * weight * (a - b).squaredNorm();
    const Vector3 torque = weight * a.cross(b);
    gradient.head<3>() -= torque;
    gradient.tail<3>() += torque;
    const Matrix3 cross_a = skew(a), cross_b = skew(b);
    hessian.topLeftCorner<3, 3>() -= weight * cross_a * cross_a;
    hessian.bottomRightCorner<3, 3>() -= weight * cross_b * cross_b;
    hessian.topRightCorner<3, 3>() += weight * cross_a * cross_b;
    hessian.bottomLeftCorner<3, 3>() += weight * cross_b * cross_a;
    remainder.topLeftCorner<3, 3>() += weight * (rotated_arm_second_derivative(a, -b) + cross_a * cross_a);
    remainder.bottomRightCorner<3, 3>() += weight * (rotated_arm_second_derivative(b, -a) + cross_b * cross_b);
  }
};

// Distance between the frames' axes: only +y, or all three with half the weight: 1 - cos of the angle in both cases.
AxisDistance axis_distance(const Quaternion& parent, const Quaternion& child, bool only_y) {
  AxisDistance distance;
  for (int axis = only_y ? 1 : 0; axis < (only_y ? 2 : 3); ++axis)
    distance.add(parent * Vector3(Vector3::Unit(axis)), child * Vector3(Vector3::Unit(axis)), only_y ? 1 : 0.5);
  return distance;
}

// Adds k f.
void add_axes(const Sink& sink, const AxisDistance& distance, double stiffness) {
  if (sink.gradient != nullptr) {
    sink.gradient->segment<3>(3) += stiffness * distance.gradient.head<3>();
    sink.gradient->segment<3>(9) += stiffness * distance.gradient.tail<3>();
  }
  if (sink.hessian != nullptr) {
    const Eigen::Matrix<double, 6, 6> h =
        stiffness * (sink.exact ? (distance.hessian + distance.remainder).eval() : distance.hessian);
    sink.add_block(1, 1, h.topLeftCorner<3, 3>());
    sink.add_block(3, 3, h.bottomRightCorner<3, 3>());
    sink.add_block(3, 1, h.bottomLeftCorner<3, 3>());
  }
}

// Adds h(s) of the chord s = sqrt(2 f) > 0, with `secant` = h'/s and `curvature` = h''.
void add_chord(const Sink& sink, const AxisDistance& distance, double secant, double curvature) {
  AxisDistance scaled = distance;
  const double square = 2 * distance.f;
  if (square > 0)
    scaled.hessian += (curvature / secant - 1) / square * distance.gradient * distance.gradient.transpose();
  add_axes(sink, scaled, secant);
}

double chord_of(double angle) { return 2 * std::sin(0.5 * std::min(angle, std::numbers::pi)); }

double excess(double q, const JointLaw& law) {
  return q > law.maximum ? q - law.maximum : q < law.minimum ? q - law.minimum : 0.0;
}

bool holds_one_axis(ObjectJointKind kind) { return kind == ObjectJointKind::hinge || kind == ObjectJointKind::screw; }

// What the steps left. The motion of a prescribed parent stays: the caller set it.
void forget(ObjectJointEnergy::Memory::Joint& joint) {
  joint = {.parent = joint.parent, .parent_velocity = joint.parent_velocity};
}

}  // namespace

ObjectJointEnergy::ObjectJointEnergy(DofLayout layout, int first_body, int bodies, int places)
    : layout_(layout),
      first_body_(first_body),
      bodies_(bodies),
      joints_(static_cast<std::size_t>(places)),
      slots_(static_cast<std::size_t>(bodies * (2 * bodies + 1))),
      wrenches_(static_cast<std::size_t>(bodies)) {
  memory_.joints.resize(joints_.size());
}

void ObjectJointEnergy::set_joint(int place, const ObjectJoint& joint) {
  check_joint_law(joint.law);
  const auto is_body = [this](int body) { return body >= first_body_ && body < first_body_ + bodies_; };
  if (!is_body(joint.child) || (joint.parent >= 0 && !is_body(joint.parent)) || joint.parent == joint.child)
    throw std::invalid_argument("object joint: parent " + std::to_string(joint.parent) + " and child " +
                                std::to_string(joint.child) + " are not two movable bodies");
  if (!(joint.child_mass > 0) || (joint.parent >= 0 && !(joint.parent_mass > 0)))
    throw std::invalid_argument("object joint: a mass is not above 0");
  Joint& j = at(place);
  j = {};
  j.set = true;
  j.model = joint;
  forget(memory_.joints[static_cast<std::size_t>(place)]);
}

void ObjectJointEnergy::clear_joint(int place) {
  at(place).set = false;
  forget(memory_.joints[static_cast<std::size_t>(place)]);
}

void ObjectJointEnergy::set_parent_motion(int place, const Pose& pose, const Twist& velocity) {
  memory_.joints[static_cast<std::size_t>(place)].parent = pose;
  memory_.joints[static_cast<std::size_t>(place)].parent_velocity = velocity;
}

void ObjectJointEnergy::load(const Memory& memory) {
  if (memory.joints.size() != joints_.size())
    throw std::invalid_argument("object joint: the memory has " + std::to_string(memory.joints.size()) +
                                " places, expected " + std::to_string(joints_.size()));
  memory_ = memory;
}

void ObjectJointEnergy::reset() {
  for (Memory::Joint& joint : memory_.joints) forget(joint);
}

JointPose ObjectJointEnergy::pose_of(const Joint& joint, const State& state, const Pose& prescribed) const {
  const ObjectJoint& model = joint.model;
  return {model.parent < 0 ? prescribed : state.body_poses[static_cast<std::size_t>(model.parent)],
          state.body_poses[static_cast<std::size_t>(model.child)], model.parent_from_joint, model.child_from_joint};
}

double ObjectJointEnergy::coordinate(const Joint& joint, const Memory::Joint& memory, const JointPose& pose) {
  const JointLaw& law = joint.model.law;
  return memory.stepped ? joint_coordinate(law, pose, memory.coordinate) : joint_coordinate(law, pose);
}

double ObjectJointEnergy::coordinate(int place, const State& state) const {
  const Joint& joint = at(place);
  const Memory::Joint& memory = memory_.joints[static_cast<std::size_t>(place)];
  return joint.set ? coordinate(joint, memory, pose_of(joint, state, memory.parent)) : 0;
}

double ObjectJointEnergy::gap(int place, const State& state) const {
  const Joint& joint = at(place);
  if (!joint.set) return 0;
  const Memory::Joint& memory = memory_.joints[static_cast<std::size_t>(place)];
  const JointPose pose = pose_of(joint, state, memory.parent);
  return held_gap(joint.model.law, pose, coordinate(joint, memory, pose));
}

double ObjectJointEnergy::misalignment(int place, const State& state) const {
  const Joint& joint = at(place);
  if (!joint.set || joint.model.law.kind == ObjectJointKind::ball) return 0;
  const JointPose pose = pose_of(joint, state, memory_.joints[static_cast<std::size_t>(place)].parent);
  const double f = axis_distance(pose.parent_frame, pose.child_frame, holds_one_axis(joint.model.law.kind)).f;
  return 2 * std::asin(std::min(1.0, std::sqrt(0.5 * f)));
}

void ObjectJointEnergy::add_pattern(BlockPattern& pattern) const {
  for (int row = 0; row < 2 * bodies_; ++row) {
    for (int column = 0; column <= row; ++column)
      pattern.add(layout_.body_translation_block(first_body_) + row,
                  layout_.body_translation_block(first_body_) + column);
  }
}

void ObjectJointEnergy::bind(const BlockMatrix& matrix) {
  const int first = layout_.body_translation_block(first_body_);
  for (int row = 0; row < 2 * bodies_; ++row) {
    for (int column = 0; column <= row; ++column) slot(row, column) = matrix.find(first + row, first + column);
  }
}

double ObjectJointEnergy::friction_stretch(const Joint& joint, const JointPose& pose) const {
  if (joint.model.law.kind == ObjectJointKind::ball)
    return std::sqrt(2 * axis_distance(pose.parent_frame, pose.child_frame * joint.anchor_turn.conjugate(), false).f);
  return joint_row(joint.model.law, pose, joint.start).value - joint.anchor;
}

void ObjectJointEnergy::set_friction(Joint& joint, const Memory::Joint& memory, const JointPose& pose,
                                     double least_stiffness) const {
  const JointLaw& law = joint.model.law;
  CoulombSpring& friction = joint.friction;
  friction.bound = law.friction_at(memory.reaction);
  friction.stiffness =
      std::max(least_stiffness, friction.bound / (law.kind == ObjectJointKind::slider ? kPreSlide : kPreTurn));
  joint.anchor = memory.anchored ? memory.anchor : joint.start;
  joint.anchor_turn = memory.anchored ? memory.anchor_turn : pose.relative;
  // The coordinate of a hinge has no memory of turns.
  if (law.kind == ObjectJointKind::hinge)
    joint.anchor = joint.start - std::remainder(joint.start - joint.anchor, 2 * std::numbers::pi);
  if (!memory.anchored || law.load_friction == 0 || friction.stiffness == memory.friction_stiffness) return;
  const double kept = memory.friction_stiffness / friction.stiffness;  // of the stretch
  joint.anchor = joint.start - kept * (joint.start - joint.anchor);
  joint.anchor_turn =
      (rotation_exp(-kept * rotation_log(pose.relative * joint.anchor_turn.conjugate())) * pose.relative).normalized();
}

void ObjectJointEnergy::begin_step(const State& state, double time_step) {
  time_step_ = time_step;
  before_ = memory_.stored;
  start_energy_ = 0;
  const double square = time_step * time_step;
  for (std::size_t place = 0; place < joints_.size(); ++place) {
    Joint& joint = joints_[place];
    if (!joint.set) continue;
    const ObjectJoint& model = joint.model;
    const JointLaw& law = model.law;
    const Memory::Joint& memory = memory_.joints[place];
    const Twist parent_velocity = memory.parent_velocity;
    const auto turning = [](double mass, const Matrix3& inertia, const Vector3& arm) {
      return inertia.trace() / 3 + mass * arm.squaredNorm();
    };
    double mass = 1 / model.child_mass;
    double inertia = 1 / turning(model.child_mass, model.child_inertia, model.child_from_joint.position);
    if (model.parent >= 0) {
      mass += 1 / model.parent_mass;
      inertia += 1 / turning(model.parent_mass, model.parent_inertia, model.parent_from_joint.position);
    }
    mass = 1 / mass;
    inertia = 1 / inertia;
    const double ratio = std::max(kHoldRatio, kLeastJointStiffness * square / mass);
    const bool slides = law.kind == ObjectJointKind::slider;
    joint.offset_stiffness = ratio * mass / square;
    joint.axis_stiffness = ratio * inertia / square;
    joint.limit_stiffness = slides ? joint.offset_stiffness : joint.axis_stiffness;
    joint.damping = law.damping / time_step;

    const JointPose pose = pose_of(joint, state, memory.parent);
    const Twist& of_parent =
        model.parent < 0 ? parent_velocity : state.body_velocities[static_cast<std::size_t>(model.parent)];
    joint.start = coordinate(joint, memory, pose);
    double rate = 0;
    if (law.has_coordinate()) {
      rate = joint_row(law, pose, joint.start)
                 .rate(of_parent, state.body_velocities[static_cast<std::size_t>(model.child)]);
    }
    set_friction(joint, memory, pose, kStickRatio * (slides ? mass : inertia) / square);
    joint.slides_on = memory.direction * rate > 0;
    joint.parent = memory.parent;
    start_energy_ += evaluate(joint, state, nullptr, nullptr, Curvature::exact);
    joint.parent = advanced(joint.parent, parent_velocity, time_step);
  }
}

double ObjectJointEnergy::evaluate(const Joint& joint, const State& state, Vector12* gradient, Matrix12* hessian,
                                   Curvature curvature) const {
  const JointLaw& law = joint.model.law;
  const JointPose pose = pose_of(joint, state, joint.parent);
  const Sink sink{gradient, hessian, curvature == Curvature::exact};
  const bool bends = hessian != nullptr && sink.exact;
  double energy = 0;

  JointRow q;
  if (law.has_coordinate()) q = joint_row(law, pose, joint.start);

  // Held offsets.
  for (int axis = 0; axis < 3; ++axis) {
    if (axis == 1 && law.kind == ObjectJointKind::slider) continue;
    JointRow offset = pose.offset(axis);
    double lead = 0;
    if (axis == 1 && law.kind == ObjectJointKind::screw) {
      lead = law.pitch / (2 * std::numbers::pi);
      JointRow thread = q;
      offset += thread *= -lead;
    }
    const double slope = joint.offset_stiffness * offset.value;
    energy += 0.5 * slope * offset.value;
    add_scalar(sink, offset, slope, joint.offset_stiffness);
    if (bends) {
      bend_offset(sink, pose, axis, slope);
      if (lead != 0) bend_twist(sink, pose, q, -lead * slope);
    }
  }

  if (law.kind != ObjectJointKind::ball) {
    const AxisDistance distance = axis_distance(pose.parent_frame, pose.child_frame, holds_one_axis(law.kind));
    energy += joint.axis_stiffness * distance.f;
    add_axes(sink, distance, joint.axis_stiffness);
  } else {
    if (law.stiffness > 0) {
      const AxisDistance distance = axis_distance(pose.parent_frame, pose.child_frame, false);
      energy += law.stiffness * distance.f;
      add_axes(sink, distance, law.stiffness);
    }
    if (law.limited()) {
      const AxisDistance distance = axis_distance(pose.parent_frame, pose.child_frame, true);
      const double chord = std::sqrt(2 * distance.f), outside = chord - chord_of(law.maximum);
      if (outside > 0) {
        energy += 0.5 * joint.limit_stiffness * outside * outside;
        add_chord(sink, distance, joint.limit_stiffness * outside / chord, joint.limit_stiffness);
      }
    }
    if (joint.friction.bound > 0) {
      const AxisDistance distance =
          axis_distance(pose.parent_frame, pose.child_frame * joint.anchor_turn.conjugate(), false);
      const double chord = std::sqrt(2 * distance.f), secant = joint.friction.secant(chord);
      energy += joint.friction.energy(chord);
      add_chord(sink, distance, secant, joint.friction.slides(chord) ? 0 : secant);
    }
  }
  if (!law.has_coordinate()) return energy;

  const JointLaw::Potential potential = law.potential(q.value);
  const double outside = excess(q.value, law);
  energy += potential.energy + 0.5 * joint.limit_stiffness * outside * outside;
  double slope = potential.slope + joint.limit_stiffness * outside;
  double bend = potential.curvature + (outside != 0 ? joint.limit_stiffness : 0.0);
  if (joint.friction.bound > 0) {
    const double stretch = q.value - joint.anchor, length = std::abs(stretch);
    energy += joint.friction.energy(length);
    slope += joint.friction.secant(length) * stretch;
    const bool slides_from_start = !sink.exact && joint.slides_on && std::abs(q.value - joint.start) < kAtStart;
    if (!joint.friction.slides(length) && !slides_from_start) bend += joint.friction.stiffness;
  }
  const double moved = q.value - joint.start;
  energy += 0.5 * joint.damping * moved * moved;
  slope += joint.damping * moved;
  bend += joint.damping;
  add_scalar(sink, q, slope, bend);
  if (bends) {
    if (law.kind == ObjectJointKind::slider) {
      bend_offset(sink, pose, 1, slope);
    } else {
      bend_twist(sink, pose, q, slope);
    }
  }
  return energy;
}

double ObjectJointEnergy::value(const State& state) const {
  double energy = 0;
  for (const Joint& joint : joints_) {
    if (joint.set) energy += evaluate(joint, state, nullptr, nullptr, Curvature::exact);
  }
  return energy;
}

double ObjectJointEnergy::add_gradient(const State& state, VectorX& gradient) const {
  double energy = 0;
  for (const Joint& joint : joints_) {
    if (!joint.set) continue;
    Vector12 local = Vector12::Zero();
    energy += evaluate(joint, state, &local, nullptr, Curvature::exact);
    if (joint.model.parent >= 0)
      gradient.segment<6>(3 * layout_.body_translation_block(joint.model.parent)) += local.head<6>();
    gradient.segment<6>(3 * layout_.body_translation_block(joint.model.child)) += local.tail<6>();
  }
  return energy;
}

void ObjectJointEnergy::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  for (const Joint& joint : joints_) {
    if (!joint.set) continue;
    Matrix12 local = Matrix12::Zero();
    evaluate(joint, state, nullptr, &local, curvature);
    const int parent = joint.model.parent < 0 ? -1 : 2 * (joint.model.parent - first_body_);
    const int child = 2 * (joint.model.child - first_body_);
    const std::array<int, 4> place{parent, parent < 0 ? -1 : parent + 1, child, child + 1};
    for (int row = 0; row < 4; ++row) {
      for (int column = 0; column < 4; ++column) {
        const int r = place[static_cast<std::size_t>(row)], c = place[static_cast<std::size_t>(column)];
        if (r < 0 || c < 0 || c > r) continue;
        hessian.add(slot(r, c), local.block<3, 3>(3 * row, 3 * column));
      }
    }
  }
}

void ObjectJointEnergy::end_step(State& state) {
  std::fill(wrenches_.begin(), wrenches_.end(), Wrench{});
  heat_ = parent_work_ = damper_ = 0;
  memory_.stored = 0;
  for (std::size_t place = 0; place < joints_.size(); ++place) {
    Joint& joint = joints_[place];
    if (!joint.set) continue;
    const ObjectJoint& model = joint.model;
    const JointLaw& law = model.law;
    Memory::Joint& memory = memory_.joints[place];
    const Pose before = memory.parent;
    Vector12 local = Vector12::Zero();
    const double energy = evaluate(joint, state, &local, nullptr, Curvature::exact);
    const auto add_wrench = [this](int body, const Vector3& force, const Vector3& torque) {
      Wrench& wrench = wrenches_[static_cast<std::size_t>(body - first_body_)];
      wrench.force -= force;
      wrench.torque -= torque;
    };
    if (model.parent >= 0) {
      add_wrench(model.parent, local.segment<3>(0), local.segment<3>(3));
    } else {
      parent_work_ += local.segment<3>(0).dot(joint.parent.position - before.position) +
                      local.segment<3>(3).dot(rotation_log(joint.parent.orientation * before.orientation.conjugate()));
    }
    add_wrench(model.child, local.segment<3>(6), local.segment<3>(9));
    memory.parent = joint.parent;

    const JointPose pose = pose_of(joint, state, joint.parent);
    double damper = 0, heat = 0;
    memory.direction = 0;
    memory.anchor = joint.anchor;
    memory.anchor_turn = joint.anchor_turn;
    memory.anchored = joint.friction.bound > 0;
    memory.friction_stiffness = law.load_friction > 0 ? joint.friction.stiffness : 0;
    memory.stepped = true;
    if (law.has_coordinate()) {
      memory.coordinate = joint_row(law, pose, joint.start).value;
      const double moved = memory.coordinate - joint.start;
      damper = 0.5 * joint.damping * moved * moved;
    }
    if (law.load_friction > 0) memory.reaction = joint.offset_stiffness * held_gap(law, pose, memory.coordinate);
    if (joint.friction.bound > 0) {
      const double stretch = friction_stretch(joint, pose);
      const double slide = joint.friction.slide(std::abs(stretch), joint.friction.bound);
      heat = joint.friction.bound * slide;
      if (slide > 0 && law.kind == ObjectJointKind::ball) {
        const Vector3 turn = rotation_log(pose.relative * joint.anchor_turn.conjugate());
        const double left = 2 * std::asin(0.5 * joint.friction.bound / joint.friction.stiffness);
        memory.anchor_turn = (rotation_exp(-left / turn.norm() * turn) * pose.relative).normalized();
      } else if (slide > 0) {
        memory.direction = stretch > 0 ? 1 : -1;
        memory.anchor += memory.direction * slide;
      }
    }
    memory_.stored += energy - damper - heat;
    heat_ += heat;
    damper_ += damper;
  }
}

EnergyFlow ObjectJointEnergy::flow(double, double end, double taken) const {
  // The stored energy went from `before_` by switches to `start_energy_`, and from there through the step.
  return {.stored = memory_.stored,
          .work = start_energy_ - before_ + parent_work_,
          .friction = heat_,
          .damping = 2 * damper_,
          .integrator = start_energy_ - end + taken + parent_work_ - damper_};
}

}  // namespace softhand
