// A bracket of the minimum along a line, by the slopes at its ends.
#pragma once

#include <algorithm>

namespace softhand {

/// Regula falsi on the slope with the Illinois rule (Dowell and Jarratt 1971, BIT 11:168). If one end stays for two
/// trials, its slope is halved, so that it moves.
class SlopeBracket {
 public:
  /// `slope` (< 0) is that of the function at scale 0.
  explicit SlopeBracket(double slope) : low_slope_(slope) {}
  /// The largest scale at which the function is known to fall.
  double low() const { return low_; }
  double low_slope() const { return low_slope_; }
  /// The smallest scale at which the function rises, or has not fallen enough. 0: not known.
  double high() const { return high_; }

  void set_low(double scale, double slope) {
    low_ = scale;
    low_slope_ = slope;
  }
  /// Replaces the end on the side of a trial at `scale`. `falls`: the function has fallen enough there.
  void narrow(double scale, double slope, bool falls) {
    const bool is_low = falls && slope < 0;
    if (is_low) {
      set_low(scale, slope);
    } else {
      high_ = scale;
      high_slope_ = slope;
    }
    if (last_ == (is_low ? End::low : End::high)) (is_low ? high_slope_ : low_slope_) *= 0.5;
    last_ = is_low ? End::low : End::high;
  }
  /// The next trial, inside the bracket.
  double next() const {
    const double root = high_slope_ > 0 ? low_slope_ / (low_slope_ - high_slope_) : 0.5;
    return low_ + std::clamp(root, kInside, 1 - kInside) * (high_ - low_);
  }

 private:
  enum class End { none, low, high };
  static constexpr double kInside = 0.05;  // least distance of a trial from the ends, as a fraction of the bracket
  double low_ = 0, low_slope_;
  double high_ = 0, high_slope_ = 0;
  End last_ = End::none;  // replaced by the last trial
};

}  // namespace softhand
