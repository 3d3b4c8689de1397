// Chord steps: steps in free motion, without a new Hessian.
//
// A chord step starts from the state predicted from the velocities of linked bodies and nodes. It extrapolates the
// tissue forces from the ends of the last two steps. It reuses the factor of an earlier step, rotated with the bones
// (linkage.hpp). If it does not converge, an ordinary step continues from the lowest state that it reached.
#pragma once

#include <cstdint>

#include "solver/hessian_factor.hpp"
#include "solver/incremental_potential.hpp"
#include "solver/linkage.hpp"

namespace softhand {

class Predictor {
 public:
  Predictor(const SolverOptions& options, DofLayout layout);

  /// False if the last step ended far from its prediction: then a chord step would fail.
  bool is_promising() const { return carried_.is_predictable; }

  enum class Outcome : std::uint8_t {
    converged,
    lowered,  ///< not converged; `state` is the lowest state reached, below the energy of the step's start
    failed,   ///< not converged; `state` is the step's start
  };
  /// Tries to move `state` from the step's start to its end.
  Outcome step(State& state, double time_step, IncrementalPotential& potential, HessianFactor& factor, Linkage& linkage,
               StepMeter& meter);

  /// What one step leaves to the next.
  struct Carried {
    bool is_predictable = true;     ///< the last step ended near the state predicted from velocities
    bool contracts_slowly = false;  ///< the factor contracted slowly when last used
    double factor_time_step = 0;    ///< of the factor, s; 0: it is not usable for chord steps
    /// Gradient of the potentials that depend on nodes only, at the start of this step and of the last step, in the
    /// axes of the nodes' bodies.
    VectorX gradient, earlier_gradient;
    double gradient_time_step = 0;  ///< of `gradient`, s; 0: it is not usable in the next step
  };
  void set_work_budget(double work_budget) { work_budget_ = work_budget; }
  /// Call before an ordinary step. The next chord step extrapolates no forces, and reuses no factor unless
  /// `keep_factor` follows.
  void begin_ordinary_step() { carried_.factor_time_step = carried_.gradient_time_step = 0; }
  /// The next chord step may reuse the last factor. It was made at the linkage's earlier state.
  void keep_factor(double time_step) { carried_.factor_time_step = time_step; }
  /// Call at the end of every step that may be followed by a chord step.
  void end_step(const State& start, const State& end, double time_step, const Linkage& linkage);
  /// As after construction, but without allocation.
  void forget() {
    carried_.is_predictable = true;
    carried_.contracts_slowly = false;
    carried_.factor_time_step = carried_.gradient_time_step = 0;
    carried_.gradient.setZero();
    carried_.earlier_gradient.setZero();
  }
  const Carried& carried() const { return carried_; }
  void set_carried(const Carried& carried) { carried_ = carried; }

 private:
  double work_budget_, tolerance_, residual_tolerance_;
  Carried carried_;
  VectorX extrapolated_, pull_, direction_;
  State lowest_;
};

}  // namespace softhand
