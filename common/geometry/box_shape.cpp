#include "geometry/convex_shape.hpp"

namespace softhand {
namespace {

class Box final : public ConvexShape {
 public:
  explicit Box(const Vector3& half) : half_(half) {}
  SurfacePoint closest(const Vector3& p) const override {
    const Vector3 clamped = p.cwiseMin(half_).cwiseMax(-half_);
    const Vector3 outside = p - clamped;
    const double distance = outside.norm();
    if (distance > kOnSurface) return {distance, clamped, outside / distance};
    int axis = 0;
    const double depth = (p.cwiseAbs() - half_).maxCoeff(&axis);
    const double side = p[axis] < 0 ? -1.0 : 1.0;
    SurfacePoint result{depth, clamped, side * Vector3::Unit(axis)};
    result.point[axis] = side * half_[axis];
    return result;
  }
  bool clip(const Vector3& from, const Vector3& direction, double& enter, double& exit,
            Vector3& normal) const override {
    Interval interval;
    for (int axis = 0; axis < 3; ++axis) {
      interval.cut(Vector3::Unit(axis), half_[axis], from, direction);
      interval.cut(-Vector3::Unit(axis), half_[axis], from, direction);
    }
    enter = interval.enter;
    exit = interval.exit;
    normal = interval.normal;
    return !interval.empty();
  }
  double bounding_radius() const override { return half_.norm(); }
  std::size_t resting_points(const Vector3&, std::span<RestingPoint> out) const override {
    for (std::size_t i = 0; i < 8; ++i) {
      const Vector3 sign(i & 1 ? 1 : -1, i & 2 ? 1 : -1, i & 4 ? 1 : -1);
      out[i] = {half_.cwiseProduct(sign), 0};
    }
    return 8;
  }
  SolidProperties properties() const override {
    const double volume = 8.0 * half_.prod();
    const Vector3 squares = half_.cwiseProduct(half_);
    const Vector3 inertia = volume / 3.0 * (Vector3::Constant(squares.sum()) - squares);
    return {volume, Vector3::Zero(), inertia.asDiagonal()};
  }

 private:
  Vector3 half_;
};

}  // namespace

std::unique_ptr<const ShapeQueries> make_box(const Vector3& half) { return std::make_unique<Box>(half); }

}  // namespace softhand
