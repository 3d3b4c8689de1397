// The distance between two trajectories.
#pragma once

#include <limits>
#include <utility>
#include <vector>

#include "error_runtime/trial.hpp"

namespace softhand::error_runtime {

/// Errors over the times that both trajectories have. "RMS" is over time and over area, joints or fingers. The errors
/// are infinite if a trajectory is not finite.
struct Errors {
  double tissue_rms_mm = 0;
  double tissue_worst_rms_mm = 0;  ///< RMS over area at the worst time
  double tissue_max_mm = 0;        ///< largest error of a vertex at any time
  double bone_mm = 0;              ///< joints, RMS
  double bone_degrees = 0;         ///< joints, RMS
  /// RMS over time of the force difference, over the reference. With f the forces of all fingers as one vector: RMS|f -
  /// f_ref| / max(RMS|f_ref|, 0.1 N).
  double force_error = 0;
  double net_force_error_p95 = 0;  ///< |sum f - sum f_ref| / max(|sum f_ref|, 0.1 N), 95th percentile over time
  /// Norm of the first Piola stress, every 1/30 s: RMS difference from the reference over area and time, over the RMS
  /// of the reference.
  double stress_error = 0;
  /// RMS distance of the fingers' centres of pressure, weighted by force. Only fingers that press with 0.1 N in both
  /// runs.
  double pressure_centre_mm = 0;
  /// Share of nodes whose contact state (free, sticks, slides) differs, among the nodes that touch in either run. NaN
  /// if the meshes differ.
  double touch_disagreement = std::numeric_limits<double>::quiet_NaN();
  /// Nodes of all flexible objects, RMS over time and nodes. NaN if there are none.
  double soft_rms_mm = std::numeric_limits<double>::quiet_NaN();
  std::size_t times = 0;
};

/// Area weight of each skin vertex: a third of the rest area of its triangles, as a share of the whole skin's area.
std::vector<double> skin_weights(const HandModel& hand);

Errors difference(const Trajectory& trajectory, const Trajectory& reference, const std::vector<double>& weights);

/// Sum of factor * trajectory over the times that all trajectories have. The factors sum to 1. Covers skin, joints,
/// flexible objects and forces by finger. Used for extrapolation.
Trajectory combined(const std::vector<std::pair<double, const Trajectory*>>& parts);

}  // namespace softhand::error_runtime
