// How far one trajectory is from another.
#pragma once

#include <limits>
#include <utility>
#include <vector>

#include "error_runtime/trial.hpp"

namespace softhand::error_runtime {

/// Over the times that both have. "RMS" is over area (or joints, or fingers) and time. Infinite where one is not
/// finite.
struct Errors {
  double tissue_rms_mm = 0;
  double tissue_worst_rms_mm = 0;  ///< over area, at the worst time
  double tissue_max_mm = 0;        ///< of any vertex at any time
  double bone_mm = 0;              ///< joints, RMS
  double bone_degrees = 0;         ///< joints, RMS
  double force_error =
      0;  ///< RMS over time of (f_finger - reference) in the norm over fingers / max(the same of the reference, 0.1 N)
  double net_force_error_p95 = 0;  ///< |sum f - sum f_ref| / max(|sum f_ref|, 0.1 N), 95th percentile over time
  double stress_error = 0;  ///< RMS over area and time of the first Piola stress's norm against the reference's / RMS
                            ///< of the reference's; at every 1/30 s
  double pressure_centre_mm =
      0;  ///< centres of pressure of fingers that press with 0.1 N in both, weighted by force, RMS
  double touch_disagreement =
      std::numeric_limits<double>::quiet_NaN();  ///< of nodes that touch in either: share that is free, sticks or
                                                 ///< slides otherwise; same mesh only
  std::size_t times = 0;
};

/// Area-weighted skin of a hand: of each vertex a third of its triangles' rest areas, as shares of 1.
std::vector<double> skin_weights(const HandModel& hand);

Errors difference(const Trajectory& trajectory, const Trajectory& reference, const std::vector<double>& weights);

/// Sum of factor * trajectory over the times that all have, factors summing to 1: skin, joints and forces by finger.
/// For extrapolation.
Trajectory combined(const std::vector<std::pair<double, const Trajectory*>>& parts);

}  // namespace softhand::error_runtime
