#include <numbers>

#include "geometry/convex_shape.hpp"

namespace softhand {
namespace {

// A cylinder lies if the sine of the angle between its axis and the ground is below this (11.5 degrees).
constexpr double kLying = 0.2;

class Cylinder final : public ConvexShape {
 public:
  Cylinder(double radius, double half_length) : radius_(radius), half_length_(half_length) {}
  SurfacePoint closest(const Vector3& p) const override {
    const double radial = std::hypot(p.x(), p.z());
    const Vector3 outward = radial > 0 ? Vector3(p.x() / radial, 0, p.z() / radial) : Vector3::UnitX();
    const double to_side = radial - radius_;
    const double to_cap = std::abs(p.y()) - half_length_;
    const Vector3 axial(0, p.y() < 0 ? -1.0 : 1.0, 0);
    if (to_side > kOnSurface && to_cap > kOnSurface) {
      const double distance = std::hypot(to_side, to_cap);
      return {distance, radius_ * outward + half_length_ * axial, (to_side * outward + to_cap * axial) / distance};
    }
    if (to_side >= to_cap) {
      return {to_side, radius_ * outward + Vector3(0, std::clamp(p.y(), -half_length_, half_length_), 0), outward};
    }
    return {to_cap, std::min(radial, radius_) * outward + half_length_ * axial, axial};
  }
  bool clip(const Vector3& from, const Vector3& direction, double& enter, double& exit,
            Vector3& normal) const override {
    Interval interval;
    round_interval(Eigen::Vector2d(from.x(), from.z()), Eigen::Vector2d(direction.x(), direction.z()), radius_,
                   interval.enter, interval.exit);
    if (interval.empty()) return false;
    if (std::isfinite(interval.enter)) {
      const Vector3 point = from + interval.enter * direction;
      interval.normal = Vector3(point.x(), 0, point.z()) / radius_;
    }
    interval.cut(Vector3::UnitY(), half_length_, from, direction);
    interval.cut(-Vector3::UnitY(), half_length_, from, direction);
    enter = interval.enter;
    exit = interval.exit;
    normal = interval.normal;
    return !interval.empty();
  }
  double bounding_radius() const override { return std::hypot(radius_, half_length_); }
  std::size_t resting_points(const Vector3& up, std::span<RestingPoint> out) const override {
    // Rotated so that one point of each rim is the lowest. If the cylinder stands on end, no point is the lowest and
    // the angle does not matter.
    const double across = std::hypot(up.x(), up.z());
    const double phase = across > 1e-6 ? std::atan2(-up.z(), -up.x()) : 0.0;
    for (std::size_t i = 0; i < 16; ++i) {
      const double angle = phase + 0.25 * std::numbers::pi * static_cast<double>(i % 8);
      out[i] = {Vector3(radius_ * std::cos(angle), i < 8 ? half_length_ : -half_length_, radius_ * std::sin(angle)), 0};
    }
    // A lying cylinder rolls on balls with the rims' radius. With corners, it would have to climb over a corner in
    // every step.
    if (std::abs(up.y()) < kLying) {
      out[0] = {Vector3(0, half_length_, 0), radius_ * across};
      out[8] = {Vector3(0, -half_length_, 0), radius_ * across};
    }
    return 16;
  }
  SolidProperties properties() const override {
    const double r2 = radius_ * radius_;
    const double volume = 2.0 * std::numbers::pi * r2 * half_length_;
    const double across = volume * (0.25 * r2 + half_length_ * half_length_ / 3.0);
    return {volume, Vector3::Zero(), Vector3(across, 0.5 * volume * r2, across).asDiagonal()};
  }

 private:
  double radius_;
  double half_length_;
};

}  // namespace

std::unique_ptr<const ShapeQueries> make_cylinder(double radius, double half_length) {
  return std::make_unique<Cylinder>(radius, half_length);
}

}  // namespace softhand
