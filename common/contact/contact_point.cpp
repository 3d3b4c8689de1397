#include "contact/contact_point.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace softhand {
namespace {

constexpr double kWeightError = 1e-9;  // of the sum of a point's weights

ContactPoint contact_point(const HandModel& hand, const SkinPoint& from) {
  std::array<std::size_t, ContactPoint::most_nodes> order{0, 1, 2, 3};
  std::stable_sort(order.begin(), order.end(),
                   [&from](std::size_t a, std::size_t b) { return from.weights[a] > from.weights[b]; });
  ContactPoint point;
  point.body = from.body;
  point.area = from.area;
  point.node_count = 0;
  for (const std::size_t k : order) {
    if (from.weights[k] == 0) continue;
    const auto i = static_cast<std::size_t>(point.node_count++);
    point.nodes[i] = hand.tetrahedra[static_cast<std::size_t>(from.tetrahedron)][k];
    point.weights[i] = from.weights[k];
  }
  return point;
}

}  // namespace

ContactPoints::ContactPoints(const HandModel& hand, const std::vector<double>& node_masses) {
  if (node_masses.size() != hand.nodes.size()) {
    throw std::invalid_argument("contact: " + std::to_string(node_masses.size()) + " node masses for " +
                                std::to_string(hand.nodes.size()) + " nodes");
  }
  points_.reserve(hand.contact_points.size());
  for (const SkinPoint& point : hand.contact_points) points_.push_back(contact_point(hand, point));
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
    if (!(p.area > 0)) refuse("area is " + std::to_string(p.area) + " m^2, expected a number > 0");
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
