#include "contact/contact_point.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace softhand {
namespace {

constexpr double kWeightError = 1e-9;  // of the sum of a point's weights

ContactPoint contact_point(const TissueModel& model, const SkinPoint& from) {
  ContactPoint point;
  point.body = from.body;
  point.area = from.area;
  point.node_count = 0;
  for (std::size_t k = 0; k < ContactPoint::most_nodes; ++k) {
    if (from.weights[k] == 0) continue;
    const auto i = static_cast<std::size_t>(point.node_count++);
    point.nodes[i] = model.tetrahedra[static_cast<std::size_t>(from.tetrahedron)][k];
    point.weights[i] = from.weights[k];
  }
  return point;
}

}  // namespace

ContactPoints::ContactPoints(const TissueModel& model, const std::vector<double>& node_masses) {
  if (node_masses.size() != model.nodes.size()) {
    throw std::invalid_argument("contact: " + std::to_string(node_masses.size()) + " node masses for " +
                                std::to_string(model.nodes.size()) + " nodes");
  }
  node_masses_ = node_masses;
  points_.reserve(model.contact_points.size() + model.surface.size());
  for (const SkinPoint& point : model.contact_points) points_.push_back(contact_point(model, point));
  count_ = static_cast<int>(points_.size());
  for (const auto& triangle : model.surface) {
    ContactPoint of_triangle;
    of_triangle.node_count = 3;
    for (std::size_t k = 0; k < 3; ++k) {
      of_triangle.nodes[k] = triangle[k];
      of_triangle.weights[k] = 1.0 / 3;
    }
    of_triangle.body = model.node_body[static_cast<std::size_t>(triangle[0])];
    of_triangle.area = triangle_point_area;
    points_.push_back(of_triangle);
  }
  finish();
}

ContactPoints::ContactPoints(std::vector<ContactPoint> points, const std::vector<double>& node_masses)
    : points_(std::move(points)), count_(static_cast<int>(points_.size())), node_masses_(node_masses) {
  finish();
}

std::int32_t ContactPoints::main_node(int point) const {
  const ContactPoint& p = (*this)[point];
  return p.nodes[static_cast<std::size_t>(std::max_element(p.weights.begin(), p.weights.begin() + p.node_count) -
                                          p.weights.begin())];
}

void ContactPoints::place(int point, const Vector3& weights) {
  ContactPoint& p = points_[static_cast<std::size_t>(point)];
  for (std::size_t k = 0; k < 3; ++k) p.weights[k] = weights[static_cast<Eigen::Index>(k)];
  masses_[static_cast<std::size_t>(point)] = 1 / mobility(p);
}

// A force f on a point gives node k the acceleration w_k f/m_k. So the point has the acceleration f sum w_k^2/m_k.
double ContactPoints::mobility(const ContactPoint& point) const {
  double sum = 0;
  for (std::size_t k = 0; k < static_cast<std::size_t>(point.node_count); ++k)
    sum += point.weights[k] * point.weights[k] / node_masses_[static_cast<std::size_t>(point.nodes[k])];
  return sum;
}

void ContactPoints::finish() {
  is_skin_.assign(node_masses_.size(), 0);
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const ContactPoint& p = points_[i];
    const auto refuse = [i](const std::string& reason) {
      throw std::invalid_argument("contact point " + std::to_string(i) + ": " + reason);
    };
    if (p.node_count < 1 || p.node_count > static_cast<std::int32_t>(ContactPoint::most_nodes))
      refuse(std::to_string(p.node_count) + " nodes, expected 1 to 4");
    if (!(p.area > 0)) refuse("area is " + std::to_string(p.area) + " m^2, expected a number > 0");
    double sum = 0;
    for (std::size_t k = 0; k < static_cast<std::size_t>(p.node_count); ++k) {
      if (p.nodes[k] < 0 || p.nodes[k] >= static_cast<std::int32_t>(node_masses_.size()))
        refuse("node " + std::to_string(p.nodes[k]) + " does not exist");
      if (!(p.weights[k] >= 0)) refuse("expected weights >= 0");
      sum += p.weights[k];
      is_skin_[static_cast<std::size_t>(p.nodes[k])] = 1;
    }
    if (!(std::abs(sum - 1) < kWeightError)) refuse("its weights sum to " + std::to_string(sum) + ", expected 1");
    masses_.push_back(p.node_count == 1 ? node_masses_[static_cast<std::size_t>(p.nodes[0])] : 1 / mobility(p));
  }
}

}  // namespace softhand
