#include "geometry/point_groups.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace softhand {

PointGroups::PointGroups(std::vector<std::int32_t> points, std::span<const std::uint8_t> group_of) {
  std::vector<std::size_t> order(points.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&group_of](std::size_t a, std::size_t b) { return group_of[a] < group_of[b]; });
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (i == 0 || group_of[order[i]] != group_of[order[i - 1]]) {
      Group group;
      group.begin = static_cast<std::int32_t>(i);
      groups_.push_back(group);
    }
    points_.push_back(points[order[i]]);
    groups_.back().end = static_cast<std::int32_t>(i + 1);
  }
}

void PointGroups::update(const Eigen::Matrix3Xd& positions, const Eigen::Matrix3Xd& velocities, double time_step) {
  Eigen::AlignedBox3d whole;
  for (Group& group : groups_) {
    Eigen::AlignedBox3d bounds;
    for (std::int32_t i = group.begin; i < group.end; ++i) {
      const std::int32_t point = points_[static_cast<std::size_t>(i)];
      bounds.extend(Vector3(positions.col(point)));
      bounds.extend(Vector3(positions.col(point) + time_step * velocities.col(point)));
    }
    group.centre = bounds.center();
    group.radius = 0.5 * bounds.diagonal().norm();
    whole.extend(bounds);
  }
  if (!groups_.empty()) {
    whole_.centre = whole.center();
    whole_.radius = 0.5 * whole.diagonal().norm();
  }
}

bool PointGroups::is_near(const Group& group, const ShapeGeometry& shape, const Pose& pose, double margin) {
  const Vector3 offset = group.centre - pose.position;
  const double reach = group.radius + margin;
  const double far = reach + shape.bounding_radius();
  if (offset.squaredNorm() > far * far) return false;
  return shape.signed_distance(pose.orientation.conjugate() * offset) <= reach;
}

}  // namespace softhand
