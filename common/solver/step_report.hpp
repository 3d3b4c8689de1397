// What a step did and what it cost.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string_view>

#include "solver/step_work.hpp"

namespace softhand {

enum class StepStatus : std::uint8_t {
  converged,             ///< by residual or increment
  iteration_limit,       ///< all iterations done, or no further descent in floating point; normal for the fast mode
  budget_spent,          ///< stopped by the work budget
  failed_factorisation,  ///< not positive definite even when shifted; the state is the best one so far, or unchanged
  nonfinite,             ///< NaN or infinity; the state is the one before the step
  refused,               ///< bad time step, or the state is not finite or has another layout; nothing was done
};
std::string_view to_string(StepStatus status);

/// Seconds on the solver's clock.
struct StepTiming {
  double begin = 0;     ///< begin_step of all terms: contact detection
  double energies = 0;  ///< values, gradients, Hessians with their scatter; the line search
  double assembly = 0;  ///< clearing and gathering the matrix
  double factorisation = 0;
  double solve = 0;
  double end = 0;  ///< end_step of all terms
  double total() const { return begin + energies + assembly + factorisation + solve + end; }
};

inline constexpr std::size_t kMaxTerms = 32;

struct TermEnergy {
  std::string_view name;
  double joules = 0;
  double start = 0;  ///< the same at the step's start, J; 0 after a chord step unless requested (`measure_work`)
  double taken = 0;  ///< gradient . dq, dq the step's whole increment, J; 0 unless requested (`measure_work`)
};

struct StepReport {
  StepStatus status = StepStatus::refused;
  int iterations = 0;      ///< Newton steps taken
  int factorisations = 0;  ///< of new Hessians; the other iterations reused a factor of this step or an earlier one
  int kink_factors = 0;    ///< among `factorisations`: only the terms with kinks were new
  int contact_solves = 0;  ///< solves of contact alone, after the last iteration (LocalNewton)
  int double_factors = 0;  ///< among `factorisations`: in double because the float factor failed or made no progress
  double residual = 0;     ///< largest |dE/dq|, N and N m
  double increment = 0;    ///< largest move of the last iteration, m and rad
  double energy = 0;       ///< E, J
  bool state_changed = false;  ///< the step was taken, velocities included; false: `state` is bitwise unchanged
  bool measured = false;       ///< energy, residual and terms are those of the result
  double work = 0;             ///< in fast steps (step_work.hpp)
  int shifts = 0;              ///< factorisations repeated with a diagonal shift
  bool chord = false;          ///< the step was a chord step (newton_solver.hpp)
  std::size_t term_count = 0;
  std::array<TermEnergy, kMaxTerms> terms{};  ///< E by term, the first `term_count`
  StepTiming timing;

  /// Bound of the rounding error of `energy`, J.
  double rounding() const;
};

/// The report of a step in progress, with the clock and the prices of its work.
class StepMeter {
 public:
  /// Both must outlive the meter.
  StepMeter(const StepWork& work_prices, const std::function<double()>& clock) : prices(work_prices), clock_(clock) {}

  StepReport report;
  const StepWork& prices;

  /// Adds the time until its destruction to a part of the step.
  class Timer {
   public:
    Timer(double& part, const std::function<double()>& clock) : part_(part), clock_(clock), begin_(clock()) {}
    ~Timer() { part_ += clock_() - begin_; }
    Timer(const Timer&) = delete;
    Timer& operator=(const Timer&) = delete;

   private:
    double& part_;
    const std::function<double()>& clock_;
    double begin_;
  };
  [[nodiscard]] Timer time(double StepTiming::*part) { return {report.timing.*part, clock_}; }
  /// Sets the report back to an earlier one, except for the time and the work spent since.
  void restore(const StepReport& earlier);

 private:
  const std::function<double()>& clock_;
};

}  // namespace softhand
