#include <cmath>
#include <stdexcept>
#include <string>

#include "geometry/shape_queries.hpp"

namespace softhand {
namespace {

class CompoundShape final : public ShapeQueries {
 public:
  explicit CompoundShape(std::vector<PosedShape> parts) : parts_(std::move(parts)) {
    for (const PosedShape& part : parts_) {
      inverses_.push_back(part.pose.inverse());
      if (!std::isfinite(part.shape->bounding_radius()))
        throw std::invalid_argument("shape: a part of the compound is a plane, expected bounded shapes");
      radius_ = std::max(radius_, part.pose.position.norm() + part.shape->bounding_radius());
    }
    std::vector<RestingPoint> room(ShapeGeometry::most_resting_points);
    std::size_t resting = 0;
    for (const PosedShape& part : parts_) resting += part.shape->resting_points(Vector3::UnitY(), room);
    if (resting > ShapeGeometry::most_resting_points) {
      throw std::invalid_argument("shape: compound with " + std::to_string(resting) +
                                  " resting points, expected at most " +
                                  std::to_string(ShapeGeometry::most_resting_points));
    }
  }
  SurfacePoint closest(const Vector3& p) const override {
    SurfacePoint best;
    std::size_t nearest = 0;
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const SurfacePoint here = parts_[i].shape->closest(inverses_[i] * p);
      if (i > 0 && !(here.distance < best.distance)) continue;
      best = here;
      nearest = i;
    }
    const Pose& pose = parts_[nearest].pose;
    return {best.distance, pose * best.point, pose.orientation * best.normal};
  }
  std::optional<Crossing> first_crossing(const Vector3& from, const Vector3& to) const override {
    std::optional<Crossing> first;
    std::size_t where = 0;
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const Vector3 start = inverses_[i] * from;
      if (parts_[i].shape->signed_distance(start) < 0) return std::nullopt;
      const auto crossing = parts_[i].shape->first_crossing(start, inverses_[i] * to);
      if (!crossing || (first && first->fraction <= crossing->fraction)) continue;
      first = crossing;
      where = i;
    }
    if (!first) return std::nullopt;
    return Crossing{from + first->fraction * (to - from), parts_[where].pose.orientation * first->normal,
                    first->fraction};
  }
  double bounding_radius() const override { return radius_; }
  std::size_t resting_points(const Vector3& up, std::span<RestingPoint> out) const override {
    std::size_t count = 0;
    for (const PosedShape& part : parts_) {
      const auto room = out.subspan(count);
      const std::size_t own = part.shape->resting_points(part.pose.orientation.conjugate() * up, room);
      for (std::size_t i = 0; i < own; ++i) room[i].centre = part.pose * room[i].centre;
      count += own;
    }
    return count;
  }
  SolidProperties properties() const override {
    SolidProperties all;
    for (const PosedShape& part : parts_) {
      const SolidProperties& own = part.shape->solid();
      all.volume += own.volume;
      all.centroid += own.volume * (part.pose * own.centroid);
    }
    all.centroid /= all.volume;
    for (const PosedShape& part : parts_) {
      const SolidProperties& own = part.shape->solid();
      const Matrix3 turn = part.pose.orientation.toRotationMatrix();
      const Vector3 arm = part.pose * own.centroid - all.centroid;
      all.inertia += turn * own.inertia * turn.transpose() +
                     own.volume * (arm.squaredNorm() * Matrix3::Identity() - arm * arm.transpose());
    }
    return all;
  }

 private:
  std::vector<PosedShape> parts_;
  std::vector<Pose> inverses_;
  double radius_ = 0;
};

}  // namespace

std::unique_ptr<const ShapeQueries> make_compound(std::vector<PosedShape> parts) {
  if (parts.empty()) throw std::invalid_argument("shape: compound without parts, expected at least one");
  for (const PosedShape& part : parts)
    if (!part.shape) throw std::invalid_argument("shape: compound with an empty part, expected a shape");
  return std::make_unique<CompoundShape>(std::move(parts));
}

}  // namespace softhand
