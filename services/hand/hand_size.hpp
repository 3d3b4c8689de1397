// `hand.model = "auto"`: which of several sizes of a hand this machine has time for.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "hand/hand_options.hpp"
#include "model/hand_model.hpp"

namespace softhand {

struct HandSizeChoice {
  std::size_t size = 0;            ///< index of the chosen size
  std::vector<double> fast_steps;  ///< s, of the sizes that were measured
  /// Fast steps of the chosen size that fit into the budget.
  double budget_fast_steps = 0;
};

/// Chooses the finest of `count` sizes, ordered from coarse to fine, whose budget (s) is at least two fast steps, else
/// the coarsest. `measure(size)` returns the seconds of a fast step. Sizes beyond the first one that is too fine are
/// not measured.
HandSizeChoice choose_hand_size(std::size_t count, double budget, const std::function<double(std::size_t)>& measure);

/// Median time of a fast step of this hand in the air, seconds on `clock`: one evaluation, factorisation and solve.
/// Makes up to nine such steps, and fewer where the first ones take longer than `enough`.
double measure_fast_step(const HandModel& hand, const HandOptions& options, double enough,
                         const std::function<double()>& clock);

}  // namespace softhand
