// The study of one scene: its references, one knob of the hand's simulation after another, and what each millisecond
// buys.
//
// References, apart:
//   R0  same mesh and step, Newton until an iteration moves nothing by 1e-12 or the energy no longer falls: the
//   solver's error. R1  same mesh, steps of 1/1440 s and 1/720 s (quick: 1/360 and 1/180), Richardson: the error of the
//   step. R2  the finest mesh: the error of the mesh. It has an error of its own, for which the second finest's
//   distance from it stands. all R2 + R1 - R0: what a converged run on the finest mesh with the finest step would give,
//   up to the mixed term. Every run is held against it too.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "error_runtime/errors.hpp"

namespace softhand::error_runtime {

struct Row {
  std::string scene;
  std::string knob;  ///< default, newton_iterations, residual_tolerance, mesh, time_step, combined, left_out, engine
  std::string setting;
  std::string hand;  ///< name of the hand file
  double rate_hz = 90;
  std::string reference;  ///< R0, R1 or R2
  bool is_default = false;
  bool on_front = false;  ///< nearer to `all`, by 2 % at least, than any run of the scene that passes and is cheaper;
                          ///< the finest mesh apart

  double ms_p50 = 0;  ///< CPU time of a step
  double ms_p99 = 0;
  double ms_frame = 0;  ///< CPU time of 1/90 s of the scene, mean: compares steps of different length
  std::size_t steps = 0;

  Errors along;                    ///< of the whole run, against `reference`
  std::optional<Errors> one_step;  ///< of single steps, each from R0's state before it, against R0
  Errors total;                    ///< of the whole run, against `all`

  double iterations = 0;
  int steps_not_converged = 0;
  int steps_cut_off = 0;      ///< by the work budget
  double worst_residual = 0;  ///< N or N m
  double penetration_p95_mm = 0;
  double penetration_max_mm = 0;
  double lag_ms = 0;
  double energy_defect = 0;    ///< largest |residual| of the energy ledger over its scale
  int inverted = 0;            ///< elements, the most at any time
  std::string classification;  ///< Pass, Diverged (not finite, a step given up, or 11 mm off), Inverted (more elements
                               ///< than in its reference in the end), Not built
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

struct SceneStudy {
  std::string scene;
  std::string statement;
  bool grasp = false;
  std::optional<LiveBound> live;
  std::string missing;       ///< why R0's run is not what the scene is called; empty when it is
  double r0_residual = 0;    ///< the largest after a step of R0, N or N m
  double r0_iterations = 0;  ///< mean a step
  double r0_iterations_most = 0;
  Errors r2_uncertainty;  ///< the second finest mesh against the finest
  Errors r1_uncertainty;  ///< the finest step against R1
  double amplification =
      0;  ///< change of the tissue, RMS, by targets moved 1 um, over 1 um: large where a scene is chaotic
  std::vector<Row> rows;
  std::vector<Slope> slopes;
};

/// Runs of another engine beside this project's on one problem that both can do.
struct PeerStudy {
  std::string statement;  ///< the problem
  std::string cannot;     ///< what the other engine cannot model of the hand
  std::vector<Row> rows;  ///< knob "engine", reference R0: this project's solver until nothing moves
};

struct Study {
  bool quick = false;
  std::string default_hand;
  std::vector<SceneStudy> scenes;
  std::vector<NotBuilt> not_built;
  PeerStudy peer;
};

/// Runs one scene. `quick`: the coarse hand is the default, and fewer settings.
SceneStudy study_scene(const Scene& scene, bool quick);

/// Work of a step, fast steps, by which the live default is judged.
inline constexpr double kLiveBudget = 2;

/// The hand of the default configuration.
std::string default_hand(bool quick);

/// Slope of log y over log x; NaN for fewer than two points. Points that are not positive and finite are passed over.
double fitted_slope(const std::vector<double>& x, const std::vector<double>& y);

/// Indices, by rising x, of those whose y is below (1 - gain) of every y at a smaller x.
std::vector<std::size_t> pareto_front(const std::vector<double>& x, const std::vector<double>& y, double gain);

}  // namespace softhand::error_runtime
