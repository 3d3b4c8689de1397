// A hand's index fingertip pressed by a flat plate, with its bones held. The material of its pulp is fitted to
// measurements of human fingertips.
//
// The tip is inclined by 30 degrees to the plate (Pawluk and Howe: 20 to 40 degrees). The plate is frictionless, as in
// Serina's model. `press` compares the elastic response, so every state is at rest. Human tissue relaxes with 4 ms, 70
// ms and 1.4 s (Pawluk and Howe 1999): `force_in_time` has the relaxation of the simulated tissue.
#pragma once

#include <span>
#include <vector>

#include "model/hand_model.hpp"
#include "scene/simulation_options.hpp"

namespace softhand::human {

/// The fitted parameters. Poisson's ratio is not fitted.
struct PulpMaterial {
  double youngs_modulus = 0;  ///< Pa
  double limit_energy = 0;    ///< W_max of ES2725128A1 eq. 22, J/m^3
  double limit_ratio = 0;     ///< k_s/W_max, 1
};

/// The material named "pulp". Throws std::invalid_argument if the hand has no such material.
PulpMaterial pulp_of(const HandModel& hand);

/// The tip at rest at one position of the plate.
struct Press {
  /// Distance that the plate moved towards the bone after it first touched the skin, m. Includes the contact springs'
  /// depth.
  double indentation = 0;
  double force = 0;  ///< N, along the plate's normal
  /// Contact area of the skin at rest, m^2, as `contacts` publishes it: the sum of whole areas of contact points.
  double area = 0;
};

/// A plate that has moved towards the bone by `indentation` (m, as in `Press`) at a time (s).
struct PlateMove {
  double time = 0;
  double indentation = 0;
};

class Fingertip {
 public:
  /// The tissue around the last two bones of the index finger. `contact_stiffness` is k_c of eq. 32, N/m^3.
  Fingertip(const HandModel& hand, double contact_stiffness);

  /// The tip at rest at each of `indentations` (m, > 0, rising). Throws std::runtime_error if it does not come to rest.
  std::vector<Press> press(const PulpMaterial& pulp, std::span<const double> indentations) const;

  /// Force (N) at the end of each move of the plate. Between two moves it moves evenly, in one step. Time counts: the
  /// tissue has inertia and the branches of `relaxation`. It begins relaxed, at the time 0 and the indentation 0.
  std::vector<double> force_in_time(const PulpMaterial& pulp, const RelaxationOptions& relaxation,
                                    std::span<const PlateMove> moves) const;

 private:
  struct Rig;
  HandModel with(const PulpMaterial& pulp) const;

  HandModel tip_;
  std::size_t pulp_ = 0;  // index of the material
  double contact_stiffness_ = 0;
};

// Human fingertips. Forms and ranges come from the sources' abstracts. Constants marked "recalled" are from memory and
// were not checked against the papers.

/// Force on a flat plate, N, at an indentation, m: (b/m) (exp(m d) - 1), b = 0.19 N/mm, m = 2.1 /mm. Form and range (0
/// to 2 N) are from Pawluk and Howe 1999. The constants are recalled.
double measured_force(double indentation);
/// Contact area, m^2, under a force, N: 100 mm^2 sqrt(F/1 N). Valid from 0.25 to 7 N (Serina 1998). The constants are
/// recalled.
double measured_area(double force);
/// People differ from each other by about these factors in both directions. The factors are recalled as an order of
/// magnitude, because no table of subjects was available.
inline constexpr double kForceSpread = 2, kAreaSpread = 1.5;
/// Indentations at which forces are compared, m. They reach the measured 2 N.
inline constexpr double kCompared[] = {0.25e-3, 0.5e-3, 0.75e-3, 1e-3, 1.25e-3, 1.5e-3};

struct PulpFit {
  PulpMaterial pulp;
  double residual = 0;  ///< RMS of log(force / measured force) over `kCompared` and all tips
  int evaluations = 0;
};

/// The residual of one material over all tips.
double residual(std::span<const Fingertip> tips, const PulpMaterial& pulp);
/// Fits one material to all tips with Nelder and Mead's simplex over the logarithms, from `start`. The result is the
/// same bit by bit in each run. Bounds:
/// - Young's modulus: 5 to 500 kPa
/// - limit energy: 1 to 1e5 J/m^3
/// - ratio: 0.1 to 50; beyond this, one Newton step chatters
PulpFit fit_pulp(std::span<const Fingertip> tips, const PulpMaterial& start);

}  // namespace softhand::human
