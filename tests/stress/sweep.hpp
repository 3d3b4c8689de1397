// The sweep: one finger presses an object on a table, over five parameters at once, as the points of a low-discrepancy
// sequence.
#pragma once

#include <vector>

#include "stress/stress.hpp"

namespace softhand::stress {

struct SweepPoint {
  double youngs_modulus = 0;     ///< Pa, 1e3 to 1e7
  double poisson_ratio = 0;      ///< 0 to 0.499
  double time_step = 0;          ///< s, 0.5e-3 to 33e-3
  double contact_stiffness = 0;  ///< N/m of a mean node, 1e2 to 1e7
  double mass_ratio = 0;         ///< object over the finger's tissue, 1e-4 to 1e4
};

/// The n-th of Halton's points, n from 1: the same first ones however many are asked for. All but Poisson's ratio by
/// their logarithm.
SweepPoint sweep_point(std::size_t n);

/// Cases "sweep" (default mode), "sweep_one_step" (one Newton step) and "sweep_live" (live budget), so many points
/// each.
std::vector<Case> sweep_cases(std::size_t points);

}  // namespace softhand::stress
