#include "solver/line_search.hpp"

#include <algorithm>
#include <limits>

#include "solver/slope_bracket.hpp"

namespace softhand {
namespace {

constexpr int kMaxHalvings = 30;
constexpr double kArmijo = 1e-4;
constexpr int kMaxBracketings = 6;
// Limits of the slope at the end of a line search, as fractions of the slope at its start.
constexpr double kLevel = 0.5;   // beyond the minimum
constexpr double kShort = 0.05;  // before the minimum, unless it is a full step
constexpr double kFar = 0.6;  // before the minimum, after a full step: above it the Hessian is too stiff along the step
// Growth of the scale if the search goes on beyond a full step.
constexpr double kLeastStride = 1.5, kLongestStride = 4;
constexpr double kNoise = 100;  // times the rounding of the energy: no search if the slope promises less

}  // namespace

double LineSearch::search(IncrementalPotential& potential, Linkage& linkage, const VectorX& direction, State& state,
                          StepMeter& meter, const Request& request) {
  StepReport& report = meter.report;
  const double slope = inner_product(potential.layout(), potential.gradient(), direction);
  const double rounding = report.rounding();
  const StepReport before = report;
  base_ = state;
  // Close to the minimum, the decrease of E is below the rounding error. Then E must only not rise by more than that
  // error.
  const auto bound = [&](double scale) { return before.energy + kArmijo * scale * slope + rounding; };
  double scale = 1;
  if (request.gradient) {
    SlopeBracket bracket(slope);
    for (int trial = 0; trial <= kMaxBracketings; ++trial) {
      linkage.move(state, direction, scale);
      const bool finite = potential.evaluate(state, meter, {.hessian = request.hessian && trial == 0});
      const double there = finite ? inner_product(potential.layout(), potential.gradient(), linkage.tangent()) : 0.0;
      const bool falls = finite && report.energy <= bound(scale);
      const bool is_bracketed = bracket.high() > 0;
      const bool continues =
          falls && !is_bracketed && there < kFar * slope && -slope > kNoise * rounding && trial < kMaxBracketings;
      const bool level =
          there <= -kLevel * slope && (there >= kShort * slope || !is_bracketed || trial == kMaxBracketings);
      if (falls && !continues && (level || -slope <= kNoise * rounding)) {
        report.increment *= scale;
        return scale;
      }
      state = base_;
      if (continues) {
        const double low = bracket.low(), low_slope = bracket.low_slope();
        const double root = there > low_slope ? low + low_slope / (low_slope - there) * (scale - low)
                                              : std::numeric_limits<double>::infinity();
        bracket.set_low(scale, there);
        scale = std::clamp(root, kLeastStride * scale, kLongestStride * scale);
        continue;
      }
      bracket.narrow(scale, there, falls);
      scale = bracket.next();
    }
    scale = bracket.low() > 0 ? bracket.low() : 0.5 * bracket.high();
  }
  for (int halving = 0; halving <= kMaxHalvings; ++halving, scale *= 0.5) {
    linkage.move(state, direction, scale);
    if (potential.value(state, meter) <= bound(scale) &&
        (!request.gradient || (potential.evaluate(state, meter, {}) && report.energy <= bound(scale)))) {
      report.increment *= scale;
      return scale;
    }
    state = base_;
  }
  meter.restore(before);
  return 0;
}

}  // namespace softhand
