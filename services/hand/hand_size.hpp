// `hand.model = "auto"`: chooses the finest hand that this machine can simulate in time.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "hand/hand_options.hpp"
#include "model/hand_model.hpp"
#include "scene/soft_objects.hpp"

namespace softhand {

struct HandSizeChoice {
  std::size_t size = 0;            ///< index of the chosen size
  std::vector<double> fast_steps;  ///< s, of the measured sizes
  /// Number of fast steps of the chosen size in the budget.
  double budget_fast_steps = 0;
};

/// Fast steps that a chosen hand can take at least: two, and four with flexible objects.
double least_fast_steps(bool has_flexible_objects);

/// Chooses the finest of `count` sizes for which the budget (s) is at least `least` fast steps. If no size fits,
/// chooses the coarsest. Sizes are ordered from coarse to fine. `measure(size)` returns the seconds of a fast step. The
/// search stops at the first size that is too fine.
HandSizeChoice choose_hand_size(std::size_t count, double budget, double least,
                                const std::function<double(std::size_t)>& measure);

/// Expected time of the work of a fast step in a live process, in seconds of `clock`. The process simulates one or two
/// hands and the flexible objects of the scene. It is the median of up to nine steps, times an allowance for what a
/// live step has in addition. The hands move to and fro on a table, with a budget of two fast steps. The steps find
/// their data in no cache of a core. Stops after three or more steps if all samples are longer than `enough` (s).
double measure_fast_step(const std::vector<HandModel>& hands, const HandOptions& options,
                         const std::vector<SoftObject>& soft_objects, double enough,
                         const std::function<double()>& clock);

}  // namespace softhand
