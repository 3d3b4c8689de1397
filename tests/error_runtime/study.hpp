// The study of one scene. It computes the references, varies the settings ("knobs") of the hand's simulation one by
// one, and shows which error each millisecond buys.
//
// References:
// - R0: same mesh and step. Newton's method runs until an iteration moves nothing by 1e-12, or the energy no longer
//   falls. Distance from R0 is the solver's error.
// - R1: same mesh, Richardson extrapolation of steps of 1/1440 s and 1/720 s (quick: 1/360 s and 1/180 s). Distance
//   from R1 is the error of the time step.
// - R2: the finest mesh. Distance from R2 is the error of the mesh. R2 has an error of its own, and the distance of the
//   second finest mesh estimates it.
// - all: R2 + R1 - R0, the result of a converged run on the finest mesh with the finest step, up to the mixed term.
//   Every run is also compared with this reference.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "error_runtime/errors.hpp"

namespace softhand::error_runtime {

struct Row {
  std::string scene;
  /// default, newton_iterations, residual_tolerance, work_budget, mesh, time_step, combined, left_out, engine
  std::string knob;
  std::string setting;
  std::string hand;  ///< name of the hand file
  double rate_hz = 90;
  std::string reference;  ///< R0, R1, R2 or all
  bool is_default = false;
  /// The run is on the Pareto front: nearer to `all` by at least 2 % than any cheaper run of the scene that passes.
  /// Runs on the finest mesh are excluded.
  bool on_front = false;

  double ms_p50 = 0;  ///< CPU time of a step
  double ms_p99 = 0;
  double ms_frame = 0;  ///< mean CPU time for 1/90 s of the scene; compares steps of different length
  std::size_t steps = 0;

  Errors along;                    ///< error of the whole run against `reference`
  std::optional<Errors> one_step;  ///< error of single steps against R0, each step from R0's state
  Errors total;                    ///< error of the whole run against `all`

  double iterations = 0;
  int steps_not_converged = 0;
  int steps_cut_off = 0;      ///< by the work budget
  double worst_residual = 0;  ///< N or N m
  double penetration_p95_mm = 0;
  double penetration_max_mm = 0;
  double lag_ms = 0;
  double energy_defect = 0;  ///< largest |residual| of the energy ledger over its scale
  int inverted = 0;          ///< inverted elements, most at any time
  /// "Pass", "Diverged", "Inverted" or "Not built". Diverged: not finite, a failed step, or an error of the tissue of
  /// 11 mm. Inverted: more inverted elements at the end than in the reference.
  std::string classification;
};

/// log(error) = slope log(x) + c, least squares.
struct Slope {
  std::string scene;
  std::string knob;
  std::string quantity;
  double observed = 0;
  double expected = 0;
  std::size_t points = 0;
};

/// Work of a step, fast steps, by which the live default is judged without flexible objects. With them it is the least
/// of a live step (`WorkPrice::least_budget`).
inline constexpr double kLiveBudget = 2;

struct SceneStudy {
  std::string scene;
  std::string statement;
  bool grasp = false;
  std::optional<LiveBound> live;
  double live_budget = kLiveBudget;  ///< fast steps, by which the live default of this scene is judged
  std::string missing;               ///< what R0's run fails to show of the scene; empty if nothing
  double r0_residual = 0;            ///< largest residual after a step of R0, N or N m
  double r0_iterations = 0;          ///< mean iterations per step
  double r0_iterations_most = 0;
  Errors r2_uncertainty;  ///< error of the second finest mesh against the finest mesh
  Errors r1_uncertainty;  ///< error of the finest step against R1
  /// RMS movement of the tissue, over 1 um, if the targets move by 1 um. The scene is chaotic if this value is large.
  double amplification = 0;
  std::vector<Row> rows;
  std::vector<Slope> slopes;
};

/// Runs of another engine and of this project on a problem that both can solve.
struct PeerStudy {
  std::string statement;  ///< the problem
  std::string cannot;     ///< features of the hand that the other engine cannot model
  std::vector<Row> rows;  ///< knob "engine"; reference R0 is this project's converged run
};

struct Study {
  bool quick = false;
  std::string default_hand;
  std::vector<SceneStudy> scenes;
  std::vector<NotBuilt> not_built;
  PeerStudy peer;
};

/// Runs one scene. With `quick` the coarse hand is the default, and there are fewer settings.
SceneStudy study_scene(const Scene& scene, bool quick);

/// The hand of the default configuration.
std::string default_hand(bool quick);

/// Slope of log y over log x. NaN for fewer than two points. Points that are not positive and finite are ignored.
double fitted_slope(const std::vector<double>& x, const std::vector<double>& y);

/// Indices of the Pareto front by rising x. The y of each point is below (1 - gain) times the y of the previous point.
std::vector<std::size_t> pareto_front(const std::vector<double>& x, const std::vector<double>& y, double gain);

}  // namespace softhand::error_runtime
