// Costs of hands that press balls, without a rig (pressing.hpp). Hands that are compared take turns, so that other load
// affects all of them alike.
#pragma once

#include <utility>
#include <vector>

#include "bench/pressing.hpp"

namespace softhand::bench {

struct PressingCost {
  double step = 0, contact = 0;  ///< s, medians
  int touched = 0, contacts = 0;
};
/// Of several hands of 1,450 nodes. `objects`: the touched and the untouched ones of each hand.
std::vector<PressingCost> measure_pressing(const std::vector<std::pair<int, int>>& objects, int steps);

/// Median fast step of a hand with 17 objects in slots, of which it touches one, over that of a hand with this one
/// alone. NaN if it touches others.
double slot_cost_ratio();

struct RelaxationCost {
  double seconds = 0, iterations = 0;
};
/// Of a hand whose tissue relaxes over a hand whose tissue does not. Both are means over whole sways, because the
/// iterations of a step depend on the phase of the sway and differ from sway to sway.
RelaxationCost relaxation_cost_ratio(HandOptions options);

/// Seconds of a step of all hands by the number of hands. Each hand has a loop of its own, as its service has.
std::vector<std::pair<double, double>> by_hands();

}  // namespace softhand::bench
