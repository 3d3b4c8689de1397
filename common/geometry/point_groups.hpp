// Broad phase: points of the skin, grouped by their bone. Each point is a mean of nodes. Each group has a bounding box
// of its nodes, so the points themselves need not be computed.
#pragma once

#include <cstdint>
#include <functional>
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
  /// Points 0, 1, ... `group_of[i]`: the group of point i. `nodes_of(i)`: the nodes whose mean point i is, with weights
  /// >= 0.
  PointGroups(std::span<const std::uint8_t> group_of,
              const std::function<std::span<const std::int32_t>(std::int32_t)>& nodes_of);

  /// Updates the bounding boxes. They contain each point's motion in a step of `time_step` seconds. `positions` and
  /// `velocities` are those of the nodes.
  void update(const Eigen::Matrix3Xd& positions, const Eigen::Matrix3Xd& velocities, double time_step);

  /// An upper bound of the distance of any point from `point`, metres.
  double farthest(const Vector3& point) const { return (whole_.centre - point).norm() + whole_.radius(); }

  /// Calls visit(point) for every point of the groups whose box may come within `margin` metres of the shape at `pose`.
  /// The order of the groups and of their points never changes.
  template <typename Visit>
  void for_each_near(const ShapeGeometry& shape, const Pose& pose, double margin, Visit&& visit) const {
    if (groups_.empty() || !is_near(whole_, shape, pose, margin)) return;
    for (const Group& group : groups_) {
      if (!is_near(group, shape, pose, margin)) continue;
      for (const std::int32_t point : group.points) visit(point);
    }
  }

  /// The same for the groups whose box comes within `margin` metres of a place.
  template <typename Visit>
  void for_each_near(const Vector3& place, double margin, Visit&& visit) const {
    if (groups_.empty() || !is_near(whole_, place, margin)) return;
    for (const Group& group : groups_) {
      if (!is_near(group, place, margin)) continue;
      for (const std::int32_t point : group.points) visit(point);
    }
  }

 private:
  struct Box {
    Vector3 centre = Vector3::Zero(), half = Vector3::Zero();  // half: of its edges
    double radius() const { return half.norm(); }
    double squared_distance(const Vector3& from_centre) const {
      return (from_centre.cwiseAbs() - half).cwiseMax(0.0).squaredNorm();
    }
  };
  struct Group : Box {
    std::vector<std::int32_t> points, nodes;
  };
  static bool is_near(const Box& box, const Vector3& place, double margin) {
    return box.squared_distance(place - box.centre) <= margin * margin;
  }
  static bool is_near(const Box& box, const ShapeGeometry& shape, const Pose& pose, double margin);

  std::vector<Group> groups_;
  Box whole_;
};

}  // namespace softhand
