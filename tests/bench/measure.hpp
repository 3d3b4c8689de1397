// Measurements of the benchmarks: the thread's own CPU time, quantiles, and the exponent of a cost.
#pragma once

#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace softhand::bench {

/// CPU time of this thread, s. Waiting for a busy processor does not count.
inline double thread_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

template <typename Work>
double seconds_of(Work&& work) {
  const double start = thread_seconds();
  work();
  return thread_seconds() - start;
}

/// The value that at least the fraction `q` of `values` does not exceed. NaN without values.
inline double quantile(std::vector<double> values, double q) {
  if (values.empty()) return std::nan("");
  const auto last = static_cast<double>(values.size() - 1);
  const auto k = static_cast<std::ptrdiff_t>(std::ceil(q * last - 1e-9));
  std::nth_element(values.begin(), values.begin() + k, values.end());
  return values[static_cast<std::size_t>(k)];
}
inline double median(std::vector<double> values) { return quantile(std::move(values), 0.5); }

/// p of the least-squares fit of y = c x^p in logarithms. All values must be > 0, with at least two different x.
inline double exponent(const std::vector<std::pair<double, double>>& points) {
  double sx = 0, sy = 0, sxx = 0, sxy = 0;
  const auto n = static_cast<double>(points.size());
  for (const auto& [x, y] : points) {
    const double u = std::log(x), v = std::log(y);
    sx += u, sy += v, sxx += u * u, sxy += u * v;
  }
  return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

}  // namespace softhand::bench
