// The cases of each source file for `all_cases`, and helpers that these files share.
#pragma once

#include <cmath>
#include <vector>

#include "solver/newton_solver.hpp"
#include "verification/verification.hpp"

namespace softhand::verification {

std::vector<Case> material_cases();
std::vector<Case> balance_cases();
std::vector<Case> bending_cases();
std::vector<Case> indentation_cases();
std::vector<Case> body_cases();
std::vector<Case> contact_cases();
std::vector<Case> layer_cases();
std::vector<Case> grasp_cases();
std::vector<Case> hand_cases();
std::vector<Case> soft_cases();
std::vector<Case> two_hands_cases();

inline constexpr double kGravity = 9.81;  // m/s^2

/// Solves down to rounding, so that a measurement shows the discretisation and not the solver.
inline SolverOptions converging() {
  SolverOptions options;
  options.max_iterations = 200;
  options.keep_factor = false;
  options.factor = "double";
  options.residual_tolerance = 1e-13;
  options.increment_tolerance = 1e-14;
  return options;
}

/// Options for rest under a load of `force_scale` newtons.
inline SolverOptions resting(double force_scale) {
  SolverOptions options = converging();
  options.residual_tolerance = 1e-9 * force_scale;
  return options;
}

/// Extrapolation from three results of a method with steps h, h/2 and h/4.
struct Richardson {
  double limit = 0;
  double order = 0;
};
/// The limit uses the expected order, because an observed order amplifies noise.
inline Richardson extrapolate(double coarse, double middle, double fine, double expected_order) {
  return {fine + (fine - middle) / (std::pow(2.0, expected_order) - 1),
          std::log2(std::abs((middle - coarse) / (fine - middle)))};
}

/// A limit in time from three steps, each half of the step before. The order of backward Euler must be 1 +- 0.1, and
/// the limit must be within 1 %.
template <typename AtStep>
Measurement time_limit(const std::string& quantity, double reference, const std::string& unit, double step,
                       AtStep&& at_step) {
  const double coarse = at_step(4 * step), middle = at_step(2 * step), fine = at_step(step);
  const Richardson result = extrapolate(coarse, middle, fine, 1);
  return {quantity, result.limit, reference, 0.01 * std::abs(reference), unit, Order{result.order, 1, 0.1}};
}

}  // namespace softhand::verification
