#include "bench/pressing_costs.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <memory>

#include "bench/measure.hpp"

namespace softhand::bench {
namespace {

constexpr const char* kHand = "right_1450.hand.json";

// Median step of the first hand over that of the second.
double cost_ratio(std::array<Pressing, 2>& hands) {
  constexpr int kSteps = 120;
  std::array<std::vector<double>, 2> times;
  for (Pressing& hand : hands) hand.settle();
  for (int i = 0; i < kSteps; ++i) {
    for (std::size_t k = 0; k < hands.size(); ++k)
      times[k].push_back(hands[k].step([](auto&& work) { return seconds_of(work); }));
  }
  return median(times[0]) / median(times[1]);
}

}  // namespace

std::vector<PressingCost> measure_pressing(const std::vector<std::pair<int, int>>& objects, int steps) {
  std::vector<std::unique_ptr<Pressing>> hands;
  for (const auto& [touched, untouched] : objects) hands.push_back(std::make_unique<Pressing>(touched, untouched));
  std::vector<std::vector<double>> times(hands.size()), contact(hands.size());
  for (const auto& hand : hands) hand->settle();
  for (int i = 0; i < steps; ++i) {
    for (std::size_t k = 0; k < hands.size(); ++k) {
      times[k].push_back(hands[k]->step([](auto&& work) { return seconds_of(work); }));
      contact[k].push_back(hands[k]->contact_seconds());
    }
  }
  std::vector<PressingCost> costs;
  for (std::size_t k = 0; k < hands.size(); ++k)
    costs.push_back({median(times[k]), median(contact[k]), hands[k]->touched_objects(), hands[k]->contacts()});
  return costs;
}

double slot_cost_ratio() {
  constexpr int kIdle = 16;
  HandOptions fast;
  fast.simulation.solver.max_iterations = 1;
  fast.near_distance = 0.3;
  std::array<Pressing, 2> hands{Pressing(1, kIdle, 0.02, kHand, fast, kIdle + 1), Pressing(1, 0, 0.02, kHand, fast, 1)};
  const double ratio = cost_ratio(hands);
  const bool valid = hands[0].mirrored_objects() == kIdle + 1 && hands[0].touched_objects() == 1;
  return valid ? ratio : std::nan("");
}

RelaxationCost relaxation_cost_ratio(HandOptions options) {
  constexpr int kSways = 20;
  HandOptions relaxing = options;
  relaxing.simulation.relaxation.active = true;
  std::array<Pressing, 2> hands{Pressing(1, 0, 0.02, kHand, relaxing, 1), Pressing(1, 0, 0.02, kHand, options, 1)};
  std::array<RelaxationCost, 2> sums;
  for (Pressing& hand : hands) hand.settle();
  for (int i = 0; i < kSways * Pressing::kStepsPerSway; ++i) {
    for (std::size_t k = 0; k < hands.size(); ++k) {
      sums[k].seconds += hands[k].step([](auto&& work) { return seconds_of(work); });
      sums[k].iterations += hands[k].iterations();
    }
  }
  return {sums[0].seconds / sums[1].seconds, sums[0].iterations / sums[1].iterations};
}

std::vector<std::pair<double, double>> by_hands() {
  constexpr int kSteps = 20;
  std::vector<std::unique_ptr<Pressing>> hands;
  std::vector<std::pair<double, double>> seconds;
  for (const std::size_t count : {1u, 2u, 4u, 8u}) {
    while (hands.size() < count) {
      hands.push_back(std::make_unique<Pressing>(5, 0));
      hands.back()->settle();
    }
    std::vector<double> times;
    for (int i = 0; i < kSteps; ++i) {
      double all = 0;
      for (const auto& hand : hands) all += hand->step([](auto&& work) { return seconds_of(work); });
      times.push_back(all);
    }
    seconds.emplace_back(count, median(times));
  }
  return seconds;
}

}  // namespace softhand::bench
