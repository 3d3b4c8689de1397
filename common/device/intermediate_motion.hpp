// How a bone of the intermediate skeleton moves on after its sample.
#pragma once

#include <algorithm>
#include <cmath>

namespace softhand {

/// The spring to the tracked bone is stiff. So the intermediate bone jumps after each sample of the tracker, within
/// about this time. A good tracker's noise of 0.1 mm then gives it 0.3 m/s. Only its mean velocity lasts longer. s.
inline constexpr double kIntermediateJumpTime = 1e-3;

/// Younger samples than this are not late: two periods of the tracking loop at its default rate. s.
inline constexpr double kIntermediateFreshTime = 2e-3;

/// The bone's displacement is `own_time` v + `mean_time` m, and its velocity is `own_share` v + (1 - `own_share`) m.
/// Here v is the velocity in the sample, and m is the mean velocity over the last samples.
struct IntermediateMotion {
  double own_time = 0;   ///< s
  double mean_time = 0;  ///< s
  double own_share = 1;
};

/// `age` of the sample, s, >= 0. The velocity in the sample counts in full while the sample is fresh. Then it decays.
inline IntermediateMotion intermediate_motion(double age) {
  const double late = std::max(0.0, age - kIntermediateFreshTime);
  const double own_share = std::exp(-late / kIntermediateJumpTime);
  const double own_time = age - late + kIntermediateJumpTime * (1 - own_share);
  return {own_time, std::max(0.0, age - own_time), own_share};
}

/// The low-pass filter of m: its next value after a sample that is `moved` from the one before, `elapsed` s later.
/// `Value` is a number or a vector.
template <typename Value>
Value mean_velocity(const Value& before, const Value& moved, double elapsed) {
  constexpr double kSmoothing = 20e-3;  // s. With less, the mean overshoots more, and soft couplings are less stable.
  return (kSmoothing * before + moved) / (elapsed + kSmoothing);
}

}  // namespace softhand
