// The face of one energy term. The solver knows nothing else about a term.
#pragma once

#include <string_view>

#include "energies/energy_ledger.hpp"
#include "math/block_matrix.hpp"
#include "model/state.hpp"

namespace softhand {

/// Whether a Hessian is exact (for the derivative tests and the text's literal eq. 16) or positive semi-definite (for
/// the solver).
enum class Curvature { exact, projected };

/// One term of the total potential, in joules. Derivatives are with respect to the increment of `apply_increment` at
/// zero: nodes and body translations in metres, body rotations as spatial increments in radians, in world axes. A term
/// returns dU/dq, never a force.
///
/// Call order: `add_pattern`, `bind` once; then per step `begin_step`, any number of evaluations, `end_step`. What a
/// term freezes for the duration of a step (contact planes, copies of other processes, friction bounds) it freezes in
/// `begin_step`, so that `value` is one fixed function while the solver minimises. Nothing after `bind` allocates.
class Energy {
 public:
  virtual ~Energy() = default;
  virtual std::string_view name() const = 0;
  /// Whether the Hessian jumps from one iteration to the next, where contact begins or friction slips; else it changes
  /// with the state alone, and little in a step.
  virtual bool has_kinks() const { return false; }
  /// Whether it depends on positions and poses alone, not on what a step froze: what it was at the end of a step it is
  /// at the start of the next. Its pattern names each body on which it depends, be it in a pair.
  virtual bool is_potential() const { return false; }
  /// Declares every block that `add_hessian` may ever touch.
  virtual void add_pattern(BlockPattern& pattern) const = 0;
  /// Looks up and keeps the slots of those blocks.
  virtual void bind(const BlockMatrix& matrix) = 0;
  /// `state` is that at the start of the step of `time_step` seconds (> 0).
  virtual void begin_step(const State& /*state*/, double /*time_step*/) {}
  virtual double value(const State& state) const = 0;
  /// Returns the value too: the two share most of their work.
  virtual double add_gradient(const State& state, VectorX& gradient) const = 0;
  virtual void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const = 0;
  /// All three at one state; returns the value.
  virtual double add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const {
    add_hessian(state, hessian, curvature);
    return add_gradient(state, gradient);
  }
  /// After the solver is done with the step: anchors slide, contacts begin and end, inertia writes the new velocities
  /// into `state`.
  virtual void end_step(State& /*state*/) {}
  /// Rows of the energy ledger for the step that ended last, whose minimisation led from the value `start` to `end` and
  /// took dU/dq . dq = `taken`. As it stands: of a potential of the state alone, whose force of the step's end did the
  /// work (convex: backward Euler loses).
  virtual EnergyFlow flow(double start, double end, double taken) const {
    return {.stored = end, .integrator = start - end + taken};
  }
};

}  // namespace softhand
