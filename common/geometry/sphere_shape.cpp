#include <numbers>

#include "geometry/convex_shape.hpp"

namespace softhand {
namespace {

class Sphere final : public ConvexShape {
 public:
  explicit Sphere(double radius) : radius_(radius) {}
  SurfacePoint closest(const Vector3& p) const override {
    const double length = p.norm();
    const Vector3 normal = length > 0 ? Vector3(p / length) : Vector3::UnitY();
    return {length - radius_, radius_ * normal, normal};
  }
  bool clip(const Vector3& from, const Vector3& direction, double& enter, double& exit,
            Vector3& normal) const override {
    round_interval(from, direction, radius_, enter, exit);
    if (!(enter <= exit)) return false;
    normal = std::isfinite(enter) ? Vector3((from + enter * direction) / radius_) : Vector3::UnitY();
    return true;
  }
  double bounding_radius() const override { return radius_; }
  std::size_t resting_points(const Vector3&, std::span<RestingPoint> out) const override {
    out[0] = {Vector3::Zero(), radius_};
    return 1;
  }
  SolidProperties properties() const override {
    const double volume = 4.0 / 3.0 * std::numbers::pi * radius_ * radius_ * radius_;
    return {volume, Vector3::Zero(), 0.4 * volume * radius_ * radius_ * Matrix3::Identity()};
  }

 private:
  double radius_;
};

}  // namespace

std::unique_ptr<const ShapeQueries> make_sphere(double radius) { return std::make_unique<Sphere>(radius); }

}  // namespace softhand
