// The incremental potential E(q) = inertia + U(q) of a list of terms (ES2725128A1 eqs. 10-17), its gradient and its
// Hessian.
//
// Terms are evaluated in three groups. The order of the report is the order of the list.
// 1. Potentials. They depend only on the state. Their values at the end of a step are reused at the start of the next.
// 2. Other terms without kinks.
// 3. Terms with kinks: contact and friction. Their part of the Hessian can be renewed alone.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "energies/energy.hpp"
#include "solver/solver_options.hpp"
#include "solver/step_report.hpp"

namespace softhand {

class IncrementalPotential {
 public:
  /// Builds the pattern of the terms and binds them. Throws std::invalid_argument if there are more than kMaxTerms.
  IncrementalPotential(std::vector<Energy*> terms, DofLayout layout, const SolverOptions& options);

  DofLayout layout() const { return layout_; }
  /// Stored blocks of the potentials and of other terms of nodes alone.
  double potential_blocks() const { return potential_blocks_; }
  std::span<Energy* const> kinked() const { return kinked_; }
  /// The kind of the Hessian of terms with kinks. The other terms may be exact (`tries_exact`).
  Curvature curvature() const { return curvature_; }

  /// Calls `begin_step` of all terms.
  void begin_step(const State& state, double time_step);
  /// Lets the terms change after an iteration (`Energy::revise`). Returns whether the energy has changed.
  bool revise(const State& state);
  void end_step(State& state);
  const State& start() const { return start_; }  ///< the state at the start of the step

  struct Request {
    bool hessian = false;
    /// `state` may be the result of the step. So the work of the step so far is measured if `measure_work` asks for it.
    bool may_be_result = true;
    /// An extrapolated gradient of the potentials that depend on nodes only. These potentials are then not evaluated,
    /// and their energy is the last known one.
    const VectorX* node_gradient = nullptr;
  };
  /// Evaluates the energy of each term and the gradient. Returns false if a value is NaN or infinite.
  bool evaluate(const State& state, StepMeter& meter, const Request& request);
  /// The energy alone.
  double value(const State& state, StepMeter& meter) const;
  /// Of the last `evaluate`.
  const VectorX& gradient() const { return gradient_; }

  /// Of the last linearisation: `evaluate` with `Request::hessian`, or `renew_kinks`.
  const BlockMatrix& hessian() const { return hessian_; }
  /// Access for a caller that changes the Hessian.
  BlockMatrix& change_hessian();
  /// Changes whenever `hessian` may have changed. Never 0.
  std::uint64_t version() const { return version_; }
  /// Entry `k` of the diagonal of the diagonal block `block`.
  double diagonal(int block, int k) const;
  /// Adds `shift` times its magnitude to each entry of the diagonal. The shift is relative, because entries per metre
  /// and per radian differ by orders of magnitude.
  void shift_diagonal(double shift);
  /// If the last Hessian was exact, evaluates it again at `state` with projected terms, and takes projected Hessians
  /// for the rest of the step. Returns false if it was not exact.
  bool project_hessian(const State& state, StepMeter& meter);
  /// Renews the part of the terms with kinks in the Hessian. The version must not have changed since the last
  /// `evaluate` with a Hessian or the last `renew_kinks`. Returns false if that part hardly changed. Then the rest of
  /// the Hessian is what is stale.
  bool renew_kinks(const State& state, StepMeter& meter);
  /// Indices of the stored blocks that the last `renew_kinks` changed.
  std::span<const std::int32_t> changed_blocks() const { return changed_; }

  /// Whether the potentials at `state` are known from the last evaluation.
  bool knows_potentials_at(const State& state) const;
  /// Gradient of the potentials that depend on nodes only, at the last state where they were evaluated.
  const VectorX& node_gradient() const { return carried_.node_gradient; }

  /// The terms without kinks that depend on nodes only, as a function of a few of them: Energy::add_around.
  Energy::Around add_around(std::span<const std::int32_t> nodes, const State& state, double* gradient,
                            double* blocks) const;
  /// A stored block of the core: the sum of all other terms without kinks. It is that of the first linearisation with
  /// this time step, because attachments and inertia, which act on nodes, have a constant one.
  Eigen::Map<const Matrix3> other_stiffness(std::int32_t stored) const {
    return Eigen::Map<const Matrix3>(other_stiffness_.data() + 9 * static_cast<std::ptrdiff_t>(stored));
  }
  bool knows_other_stiffness() const { return other_time_step_ == time_step_; }

  /// See NewtonSolver::measure_work.
  void measure_work(bool taken, bool start_of_chord_steps);
  /// Fills `TermEnergy::start` at the start of a chord step, if `measure_work` asked for it.
  void measure_start(const State& state, StepReport& report) const;

  /// What one step leaves to the next: the potentials at the state where they were evaluated last. Usually this is the
  /// start of the next step.
  struct Carried {
    bool known = false;
    Eigen::Matrix3Xd positions;
    std::vector<Pose> poses;
    VectorX gradient;
    VectorX node_gradient;                   // of the potentials that depend on nodes only
    std::array<double, kMaxTerms> joules{};  // by place in `order_`
  };
  /// No potential is known from an earlier evaluation.
  void forget() {
    carried_.known = false;
    other_time_step_ = 0;
    ++version_;
  }
  /// Takes over what the last step of `other` left, and its Hessian if `with_hessian`. `other` must have the same
  /// terms.
  void take_over(const IncrementalPotential& other, bool with_hessian);

 private:
  void measure_displacement(const State& state);

  std::vector<Energy*> terms_;
  std::vector<std::size_t> order_;  // of evaluation
  std::vector<Energy*> kinked_;
  // Places in `order_`: the first potential that depends on bodies, the first term after the potentials, and the first
  // term with kinks. In between, the terms of nodes alone come first, up to `first_other_`.
  std::size_t first_bodily_ = 0, first_frozen_ = 0, first_other_ = 0, first_kinked_ = 0;
  std::size_t potential_bodies_ = 0;  // the potentials depend on this many bodies: the first ones
  double potential_blocks_ = 0;
  DofLayout layout_;
  Curvature curvature_;
  bool tries_exact_;
  bool exact_now_;  // the next Hessian of terms without kinks is exact
  bool hessian_is_exact_ = false;
  BlockMatrix hessian_;
  std::uint64_t version_ = 1;
  std::vector<std::int32_t> diagonal_;  // stored block of each diagonal block
  std::vector<std::int32_t> changed_;
  VectorX gradient_;
  VectorX other_stiffness_;     // nine per stored block of the core
  double other_time_step_ = 0;  // of `other_stiffness_`, s; 0: unknown
  double time_step_ = 0;        // of this step, s
  VectorX displacement_;        // the increment from start_ to the state evaluated last
  State start_;
  Carried carried_;
  bool measures_work_ = false;
  bool measures_start_ = false;
};

}  // namespace softhand
