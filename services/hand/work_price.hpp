// Converts the time that a live step may take into a budget of work.
//
// What a unit of work costs depends on the machine and on the programs beside. It also depends on the kind of work,
// because the model of solver/step_work.hpp has fixed ratios. So the price is measured at start, and learned from the
// live steps afterwards.
#pragma once

namespace softhand {

class WorkPrice {
 public:
  /// Least budget of a live step, in fast steps.
  static double least_budget(bool has_flexible_objects);
  /// `fast_step`: s, cost of a fast step as measured at start, > 0. `step_time`: s, time that a step may take, > 0.
  /// `least_budget`: fast steps, > 0.
  WorkPrice(double fast_step, double step_time, double least_budget);

  /// Nine of ten large steps cost at most this per fast step of work, s.
  double fast_step() const { return fast_step_; }
  /// Work that a step may do, in fast steps, at least `least_budget`.
  double budget() const { return step_time_ / fast_step_; }
  /// A step of `work` fast steps took `seconds`. Steps with less than half of the budget teach nothing, because most of
  /// their time is not that of the solver.
  void learn(double seconds, double work);

 private:
  double step_time_, least_budget_;
  double fast_step_;
};

}  // namespace softhand
