// Broad phase: the skin nodes, grouped by their bone. Each group has a bounding ball.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "geometry/shape.hpp"
#include "math/types.hpp"

namespace softhand {

/// Finds the nodes that an object may reach. One distance test rejects all groups if the object is far from the hand.
/// One distance test per group rejects the groups of far bones. So the cost grows with the number of near nodes.
/// Allocates only at construction.
class NodeGroups {
 public:
  /// `nodes`: the nodes that can touch objects. `group_of[i]`: the group of `nodes[i]`.
  NodeGroups(std::vector<std::int32_t> nodes, std::span<const std::uint8_t> group_of);

  /// Updates the bounding balls. They contain each node's motion in a step of `time_step` seconds.
  void update(const Eigen::Matrix3Xd& positions, const Eigen::Matrix3Xd& velocities, double time_step);

  /// An upper bound of the distance of any node from `point`, metres.
  double farthest(const Vector3& point) const { return (whole_.centre - point).norm() + whole_.radius; }

  /// Calls visit(node) for every node of the groups whose ball comes within `margin` metres of the shape at `pose`. The
  /// order of the groups and of their nodes never changes.
  template <typename Visit>
  void for_each_near(const ShapeGeometry& shape, const Pose& pose, double margin, Visit&& visit) const {
    if (nodes_.empty() || !is_near(whole_, shape, pose, margin)) return;
    for (const Group& group : groups_) {
      if (!is_near(group, shape, pose, margin)) continue;
      for (std::int32_t i = group.begin; i < group.end; ++i) visit(nodes_[static_cast<std::size_t>(i)]);
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

  std::vector<std::int32_t> nodes_;  // sorted by group
  std::vector<Group> groups_;
  Group whole_;
};

}  // namespace softhand
