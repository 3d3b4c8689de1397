#include "hand_builder/skin_shape.hpp"

#include <cmath>

namespace softhand::builder {

Vector3 SkinShape::normal(const Vector3& point) const {
  constexpr double h = 1e-5;
  Vector3 gradient;
  for (int k = 0; k < 3; ++k) {
    const Vector3 step = h * Vector3::Unit(k);
    gradient[k] = distance(point + step) - distance(point - step);
  }
  const double norm = gradient.norm();
  return norm > 0 ? Vector3(gradient / norm) : Vector3::UnitY();
}

Vector3 SkinShape::project(Vector3 point, double level) const {
  for (int i = 0; i < 8; ++i) {
    const double d = distance(point) - level;
    if (std::abs(d) < 1e-7) break;
    point -= d * normal(point);
  }
  return point;
}

}  // namespace softhand::builder
