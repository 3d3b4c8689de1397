// Contact at the nodes of a small skin, for tests that need few points with known places.
#pragma once

#include <algorithm>
#include <vector>

#include "contact/contact_point.hpp"
#include "model/hand_model.hpp"

namespace softhand::testing {

/// The area of the skin that belongs to each node of `hand.surface`, m^2, by node. 0 for inner nodes.
inline std::vector<double> nodal_areas(const HandModel& hand) {
  std::vector<double> areas(hand.nodes.size(), 0.0);
  for (const auto& triangle : hand.surface) {
    const auto x = [&](std::size_t k) { return hand.nodes[static_cast<std::size_t>(triangle[k])]; };
    const double area = 0.5 * (x(1) - x(0)).cross(x(2) - x(0)).norm();
    for (const std::int32_t node : triangle) areas[static_cast<std::size_t>(node)] += area / 3;
  }
  return areas;
}

/// One contact point at each node of the skin, in ascending order.
inline ContactPoints contact_at_nodes(const HandModel& hand, const std::vector<double>& node_masses) {
  const std::vector<double> areas = nodal_areas(hand);
  std::vector<ContactPoint> points;
  for (std::size_t n = 0; n < areas.size(); ++n) {
    if (!(areas[n] > 0)) continue;
    ContactPoint point;
    point.nodes[0] = static_cast<std::int32_t>(n);
    point.weights[0] = 1;
    point.body = hand.node_body[n];
    point.area = areas[n];
    points.push_back(point);
  }
  return ContactPoints(std::move(points), node_masses);
}

/// k_c, N/m^3, that gives a node of mean area the stiffness `node_stiffness`, N/m.
inline double contact_stiffness(const HandModel& hand, double node_stiffness) {
  double total = 0, count = 0;
  for (const double area : nodal_areas(hand)) {
    total += area;
    count += area > 0 ? 1 : 0;
  }
  return node_stiffness * count / total;
}

}  // namespace softhand::testing
