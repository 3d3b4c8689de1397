// Factorisation and solve of the shipped hands (factor_turns.hpp). Pin it to a core: `taskset -c 1 bin/bench_cholesky`.
#include <benchmark/benchmark.h>

#include "bench/factor_turns.hpp"

namespace softhand {
namespace {

void factor_and_solve(benchmark::State& bench) {
  bench::FactorTurns turns(static_cast<int>(bench.range(0)));
  for (auto _ : bench) turns.turn(true);
  bench.counters["double_ms"] = 1e3 * turns.block();
  bench.counters["of_it_solve_ms"] = 1e3 * turns.block_solve();
  bench.counters["float_ms"] = 1e3 * turns.single();
  bench.counters["cholmod_ms"] = 1e3 * turns.cholmod();
  bench.counters["eigen_ms"] = 1e3 * turns.eigen();
  bench.counters["gradients_ms"] = 1e3 * turns.conjugate_gradients();
  bench.counters["gradients_iterations"] = static_cast<double>(turns.gradients_iterations());
  bench.counters["over_cholmod"] = turns.cholmod() / turns.block();
  bench.counters["float_over_cholmod"] = turns.cholmod() / turns.single();
  bench.counters["over_eigen"] = turns.eigen() / turns.block();
  bench.counters["Mflop"] = 1e-6 * turns.operations();
  bench.counters["dgemm_Gflops"] = 1e-9 * turns.dgemm_rate();
  bench.counters["of_peak"] = turns.fraction_of_peak();
  bench.counters["fronts"] = static_cast<double>(turns.front_count());
  bench.counters["analysis_ms"] = 1e3 * turns.analysis();
}
BENCHMARK(factor_and_solve)
    ->ArgName("nodes")
    ->Arg(400)
    ->Arg(750)
    ->Arg(1450)
    ->Arg(3000)
    ->Arg(6000)
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace softhand
