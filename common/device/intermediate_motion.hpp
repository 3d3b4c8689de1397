// How a bone of the intermediate skeleton moves on after its sample: with its mean velocity over the last samples.
//
// The spring to the tracked bone is stiff. So the intermediate bone jumps in the first milliseconds after each sample
// of the tracker. A good tracker's noise of 0.1 mm gives it 0.3 m/s. The hand's steps begin at that time
// (`hand.phase_lock`). So the velocity in a sample says little about the next milliseconds.
#pragma once

namespace softhand {

/// The low-pass filter of the mean velocity: its next value after a sample that is `moved` from the one before,
/// `elapsed` s later. `Value` is a number or a vector.
template <typename Value>
Value mean_velocity(const Value& before, const Value& moved, double elapsed) {
  constexpr double kSmoothing = 20e-3;  // s. With less, the mean overshoots more, and soft couplings are less stable.
  return (kSmoothing * before + moved) / (elapsed + kSmoothing);
}

}  // namespace softhand
