#include "geometry/mesh_distance.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "geometry/triangle.hpp"
#include "math/index.hpp"

namespace softhand {
namespace {}  // namespace

struct MeshDistance::Tree {
  struct Box {
    Vector3 low, high;
    std::size_t first, count;  // triangles of a leaf; an inner box has count 0
    std::size_t left, right;
  };
  std::vector<Vector3> vertices;
  std::vector<std::array<std::int32_t, 3>> triangles;  // in the order of the leaves
  std::vector<std::array<Vector3, 7>> normals;         // of corners, edges, face
  std::vector<Box> boxes;

  explicit Tree(const TriangleMesh& mesh) : vertices(mesh.vertices), triangles(mesh.triangles) {
    build(0, triangles.size());
    // Corner normals are weighted by the angles of their triangles. Edge normals weight both triangles equally.
    std::vector<Vector3> corner(vertices.size(), Vector3::Zero());
    std::map<std::array<std::int32_t, 2>, Vector3> edge;
    const auto key = [](std::int32_t a, std::int32_t b) {
      return std::array<std::int32_t, 2>{std::min(a, b), std::max(a, b)};
    };
    const auto face_normal = [this](const std::array<std::int32_t, 3>& t) {
      return Vector3(
          (vertices[at(t[1])] - vertices[at(t[0])]).cross(vertices[at(t[2])] - vertices[at(t[0])]).normalized());
    };
    for (const auto& t : triangles) {
      const Vector3 normal = face_normal(t);
      for (std::size_t k = 0; k < 3; ++k) {
        const Vector3 one = vertices[at(t[(k + 1) % 3])] - vertices[at(t[k])],
                      other = vertices[at(t[(k + 2) % 3])] - vertices[at(t[k])];
        corner[at(t[k])] += std::atan2(one.cross(other).norm(), one.dot(other)) * normal;
        edge.try_emplace(key(t[k], t[(k + 1) % 3]), Vector3::Zero()).first->second += normal;
      }
    }
    for (const auto& t : triangles) {
      std::array<Vector3, 7> n;
      for (std::size_t k = 0; k < 3; ++k) {
        n[k] = corner[at(t[k])];
        n[3 + k] = edge.at(key(t[k], t[(k + 1) % 3]));
      }
      n[6] = face_normal(t);
      normals.push_back(n);
    }
  }

  std::size_t build(std::size_t first, std::size_t last) {
    const std::size_t number = boxes.size();
    Box box{Vector3::Constant(1e9), Vector3::Constant(-1e9), first, last - first, 0, 0};
    for (std::size_t i = first; i < last; ++i) {
      for (const std::int32_t v : triangles[i]) {
        box.low = box.low.cwiseMin(vertices[at(v)]);
        box.high = box.high.cwiseMax(vertices[at(v)]);
      }
    }
    boxes.push_back(box);
    if (last - first > 4) {
      int axis = 0;
      (box.high - box.low).maxCoeff(&axis);
      const std::size_t middle = (first + last) / 2;
      const auto place = [&](const std::array<std::int32_t, 3>& t) {
        return vertices[at(t[0])][axis] + vertices[at(t[1])][axis] + vertices[at(t[2])][axis];
      };
      const auto begin = triangles.begin();
      std::nth_element(begin + static_cast<std::ptrdiff_t>(first), begin + static_cast<std::ptrdiff_t>(middle),
                       begin + static_cast<std::ptrdiff_t>(last),
                       [&](const auto& a, const auto& b) { return place(a) < place(b); });
      const std::size_t left = build(first, middle), right = build(middle, last);
      boxes[number].count = 0;
      boxes[number].left = left;
      boxes[number].right = right;
    }
    return number;
  }

  struct Best {
    double squared = std::numeric_limits<double>::infinity();
    Vector3 point;
    std::size_t triangle = 0;
    int feature = 6;
  };
  double squared_to(std::size_t box, const Vector3& p) const {
    return (boxes[box].low - p).cwiseMax(p - boxes[box].high).cwiseMax(0.0).squaredNorm();
  }
  double squared_to_triangle(std::size_t i, const Vector3& p) const {
    const auto& t = triangles[i];
    return (p - nearest_on_triangle(p, vertices[at(t[0])], vertices[at(t[1])], vertices[at(t[2])]).point).squaredNorm();
  }
  void search(std::size_t number, const Vector3& p, Best& best) const {
    const Box& box = boxes[number];
    for (std::size_t i = box.first; i < box.first + box.count; ++i) {
      const auto& t = triangles[i];
      const TrianglePoint nearest = nearest_on_triangle(p, vertices[at(t[0])], vertices[at(t[1])], vertices[at(t[2])]);
      const double squared = (p - nearest.point).squaredNorm();
      if (squared < best.squared) best = {squared, nearest.point, i, nearest.feature};
    }
    if (box.count > 0) return;
    const double left = squared_to(box.left, p), right = squared_to(box.right, p);
    for (const auto& [squared, child] : {std::min(std::pair{left, box.left}, std::pair{right, box.right}),
                                         std::max(std::pair{left, box.left}, std::pair{right, box.right})}) {
      if (squared < best.squared) search(child, p, best);
    }
  }
};

MeshDistance::MeshDistance(const TriangleMesh& mesh) : tree_(std::make_unique<const Tree>(mesh)) {}
MeshDistance::~MeshDistance() = default;
MeshDistance::MeshDistance(MeshDistance&&) noexcept = default;
const Vector3& MeshDistance::low() const { return tree_->boxes[0].low; }
const Vector3& MeshDistance::high() const { return tree_->boxes[0].high; }

MeshDistance::Nearest MeshDistance::nearest(const Vector3& point, std::size_t hint) const {
  Tree::Best best;
  // The hint's distance only prunes the search: equally near triangles are found in the same order with every hint.
  best.squared = tree_->squared_to_triangle(hint, point) * (1 + 1e-12) + 1e-300;
  tree_->search(0, point, best);
  const double distance = std::sqrt(best.squared);
  const bool outside =
      (point - best.point).dot(tree_->normals[best.triangle][static_cast<std::size_t>(best.feature)]) >= 0;
  return {outside ? distance : -distance, best.point, best.triangle};
}

SolidProperties solid_properties(const TriangleMesh& mesh) {
  // Sums over tetrahedra that share one point o. With the other corners a, b, c from o, the second moments about o are
  //
  //   volume/20 ((a+b+c)(a+b+c)^T + a a^T + b b^T + c c^T)
  const Vector3 origin = mesh.vertices.at(0);
  double volume = 0;
  Vector3 first = Vector3::Zero();
  Matrix3 second = Matrix3::Zero();
  for (const auto& face : mesh.triangles) {
    const Vector3 a = mesh.vertices[at(face[0])] - origin, b = mesh.vertices[at(face[1])] - origin,
                  c = mesh.vertices[at(face[2])] - origin;
    const double part = a.dot(b.cross(c)) / 6.0;
    const Vector3 sum = a + b + c;
    volume += part;
    first += part / 4.0 * sum;
    second += part / 20.0 * (sum * sum.transpose() + a * a.transpose() + b * b.transpose() + c * c.transpose());
  }
  const Vector3 centre = first / volume;
  second -= volume * centre * centre.transpose();
  return {volume, origin + centre, second.trace() * Matrix3::Identity() - second};
}

}  // namespace softhand
