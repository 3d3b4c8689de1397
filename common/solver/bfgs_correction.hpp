// Limited-memory BFGS around a factor that serves several iterations (Nocedal, "Updating quasi-Newton matrices with
// limited storage", Mathematics of Computation 35, 1980).
//
// The factor F of an earlier Hessian gives the direction d = -F^-1 g. Since then the Hessian H has changed, so each
// iteration leaves a similar part of the residual. An iteration that moves by s changes the gradient by y, which is
// about H s. BFGS corrects F so that F s = y for the last moves. This needs no solve: F^-1 y is minus the change of d.
#pragma once

#include <array>

#include "model/state.hpp"

namespace softhand {

class BfgsCorrection {
 public:
  explicit BfgsCorrection(DofLayout layout);

  /// Forgets all moves. Call it if the factor or the terms change, or if the state moves between two iterations.
  void clear() {
    count_ = 0;
    has_last_ = false;
  }
  /// Corrects `direction`, which is the factor's direction at this gradient. Returns false, and changes nothing, if no
  /// moves are known or if the energy would not fall along the corrected direction. Does not allocate.
  bool correct(const VectorX& gradient, VectorX& direction);
  /// The state has moved by `scale` times `direction` since the last call of `correct`.
  void add_move(const VectorX& direction, double scale);

 private:
  static constexpr std::size_t kMoves = 4;
  struct Move {
    VectorX move, gradient_change, direction_change;
    double curvature = 0;  // move . gradient_change
  };

  double dot(const VectorX& a, const VectorX& b) const { return inner_product(layout_, a, b); }
  const Move& move_of_age(std::size_t age) const { return moves_[(next_ + kMoves - 1 - age) % kMoves]; }
  void store_last(const VectorX& gradient, const VectorX& direction);

  DofLayout layout_;
  std::array<Move, kMoves> moves_;  // a ring
  std::size_t count_ = 0, next_ = 0;
  bool has_last_ = false;  // the three vectors below are those of the last iteration
  VectorX last_gradient_, last_direction_, last_move_;
  VectorX corrected_;
};

}  // namespace softhand
