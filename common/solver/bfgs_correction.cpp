#include "solver/bfgs_correction.hpp"

#include <algorithm>

namespace softhand {

BfgsCorrection::BfgsCorrection(DofLayout layout) : layout_(layout) {
  const VectorX zero = VectorX::Zero(layout.dof_count());
  for (Move& each : moves_) each.move = each.gradient_change = each.direction_change = zero;
  last_gradient_ = last_direction_ = last_move_ = corrected_ = zero;
}

// Stores the last iteration's move if H is positive along it, as the factor is.
void BfgsCorrection::store_last(const VectorX& gradient, const VectorX& direction) {
  Move& last = moves_[next_];
  last.move = last_move_;
  last.gradient_change = gradient - last_gradient_;
  last.direction_change = direction - last_direction_;
  last.curvature = dot(last.move, last.gradient_change);
  if (!(last.curvature > 0) || !(dot(last.direction_change, last.gradient_change) < 0)) return;
  next_ = (next_ + 1) % kMoves;
  count_ = std::min(count_ + 1, kMoves);
}

// Nocedal's recursion of two loops. The first one finds F^-1 q of q = g - sum factor y from what is known:
// F^-1 g = -d and F^-1 y = -(change of d).
bool BfgsCorrection::correct(const VectorX& gradient, VectorX& direction) {
  if (has_last_) store_last(gradient, direction);
  last_gradient_ = gradient;
  last_direction_ = direction;
  has_last_ = false;
  if (count_ == 0) return false;
  std::array<double, kMoves> factors{};
  corrected_ = direction;
  for (std::size_t age = 0; age < count_; ++age) {
    const Move& each = move_of_age(age);
    double product = dot(each.move, gradient);
    for (std::size_t later = 0; later < age; ++later)
      product -= factors[later] * dot(each.move, move_of_age(later).gradient_change);
    factors[age] = product / each.curvature;
    corrected_ -= factors[age] * each.direction_change;
  }
  for (std::size_t age = count_; age-- > 0;) {
    const Move& each = move_of_age(age);
    corrected_ -= (factors[age] + dot(each.gradient_change, corrected_) / each.curvature) * each.move;
  }
  if (!(dot(gradient, corrected_) < 0)) return false;
  direction = corrected_;
  return true;
}

void BfgsCorrection::add_move(const VectorX& direction, double scale) {
  last_move_ = scale * direction;
  has_last_ = true;
}

}  // namespace softhand
