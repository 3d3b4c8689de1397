#include "object_builder/convex_pieces.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "geometry/convex_hull.hpp"

namespace softhand::builder {
namespace {

constexpr double kSamples = 200'000;
constexpr int kPlaces = 7;  // of cutting planes along a direction
// Weight of compactness in the cost of a cut. The hulls alone do not lead to good cuts: a ring has the hull of a disc
// until it is cut twice.
constexpr double kCompact = 0.3;
constexpr std::size_t kCoarse = 48;  // corners of the hulls of candidate cuts

using Triangle = std::array<Vector3, 3>;

// The part of the solid between cutting planes: the surface without caps, and samples of the inside.
struct Part {
  std::vector<Triangle> surface;
  std::vector<Vector3> samples;
  std::vector<Vector3> corners;
  double hull_volume = 0;
};

double hull_volume(const std::vector<Vector3>& corners) {
  if (corners.size() < 4) return 0;
  try {
    const ConvexHull hull = convex_hull(corners);
    TriangleMesh mesh{hull.vertices, {}};
    for (const auto& face : hull.faces) mesh.triangles.push_back({face[0], face[1], face[2]});
    return solid_properties(mesh).volume;
  } catch (const std::invalid_argument&) {  // flat
    return 0;
  }
}

// The triangles of the surface on the side n . x <= offset, cut at the plane (Sutherland and Hodgman 1974).
std::vector<Triangle> clipped(const std::vector<Triangle>& surface, const Vector3& n, double offset) {
  std::vector<Triangle> out;
  for (const Triangle& t : surface) {
    std::array<Vector3, 4> polygon;
    std::size_t count = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vector3 &a = t[k], &b = t[(k + 1) % 3];
      const double ha = n.dot(a) - offset, hb = n.dot(b) - offset;
      if (ha <= 0) polygon[count++] = a;
      if ((ha < 0 && hb > 0) || (ha > 0 && hb < 0)) polygon[count++] = a + ha / (ha - hb) * (b - a);
    }
    for (std::size_t k = 2; k < count; ++k) out.push_back({polygon[0], polygon[k - 1], polygon[k]});
  }
  return out;
}

std::vector<Vector3> points_of(const std::vector<Triangle>& surface) {
  std::vector<Vector3> points;
  for (const Triangle& t : surface) points.insert(points.end(), t.begin(), t.end());
  return points;
}

// Corners and volume of the hull of the part. With fewer corners a hull that failed can succeed.
void close(Part& part, std::size_t most_vertices) {
  const std::vector<Vector3> points = points_of(part.surface);
  for (std::size_t most = most_vertices; most >= 4; most = most * 3 / 4) {
    part.corners = hull_corners(points, most);
    part.hull_volume = hull_volume(part.corners);
    if (part.hull_volume > 0) return;
  }
}

// Cuts `part` at the best plane. The result replaces `part` and is returned.
Part cut(Part& part, std::size_t most_vertices) {
  const std::vector<Vector3> points = points_of(part.surface);
  Vector3 best_normal = Vector3::UnitX();
  double best_offset = 0, least = 1e300;
  // Sum over both sides of the squared distances of the samples from their mean.
  const auto scatter = [&part](const Vector3& n, double offset) {
    std::array<Vector3, 2> sum{Vector3::Zero(), Vector3::Zero()};
    std::array<double, 2> squares{}, count{};
    for (const Vector3& p : part.samples) {
      const std::size_t side = n.dot(p) <= offset ? 0 : 1;
      sum[side] += p;
      squares[side] += p.squaredNorm();
      count[side] += 1;
    }
    double total = 0;
    for (std::size_t side = 0; side < 2; ++side)
      if (count[side] > 0) total += squares[side] - sum[side].squaredNorm() / count[side];
    return total;
  };
  const double whole_scatter = std::max(1e-30, scatter(Vector3::Zero(), 1));
  for (int direction = 0; direction < 9; ++direction) {
    Vector3 n = Vector3::Zero();
    if (direction < 3) {
      n[direction] = 1;
    } else {
      n[direction % 3] = std::sqrt(0.5);
      n[(direction + 1) % 3] = direction < 6 ? std::sqrt(0.5) : -std::sqrt(0.5);
    }
    double low = 1e300, high = -1e300;
    for (const Vector3& p : points) {
      low = std::min(low, n.dot(p));
      high = std::max(high, n.dot(p));
    }
    for (int place = 1; place <= kPlaces; ++place) {
      const double offset = low + place * (high - low) / (kPlaces + 1);
      const double volume = hull_volume(hull_corners(points_of(clipped(part.surface, n, offset)), kCoarse)) +
                            hull_volume(hull_corners(points_of(clipped(part.surface, -n, -offset)), kCoarse));
      const double cost = volume / part.hull_volume + kCompact * scatter(n, offset) / whole_scatter;
      if (cost < least) {
        least = cost;
        best_normal = n;
        best_offset = offset;
      }
    }
  }
  Part upper{clipped(part.surface, -best_normal, -best_offset), {}, {}, 0};
  Part lower{clipped(part.surface, best_normal, best_offset), {}, {}, 0};
  for (const Vector3& p : part.samples) (best_normal.dot(p) <= best_offset ? lower : upper).samples.push_back(p);
  close(lower, most_vertices);
  close(upper, most_vertices);
  part = std::move(lower);
  return upper;
}

}  // namespace

ConvexPieces convex_pieces(const TriangleMesh& mesh, std::size_t most_pieces, std::size_t most_vertices,
                           double tolerance) {
  const MeshDistance distance(mesh);
  const Vector3 size = distance.high() - distance.low();
  const double cell = std::cbrt(size.prod() / kSamples);
  std::vector<Vector3> samples;
  std::vector<double> distances;
  std::size_t hint = 0;
  for (double z = 0.5 * cell; z < size.z(); z += cell)
    for (double y = 0.5 * cell; y < size.y(); y += cell)
      for (double x = 0.5 * cell; x < size.x(); x += cell) {
        const Vector3 p = distance.low() + Vector3(x, y, z);
        const auto nearest = distance.nearest(p, hint);
        hint = nearest.triangle;
        samples.push_back(p);
        distances.push_back(nearest.distance);
      }
  const double cell_volume = cell * cell * cell, volume = solid_properties(mesh).volume;

  std::vector<Part> parts(1);
  for (const auto& t : mesh.triangles)
    parts[0].surface.push_back({mesh.vertices[static_cast<std::size_t>(t[0])],
                                mesh.vertices[static_cast<std::size_t>(t[1])],
                                mesh.vertices[static_cast<std::size_t>(t[2])]});
  for (std::size_t i = 0; i < samples.size(); ++i)
    if (distances[i] < 0) parts[0].samples.push_back(samples[i]);
  close(parts[0], most_vertices);
  const auto excess_of = [cell_volume](const Part& part) {
    return part.hull_volume - cell_volume * static_cast<double>(part.samples.size());
  };
  while (parts.size() < most_pieces) {
    double total = 0;
    for (const Part& part : parts) total += excess_of(part);
    if (total < tolerance * volume) break;
    const auto worst = std::max_element(parts.begin(), parts.end(),
                                        [&](const Part& a, const Part& b) { return excess_of(a) < excess_of(b); });
    Part other = cut(*worst, most_vertices);
    parts.push_back(std::move(other));
  }

  ConvexPieces out;
  std::vector<ConvexHull> hulls;
  for (const Part& part : parts) {
    if (part.hull_volume <= 0) continue;
    out.pieces.push_back(part.corners);
    hulls.push_back(convex_hull(part.corners));
  }
  std::size_t inside = 0, missing = 0, excess = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const bool covered = std::any_of(hulls.begin(), hulls.end(), [&](const ConvexHull& hull) {
      for (std::size_t f = 0; f < hull.normals.size(); ++f)
        if (hull.normals[f].dot(samples[i]) > hull.offsets[f]) return false;
      return true;
    });
    inside += distances[i] < 0 ? 1 : 0;
    missing += distances[i] < 0 && !covered ? 1 : 0;
    excess += distances[i] >= 0 && covered ? 1 : 0;
  }
  out.missing = static_cast<double>(missing) / static_cast<double>(std::max<std::size_t>(1, inside));
  out.excess = static_cast<double>(excess) / static_cast<double>(std::max<std::size_t>(1, inside));
  return out;
}

}  // namespace softhand::builder
