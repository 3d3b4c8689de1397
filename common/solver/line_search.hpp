// Line search on the energy.
//
// The second derivative of E jumps at kinks: contacts begin and end, friction sticks and slides. The Hessian before a
// kink does not know the far side. Steps that are only halved until E falls would approach the kink in each iteration
// and never cross it. So the search brackets the minimum by the slope and ends at the minimum or beyond, where the next
// Hessian is different.
//
// A full step may also end far before the minimum. A Hessian that was made positive semi-definite is too stiff where
// tissue snaps through, for dozens of iterations. In this case the search continues beyond the full step.
#pragma once

#include "solver/incremental_potential.hpp"
#include "solver/linkage.hpp"

namespace softhand {

class LineSearch {
 public:
  explicit LineSearch(DofLayout layout) : base_(empty_state(layout)) {}

  /// How the result is evaluated.
  struct Request {
    bool gradient = true;  ///< energy and gradient
    bool hessian = false;  ///< also the Hessian, if the result is a full step. Requires `gradient`.
  };
  /// Moves `state` along the direction until E has fallen by Armijo's rule and is near its minimum. Returns the scale
  /// of the move. Returns 0 if E does not fall in floating point. Then `state` and the report are unchanged, except
  /// for time and work, but the potential's gradient is that of a trial. Energy and gradient must be those of `state`.
  double search(IncrementalPotential& potential, Linkage& linkage, const VectorX& direction, State& state,
                StepMeter& meter, const Request& request);

 private:
  State base_;
};

}  // namespace softhand
