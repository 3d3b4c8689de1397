// Decides in each iteration whether the last factor of the Hessian is reused or renewed, and when the work budget ends
// the step.
//
// A factor is reused while this converges sooner than a new factor. The last factor of a step also serves the first
// iteration of the next step. If reuse is too slow, only contact and friction are renewed. The rest is renewed only if
// this is not enough. If a float factor makes no progress, or hardly any, the next factor is in double.
//
// With a budget, a step first reserves the work of one new Hessian and factor. It spends the rest on cheaper
// iterations. After a step that the budget cut off far from the minimum, the next step begins with a new Hessian and
// factor. Iterations on the condensed hand may take some work beyond the budget, because they gain most. Far from the
// minimum that includes a new Hessian and factor.
#pragma once

#include <cstdint>
#include <limits>

#include "solver/solver_options.hpp"
#include "solver/step_report.hpp"

namespace softhand {

class FactorPolicy {
 public:
  FactorPolicy(const SolverOptions& options, const StepWork& prices);

  /// Of the later steps, in fast steps, > 0.
  void set_work_budget(double work_budget) { options_.work_budget = work_budget; }
  /// `has_factor`: a factor of this step exists. `touches`: the work of a solve of contact alone is reserved.
  void begin_step(double time_step, bool has_factor, bool touches);
  /// Whether this step may reuse a factor in several iterations.
  bool may_reuse() const { return may_reuse_; }
  /// Whether a step may solve contact on the condensed hand.
  bool may_condense() const { return may_condense_; }
  /// Whether a step with a budget computes a Hessian only for a factor that it affords, or to solve contact alone. With
  /// flexible objects, the condensed solve costs several factors. Then saving Hessians gains nothing.
  bool saves_hessians() const { return options_.work_budget > 0 && !options_.condenses_all_contact; }
  /// Whether the next iteration needs no new Hessian.
  bool reuses() const { return reuses_; }

  enum class Renewal : std::uint8_t { none, kinks, whole };
  struct Decision {
    bool stops = false;  ///< the budget allows no further iteration
    Renewal renewal = Renewal::none;
    bool in_double = false;
  };
  /// For the next iteration. `can_renew_kinks`: the last factor is that of the Hessian, and there are terms with kinks.
  /// `condenses`: the iteration solves contact on the condensed hand. It may go beyond the budget.
  Decision decide(const StepReport& report, bool can_renew_kinks, bool condenses) const;
  /// The energy does not fall along the direction of a factor. Changes `decision` to a better factor. Returns false if
  /// there is none, or if the budget allows none.
  bool improve(Decision& decision, bool is_most_precise, const StepReport& report);

  struct Iteration {
    double scale = 0;            ///< of the line search
    bool condenses = false;      ///< terms with kinks were exact (CondensedNewton)
    double move = 0;             ///< the largest, relative to its tolerance
    double residual_before = 0;  ///< N and N m
    bool measured = false;       ///< the report's residual is that of the result
  };
  /// Learns from an iteration with `decision`.
  void learn(const Decision& decision, const Iteration& iteration, const StepReport& report);
  /// The energy has changed after an iteration (`Energy::revise`). Unless `keeps_factor`, the last factor lacks the new
  /// contacts, so the next iteration renews it.
  void start_again(bool keeps_factor);
  /// By the residual and by the estimated remaining movement.
  bool has_converged(const StepReport& report) const;
  /// Work that the solves of an iteration may take, so that its line search fits into the budget.
  double work_for_solves(const StepReport& report) const { return remaining_work(report) - evaluation_work_; }
  bool affords_whole_factor(const StepReport& report) const { return remaining_work(report) >= whole_work_; }
  /// Whether the step has taken all work that it may take beyond its budget.
  bool exceeds_overrun(const StepReport& report) const;
  /// Whether the residual is so small that the step is near its minimum.
  static bool is_balanced(const StepReport& report);

  /// What one step leaves to the next.
  struct Carried {
    double time_step = 0;          ///< of the factor to reuse, s; 0: none
    bool was_cut_off_far = false;  ///< the budget stopped the last step far from the minimum
    bool touches_much = false;     ///< since this contact began: more blocks than the condensed model has room for
  };
  /// `fastest`: m/s, speed of the fastest node at the end of the step.
  void end_step(double time_step, double fastest, const StepReport& report);
  /// No later step reuses the factor that exists now.
  void drop_factor() { carried_.time_step = 0; }
  void set_touches_much(bool touches_much) { carried_.touches_much = touches_much; }
  const Carried& carried() const { return carried_; }
  void set_carried(const Carried& carried) { carried_ = carried; }

 private:
  double remaining_work(const StepReport& report) const;

  SolverOptions options_;
  bool may_condense_;
  double equivalent_iterations_;
  double evaluation_work_, contact_work_;
  // Of an iteration: with the last factor, with a factor renewed in the terms with kinks, and with a new Hessian and
  // factor.
  double reuse_work_, kinks_work_, whole_work_;
  Carried carried_;

  // Within a step.
  bool may_reuse_ = false;
  bool has_factor_ = false;    // an iteration or `begin_step` had one
  bool is_first_ = true;       // the next iteration is the first one
  bool reuses_ = false;        // the next iteration reuses the last factor
  bool in_double_ = false;     // the next factors are in double
  bool needs_double_ = false;  // a float factor made no progress
  bool double_helps_ = true;   // double converges better than float if float converges slowly; true until disproved
  bool is_revised_ = false;    // after the last iteration
  int consecutive_kinks_ = 0;  // iterations so far whose factor was renewed only in the terms with kinks
  double reserved_ = 0;        // work for a solve of contact alone
  double last_move_ = 0;
  double contraction_ = 0;
  double remaining_move_ = std::numeric_limits<double>::infinity();  // relative to the tolerance
  double estimated_move_ = std::numeric_limits<double>::infinity();  // the same in m; a revision does not forget it
};

}  // namespace softhand
