// Nanoseconds a tetrahedron of the tissue's kernels, by instruction set, against the scalar reference. Pin it: `taskset -c 1 bin/bench_tissue`.
#include <benchmark/benchmark.h>

#include <memory>

#include "energies/tissue.hpp"
#include "support/box_mesh.hpp"
#include "support/scalar_tissue.hpp"

namespace softhand {
namespace {

enum Wanted { value_only, value_and_gradient, everything };

// A bar of 6,000 tetrahedra, strained by some per cent, so that some pass the strain limit.
void tissue(benchmark::State& bench) {
  const HandModel box = testing::box_mesh({20, 5, 10}, Vector3(0.16, 0.02, 0.08), {"skin", 1000, 1e5, 0.45, 500, 500});
  State state = testing::rest_state(box);
  testing::Random random(1);
  for (int n = 0; n < box.node_count(); ++n) state.node_positions.col(n) += 3e-4 * random.vector();
  std::unique_ptr<Energy> term;
  if (bench.range(0) < 0) {
    term = std::make_unique<testing::ScalarTissue>(box);
    bench.SetLabel("scalar");
  } else {
    const auto set = static_cast<InstructionSet>(bench.range(0));
    if (!is_supported(set)) {
      bench.SkipWithError("not supported by this processor");
      return;
    }
    term = std::make_unique<Tissue>(box, set);
    bench.SetLabel(std::string(to_string(set)));
  }
  BlockPattern pattern(box.node_count());
  term->add_pattern(pattern);
  BlockMatrix matrix(pattern);
  term->bind(matrix);
  VectorX gradient = VectorX::Zero(3 * box.node_count());
  for (auto _ : bench) {
    switch (bench.range(1)) {
      case value_only: benchmark::DoNotOptimize(term->value(state)); break;
      case value_and_gradient: term->add_gradient(state, gradient); break;
      default: benchmark::DoNotOptimize(term->add_all(state, gradient, matrix, Curvature::projected));
    }
  }
  bench.counters["per_tet"] = benchmark::Counter(static_cast<double>(box.tetrahedra.size()) * static_cast<double>(bench.iterations()),
                                                 benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}
BENCHMARK(tissue)->ArgNames({"set", "wanted"})->ArgsProduct({{-1, 0, 1, 2}, {value_only, value_and_gradient, everything}})->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace softhand
