// Steps for callgrind to count: one dump a row, and a line that says of what. The shipped hand of 400 nodes in the method's fast mode.
#include <valgrind/callgrind.h>

#include <cstdio>
#include <memory>
#include <utility>
#include <vector>

#include "bench/pressing.hpp"

namespace {

// Few, because valgrind takes a second for a step: it computes fused multiply-adds one by one.
constexpr int kSettlingSteps = 2;

softhand::HandOptions fast_mode() {
  softhand::HandOptions options;
  options.simulation.solver.max_iterations = 1;
  options.simulation.solver.measure_result = false;
  return options;
}

}  // namespace

int main() {
  struct Row {
    int touched, untouched;
    double clearance;  // m
    std::unique_ptr<softhand::bench::Pressing> hand{};
  };
  std::vector<Row> rows;
  rows.push_back({1, 0, 0});
  rows.push_back({2, 0, 0});
  rows.push_back({3, 0, 0});
  rows.push_back({4, 0, 0});
  rows.push_back({5, 0, 0});
  rows.push_back({5, 95, 0.02});
  rows.push_back({5, 95, 0.5});
  // All are ready before counting starts, which makes valgrind translate everything anew.
  for (Row& row : rows) {
    row.hand = std::make_unique<softhand::bench::Pressing>(row.touched, row.untouched, row.clearance, "right_400.hand.json", fast_mode());
    row.hand->settle(kSettlingSteps);
  }
  CALLGRIND_START_INSTRUMENTATION;
  for (const Row& row : rows) {
    CALLGRIND_ZERO_STATS;
    row.hand->step([](auto&& work) { work(); });
    CALLGRIND_DUMP_STATS;
    std::printf("%d %d %d %g %d\n", row.touched, row.hand->touched_objects(), row.untouched, row.clearance, row.hand->contacts());
  }
}
