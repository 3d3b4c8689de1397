#include "solver/loose_solve.hpp"

#include <cmath>

namespace softhand {
namespace {

// The direction of an iteration of Newton's method need not be precise: the line search and the next iteration follow.
constexpr int kMostIterations = 12;
constexpr double kPrecision = 0.03;  // of the residual, in the norm of A^-1

// y += L x.
void add_loose_product(const BlockMatrix& hessian, const VectorX& x, VectorX& y) {
  for (const std::int32_t stored : hessian.loose_in_use()) {
    const auto [row, column] = hessian.position(stored);
    const Eigen::Map<const Matrix3> block(hessian.values().data() + 9 * static_cast<std::ptrdiff_t>(stored));
    y.segment<3>(3 * row) += block * x.segment<3>(3 * column);
    y.segment<3>(3 * column) += block.transpose() * x.segment<3>(3 * row);
  }
}

}  // namespace

LooseSolve::LooseSolve(int dof_count) {
  residual_ = preconditioned_ = direction_ = product_ = VectorX::Zero(dof_count);
}

void LooseSolve::solve(HessianFactor& factor, const BlockMatrix& hessian, const VectorX& rhs, VectorX& x,
                       double most_work, StepMeter& meter) {
  if (hessian.loose_in_use().empty()) {
    factor.solve(rhs, x, meter);
    return;
  }
  const double work_before = meter.report.work;
  residual_ = rhs;
  factor.solve(residual_, preconditioned_, meter);
  direction_ = preconditioned_;
  product_ = residual_;  // A times the direction
  x.setZero();
  double square = residual_.dot(preconditioned_);
  const double enough = kPrecision * kPrecision * square;
  for (int iteration = 0; iteration < kMostIterations && square > enough; ++iteration) {
    // `preconditioned_` is only scratch until the next solve.
    preconditioned_ = product_;
    add_loose_product(hessian, direction_, preconditioned_);
    const double curvature = direction_.dot(preconditioned_);
    if (!(curvature > 0)) break;
    const double length = square / curvature;
    x += length * direction_;
    residual_ -= length * preconditioned_;
    factor.solve(residual_, preconditioned_, meter);
    const double next = residual_.dot(preconditioned_);
    direction_ = preconditioned_ + next / square * direction_;
    product_ = residual_ + next / square * product_;
    square = next;
    if (meter.report.work - work_before + meter.prices.solve > most_work) break;
  }
  // An indefinite model: the direction of the factor alone.
  if (x.isZero(0)) x = direction_;
}

}  // namespace softhand
