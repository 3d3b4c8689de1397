// First-order low-pass filters of sampled signals.
#pragma once

#include <cmath>

namespace softhand {

/// Weight of a new sample, 0 to 1. `cutoff`: Hz, `elapsed`: s since the last sample.
inline double low_pass_gain(double cutoff, double elapsed) {
  const double turn = 2 * M_PI * cutoff * elapsed;
  return turn / (1 + turn);
}

}  // namespace softhand
