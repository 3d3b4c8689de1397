// Nanoseconds per tetrahedron of the tissue's kernels, by instruction set, compared with the scalar reference. Pin it
// to a core: `taskset -c 1 bin/bench_tissue`.
#include <benchmark/benchmark.h>

#include <memory>

#include "bench/tissue_sample.hpp"
#include "energies/tissue.hpp"
#include "support/scalar_tissue.hpp"

namespace softhand {
namespace {

enum Outputs { value_only, value_and_gradient, everything, single_hessian };

void tissue(benchmark::State& bench) {
  bench::TissueSample sample;
  std::unique_ptr<Energy> term;
  if (bench.range(0) < 0) {
    term = std::make_unique<testing::ScalarTissue>(sample.box);
    bench.SetLabel("scalar");
  } else {
    const auto set = static_cast<InstructionSet>(bench.range(0));
    if (!is_supported(set)) {
      bench.SkipWithError("not supported by this processor");
      return;
    }
    auto tissue = std::make_unique<Tissue>(sample.box, set);
    if (bench.range(1) == single_hessian) tissue->use_single_hessian();
    term = std::move(tissue);
    bench.SetLabel(std::string(to_string(set)));
  }
  sample.bind(*term);
  for (auto _ : bench) {
    switch (bench.range(1)) {
      case value_only:
        benchmark::DoNotOptimize(term->value(sample.state));
        break;
      case value_and_gradient:
        term->add_gradient(sample.state, sample.gradient);
        break;
      default:
        benchmark::DoNotOptimize(sample.all(*term));
    }
  }
  bench.counters["per_tet"] =
      benchmark::Counter(static_cast<double>(sample.box.tetrahedra.size()) * static_cast<double>(bench.iterations()),
                         benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}
BENCHMARK(tissue)
    ->ArgNames({"set", "wanted"})
    ->ArgsProduct({{-1, 0, 1, 2}, {value_only, value_and_gradient, everything, single_hessian}})
    ->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace softhand
