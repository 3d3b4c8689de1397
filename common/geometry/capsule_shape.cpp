#include <numbers>

#include "geometry/convex_shape.hpp"

namespace softhand {
namespace {

class Capsule final : public ConvexShape {
 public:
  Capsule(double radius, double half_length) : radius_(radius), half_length_(half_length) {}
  SurfacePoint closest(const Vector3& p) const override {
    const Vector3 centre(0, std::clamp(p.y(), -half_length_, half_length_), 0);
    const double length = (p - centre).norm();
    const Vector3 normal = length > 0 ? Vector3((p - centre) / length) : Vector3::UnitX();
    return {length - radius_, centre + radius_ * normal, normal};
  }
  bool clip(const Vector3& from, const Vector3& direction, double& enter, double& exit,
            Vector3& normal) const override {
    // The capsule is the union of a cylinder and two balls. The union is convex, so the three intervals form one
    // interval.
    Interval side;
    round_interval(Eigen::Vector2d(from.x(), from.z()), Eigen::Vector2d(direction.x(), direction.z()), radius_,
                   side.enter, side.exit);
    side.cut(Vector3::UnitY(), half_length_, from, direction);
    side.cut(-Vector3::UnitY(), half_length_, from, direction);
    enter = kInfinity;
    exit = -kInfinity;
    const auto join = [&enter, &exit](double first, double last) {
      if (!(first <= last)) return;
      enter = std::min(enter, first);
      exit = std::max(exit, last);
    };
    join(side.enter, side.exit);
    for (const double end : {-half_length_, half_length_}) {
      double first = 0, last = 0;
      round_interval(Vector3(from - Vector3(0, end, 0)), direction, radius_, first, last);
      join(first, last);
    }
    if (!(enter <= exit)) return false;
    if (std::isfinite(enter)) normal = closest(from + enter * direction).normal;
    return true;
  }
  double bounding_radius() const override { return radius_ + half_length_; }
  std::size_t resting_points(const Vector3&, std::span<RestingPoint> out) const override {
    out[0] = {Vector3(0, half_length_, 0), radius_};
    out[1] = {Vector3(0, -half_length_, 0), radius_};
    return 2;
  }
  SolidProperties properties() const override {
    const double r2 = radius_ * radius_;
    const double cylinder = 2.0 * std::numbers::pi * r2 * half_length_;
    const double ball = 4.0 / 3.0 * std::numbers::pi * r2 * radius_;
    const double along = 0.5 * cylinder * r2 + 0.4 * ball * r2;
    const double across = cylinder * (0.25 * r2 + half_length_ * half_length_ / 3.0) +
                          ball * (0.4 * r2 + half_length_ * half_length_ + 0.75 * half_length_ * radius_);
    return {cylinder + ball, Vector3::Zero(), Vector3(across, along, across).asDiagonal()};
  }

 private:
  double radius_;
  double half_length_;
};

}  // namespace

std::unique_ptr<const ShapeQueries> make_capsule(double radius, double half_length) {
  return std::make_unique<Capsule>(radius, half_length);
}

}  // namespace softhand
