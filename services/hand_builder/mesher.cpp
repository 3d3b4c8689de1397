#include "hand_builder/mesher.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

#include "math/index.hpp"
#include "math/tetrahedron.hpp"
#include "model/tissue_model.hpp"

namespace softhand::builder {
namespace {

// The largest cosine of the six dihedral angles. It is 1 for a flat or inverted tetrahedron.
double worst_cosine(const std::vector<Vector3>& nodes, const std::array<std::int32_t, 4>& t) {
  const Vector3 &a = nodes[at(t[0])], &b = nodes[at(t[1])], &c = nodes[at(t[2])], &d = nodes[at(t[3])];
  const Vector3 ab = b - a, ac = c - a, ad = d - a, bc = c - b, bd = d - b;
  if (!(tetrahedron_volume(nodes, t) > 0)) return 1.0;
  const Vector3 n[4] = {bc.cross(bd), ad.cross(ac), ab.cross(ad), ac.cross(ab)};  // outward, opposite a, b, c, d
  double norm[4];
  for (int k = 0; k < 4; ++k) norm[k] = n[k].norm();
  double worst = -1;
  for (int i = 0; i < 4; ++i) {
    for (int j = i + 1; j < 4; ++j) worst = std::max(worst, -n[i].dot(n[j]) / (norm[i] * norm[j]));
  }
  return worst;
}

}  // namespace

double TetrahedralMesh::volume() const {
  double sum = 0;
  for (const auto& t : tetrahedra) sum += tetrahedron_volume(nodes, t);
  return sum;
}

double TetrahedralMesh::minimum_dihedral_degrees() const {
  double worst = -1;
  for (const auto& t : tetrahedra) worst = std::max(worst, worst_cosine(nodes, t));
  return std::acos(std::clamp(worst, -1.0, 1.0)) * 180.0 / M_PI;
}

void improve(TetrahedralMesh& mesh, const SkinShape& skin, const SizingField& sizing, const std::vector<Vector3>& seeds,
             double volume) {
  const std::size_t count = mesh.nodes.size();
  std::vector<std::vector<std::int32_t>> around(count);
  for (std::size_t t = 0; t < mesh.tetrahedra.size(); ++t) {
    for (const std::int32_t n : mesh.tetrahedra[t]) around[at(n)].push_back(static_cast<std::int32_t>(t));
  }
  std::vector<bool> outer(count, false);
  for (const auto& f : mesh.surface)
    for (const std::int32_t n : f) outer[at(n)] = true;

  const auto worst_around = [&](std::size_t n) {
    double worst = -1;
    for (const std::int32_t t : around[n]) {
      worst = std::max(worst, worst_cosine(mesh.nodes, mesh.tetrahedra[at(t)]));
      if (worst >= 1) return 1.0;
    }
    return worst;
  };

  // Moves the node nearest to each seed back to the seed, as far as the shape of its tetrahedra allows. The node stays
  // there once it has arrived. So fingertips and pads have the same place in coarse and fine meshes.
  std::vector<bool> pinned(count, false);
  const auto recall_seeds = [&] {
    constexpr double kAtSeed = 0.1e-3, kFar = 0.008;  // m
    for (const Vector3& seed : seeds) {
      std::size_t nearest = count;
      double least = kFar;
      for (std::size_t n = 0; n < count; ++n) {
        const double distance = (mesh.nodes[n] - seed).norm();
        if (!outer[n] || distance >= least) continue;
        least = distance;
        nearest = n;
      }
      if (nearest == count || pinned[nearest]) continue;
      const Vector3 old = mesh.nodes[nearest];
      const double limit = std::max(worst_around(nearest), std::cos(20.0 * M_PI / 180.0));
      for (double step = 1; step > 0.1; step *= 0.5) {
        mesh.nodes[nearest] = old + step * (seed - old);
        if (worst_around(nearest) <= limit) break;
        mesh.nodes[nearest] = old;
      }
      pinned[nearest] = (mesh.nodes[nearest] - seed).norm() < kAtSeed;
    }
  };

  // Hill climbing with our own random distribution. The language fixes the numbers of the standard generator, but not
  // those of its distributions.
  std::minstd_rand generator(7);
  const auto uniform = [&generator] {
    return 2.0 * static_cast<double>(generator()) / static_cast<double>(std::minstd_rand::max()) - 1.0;
  };
  // Height of a surface node outside the skin. A facet of edge h over a radius r cuts off a cap of h^2/(8 r), so the
  // height is proportional to h^2. The pulps are finely meshed and must touch at the true skin. They move little for
  // the volume that the palm lacks.
  double height = 0;  // m, height where the sizing is 1
  std::vector<double> share(count, 0);
  for (std::size_t n = 0; n < count; ++n) share[n] = std::pow(sizing(mesh.nodes[n]), 2);
  const auto level_of = [&](std::size_t n) { return std::clamp(height * share[n], -0.001, 0.003); };
  const auto sweep = [&](double reach) {
    for (std::size_t n = 0; n < count; ++n) {
      if (pinned[n]) continue;
      double shortest = 1;
      Vector3 centroid = Vector3::Zero();
      for (const std::int32_t t : around[n]) {
        for (const std::int32_t m : mesh.tetrahedra[at(t)]) {
          if (at(m) != n) {
            shortest = std::min(shortest, (mesh.nodes[at(m)] - mesh.nodes[n]).norm());
            centroid += mesh.nodes[at(m)];
          }
        }
      }
      centroid /= 3.0 * static_cast<double>(around[n].size());
      double best = worst_around(n);
      if (best < std::cos(40.0 * M_PI / 180.0)) continue;  // good enough; spend the effort on worse nodes
      for (int trial = 0; trial < 10; ++trial) {
        const Vector3 old = mesh.nodes[n];
        Vector3 moved = trial == 0 ? Vector3(old + 0.5 * reach * (centroid - old))
                                   : Vector3(old + reach * 0.3 * shortest * Vector3(uniform(), uniform(), uniform()));
        if (outer[n]) moved = skin.project(moved, level_of(n));
        mesh.nodes[n] = moved;
        const double now = worst_around(n);
        if (now < best - 1e-9) {
          best = now;
        } else {
          mesh.nodes[n] = old;
        }
      }
    }
  };
  for (int i = 0; i < 12; ++i) {
    recall_seeds();
    sweep(i < 6 ? 1.0 : 0.5);
  }

  // Move the surface outwards until the volume is right. The step of a node shrinks if it would invert a tetrahedron.
  double shared_area = 0;
  for (const auto& f : mesh.surface) {
    const double area =
        0.5 * (mesh.nodes[at(f[1])] - mesh.nodes[at(f[0])]).cross(mesh.nodes[at(f[2])] - mesh.nodes[at(f[0])]).norm();
    shared_area += area * (share[at(f[0])] + share[at(f[1])] + share[at(f[2])]) / 3;
  }
  for (int round = 0; round < 4; ++round) {
    height += (volume - mesh.volume()) / shared_area;
    for (std::size_t n = 0; n < count; ++n) {
      if (!outer[n] || pinned[n]) continue;
      const Vector3 old = mesh.nodes[n];
      const Vector3 target = skin.project(old, level_of(n));
      const double limit = std::max(worst_around(n), std::cos(18.0 * M_PI / 180.0));
      for (double step = 1; step > 0.1; step *= 0.5) {
        mesh.nodes[n] = old + step * (target - old);
        if (worst_around(n) <= limit) break;
        mesh.nodes[n] = old;
      }
    }
    for (int i = 0; i < 5; ++i) sweep(0.5 / (1 + round));
  }
}

void remove_flat_ears(TetrahedralMesh& mesh, const std::vector<int>& part) {
  // Chosen so that of the ears in the shipped hands, it is only the one that turned inside out.
  const double flat = std::cos(138.0 * M_PI / 180.0);
  using Edge = std::array<std::int32_t, 2>;
  const auto edge = [](std::int32_t a, std::int32_t b) { return Edge{std::min(a, b), std::max(a, b)}; };
  for (;;) {
    std::set<std::array<std::int32_t, 3>> faces;
    std::set<Edge> edges;
    for (auto f : mesh.surface) {
      std::sort(f.begin(), f.end());
      faces.insert(f);
      for (const Edge& e : {edge(f[0], f[1]), edge(f[1], f[2]), edge(f[0], f[2])}) edges.insert(e);
    }
    const auto is_flat_ear = [&](const std::array<std::int32_t, 4>& t) {
      std::vector<std::int32_t> inner, outer;  // ends of the edge between the inner faces, and between the outer faces
      for (std::size_t k = 0; k < 4; ++k) {
        std::array<std::int32_t, 3> face{t[(k + 1) % 4], t[(k + 2) % 4], t[(k + 3) % 4]};
        std::sort(face.begin(), face.end());
        (faces.contains(face) ? inner : outer).push_back(t[k]);
      }
      // If the inner edge is already on the surface, the boundary would touch itself there.
      if (inner.size() != 2 || edges.contains(edge(inner[0], inner[1]))) return false;
      const Vector3 origin = mesh.nodes[at(outer[0])];
      const Vector3 axis = (mesh.nodes[at(outer[1])] - origin).normalized();
      const auto across = [&](std::int32_t n) {
        const Vector3 x = mesh.nodes[at(n)] - origin;
        return Vector3(x - axis.dot(x) * axis).normalized();
      };
      return across(inner[0]).dot(across(inner[1])) < flat;
    };
    const auto joins_parts = [&](const std::array<std::int32_t, 4>& t) {
      std::set<int> parts;
      for (const std::int32_t n : t) parts.insert(part[at(n)]);
      parts.erase(-1);
      return parts.size() > 1;
    };
    const auto found = std::find_if(mesh.tetrahedra.begin(), mesh.tetrahedra.end(),
                                    [&](const auto& t) { return joins_parts(t) && is_flat_ear(t); });
    if (found == mesh.tetrahedra.end()) return;
    mesh.tetrahedra.erase(found);
    mesh.surface = boundary(mesh.tetrahedra);
  }
}

double skin_volume(const SkinShape& skin, double cell) {
  const auto box = skin.bounds();
  const Vector3 extent = (box[1] - box[0]) / cell;
  double sum = 0;
  for (int i = 0; i < extent.x(); ++i) {
    for (int j = 0; j < extent.y(); ++j) {
      for (int k = 0; k < extent.z(); ++k) {
        const double d = skin.distance(box[0] + cell * Vector3(i + 0.5, j + 0.5, k + 0.5));
        sum += std::clamp(0.5 - d / cell, 0.0, 1.0);  // a cell that the surface crosses counts partly
      }
    }
  }
  return sum * cell * cell * cell;
}

TriangleMesh triangulate_skin(const SkinShape& skin, double cell) {
  const auto box = skin.bounds();
  std::array<int, 3> size{};
  for (int k = 0; k < 3; ++k) size[at(k)] = static_cast<int>(std::ceil((box[1][k] - box[0][k]) / cell)) + 1;
  const auto number = [&size](int i, int j, int k) {
    return (static_cast<std::size_t>(i) * at(size[1]) + at(j)) * at(size[2]) + at(k);
  };
  std::vector<double> value(number(size[0] - 1, size[1] - 1, size[2] - 1) + 1);
  for (int i = 0; i < size[0]; ++i) {
    for (int j = 0; j < size[1]; ++j) {
      for (int k = 0; k < size[2]; ++k) value[number(i, j, k)] = skin.distance(box[0] + cell * Vector3(i, j, k));
    }
  }
  // One vertex in each crossed cell, at the mean of the crossings of its edges.
  TriangleMesh mesh;
  std::vector<std::int32_t> vertex(value.size(), -1);
  for (int i = 0; i + 1 < size[0]; ++i) {
    for (int j = 0; j + 1 < size[1]; ++j) {
      for (int k = 0; k + 1 < size[2]; ++k) {
        Vector3 sum = Vector3::Zero();
        int crossings = 0;
        for (int corner = 0; corner < 8; ++corner) {
          for (int axis = 0; axis < 3; ++axis) {
            if (corner & (1 << axis)) continue;
            const int other = corner | (1 << axis);
            const auto offset = [](int c) { return Vector3(c & 1, (c >> 1) & 1, (c >> 2) & 1); };
            const auto sample = [&](int c) {
              return value[number(i + (c & 1), j + ((c >> 1) & 1), k + ((c >> 2) & 1))];
            };
            const double a = sample(corner), b = sample(other);
            if ((a < 0) == (b < 0)) continue;
            sum += offset(corner) + a / (a - b) * (offset(other) - offset(corner));
            ++crossings;
          }
        }
        if (crossings == 0) continue;
        vertex[number(i, j, k)] = static_cast<std::int32_t>(mesh.vertices.size());
        mesh.vertices.push_back(box[0] + cell * (Vector3(i, j, k) + sum / crossings));
      }
    }
  }
  // One quad around each crossed edge.
  for (int i = 1; i + 1 < size[0]; ++i) {
    for (int j = 1; j + 1 < size[1]; ++j) {
      for (int k = 1; k + 1 < size[2]; ++k) {
        for (int axis = 0; axis < 3; ++axis) {
          const std::array<int, 3> unit{axis == 0, axis == 1, axis == 2};
          const bool inside = value[number(i, j, k)] < 0;
          if (inside == (value[number(i + unit[0], j + unit[1], k + unit[2])] < 0)) continue;
          const int u = (axis + 1) % 3, v = (axis + 2) % 3;
          const auto corner = [&](int du, int dv) {
            std::array<int, 3> c{i, j, k};
            c[at(u)] -= du;
            c[at(v)] -= dv;
            return vertex[number(c[0], c[1], c[2])];
          };
          std::array<std::int32_t, 4> quad{corner(1, 1), corner(0, 1), corner(0, 0), corner(1, 0)};
          if (!inside) std::swap(quad[1], quad[3]);
          // Split along the shorter diagonal.
          const auto length = [&](std::size_t a, std::size_t b) {
            return (mesh.vertices[at(quad[a])] - mesh.vertices[at(quad[b])]).norm();
          };
          if (length(0, 2) <= length(1, 3)) {
            mesh.triangles.push_back({quad[0], quad[1], quad[2]});
            mesh.triangles.push_back({quad[0], quad[2], quad[3]});
          } else {
            mesh.triangles.push_back({quad[0], quad[1], quad[3]});
            mesh.triangles.push_back({quad[1], quad[2], quad[3]});
          }
        }
      }
    }
  }
  for (Vector3& x : mesh.vertices) {
    const Vector3 projected = skin.project(x);
    if ((projected - x).norm() < cell) x = projected;
  }
  return mesh;
}

}  // namespace softhand::builder
