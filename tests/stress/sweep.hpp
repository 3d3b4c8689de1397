// The sweep: one finger presses an object on a table. Five parameters vary at once and follow the points of a
// low-discrepancy sequence.
#pragma once

#include <vector>

#include "stress/stress.hpp"

namespace softhand::stress {

struct SweepPoint {
  double youngs_modulus = 0;     ///< Pa, 1e3 to 1e7
  double poisson_ratio = 0;      ///< 0 to 0.499
  double time_step = 0;          ///< s, 0.5e-3 to 33e-3
  double contact_stiffness = 0;  ///< N/m^3, 1e6 to 1e11
  double mass_ratio = 0;         ///< object mass over tissue mass of the finger, 1e-4 to 1e4
};

/// The n-th point of Halton's sequence, n from 1. The point does not depend on the number of points. All parameters
/// except Poisson's ratio are spread by their logarithm.
SweepPoint sweep_point(std::size_t n);

/// Cases "sweep" (default mode), "sweep_one_step" (one Newton step) and "sweep_live" (live budget), each with `points`
/// points.
std::vector<Case> sweep_cases(std::size_t points);

}  // namespace softhand::stress
