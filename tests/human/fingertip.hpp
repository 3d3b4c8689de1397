// A hand's index fingertip pressed by a flat plate, its bones held, and the material of its pulp fitted to what
// people's fingertips do.
//
// The tip is inclined by 30 degrees to the plate (Pawluk and Howe: 20 to 40), the plate frictionless (as in Serina's
// model), every state at rest: what is compared is the elastic response. Tissue relaxes (4 ms, 70 ms, 1.4 s: Pawluk and
// Howe 1999); the simulation does not.
#pragma once

#include <span>
#include <vector>

#include "model/hand_model.hpp"

namespace softhand::human {

/// What is fitted. Poisson's ratio is left as it is.
struct PulpMaterial {
  double youngs_modulus = 0;  ///< Pa
  double limit_energy = 0;    ///< W_max of ES2725128A1 eq. 22, J/m^3
  double limit_ratio = 0;     ///< k_s/W_max, 1
};

/// Of the material named "pulp"; std::invalid_argument where the hand has none.
PulpMaterial pulp_of(const HandModel& hand);

/// The tip at rest at one place of the plate.
struct Press {
  double indentation = 0;  ///< m that the plate came nearer to the bone since it first touched the skin; the contact's
                           ///< own springs give way too
  double force = 0;        ///< N, along the plate's normal
  double area = 0;         ///< m^2, of the skin at rest that touches, as `contacts` publishes it: whole shares of nodes
};

class Fingertip {
 public:
  /// The tissue around the last two bones of the index finger. `contact_stiffness`: k_c of eq. 32, N/m of a mean skin
  /// node of the whole hand.
  Fingertip(const HandModel& hand, double contact_stiffness);

  /// Rest at each of `indentations` (m, > 0, rising). std::runtime_error where it does not come to rest.
  std::vector<Press> press(const PulpMaterial& pulp, std::span<const double> indentations) const;

 private:
  HandModel tip_;
  std::size_t pulp_ = 0;  // index of the material
  double contact_stiffness_ = 0;
};

// People's fingertips. The forms and ranges are read in the sources' abstracts; the constants marked so are recalled
// and were not checked against the papers.

/// Force on a flat plate, N, at an indentation, m: (b/m) (exp(m d) - 1), b = 0.19 N/mm, m = 2.1 /mm (form and range 0
/// to 2 N: Pawluk and Howe 1999; constants recalled).
double measured_force(double indentation);
/// Contact area, m^2, under a force, N: 100 mm^2 sqrt(F/1 N) (valid 0.25 to 7 N: Serina 1998; constants recalled).
double measured_area(double force);
/// People differ by about so much either way, as a factor. Recalled as an order of magnitude: no table of subjects was
/// at hand.
inline constexpr double kForceSpread = 2, kAreaSpread = 1.5;
/// Where forces are compared, m: up to the 2 N that were measured.
inline constexpr double kCompared[] = {0.25e-3, 0.5e-3, 0.75e-3, 1e-3, 1.25e-3, 1.5e-3};

struct PulpFit {
  PulpMaterial pulp;
  double residual = 0;  ///< RMS of log(force / measured force) over `kCompared` and all tips, 1
  int evaluations = 0;
};

/// The residual of one material.
double residual(std::span<const Fingertip> tips, const PulpMaterial& pulp);
/// One material for all tips. Nelder and Mead's simplex over the logarithms, from `start`; within 5 to 500 kPa, 1 to
/// 1e5 J/m^3 and a ratio of 0.1 to 50 (beyond, one Newton step chatters). Same bits on each run.
PulpFit fit_pulp(std::span<const Fingertip> tips, const PulpMaterial& start);

}  // namespace softhand::human
