// Points of the skin where contact happens. A point is a weighted mean of up to four mesh nodes. Only this file knows
// which nodes a point has.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "model/tissue_model.hpp"

namespace softhand {

struct ContactPoint {
  static constexpr std::size_t most_nodes = 4;
  std::array<std::int32_t, most_nodes> nodes{};  ///< the first `node_count` are valid
  std::array<double, most_nodes> weights{};      ///< >= 0, sum 1
  std::int32_t node_count = 1;
  std::uint8_t body = 0;  ///< nearest bone, `Body`, or flexible object (TissueModel::node_body)
  double area = 0;        ///< A, m^2: the point's contact stiffness is A k_c
};

/// The table of the contact points of one model. The first `count()` points never change. After them comes one
/// point for each triangle of the mesh's surface. Its place in the triangle is given when a sharp point of
/// an object touches the triangle.
class ContactPoints {
 public:
  /// Area of a triangle's point in reports, m^2: a disc of 1 mm.
  static constexpr double triangle_point_area = 0.785e-6;

  /// The model's contact points. Nodes of weight 0 are left out. `node_masses` in kg. Throws std::invalid_argument if
  /// their number differs from that of the nodes.
  ContactPoints(const TissueModel& model, const std::vector<double>& node_masses);
  /// Throws std::invalid_argument if a point names a wrong node, its area is not > 0, or its weights do not sum to 1.
  ContactPoints(std::vector<ContactPoint> points, const std::vector<double>& node_masses);

  int count() const { return count_; }
  /// With the points of the triangles.
  int size() const { return static_cast<int>(points_.size()); }
  /// Puts a triangle's point at the mean of its triangle's corners. `weights` >= 0, sum 1.
  void place(int point, const Vector3& weights);
  const ContactPoint& operator[](int point) const { return points_[static_cast<std::size_t>(point)]; }
  std::span<const std::int32_t> nodes(int point) const {
    const ContactPoint& p = (*this)[point];
    return {p.nodes.data(), static_cast<std::size_t>(p.node_count)};
  }
  /// The node with the largest weight.
  std::int32_t main_node(int point) const;
  /// Mass of the point if its nodes move freely, kg.
  double mass(int point) const { return masses_[static_cast<std::size_t>(point)]; }
  /// Number of nodes of the mesh.
  int node_count() const { return static_cast<int>(is_skin_.size()); }
  /// Whether any point has this node.
  bool has_node(std::int32_t node) const { return is_skin_[static_cast<std::size_t>(node)] != 0; }
  /// Whether any node of the point is marked. `marks`: by node.
  bool is_marked(int point, std::span<const std::uint8_t> marks) const {
    for (const std::int32_t node : nodes(point)) {
      if (marks[static_cast<std::size_t>(node)] != 0) return true;
    }
    return false;
  }

  /// The point's value of a field that is given at the nodes, for example of their positions.
  Vector3 at(int point, const Eigen::Matrix3Xd& of_nodes) const {
    const ContactPoint& p = (*this)[point];
    if (p.node_count == 1) return of_nodes.col(p.nodes[0]);
    Vector3 sum = p.weights[0] * of_nodes.col(p.nodes[0]);
    for (std::size_t k = 1; k < static_cast<std::size_t>(p.node_count); ++k)
      sum += p.weights[k] * of_nodes.col(p.nodes[k]);
    return sum;
  }

 private:
  void finish();
  double mobility(const ContactPoint& point) const;

  std::vector<ContactPoint> points_;
  int count_ = 0;
  std::vector<double> node_masses_;
  std::vector<double> masses_;         // by point
  std::vector<std::uint8_t> is_skin_;  // by node
};

}  // namespace softhand
