// Rotations and the block matrix: identities, finite differences, and difficult angles.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>

#include "math/block_matrix.hpp"
#include "math/rotation.hpp"

namespace softhand::math_test {
namespace {

// Deterministic directions: three along axes and ten pseudo-random ones.
std::vector<Vector3> directions() {
  std::mt19937_64 generator(1);
  const auto uniform = [&generator] { return 2.0 * static_cast<double>(generator() >> 11) * 0x1p-53 - 1.0; };
  std::vector<Vector3> result{Vector3::UnitX(), Vector3::UnitY(), -Vector3::UnitZ()};
  for (int i = 0; i < 10; ++i) {
    const double x = uniform(), y = uniform(), z = uniform();
    result.push_back(Vector3(x, y, z).normalized());
  }
  return result;
}

// Tiny angles, angles on both sides of the switch to the series at 0.05, and angles up to just below pi.
constexpr std::array kAngles{0.0, 1e-12, 1e-7, 1e-4, 0.0499, 0.0501, 0.3, 1.0, 2.0, 3.0, M_PI - 1e-3};

TEST(Rotation, LogInvertsExpUpToPi) {
  for (const Vector3& axis : directions()) {
    for (const double angle : kAngles) {
      const Vector3 v = angle * axis;
      EXPECT_LE((rotation_log(rotation_exp(v)) - v).norm(), 1e-15 + 1e-14 * angle) << angle;
      EXPECT_NEAR(rotation_exp(v).norm(), 1.0, 1e-15);
    }
    // Just below pi, the angle itself must stay accurate, not only its cosine.
    EXPECT_LE((rotation_log(rotation_exp((M_PI - 1e-9) * axis)) - (M_PI - 1e-9) * axis).norm(), 1e-14);
  }
}

TEST(Rotation, ExpIsTheRotationAboutTheAxis) {
  for (const Vector3& axis : directions()) {
    for (const double angle : kAngles) {
      EXPECT_LE(
          (rotation_exp(angle * axis).toRotationMatrix() - Eigen::AngleAxisd(angle, axis).toRotationMatrix()).norm(),
          1e-14);
    }
  }
}

TEST(Rotation, LogTakesTheShortestArcAndIgnoresTheQuaternionsSign) {
  for (const Vector3& axis : directions()) {
    for (const double angle : {0.1, 1.0, 3.0, M_PI, 4.0, 6.0}) {
      const Quaternion q = rotation_exp(angle * axis);
      const Quaternion negated(-q.w(), -q.x(), -q.y(), -q.z());
      EXPECT_EQ(rotation_log(q), rotation_log(negated));
      EXPECT_LE(rotation_log(q).norm(), M_PI + 1e-15);
      EXPECT_LE((rotation_exp(rotation_log(q)).toRotationMatrix() - q.toRotationMatrix()).norm(), 1e-14);
    }
  }
}

// Angles on both sides of the end of the series.
TEST(Rotation, LogOfASmallTurnIsExactToRounding) {
  for (const double angle : {1e-9, 1e-5, 1e-3, 0.01, 0.0199, 0.0201, 0.05}) {
    const Quaternion turn(std::cos(0.5 * angle), 0.6 * std::sin(0.5 * angle), 0, -0.8 * std::sin(0.5 * angle));
    EXPECT_NEAR((rotation_log(turn) - Vector3(0.6 * angle, 0, -0.8 * angle)).norm() / angle, 0, 4e-16) << angle;
  }
}

TEST(Rotation, LogAtExactlyPiHasAFixedAxis) {
  EXPECT_LE((rotation_log(Quaternion(0, 0, -1, 0)) - M_PI * Vector3::UnitY()).norm(), 1e-15);
  const Vector3 axis = Vector3(0.2, -0.9, 0.1).normalized();
  EXPECT_LE((rotation_log(Quaternion(0, axis.x(), axis.y(), axis.z())) + M_PI * axis).norm(), 1e-15);
}

TEST(Rotation, InverseJacobianIsTheDerivativeOfTheLog) {
  constexpr double h = 1e-5;
  for (const Vector3& axis : directions()) {
    for (const double angle : kAngles) {
      const Vector3 v = angle * axis;
      const Quaternion q = rotation_exp(v);
      const Matrix3 left = left_jacobian_inverse(v);
      const Vector3 y(0.3, -1.1, 0.7);
      EXPECT_LE((left_jacobian_inverse_transpose(v, y) - left.transpose() * y).norm(), 1e-14) << angle;
      for (int i = 0; i < 3; ++i) {
        const Vector3 d = h * Vector3::Unit(i);
        const Vector3 from_left = (rotation_log(rotation_exp(d) * q) - rotation_log(rotation_exp(-d) * q)) / (2 * h);
        const Vector3 from_right = (rotation_log(q * rotation_exp(d)) - rotation_log(q * rotation_exp(-d))) / (2 * h);
        EXPECT_LE((left.col(i) - from_left).norm(), 2e-9) << angle;
        EXPECT_LE((left.transpose().col(i) - from_right).norm(), 2e-9) << angle;
      }
    }
  }
}

TEST(Rotation, SecondDerivativeOfTheLog) {
  constexpr double h = 1e-3;
  const Vector3 y(0.3, -1.1, 0.7);
  for (const Vector3& axis : directions()) {
    for (const double angle : {0.0, 1e-6, 0.03, 0.0499, 0.0501, 0.3, 1.0, 2.0, 3.0}) {
      const Vector3 v = angle * axis;
      const auto f = [&](const Vector3& d) { return y.dot(rotation_log(rotation_exp(d) * rotation_exp(v))); };
      const Matrix3 second = log_second_derivative(v, y);
      EXPECT_LE((second - second.transpose()).norm(), 1e-15);
      for (const Vector3& d : directions()) {
        // Fourth order: (-f(2h) + 16 f(h) - 30 f(0) + 16 f(-h) - f(-2h)) / 12 h^2
        const double difference =
            (-f(2 * h * d) + 16 * f(h * d) - 30 * f(Vector3::Zero()) + 16 * f(-h * d) - f(-2 * h * d)) / (12 * h * h);
        EXPECT_NEAR(d.dot(second * d), difference, 1e-8) << angle;
      }
    }
  }
}

TEST(Rotation, DerivativesAreContinuousAtTheSeriesSwitchAndFiniteAtPi) {
  const Vector3 axis = Vector3(1, 2, -3).normalized();
  const Vector3 y(0.5, 0.2, -0.4);
  constexpr double step = 1e-9;
  EXPECT_LE((left_jacobian_inverse((0.05 - step) * axis) - left_jacobian_inverse((0.05 + step) * axis)).norm(), 1e-8);
  EXPECT_LE((log_second_derivative((0.05 - step) * axis, y) - log_second_derivative((0.05 + step) * axis, y)).norm(),
            1e-8);
  EXPECT_TRUE(left_jacobian_inverse(M_PI * axis).allFinite());
  EXPECT_TRUE(log_second_derivative(M_PI * axis, y).allFinite());
  // (t/2) cot(t/2) = 0 at pi. So only the skew part remains perpendicular to the axis.
  const Matrix3 at_pi = left_jacobian_inverse(M_PI * axis);
  const Matrix3 symmetric = 0.5 * (at_pi + at_pi.transpose());
  EXPECT_LE((symmetric - axis * axis.transpose()).norm(), 1e-14);
}

TEST(Rotation, SecondDerivativeOfARotatedArm) {
  constexpr double h = 1e-3;
  const Vector3 arm(0.2, 0.5, -0.3), y(-1, 0.4, 0.6);
  const auto f = [&](const Vector3& d) { return y.dot(rotation_exp(d) * arm); };
  for (const Vector3& d : directions()) {
    const double difference =
        (-f(2 * h * d) + 16 * f(h * d) - 30 * f(Vector3::Zero()) + 16 * f(-h * d) - f(-2 * h * d)) / (12 * h * h);
    EXPECT_NEAR(d.dot(rotated_arm_second_derivative(arm, y) * d), difference, 1e-8);
  }
}

TEST(Rotation, IncrementIsSpatial) {
  const Pose pose{Vector3(1, 2, 3), rotation_exp(Vector3(0.3, -0.2, 0.9))};
  const Vector3 w(0.1, 0.7, -0.4);
  const Pose moved = increment(pose, Vector3(0.5, 0, 0), w);
  EXPECT_EQ(moved.position, Vector3(1.5, 2, 3));
  EXPECT_LE((moved.orientation.toRotationMatrix() - (rotation_exp(w) * pose.orientation).toRotationMatrix()).norm(),
            1e-15);
}

TEST(Pose, CompositionAndInverse) {
  const Pose a{Vector3(1, 2, 3), rotation_exp(Vector3(0.3, -0.2, 0.9))};
  const Pose b{Vector3(-0.4, 0.1, 2), rotation_exp(Vector3(-1, 0.5, 0.2))};
  const Vector3 p(0.1, 0.2, 0.3);
  EXPECT_LE(((a * b) * p - a * (b * p)).norm(), 1e-15);
  EXPECT_LE((a.inverse() * (a * p) - p).norm(), 1e-15);
}

TEST(BlockMatrix, AddsAndMultipliesLikeADenseMatrix) {
  BlockPattern pattern(5);
  pattern.add(1, 3);
  pattern.add(3, 1);
  pattern.add_clique(std::array{4, 0, 2});
  BlockMatrix matrix(pattern);
  EXPECT_EQ(matrix.stored_blocks(), 5 + 1 + 3);
  Matrix3 block;
  block << 1, 2, 3, 4, 5, 6, 7, 8, 10;
  const Matrix3 diagonal = block + block.transpose();
  matrix.add(matrix.find(1, 3), block);  // upper: stored transposed
  matrix.add(matrix.find(4, 0), 2.0 * block);
  matrix.add(matrix.find(2, 2), diagonal);
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(15, 15);
  expected.block<3, 3>(3, 9) = block;
  expected.block<3, 3>(9, 3) = block.transpose();
  expected.block<3, 3>(12, 0) = 2.0 * block;
  expected.block<3, 3>(0, 12) = 2.0 * block.transpose();
  expected.block<3, 3>(6, 6) = diagonal;
  EXPECT_EQ(matrix.dense(), expected);
  VectorX x = VectorX::LinSpaced(15, -1, 2), y(15);
  matrix.multiply(x, y);
  EXPECT_LE((y - expected * x).norm(), 1e-13);
  EXPECT_THROW(static_cast<void>(matrix.find(0, 1)), std::out_of_range);
  EXPECT_THROW(static_cast<void>(matrix.find(5, 5)), std::out_of_range);
  EXPECT_THROW(pattern.add(0, 5), std::out_of_range);
  matrix.set_zero();
  EXPECT_EQ(matrix.dense().norm(), 0);
}

TEST(BlockMatrix, TakeBackRestoresTheJournaledBlocks) {
  BlockPattern pattern(4);
  pattern.add(3, 1);
  BlockMatrix matrix(pattern);
  const Matrix3 block = Matrix3::Random();
  matrix.add(matrix.find(3, 1), block);
  matrix.add(matrix.find(2, 2), 0.1 * block);
  EXPECT_TRUE(matrix.journal().empty()) << "no journal was begun";
  const Eigen::MatrixXd before = matrix.dense();
  matrix.begin_journal();
  for (int round = 0; round < 2; ++round) {
    matrix.add(matrix.find(2, 2), 1e9 * block);
    matrix.add(matrix.find(1, 3), block);
    matrix.add(matrix.find(2, 2), block);
    EXPECT_EQ(std::vector(matrix.journal().begin(), matrix.journal().end()),
              (std::vector{matrix.find(2, 2).index, matrix.find(3, 1).index}));
    EXPECT_NE(matrix.dense(), before);
    matrix.take_back();
    EXPECT_EQ(matrix.dense(), before) << "equal to the bit; subtraction would leave rounding errors";
    EXPECT_TRUE(matrix.journal().empty());
  }
  matrix.set_zero();
  matrix.add(matrix.find(0, 0), block);
  EXPECT_TRUE(matrix.journal().empty());
}

TEST(BlockMatrix, ReportsTheChangeSinceTakeBack) {
  BlockPattern pattern(4);
  BlockMatrix matrix(pattern);
  matrix.add(matrix.find(0, 0), 1e6 * Matrix3::Ones());
  matrix.begin_journal();
  matrix.add(matrix.find(0, 0), 3 * Matrix3::Identity());
  matrix.add(matrix.find(1, 1), 4 * Matrix3::Identity());
  matrix.take_back();
  matrix.add(matrix.find(0, 0), 3 * Matrix3::Identity());
  matrix.add(matrix.find(1, 1), 4 * Matrix3::Identity());
  EXPECT_NEAR(matrix.change_since_taken_back(), 0, 1e-6);
  matrix.take_back();
  matrix.add(matrix.find(0, 0), 3 * Matrix3::Identity());
  EXPECT_NEAR(matrix.change_since_taken_back(), 0.8, 1e-6) << "4 of the norm 5 are missing";
  matrix.take_back();
  matrix.add(matrix.find(0, 0), 3 * Matrix3::Identity());
  matrix.add(matrix.find(2, 2), 4 * Matrix3::Identity());
  EXPECT_NEAR(matrix.change_since_taken_back(), 0.8, 1e-6) << "4 of the norm 5 are new";
}

}  // namespace
}  // namespace softhand::math_test
