// Factor + solve of the shipped hands in a grasp: the block factorisation in double and float against CHOLMOD supernodal and Eigen's SimplicialLDLT in the same run,
// and its rate against dgemm's. The solvers take turns, so that other load on the machine hits all alike; times are the thread's own. Pin it: `taskset -c 1 bin/bench_cholesky`.
#include <benchmark/benchmark.h>

#include <time.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <string>
#include <vector>

#include "solver/block_cholesky.hpp"
#include "solver/cholmod_solver.hpp"
#include "support/hand_matrix.hpp"

extern "C" void dgemm_(const char*, const char*, const int*, const int*, const int*, const double*, const double*, const int*, const double*, const int*, const double*,
                       double*, const int*);

namespace softhand {
namespace {

// Of this thread's own work: waiting for a busy processor does not count.
double seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

template <typename Work>
double seconds_of(Work work) {
  const double start = seconds();
  work();
  return seconds() - start;
}

double median(std::vector<double> times) {
  std::nth_element(times.begin(), times.begin() + static_cast<std::ptrdiff_t>(times.size() / 2), times.end());
  return times[times.size() / 2];
}

void factor_and_solve(benchmark::State& bench) {
  const BlockMatrix matrix = testing::hand_matrix(std::string(SOFTHAND_SOURCE_DIR "/config/hands/right_") + std::to_string(bench.range(0)) + ".hand.json");
  const VectorX rhs = VectorX::Ones(3 * matrix.block_count());
  VectorX x(rhs.size());
  BlockCholesky<double> block;
  BlockCholesky<float> single;
  CholmodSolver cholmod;
  const double analysis = seconds_of([&] { block.analyze(matrix); });
  single.analyze(matrix);
  cholmod.analyze(matrix);
  const Eigen::SparseMatrix<double> sparse = matrix.dense().sparseView();
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> eigen;
  eigen.analyzePattern(sparse);

  constexpr int kSize = 384;
  const std::vector<double> a(kSize * kSize, 1.0);
  std::vector<double> c(kSize * kSize);
  const double one = 1, zero = 0;
  std::vector<double> block_times, block_solves, single_times, cholmod_times, eigen_times, dgemm_times;
  const auto time = [&](LinearSolver& solver, std::vector<double>& times) {
    // Twice, the second counts: the solver before has left its own data in the caches.
    for (int run = 0; run < 2; ++run) {
      const double taken = seconds_of([&] {
        solver.load(matrix);
        if (!solver.factorize()) bench.SkipWithError("not positive definite");
        solver.solve(rhs, x);
      });
      if (run == 1) times.push_back(taken);
    }
  };
  for (auto _ : bench) {
    time(block, block_times);
    block_solves.push_back(seconds_of([&] { block.solve(rhs, x); }));
    time(single, single_times);
    time(cholmod, cholmod_times);
    eigen_times.push_back(seconds_of([&] {
      eigen.factorize(sparse);
      x = eigen.solve(rhs);
    }));
    dgemm_times.push_back(seconds_of([&] { dgemm_("N", "N", &kSize, &kSize, &kSize, &one, a.data(), &kSize, a.data(), &kSize, &zero, c.data(), &kSize); }));
  }
  const double factor = median(block_times) - median(block_solves);
  const double rate = block.floating_point_operations() / factor;
  const double peak = 2.0 * kSize * kSize * kSize / median(dgemm_times);
  bench.counters["double_ms"] = 1e3 * median(block_times);
  bench.counters["of_it_solve_ms"] = 1e3 * median(block_solves);
  bench.counters["float_ms"] = 1e3 * median(single_times);
  bench.counters["cholmod_ms"] = 1e3 * median(cholmod_times);
  bench.counters["eigen_ms"] = 1e3 * median(eigen_times);
  bench.counters["over_cholmod"] = median(cholmod_times) / median(block_times);
  bench.counters["float_over_cholmod"] = median(cholmod_times) / median(single_times);
  bench.counters["over_eigen"] = median(eigen_times) / median(block_times);
  bench.counters["Mflop"] = 1e-6 * block.floating_point_operations();
  bench.counters["dgemm_Gflops"] = 1e-9 * peak;
  bench.counters["of_peak"] = rate / peak;
  bench.counters["fronts"] = static_cast<double>(block.front_count());
  bench.counters["analysis_ms"] = 1e3 * analysis;
}
BENCHMARK(factor_and_solve)->ArgName("nodes")->Arg(400)->Arg(750)->Arg(1450)->Arg(3000)->Arg(6000)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace softhand
