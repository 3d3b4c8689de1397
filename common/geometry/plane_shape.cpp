#include "geometry/convex_shape.hpp"

namespace softhand {
namespace {

class Plane final : public ConvexShape {
 public:
  SurfacePoint closest(const Vector3& p) const override { return {p.y(), Vector3(p.x(), 0, p.z()), Vector3::UnitY()}; }
  bool clip(const Vector3& from, const Vector3& direction, double& enter, double& exit,
            Vector3& normal) const override {
    Interval interval;
    interval.cut(Vector3::UnitY(), 0, from, direction);
    enter = interval.enter;
    exit = interval.exit;
    normal = interval.normal;
    return !interval.empty();
  }
  double bounding_radius() const override { return kInfinity; }
  std::size_t resting_points(const Vector3&, std::span<RestingPoint>) const override { return 0; }
  SolidProperties properties() const override { return {kInfinity, Vector3::Zero(), Matrix3::Zero()}; }
};

}  // namespace

std::unique_ptr<const ShapeQueries> make_plane() { return std::make_unique<Plane>(); }

}  // namespace softhand
