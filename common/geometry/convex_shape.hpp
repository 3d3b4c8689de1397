// Base of the convex shapes: a line meets a convex solid in one interval. Internal to this folder.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "geometry/shape_queries.hpp"

namespace softhand {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();
// m. Closer to the surface than this, the direction to the closest point is only rounding error, so the face's normal
// is used.
inline constexpr double kOnSurface = 1e-12;

class ConvexShape : public ShapeQueries {
 public:
  /// Computes the part of the line from + t direction that is inside: [enter, exit], and the outward normal at the
  /// entry. Returns false if the line misses.
  virtual bool clip(const Vector3& from, const Vector3& direction, double& enter, double& exit,
                    Vector3& normal) const = 0;
  std::optional<Crossing> first_crossing(const Vector3& from, const Vector3& to) const final {
    const Vector3 direction = to - from;
    double enter = 0, exit = 0;
    Vector3 normal = Vector3::UnitY();
    // A path that only touches the solid (enter = exit) does not enter.
    if (!clip(from, direction, enter, exit, normal) || !(enter >= 0 && enter <= 1 && enter < exit)) return std::nullopt;
    return Crossing{from + enter * direction, normal, enter};
  }
};

/// The part of a line that is inside a convex solid.
struct Interval {
  double enter = -kInfinity;
  double exit = kInfinity;
  Vector3 normal = Vector3::UnitY();  // at the entry

  bool empty() const { return !(enter <= exit); }
  // Cuts away the part outside the half-space normal . p <= offset.
  void cut(const Vector3& n, double offset, const Vector3& from, const Vector3& direction) {
    const double height = n.dot(from) - offset;
    const double rate = n.dot(direction);
    if (rate < 0) {
      const double t = -height / rate;
      if (t > enter) {
        enter = t;
        normal = n;
      }
    } else if (rate > 0) {
      exit = std::min(exit, -height / rate);
    } else if (height > 0) {
      exit = -kInfinity;
    }
  }
};

// Solves |from + t direction| = radius for vectors of any dimension. If direction is zero, the result is the whole line
// or nothing.
template <typename Vector>
void round_interval(const Vector& from, const Vector& direction, double radius, double& enter, double& exit) {
  const double a = direction.squaredNorm();
  const double c = from.squaredNorm() - radius * radius;
  if (a == 0) {
    enter = c <= 0 ? -kInfinity : kInfinity;
    exit = -enter;
    return;
  }
  const double b = from.dot(direction);
  // b^2 - a c without cancellation: a times (radius^2 - squared distance of the line from the centre).
  const Vector foot = from - b / a * direction;
  const double discriminant = a * (radius * radius - foot.squaredNorm());
  if (discriminant < 0) {
    enter = kInfinity;
    exit = -kInfinity;
    return;
  }
  const double root = std::sqrt(discriminant);
  enter = (-b - root) / a;
  exit = (-b + root) / a;
}

}  // namespace softhand
