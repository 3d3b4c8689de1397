#include "contact/contact_point.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace softhand {
namespace {

constexpr double kWeightError = 1e-9;  // of the sum of a point's weights

std::vector<ContactPoint> points_at_nodes(const HandModel& hand) {
  std::vector<std::int32_t> nodes;
  for (const auto& triangle : hand.surface) nodes.insert(nodes.end(), triangle.begin(), triangle.end());
  std::sort(nodes.begin(), nodes.end());
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  std::vector<ContactPoint> points(nodes.size());
  std::vector<std::size_t> point_of(hand.nodes.size());
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    points[i].nodes[0] = nodes[i];
    points[i].weights[0] = 1;
    points[i].body = hand.node_body[static_cast<std::size_t>(nodes[i])];
    point_of[static_cast<std::size_t>(nodes[i])] = i;
  }
  double total = 0;
  for (const auto& triangle : hand.surface) {
    const auto corner = [&](std::size_t k) { return hand.nodes[static_cast<std::size_t>(triangle[k])]; };
    const double area = 0.5 * (corner(1) - corner(0)).cross(corner(2) - corner(0)).norm();
    total += area;
    for (const std::int32_t node : triangle) points[point_of[static_cast<std::size_t>(node)]].area += area / 3.0;
  }
  const double mean = total / static_cast<double>(std::max<std::size_t>(1, points.size()));
  for (ContactPoint& point : points) point.share = point.area / mean;
  return points;
}

}  // namespace

ContactPoints::ContactPoints(const HandModel& hand, const std::vector<double>& node_masses) {
  if (node_masses.size() != hand.nodes.size()) {
    throw std::invalid_argument("contact: " + std::to_string(node_masses.size()) + " node masses for " +
                                std::to_string(hand.nodes.size()) + " nodes");
  }
  points_ = points_at_nodes(hand);
  finish(node_masses);
}

ContactPoints::ContactPoints(std::vector<ContactPoint> points, const std::vector<double>& node_masses)
    : points_(std::move(points)) {
  finish(node_masses);
}

// Computes the masses. A force f on a point gives node k the acceleration w_k f/m_k. So the point has the acceleration
// f sum w_k^2/m_k.
void ContactPoints::finish(const std::vector<double>& node_masses) {
  is_skin_.assign(node_masses.size(), 0);
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const ContactPoint& p = points_[i];
    const auto refuse = [i](const std::string& reason) {
      throw std::invalid_argument("contact point " + std::to_string(i) + ": " + reason);
    };
    if (p.node_count < 1 || p.node_count > static_cast<std::int32_t>(ContactPoint::most_nodes))
      refuse(std::to_string(p.node_count) + " nodes, expected 1 to 4");
    double sum = 0, mobility = 0;
    for (std::size_t k = 0; k < static_cast<std::size_t>(p.node_count); ++k) {
      if (p.nodes[k] < 0 || p.nodes[k] >= static_cast<std::int32_t>(node_masses.size()))
        refuse("node " + std::to_string(p.nodes[k]) + " does not exist");
      if (!(p.weights[k] >= 0) || p.weights[k] > p.weights[0])
        refuse("expected weights >= 0 with the largest one first");
      const auto node = static_cast<std::size_t>(p.nodes[k]);
      sum += p.weights[k];
      mobility += p.weights[k] * p.weights[k] / node_masses[node];
      is_skin_[node] = 1;
    }
    if (!(std::abs(sum - 1) < kWeightError)) refuse("its weights sum to " + std::to_string(sum) + ", expected 1");
    masses_.push_back(p.node_count == 1 ? node_masses[static_cast<std::size_t>(p.nodes[0])] : 1 / mobility);
  }
}

}  // namespace softhand
