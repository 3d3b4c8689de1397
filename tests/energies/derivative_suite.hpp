// Checks that every energy term must pass at any state. Derivatives agree with finite differences. The Hessian is
// symmetric, and the projected Hessian is positive semi-definite. The Hessian stays in the declared pattern. Internal
// forces balance.
//
// The second derivative is that of U(state (+) delta) at delta = 0. Here `(+)` is `apply_increment`. A term's gradient
// at state (+) delta is taken with respect to a *new* increment there. So for rotations it is pulled back to delta
// first: exp(delta + e) = exp(J_l(delta) e) exp(delta), hence dU/d(delta) = J_l(delta)^T g. Then the differences of the
// gradient are the symmetric second derivative. Without the pull-back they would be wrong by 1/2 [torque]x.
#pragma once

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "energies/energy.hpp"
#include "math/rotation.hpp"

namespace softhand::testing {

/// Seeded random state: nodes and bodies in a cube of +-`size` metres, any orientation, velocities up to `speed` m/s
/// and rad/s.
inline State random_state(DofLayout layout, std::uint64_t seed, double size = 0.1, double speed = 1.0) {
  std::mt19937_64 generator(seed);
  const auto uniform = [&generator] { return 2.0 * static_cast<double>(generator() >> 11) * 0x1p-53 - 1.0; };
  const auto vector = [&uniform](double scale) {
    const double x = uniform(), y = uniform(), z = uniform();
    return Vector3(scale * Vector3(x, y, z));
  };
  State state;
  state.node_positions.resize(3, layout.node_count);
  state.node_velocities.resize(3, layout.node_count);
  for (int n = 0; n < layout.node_count; ++n) {
    state.node_positions.col(n) = vector(size);
    state.node_velocities.col(n) = vector(speed);
  }
  for (int b = 0; b < layout.body_count; ++b) {
    Pose pose;
    pose.position = vector(size);
    const double x = uniform(), y = uniform(), z = uniform(), w = uniform();
    pose.orientation = Quaternion(w, x, y, z).normalized();
    state.body_poses.push_back(pose);
    Twist twist;
    twist.linear = vector(speed);
    twist.angular = vector(speed);
    state.body_velocities.push_back(twist);
  }
  return state;
}

/// `state` moved by a seeded random increment: nodes and translations up to `translation` metres, rotations up to
/// `rotation` radians.
inline State perturbed(const State& state, std::uint64_t seed, double translation, double rotation) {
  std::mt19937_64 generator(seed);
  const auto uniform = [&generator] { return 2.0 * static_cast<double>(generator() >> 11) * 0x1p-53 - 1.0; };
  const DofLayout layout = state.layout();
  VectorX direction(layout.dof_count());
  for (Eigen::Index i = 0; i < direction.size(); ++i) direction[i] = translation * uniform();
  for (int b = 0; b < layout.body_count; ++b)
    direction.segment<3>(3 * layout.body_rotation_block(b)) *= rotation / translation;
  State moved = state;
  apply_increment(moved, direction);
  return moved;
}

struct DerivativeCheck {
  double step = 1e-5;        ///< of the fourth-order central differences, metres and radians
  double tolerance = 1e-6;   ///< relative to the largest entry of the derivative
  bool expect_force = true;  ///< the gradient at this state must not vanish
};

/// Gradient by differences of the value, over all degrees of freedom.
inline VectorX difference_gradient(const Energy& term, const State& state, double step) {
  VectorX direction = VectorX::Zero(state.layout().dof_count());
  VectorX result = direction;
  const auto value_at = [&](Eigen::Index dof, double distance) {
    State moved = state;
    direction.setZero();
    direction[dof] = distance;
    apply_increment(moved, direction);
    return term.value(moved);
  };
  for (Eigen::Index dof = 0; dof < result.size(); ++dof) {
    result[dof] =
        (8.0 * (value_at(dof, step) - value_at(dof, -step)) - (value_at(dof, 2 * step) - value_at(dof, -2 * step))) /
        (12.0 * step);
  }
  return result;
}

/// Second derivative by differences of the gradient, pulled back to the increment at `state`.
inline Eigen::MatrixXd difference_hessian(const Energy& term, const State& state, double step) {
  const DofLayout layout = state.layout();
  const Eigen::Index size = layout.dof_count();
  const auto gradient_at = [&](Eigen::Index dof, double distance) {
    State moved = state;
    VectorX direction = VectorX::Zero(size);
    direction[dof] = distance;
    apply_increment(moved, direction);
    VectorX gradient = VectorX::Zero(size);
    term.add_gradient(moved, gradient);
    const Eigen::Index block = dof / 3;
    if (block >= layout.node_count && (block - layout.node_count) % 2 == 1) {
      const Matrix3 jacobian = left_jacobian_inverse(direction.segment<3>(3 * block)).inverse();
      gradient.segment<3>(3 * block) = (jacobian.transpose() * gradient.segment<3>(3 * block)).eval();
    }
    return gradient;
  };
  Eigen::MatrixXd result(size, size);
  for (Eigen::Index dof = 0; dof < size; ++dof) {
    result.col(dof) = (8.0 * (gradient_at(dof, step) - gradient_at(dof, -step)) -
                       (gradient_at(dof, 2 * step) - gradient_at(dof, -2 * step))) /
                      (12.0 * step);
  }
  return result;
}

/// Returns a matrix with the term's own pattern. Binds the term to it.
inline BlockMatrix bound_matrix(Energy& term, const State& state) {
  BlockPattern pattern(state.layout().block_count());
  term.add_pattern(pattern);
  BlockMatrix matrix(pattern);
  term.bind(matrix);
  return matrix;
}

/// Checks the term's derivatives at `state`, in a step that began at `start`. Afterwards the term is still in this step
/// and bound to a matrix of its own pattern.
inline void check_term(Energy& term, const State& start, double time_step, const State& state,
                       const DerivativeCheck& check = {}) {
  SCOPED_TRACE(std::string(term.name()));
  const DofLayout layout = state.layout();
  const Eigen::Index size = layout.dof_count();

  // The first matrix has every block, so that the term must look up its slots. The second one has the term's own
  // pattern.
  Eigen::MatrixXd exact_in_full;
  {
    BlockPattern full(layout.block_count());
    for (int row = 0; row < layout.block_count(); ++row) {
      for (int column = 0; column <= row; ++column) full.add(row, column);
    }
    BlockMatrix matrix(full);
    term.bind(matrix);
    term.begin_step(start, time_step);
    term.add_hessian(state, matrix, Curvature::exact);
    exact_in_full = matrix.dense();
  }
  BlockMatrix matrix = bound_matrix(term, state);
  term.begin_step(start, time_step);

  const double value = term.value(state);
  ASSERT_TRUE(std::isfinite(value));
  EXPECT_EQ(value, term.value(state)) << "the value is not a fixed function within the step";

  VectorX gradient = VectorX::Zero(size);
  term.add_gradient(state, gradient);
  ASSERT_TRUE(gradient.allFinite());
  const double force = gradient.lpNorm<Eigen::Infinity>();
  EXPECT_TRUE(force > 0 || !check.expect_force) << "the gradient is zero: nothing is tested";
  const double rounding = 1e-14 * std::abs(value) / check.step;
  const VectorX expected_gradient = difference_gradient(term, state, check.step);
  EXPECT_LE((gradient - expected_gradient).lpNorm<Eigen::Infinity>(), check.tolerance * force + rounding)
      << "gradient against differences of the value";

  matrix.set_zero();
  term.add_hessian(state, matrix, Curvature::exact);
  const Eigen::MatrixXd exact = matrix.dense();
  ASSERT_TRUE(exact.allFinite());
  const double stiffness = exact.lpNorm<Eigen::Infinity>();
  EXPECT_GT(stiffness, 0) << "the Hessian is zero: nothing is tested";
  EXPECT_LE((exact - exact_in_full).lpNorm<Eigen::Infinity>(), 1e-12 * stiffness)
      << "the Hessian depends on the matrix it is scattered into";
  EXPECT_LE((exact - exact.transpose()).lpNorm<Eigen::Infinity>(), 1e-12 * stiffness) << "asymmetric";
  const Eigen::MatrixXd expected_hessian = difference_hessian(term, state, check.step);
  EXPECT_LE((exact - expected_hessian).lpNorm<Eigen::Infinity>(), check.tolerance * stiffness)
      << "exact Hessian against differences of the gradient";

  matrix.set_zero();
  term.add_hessian(state, matrix, Curvature::projected);
  const Eigen::MatrixXd projected = matrix.dense();
  ASSERT_TRUE(projected.allFinite());
  EXPECT_LE((projected - projected.transpose()).lpNorm<Eigen::Infinity>(), 1e-12 * projected.lpNorm<Eigen::Infinity>())
      << "asymmetric";
  const double lowest =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(projected, Eigen::EigenvaluesOnly).eigenvalues().minCoeff();
  EXPECT_GE(lowest, -1e-9 * projected.norm()) << "the projected Hessian is indefinite";
  EXPECT_GT(projected.norm(), 0);

  // add_all does all three at once. It adds: it must neither clear nor assign.
  for (const Curvature curvature : {Curvature::exact, Curvature::projected}) {
    matrix.set_zero();
    VectorX together = VectorX::Constant(size, force);
    term.add_hessian(state, matrix, curvature);
    EXPECT_NEAR(term.add_all(state, together, matrix, curvature), value, 1e-10 * std::abs(value));
    const Eigen::MatrixXd& once = curvature == Curvature::exact ? exact : projected;
    EXPECT_LE((matrix.dense() - 2.0 * once).lpNorm<Eigen::Infinity>(), 1e-10 * once.lpNorm<Eigen::Infinity>())
        << "add_all, Hessian";
    EXPECT_LE((together - gradient - VectorX::Constant(size, force)).lpNorm<Eigen::Infinity>(), 1e-10 * force)
        << "add_all, gradient";
  }
  VectorX together = VectorX::Constant(size, force);
  EXPECT_NEAR(term.add_gradient(state, together), value, 1e-10 * std::abs(value));
  EXPECT_LE((together - gradient - VectorX::Constant(size, force)).lpNorm<Eigen::Infinity>(), 1e-10 * force)
      << "add_gradient";
}

/// The same with a step that begins at the state itself.
inline void check_term(Energy& term, const State& state, double time_step, const DerivativeCheck& check = {}) {
  check_term(term, state, time_step, state, check);
}

/// Internal terms exert no net force and no net torque: sum f = 0, sum (x cross f + torque) = 0. The state may be far
/// from rest. The tolerance is relative to the sum of magnitudes. Call this after `begin_step`.
inline void check_balance(const Energy& term, const State& state, double tolerance = 1e-9) {
  SCOPED_TRACE(std::string(term.name()));
  const DofLayout layout = state.layout();
  VectorX gradient = VectorX::Zero(layout.dof_count());
  term.add_gradient(state, gradient);
  Vector3 force = Vector3::Zero(), torque = Vector3::Zero();
  double force_scale = 0, torque_scale = 0;
  const auto add = [&](const Vector3& point, const Vector3& f) {
    force += f;
    torque += point.cross(f);
    force_scale += f.norm();
    torque_scale += point.norm() * f.norm();
  };
  for (int n = 0; n < layout.node_count; ++n)
    add(state.node_positions.col(n), gradient.segment<3>(3 * layout.node_block(n)));
  for (int b = 0; b < layout.body_count; ++b) {
    add(state.body_poses[static_cast<std::size_t>(b)].position,
        gradient.segment<3>(3 * layout.body_translation_block(b)));
    const Vector3 own = gradient.segment<3>(3 * layout.body_rotation_block(b));
    torque += own;
    torque_scale += own.norm();
  }
  EXPECT_GT(force_scale + torque_scale, 0) << "no force at all: nothing is tested";
  EXPECT_LE(force.norm(), tolerance * force_scale);
  EXPECT_LE(torque.norm(), tolerance * torque_scale);
}

/// A rigid motion of the whole state costs no energy: the value is the same, and the gradient turns with the state.
inline void check_rigid_motion(const Energy& term, const State& state, const Pose& motion, double tolerance = 1e-9) {
  SCOPED_TRACE(std::string(term.name()));
  State moved = state;
  const DofLayout layout = state.layout();
  for (int n = 0; n < layout.node_count; ++n)
    moved.node_positions.col(n) = motion * Vector3(state.node_positions.col(n));
  for (std::size_t b = 0; b < moved.body_poses.size(); ++b) moved.body_poses[b] = motion * state.body_poses[b];
  VectorX before = VectorX::Zero(layout.dof_count()), after = before;
  term.add_gradient(state, before);
  term.add_gradient(moved, after);
  for (int block = 0; block < layout.block_count(); ++block) {
    before.segment<3>(3 * block) = (motion.orientation * Vector3(before.segment<3>(3 * block))).eval();
  }
  EXPECT_NEAR(term.value(moved), term.value(state), tolerance * std::abs(term.value(state)));
  EXPECT_LE((after - before).lpNorm<Eigen::Infinity>(), tolerance * before.lpNorm<Eigen::Infinity>());
}

/// `add_around` of some nodes gives their part of gradient and projected Hessian. Returns its result.
inline Energy::Around check_around(Energy& term, const State& state, const std::vector<std::int32_t>& nodes) {
  SCOPED_TRACE(std::string(term.name()));
  BlockMatrix matrix = bound_matrix(term, state);
  VectorX part = VectorX::Zero(3 * static_cast<Eigen::Index>(nodes.size()));
  VectorX whole = VectorX::Zero(state.layout().dof_count());
  std::vector<double> blocks(9 * (nodes.size() * (nodes.size() + 1) / 2 + 1), 0.0);
  const Energy::Around around = term.add_around(nodes, state, part.data(), blocks.data());
  term.add_gradient(state, whole);
  term.add_hessian(state, matrix, Curvature::projected);
  const Eigen::MatrixXd dense = matrix.dense();
  const double* block = blocks.data();
  for (std::size_t j = 0; j < nodes.size(); ++j) {
    EXPECT_LE((part.segment<3>(3 * static_cast<int>(j)) - whole.segment<3>(3 * nodes[j])).norm(), 1e-13 * whole.norm());
    for (std::size_t i = 0; i <= j; ++i, block += 9) {
      const Matrix3 expected = dense.block<3, 3>(3 * nodes[j], 3 * nodes[i]);
      EXPECT_LE((Eigen::Map<const Matrix3>(block) - expected).norm(), 1e-13 * dense.norm()) << j << ' ' << i;
    }
  }
  return around;
}

}  // namespace softhand::testing
