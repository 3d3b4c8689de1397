// Where the time of a fast step goes, by mesh size: bars of tissue swaying under their own weight. Pin it: `taskset -c 1 bin/bench_solver`.
#include <benchmark/benchmark.h>

#include "energies/inertia.hpp"
#include "energies/tissue.hpp"
#include "math/polar.hpp"
#include "solver/newton_solver.hpp"
#include "support/box_mesh.hpp"

namespace softhand {
namespace {

const Material kSkin{"skin", 1000, 1e5, 0.45, 500, 500};

HandModel bar(int cells) { return testing::box_mesh({4 * cells, cells, 2 * cells}, Vector3(0.16, 0.02, 0.08), kSkin); }

void fast_step(benchmark::State& bench) {
  const HandModel box = bar(static_cast<int>(bench.range(0)));
  State state = testing::rest_state(box);
  Tissue tissue(box);
  std::vector<double> masses = lumped_masses(box);
  for (int n = 0; n < box.node_count(); ++n) {
    if (box.nodes[static_cast<std::size_t>(n)].x() == 0) masses[static_cast<std::size_t>(n)] = 1e6;  // held
  }
  Inertia inertia(masses, 0);
  for (int n = 0; n < box.node_count(); ++n) {
    if (masses[static_cast<std::size_t>(n)] < 1) inertia.set_node_gravity(n, Vector3(0, -9.81, 0));
  }
  SolverOptions options;
  options.measure_result = bench.range(1) != 0;
  NewtonSolver solver({&inertia, &tissue}, state.layout(), options);
  StepTiming sum;
  for (auto _ : bench) {
    const StepTiming timing = solver.step(state, 1.0 / 90).timing;
    sum.energies += timing.energies;
    sum.assembly += timing.assembly;
    sum.factorisation += timing.factorisation;
    sum.solve += timing.solve;
  }
  const auto mean_ms = [&bench](double seconds) { return benchmark::Counter(1e3 * seconds / static_cast<double>(bench.iterations())); };
  bench.counters["nodes"] = box.node_count();
  bench.counters["tetrahedra"] = static_cast<double>(box.tetrahedra.size());
  bench.counters["energies_ms"] = mean_ms(sum.energies);
  bench.counters["assembly_ms"] = mean_ms(sum.assembly);
  bench.counters["factor_ms"] = mean_ms(sum.factorisation);
  bench.counters["solve_ms"] = mean_ms(sum.solve);
}
BENCHMARK(fast_step)->ArgNames({"cells", "measured"})->ArgsProduct({{3, 4, 5, 7, 8}, {0, 1}})->Unit(benchmark::kMillisecond);

void tissue_all(benchmark::State& bench) {
  const HandModel box = bar(4);
  State state = testing::rest_state(box);
  testing::Random random(1);
  for (int n = 0; n < box.node_count(); ++n) state.node_positions.col(n) += 5e-4 * random.vector();
  Tissue tissue(box);
  BlockPattern pattern(box.node_count());
  tissue.add_pattern(pattern);
  BlockMatrix matrix(pattern);
  tissue.bind(matrix);
  VectorX gradient = VectorX::Zero(3 * box.node_count());
  for (auto _ : bench) {
    if (bench.range(0) == 0) {
      benchmark::DoNotOptimize(tissue.value(state));
    } else {
      benchmark::DoNotOptimize(tissue.add_all(state, gradient, matrix, Curvature::projected));
    }
  }
  bench.counters["per_tet"] =
      benchmark::Counter(static_cast<double>(box.tetrahedra.size()) * static_cast<double>(bench.iterations()), benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}
BENCHMARK(tissue_all)->ArgName("derivatives")->Arg(0)->Arg(1)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace softhand
