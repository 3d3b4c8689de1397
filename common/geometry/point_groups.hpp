// Broad phase: points of the skin, grouped by their bone. Each group has a bounding ball.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "geometry/shape.hpp"
#include "math/types.hpp"

namespace softhand {

/// Finds the points that an object may reach. One distance test rejects all groups if the object is far from the hand.
/// One distance test per group rejects the groups of far bones. So the cost grows with the number of near points.
/// Allocates only at construction.
class PointGroups {
 public:
  /// `points`: the columns of the points that can touch objects. `group_of[i]`: the group of `points[i]`.
  PointGroups(std::vector<std::int32_t> points, std::span<const std::uint8_t> group_of);

  /// Updates the bounding balls. They contain each point's motion in a step of `time_step` seconds.
  void update(const Eigen::Matrix3Xd& positions, const Eigen::Matrix3Xd& velocities, double time_step);

  /// An upper bound of the distance of any point from `point`, metres.
  double farthest(const Vector3& point) const { return (whole_.centre - point).norm() + whole_.radius; }

  /// Calls visit(point) for every point of the groups whose ball comes within `margin` metres of the shape at `pose`.
  /// The order of the groups and of their points never changes.
  template <typename Visit>
  void for_each_near(const ShapeGeometry& shape, const Pose& pose, double margin, Visit&& visit) const {
    if (points_.empty() || !is_near(whole_, shape, pose, margin)) return;
    for (const Group& group : groups_) {
      if (!is_near(group, shape, pose, margin)) continue;
      for (std::int32_t i = group.begin; i < group.end; ++i) visit(points_[static_cast<std::size_t>(i)]);
    }
  }

 private:
  struct Group {
    std::int32_t begin = 0;
    std::int32_t end = 0;
    Vector3 centre = Vector3::Zero();
    double radius = 0;
  };
  static bool is_near(const Group& group, const ShapeGeometry& shape, const Pose& pose, double margin);

  std::vector<std::int32_t> points_;  // sorted by group
  std::vector<Group> groups_;
  Group whole_;
};

}  // namespace softhand
