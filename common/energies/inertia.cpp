#include "energies/inertia.hpp"

#include <cmath>
#include <stdexcept>
#include <utility>

#include "math/rotation.hpp"

namespace softhand {
namespace {

constexpr double kHeldStiffness = 1e9;         // N/m: 10 N move a held body by 10 nm within the step
constexpr double kHeldAngularStiffness = 1e7;  // N m/rad
constexpr double kLargestTurn = 3.0;           // rad per step
constexpr int kMidpointIterations = 25;        // slow bodies need a few; the limit is for a radian per step and more

Matrix3 in_world(const Matrix3& inertia, const Quaternion& orientation) {
  const Matrix3 r = orientation.toRotationMatrix();
  return r * inertia * r.transpose();
}

Vector3 turn_from(const Pose& start, const Pose& now) {
  return rotation_log(now.orientation * start.orientation.conjugate());
}

}  // namespace

Inertia::Inertia(std::vector<double> node_masses, int body_count)
    : node_masses_(std::move(node_masses)), bodies_(static_cast<std::size_t>(body_count)) {
  for (std::size_t n = 0; n < node_masses_.size(); ++n) {
    if (!(node_masses_[n] > 0) || !std::isfinite(node_masses_[n])) {
      throw std::invalid_argument("Inertia: the mass of node " + std::to_string(n) + " is " +
                                  std::to_string(node_masses_[n]) + ", expected a finite number > 0");
    }
  }
  const auto nodes = static_cast<Eigen::Index>(node_masses_.size());
  node_gravity_ = node_start_ = node_target_ = Eigen::Matrix3Xd::Zero(3, nodes);
}

void Inertia::set_node_gravity(const Vector3& gravity) { node_gravity_.colwise() = gravity; }

void Inertia::set_dynamic(int body, double mass, const Matrix3& inertia, const Vector3& gravity) {
  BodyInertia& b = bodies_[static_cast<std::size_t>(body)];
  b.dynamic = true;
  b.mass = mass;
  b.inertia = inertia;
  b.gravity = gravity;
}

void Inertia::hold(int body) { bodies_[static_cast<std::size_t>(body)].dynamic = false; }

double Inertia::kinetic_energy(const State& state) const {
  double energy = 0;
  for (std::size_t n = 0; n < node_masses_.size(); ++n) {
    energy += 0.5 * node_masses_[n] * state.node_velocities.col(static_cast<Eigen::Index>(n)).squaredNorm();
  }
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    if (!bodies_[b].dynamic) continue;
    const Twist& velocity = state.body_velocities[b];
    const Vector3 local = state.body_poses[b].orientation.conjugate() * velocity.angular;
    energy += 0.5 * bodies_[b].mass * velocity.linear.squaredNorm() + 0.5 * local.dot(bodies_[b].inertia * local);
  }
  return energy;
}

void Inertia::bind(const BlockMatrix& matrix) {
  diagonal_.resize(node_masses_.size() + 2 * bodies_.size());
  for (std::size_t block = 0; block < diagonal_.size(); ++block) {
    diagonal_[block] = matrix.find(static_cast<int>(block), static_cast<int>(block));
  }
}

void Inertia::begin_step(const State& state, double time_step) {
  time_step_ = time_step;
  start_energy_ = kinetic_energy(state);
  const double inverse_square = 1.0 / (time_step * time_step);
  node_start_ = state.node_positions;
  node_target_ = state.node_positions + time_step * state.node_velocities + time_step * time_step * node_gravity_;
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    BodyInertia& b = bodies_[i];
    b.start = state.body_poses[i];
    if (!b.dynamic) {
      b.position_target = b.start.position;
      b.turn_target.setZero();
      b.translation_weight = kHeldStiffness;
      b.rotation_weight = kHeldAngularStiffness * Matrix3::Identity();
      continue;
    }
    const Twist& velocity = state.body_velocities[i];
    b.position_target = b.start.position + time_step * velocity.linear + time_step * time_step * b.gravity;
    b.translation_weight = b.mass * inverse_square;
    const Vector3 momentum = in_world(b.inertia, b.start.orientation) * velocity.angular;
    b.spin_energy = 0.5 * velocity.angular.dot(momentum);
    // Implicit midpoint rule by fixed-point iteration: the rotation of free motion, computed with the inertia half way
    // along this rotation. Every iterate conserves the momentum, because weight and target use the same inertia.
    Matrix3 inertia_mid;
    Vector3 turn = time_step * velocity.angular;
    for (int iteration = 0; iteration < kMidpointIterations; ++iteration) {
      inertia_mid = in_world(b.inertia, rotation_exp(0.5 * turn) * b.start.orientation);
      const Vector3 next = time_step * inertia_mid.inverse() * momentum;
      const double change = (next - turn).norm();
      turn = next;
      const double angle = turn.norm();
      if (angle > kLargestTurn) turn *= kLargestTurn / angle;
      if (change < 1e-13) break;
    }
    b.turn_target = turn;
    b.rotation_weight = inertia_mid * inverse_square;
  }
}

double Inertia::value(const State& state) const {
  double energy = 0;
  for (std::size_t n = 0; n < node_masses_.size(); ++n) {
    const auto column = static_cast<Eigen::Index>(n);
    energy += node_masses_[n] * (state.node_positions.col(column) - node_target_.col(column)).squaredNorm();
  }
  energy *= 0.5 / (time_step_ * time_step_);
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    const BodyInertia& b = bodies_[i];
    const Vector3 off = turn_from(b.start, state.body_poses[i]) - b.turn_target;
    energy += 0.5 * b.translation_weight * (state.body_poses[i].position - b.position_target).squaredNorm() +
              0.5 * off.dot(b.rotation_weight * off);
  }
  return energy;
}

double Inertia::add_gradient(const State& state, VectorX& gradient) const {
  const DofLayout layout = state.layout();
  const double inverse_square = 1.0 / (time_step_ * time_step_);
  double twice_energy = 0;
  for (int n = 0; n < layout.node_count; ++n) {
    const Vector3 off = state.node_positions.col(n) - node_target_.col(n);
    const Vector3 force = node_masses_[static_cast<std::size_t>(n)] * inverse_square * off;
    gradient.segment<3>(3 * layout.node_block(n)) += force;
    twice_energy += force.dot(off);
  }
  for (int body = 0; body < layout.body_count; ++body) {
    const BodyInertia& b = bodies_[static_cast<std::size_t>(body)];
    const Pose& pose = state.body_poses[static_cast<std::size_t>(body)];
    const Vector3 off = pose.position - b.position_target;
    const Vector3 turn = turn_from(b.start, pose);
    const Vector3 turn_off = turn - b.turn_target;
    const Vector3 force = b.translation_weight * off;
    const Vector3 moment = b.rotation_weight * turn_off;
    gradient.segment<3>(3 * layout.body_translation_block(body)) += force;
    gradient.segment<3>(3 * layout.body_rotation_block(body)) += left_jacobian_inverse_transpose(turn, moment);
    twice_energy += force.dot(off) + moment.dot(turn_off);
  }
  return 0.5 * twice_energy;
}

void Inertia::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  const DofLayout layout = state.layout();
  const double inverse_square = 1.0 / (time_step_ * time_step_);
  for (int n = 0; n < layout.node_count; ++n) {
    hessian.add(diagonal_[static_cast<std::size_t>(layout.node_block(n))],
                node_masses_[static_cast<std::size_t>(n)] * inverse_square * Matrix3::Identity());
  }
  for (int body = 0; body < layout.body_count; ++body) {
    const BodyInertia& b = bodies_[static_cast<std::size_t>(body)];
    const Vector3 turn = turn_from(b.start, state.body_poses[static_cast<std::size_t>(body)]);
    const Matrix3 jacobian = left_jacobian_inverse(turn);
    Matrix3 rotation = jacobian.transpose() * b.rotation_weight * jacobian;
    if (curvature == Curvature::exact)
      rotation += log_second_derivative(turn, b.rotation_weight * (turn - b.turn_target));
    hessian.add(diagonal_[static_cast<std::size_t>(layout.body_translation_block(body))],
                b.translation_weight * Matrix3::Identity());
    hessian.add(diagonal_[static_cast<std::size_t>(layout.body_rotation_block(body))], rotation);
  }
}

void Inertia::end_step(State& state) {
  // Velocities that differ from the end of the last step were set from outside.
  EnergyFlow flow{.work = start_energy_ - memory_.stored};
  for (std::size_t n = 0; n < node_masses_.size(); ++n) {
    const auto column = static_cast<Eigen::Index>(n);
    const Vector3 moved = state.node_positions.col(column) - node_start_.col(column);
    const Vector3 velocity = moved / time_step_;
    flow.stored += 0.5 * node_masses_[n] * velocity.squaredNorm();
    flow.integrator += 0.5 * node_masses_[n] * (velocity - state.node_velocities.col(column)).squaredNorm();
    flow.work += node_masses_[n] * node_gravity_.col(column).dot(moved);
    state.node_velocities.col(column) = velocity;
  }
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    const BodyInertia& b = bodies_[i];
    Pose& pose = state.body_poses[i];
    if (!b.dynamic) {
      pose = advanced(b.start, state.body_velocities[i], time_step_);
      continue;
    }
    Twist& velocity = state.body_velocities[i];
    const Vector3 moved = pose.position - b.start.position;
    const Vector3 linear = moved / time_step_;
    const Vector3 turn = turn_from(b.start, pose);
    const Vector3 momentum = time_step_ * b.rotation_weight * turn;
    const Vector3 angular = in_world(b.inertia, pose.orientation).inverse() * momentum;
    const double spin_energy = 0.5 * angular.dot(momentum);
    flow.stored += 0.5 * b.mass * linear.squaredNorm() + spin_energy;
    flow.integrator += 0.5 * b.mass * (linear - velocity.linear).squaredNorm() +
                       (turn - b.turn_target).dot(b.rotation_weight * turn) - (spin_energy - b.spin_energy);
    flow.work += b.mass * b.gravity.dot(moved);
    velocity = {linear, angular};
  }
  flow_ = flow;
  memory_.stored = flow.stored;
}

}  // namespace softhand
