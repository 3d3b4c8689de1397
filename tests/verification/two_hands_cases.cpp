// Two hands in one simulation: a thrown hand meets a hand at rest.
#include <algorithm>

#include "support/block_hand.hpp"
#include "support/two_hands.hpp"
#include "verification/cases.hpp"

namespace softhand::verification {
namespace {

// Nothing holds the hands. One is thrown at the other, so only their skins pass momentum on. The throw is not along the
// normal of the palms: friction acts too.
std::vector<Measurement> clap(const Parameters& p) {
  constexpr double kGap = 0.004, kSeconds = 0.06;
  SimulationOptions options;
  options.solver.max_iterations = 200;
  options.solver.residual_tolerance = 1e-7;
  options.solver.movement_tolerance = 1;
  options.solver.increment_tolerance = 1e-13;
  options.solver.chord_tolerance = 0;
  testing::PalmToPalm hands(testing::block_hand(), options, kGap);
  const double speed = p["speed"], step = p["step"];
  hands.throw_hand(1, speed * Vector3(0.1, 1, 0.05));
  const Vector3 before = hands.momentum(1);
  double largest = 0, unbalanced = 0;
  for (int i = 0; i < static_cast<int>(kSeconds / step); ++i) {
    hands.simulation.step(step);
    const Vector3 on_first = hands.force_on(0), on_second = hands.force_on(1);
    largest = std::max(largest, on_first.norm());
    unbalanced = std::max(unbalanced, (on_first + on_second).norm());
  }
  const Vector3 change = hands.momentum(0) + hands.momentum(1) - before;
  return {{"change of the momentum of both over the first momentum", change.norm() / before.norm(), 0, 1e-6, "1", {}},
          {"sum of both forces over the largest force", unbalanced / largest, 0, 1e-9, "1", {}},
          {"momentum taken over by the other hand, at least 0.2 of the first",
           std::min(0.2, hands.momentum(0).dot(before) / before.squaredNorm()),
           0.2,
           1e-9,
           "1",
           {}}};
}

}  // namespace

std::vector<Case> two_hands_cases() {
  return {{"two_hands_clap",
           "m_1 v_1 + m_2 v_2 stays; the force of each hand on the other sums to 0",
           {{{"speed", 1}, {"step", 1e-3}}, {{"speed", 5}, {"step", 1e-3}}},
           clap}};
}

}  // namespace softhand::verification
