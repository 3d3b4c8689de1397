// Closed, outward triangle meshes of simple solids for tests.
#pragma once

#include <cmath>
#include <functional>

#include "model/triangle_mesh.hpp"

namespace softhand::testing {

/// A grid of `rows` x `columns` quads over a torus-like surface: both directions close.
inline TriangleMesh closed_grid(int rows, int columns, const std::function<Vector3(double, double)>& place) {
  TriangleMesh mesh;
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < columns; ++j) mesh.vertices.push_back(place(2 * M_PI * i / rows, 2 * M_PI * j / columns));
  const auto at = [&](int i, int j) { return (i % rows) * columns + j % columns; };
  for (int i = 0; i < rows; ++i) {
    for (int j = 0; j < columns; ++j) {
      mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  }
  return mesh;
}

/// A torus about y: `ring` from the axis to the tube's centre, `tube` its radius, m.
inline TriangleMesh torus_mesh(double ring, double tube, double edge) {
  const int around = static_cast<int>(2 * M_PI * (ring + tube) / edge),
            across = static_cast<int>(2 * M_PI * tube / edge);
  return closed_grid(around, across, [=](double u, double v) {
    const double r = ring + tube * std::cos(v);
    return Vector3(r * std::sin(u), tube * std::sin(v), r * std::cos(u));
  });
}

/// A box of these half extents with faces divided into `parts` x `parts` quads.
inline TriangleMesh box_mesh(const Vector3& half, int parts = 1) {
  TriangleMesh mesh;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      const auto first = static_cast<std::int32_t>(mesh.vertices.size());
      for (int i = 0; i <= parts; ++i) {
        for (int j = 0; j <= parts; ++j) {
          Vector3 p;
          p[axis] = sign;
          p[(axis + 1) % 3] = sign * (2.0 * i / parts - 1);
          p[(axis + 2) % 3] = 2.0 * j / parts - 1;
          mesh.vertices.push_back(p.cwiseProduct(half));
        }
      }
      for (int i = 0; i < parts; ++i) {
        for (int j = 0; j < parts; ++j) {
          const std::int32_t a = first + i * (parts + 1) + j, b = a + parts + 1;
          mesh.triangles.push_back({a, b, b + 1});
          mesh.triangles.push_back({a, b + 1, a + 1});
        }
      }
    }
  }
  // Weld the faces at the edges of the box.
  TriangleMesh out;
  std::vector<std::int32_t> number;
  for (const Vector3& v : mesh.vertices) {
    std::size_t k = 0;
    while (k < out.vertices.size() && (out.vertices[k] - v).norm() > 1e-12) ++k;
    if (k == out.vertices.size()) out.vertices.push_back(v);
    number.push_back(static_cast<std::int32_t>(k));
  }
  for (const auto& t : mesh.triangles)
    out.triangles.push_back({number[static_cast<std::size_t>(t[0])], number[static_cast<std::size_t>(t[1])],
                             number[static_cast<std::size_t>(t[2])]});
  return out;
}

/// A cube's faces pushed out to a sphere.
inline TriangleMesh sphere_mesh(double radius, double edge) {
  TriangleMesh mesh = box_mesh(Vector3::Ones(), static_cast<int>(std::ceil(M_PI / 2 * radius / edge)));
  for (Vector3& v : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) v[axis] = std::tan(M_PI / 4 * v[axis]);
    v = radius * v.normalized();
  }
  return mesh;
}

/// A sphere with a spherical cavity.
inline TriangleMesh shell_mesh(double outer, double inner, double edge) {
  TriangleMesh mesh = sphere_mesh(outer, edge);
  const TriangleMesh cavity = sphere_mesh(inner, edge);
  const auto first = static_cast<std::int32_t>(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), cavity.vertices.begin(), cavity.vertices.end());
  for (const auto& t : cavity.triangles) mesh.triangles.push_back({first + t[0], first + t[2], first + t[1]});
  return mesh;
}

}  // namespace softhand::testing
