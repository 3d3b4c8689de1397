#include "geometry/point_groups.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace softhand {

PointGroups::PointGroups(std::span<const std::uint8_t> group_of,
                         const std::function<std::span<const std::int32_t>(std::int32_t)>& nodes_of) {
  std::vector<std::int32_t> points(group_of.size());
  std::iota(points.begin(), points.end(), 0);
  const auto group = [&group_of](std::int32_t point) { return group_of[static_cast<std::size_t>(point)]; };
  std::stable_sort(points.begin(), points.end(),
                   [&group](std::int32_t a, std::int32_t b) { return group(a) < group(b); });
  for (const std::int32_t point : points) {
    if (groups_.empty() || group(point) != group(groups_.back().points.front())) groups_.emplace_back();
    groups_.back().points.push_back(point);
    const auto nodes = nodes_of(point);
    groups_.back().nodes.insert(groups_.back().nodes.end(), nodes.begin(), nodes.end());
  }
  for (Group& each : groups_) {
    std::sort(each.nodes.begin(), each.nodes.end());
    each.nodes.erase(std::unique(each.nodes.begin(), each.nodes.end()), each.nodes.end());
  }
}

void PointGroups::update(const Eigen::Matrix3Xd& positions, const Eigen::Matrix3Xd& velocities, double time_step) {
  Eigen::AlignedBox3d whole;
  for (Group& group : groups_) {
    Eigen::AlignedBox3d bounds;
    for (const std::int32_t node : group.nodes) {
      bounds.extend(Vector3(positions.col(node)));
      bounds.extend(Vector3(positions.col(node) + time_step * velocities.col(node)));
    }
    group.centre = bounds.center();
    group.half = 0.5 * bounds.diagonal();
    whole.extend(bounds);
  }
  if (!groups_.empty()) {
    whole_.centre = whole.center();
    whole_.half = 0.5 * whole.diagonal();
  }
}

// The box rejects most groups. Then the distance between the shape and the ball around the box rejects others.
bool PointGroups::is_near(const Box& box, const ShapeGeometry& shape, const Pose& pose, double margin) {
  const Vector3 to_shape = pose.position - box.centre;
  const double far = margin + shape.bounding_radius();
  if (box.squared_distance(to_shape) > far * far) return false;
  return shape.signed_distance(pose.orientation.conjugate() * Vector3(-to_shape)) <= margin + box.radius();
}

}  // namespace softhand
