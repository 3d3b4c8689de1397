#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <string>

#include "geometry/convex_hull.hpp"
#include "geometry/point_groups.hpp"
#include "geometry/shape.hpp"

namespace softhand::geometry_test {
namespace {

Shape make(ShapeKind kind, Vec3 size = {}) {
  Shape shape;
  shape.kind = static_cast<std::uint32_t>(kind);
  shape.size = size;
  return shape;
}

Shape hull_of(const std::vector<Vector3>& points) {
  Shape shape = make(ShapeKind::convex_hull);
  for (const Vector3& p : points) shape.vertices.push_back({p.x(), p.y(), p.z()});
  return shape;
}

class Random {
 public:
  explicit Random(std::uint64_t seed) : generator_(seed) {}
  double uniform() { return 2.0 * static_cast<double>(generator_() >> 11) * 0x1p-53 - 1.0; }
  Vector3 vector(double scale) {
    const double x = uniform(), y = uniform(), z = uniform();
    return scale * Vector3(x, y, z);
  }

 private:
  std::mt19937_64 generator_;
};

std::vector<Vector3> cloud(int count, std::uint64_t seed) {
  Random random(seed);
  std::vector<Vector3> points;
  for (int i = 0; i < count; ++i) points.push_back(random.vector(0.03));
  return points;
}

std::vector<Vector3> box_points(const Vector3& half, int per_edge) {
  std::vector<Vector3> points;
  for (int x = 0; x < per_edge; ++x) {
    for (int y = 0; y < per_edge; ++y) {
      for (int z = 0; z < per_edge; ++z) {
        points.push_back((2.0 / (per_edge - 1) * Vector3(x, y, z) - Vector3::Ones()).cwiseProduct(half));
      }
    }
  }
  return points;
}

struct Named {
  std::string name;
  Shape shape;
};

std::vector<Named> shapes() {
  return {{"sphere", make(ShapeKind::sphere, {0.03, 0, 0})},
          {"box", make(ShapeKind::box, {0.02, 0.03, 0.01})},
          {"capsule", make(ShapeKind::capsule, {0.01, 0.03, 0})},
          {"cylinder", make(ShapeKind::cylinder, {0.02, 0.025, 0})},
          {"plane", make(ShapeKind::plane)},
          {"hull", hull_of(cloud(60, 5))},
          {"thin plate", make(ShapeKind::box, {0.03, 0.00025, 0.03})}};
}

TEST(Geometry, KnownDistances) {
  const ShapeGeometry sphere(make(ShapeKind::sphere, {0.03, 0, 0}));
  EXPECT_DOUBLE_EQ(sphere.signed_distance({0.05, 0, 0}), 0.02);
  EXPECT_DOUBLE_EQ(sphere.signed_distance(Vector3::Zero()), -0.03);
  const ShapeGeometry box(make(ShapeKind::box, {0.02, 0.03, 0.01}));
  EXPECT_DOUBLE_EQ(box.signed_distance({0.05, 0.07, 0}), 0.05);
  EXPECT_DOUBLE_EQ(box.signed_distance({0.019, 0, 0}), -0.001);
  const ShapeGeometry capsule(make(ShapeKind::capsule, {0.01, 0.03, 0}));
  EXPECT_DOUBLE_EQ(capsule.signed_distance({0, 0.05, 0}), 0.01);
  EXPECT_DOUBLE_EQ(capsule.signed_distance({0.02, 0.01, 0}), 0.01);
  EXPECT_NEAR(capsule.signed_distance({0, 0.035, 0}), -0.005, 1e-15);
  const ShapeGeometry cylinder(make(ShapeKind::cylinder, {0.02, 0.025, 0}));
  EXPECT_NEAR(cylinder.signed_distance({0.05, 0.065, 0}), 0.05, 1e-15);
  EXPECT_NEAR(cylinder.signed_distance({0, 0.02, 0.001}), -0.005, 1e-15);
  const ShapeGeometry plane(make(ShapeKind::plane));
  EXPECT_DOUBLE_EQ(plane.signed_distance({3, -0.2, 1}), -0.2);
  EXPECT_TRUE(std::isinf(plane.bounding_radius()));
}

// The hull of a box's point grid is the box, although the grid has collinear and coplanar points.
TEST(Geometry, HullOfABoxIsTheBox) {
  const Vector3 half(0.02, 0.03, 0.01);
  const ShapeGeometry box(make(ShapeKind::box, {half.x(), half.y(), half.z()}));
  for (const int per_edge : {2, 3, 6}) {
    const ShapeGeometry hull(hull_of(box_points(half, per_edge)));
    Random random(11);
    for (int i = 0; i < 500; ++i) {
      const Vector3 p = random.vector(0.05);
      EXPECT_NEAR(hull.signed_distance(p), box.signed_distance(p), 2e-6 * half.norm());
    }
    EXPECT_NEAR(hull.solid().volume, box.solid().volume, 1e-5 * box.solid().volume);
    EXPECT_LE((hull.solid().inertia - box.solid().inertia).norm(), 1e-4 * box.solid().inertia.norm());
  }
}

TEST(Geometry, HullHoldsAllPointsAndIsClosed) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    std::vector<Vector3> points = cloud(256, seed);
    if (seed % 2 == 0) {
      for (Vector3& p : points) p = 0.04 * p.normalized();  // all points are on a sphere, so every point is a corner
    }
    if (seed == 4) points[7] = points[8];  // a repeated point
    const ConvexHull hull = convex_hull(points);
    const int v = static_cast<int>(hull.vertices.size()), f = static_cast<int>(hull.faces.size());
    EXPECT_EQ(2 * v - 4, f) << "Euler's formula, seed " << seed;
    for (std::size_t k = 0; k < hull.faces.size(); ++k) {
      for (std::size_t edge = 0; edge < 3; ++edge) {
        const auto& there = hull.faces[static_cast<std::size_t>(hull.neighbours[k][edge])];
        const auto end = std::find(there.begin(), there.end(), hull.faces[k][edge]);
        ASSERT_NE(end, there.end());
        EXPECT_EQ(there[static_cast<std::size_t>(end - there.begin() + 2) % 3], hull.faces[k][(edge + 1) % 3])
            << "the neighbour must have the same edge in the opposite direction";
      }
    }
    for (std::size_t k = 0; k < hull.faces.size(); ++k) {
      for (const Vector3& p : points) EXPECT_LE(hull.normals[k].dot(p) - hull.offsets[k], 1e-9);
    }
  }
}

// The least distance to all edges, and to all faces onto which the point projects.
double distance_to_all_faces(const ConvexHull& hull, const Vector3& p) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t f = 0; f < hull.faces.size(); ++f) {
    const auto corner = [&](std::size_t k) { return hull.vertices[static_cast<std::size_t>(hull.faces[f][k])]; };
    const Vector3 u = corner(1) - corner(0), v = corner(2) - corner(0), w = p - corner(0);
    const double uu = u.dot(u), uv = u.dot(v), vv = v.dot(v), determinant = uu * vv - uv * uv;
    const double a = (vv * w.dot(u) - uv * w.dot(v)) / determinant, b = (uu * w.dot(v) - uv * w.dot(u)) / determinant;
    if (a >= 0 && b >= 0 && a + b <= 1) least = std::min(least, std::abs(w.dot(hull.normals[f])));
    for (std::size_t k = 0; k < 3; ++k) {
      const Vector3 from = corner(k), edge = corner((k + 1) % 3) - from;
      least = std::min(least, (p - from - std::clamp(edge.dot(p - from) / edge.squaredNorm(), 0.0, 1.0) * edge).norm());
    }
  }
  return least;
}

// Includes plates, needles and grids of coplanar points. The points lie outside the hull: over corners, edges and
// faces, near and far.
TEST(Geometry, ClosestPointOfAHullIsTheNearestOfAllFaces) {
  std::vector<std::vector<Vector3>> solids{cloud(4, 1),
                                           cloud(60, 2),
                                           cloud(256, 3),
                                           box_points({0.02, 0.03, 0.01}, 2),
                                           box_points({0.02, 0.03, 0.01}, 6),
                                           box_points({0.03, 0.00025, 0.03}, 4)};
  solids.push_back(cloud(256, 4));
  for (Vector3& p : solids.back()) p = 0.03 * p.normalized();
  solids.push_back(solids.back());
  for (Vector3& p : solids.back()) p = p.cwiseProduct(Vector3(1, 0.02, 0.02));
  solids.push_back(solids[6]);
  for (Vector3& p : solids.back())
    p = p.cwiseProduct(Vector3(1, 0.01, 1)) + Vector3(0.2, 0, 0);  // a plate far from its frame's origin
  for (std::size_t solid = 0; solid < solids.size(); ++solid) {
    SCOPED_TRACE(solid);
    const ShapeGeometry shape(hull_of(solids[solid]));
    const ConvexHull hull = convex_hull(solids[solid]);
    Random random(17 + solid);
    int outside = 0;
    for (int i = 0; i < 3000; ++i) {
      const auto any = [&] {
        return static_cast<std::size_t>(std::abs(random.uniform()) * static_cast<double>(hull.faces.size() - 1));
      };
      const auto& face = hull.faces[any()];
      const Vector3 corner = hull.vertices[static_cast<std::size_t>(face[0])],
                    other = hull.vertices[static_cast<std::size_t>(face[1])];
      const Vector3 about = i % 3 == 0 ? corner : i % 3 == 1 ? Vector3(0.5 * (corner + other)) : hull.vertices[0];
      const Vector3 p = about + random.vector(std::pow(10.0, -5 + 4 * std::abs(random.uniform())));
      double highest = -std::numeric_limits<double>::infinity();
      for (std::size_t f = 0; f < hull.faces.size(); ++f)
        highest = std::max(highest, hull.normals[f].dot(p) - hull.offsets[f]);
      if (highest <= 1e-9) continue;
      ++outside;
      const SurfacePoint closest = shape.closest(p);
      const double least = distance_to_all_faces(hull, p);
      ASSERT_NEAR(closest.distance, least, 1e-12 + 1e-9 * least) << p.transpose();
      ASSERT_NEAR((p - closest.point).norm(), closest.distance, 1e-12);
      ASSERT_NEAR((closest.point + closest.distance * closest.normal - p).norm(), 0, 1e-12);
    }
    EXPECT_GT(outside, 1000);
  }
}

TEST(Geometry, DistanceGradientIsTheUnitNormal) {
  for (const Named& named : shapes()) {
    SCOPED_TRACE(named.name);
    const ShapeGeometry shape(named.shape);
    Random random(3);
    int tested = 0;
    for (int i = 0; i < 2000; ++i) {
      const Vector3 p = random.vector(0.06);
      const SurfacePoint at = shape.closest(p);
      EXPECT_NEAR(at.normal.norm(), 1.0, 1e-12);
      EXPECT_NEAR(shape.signed_distance(at.point), 0.0, 1e-12);
      EXPECT_NEAR((p - at.point).norm(), std::abs(at.distance), 1e-12);
      const double h = 1e-7;
      Vector3 difference;
      for (int axis = 0; axis < 3; ++axis) {
        const Vector3 e = h * Vector3::Unit(axis);
        difference[axis] = (shape.signed_distance(p + e) - shape.signed_distance(p - e)) / (2 * h);
      }
      if ((difference - at.normal).norm() > 1e-5) continue;  // the distance has a kink at a medial surface
      ++tested;
    }
    EXPECT_GT(tested, 1990);
  }
}

// No point of a dense sample of the surface is nearer than the signed distance. Some points are as near.
TEST(Geometry, DistanceAgreesWithBruteForce) {
  for (const Named& named : shapes()) {
    if (named.name == "plane") continue;
    SCOPED_TRACE(named.name);
    const ShapeGeometry shape(named.shape);
    Random random(17);
    std::vector<Vector3> surface;
    while (surface.size() < 40000) surface.push_back(shape.closest(random.vector(0.05)).point);
    for (int i = 0; i < 30; ++i) {
      const Vector3 p = random.vector(0.06);
      double nearest = std::numeric_limits<double>::infinity();
      for (const Vector3& s : surface) nearest = std::min(nearest, (s - p).norm());
      const double distance = std::abs(shape.signed_distance(p));
      EXPECT_GE(nearest, distance - 1e-12);
      EXPECT_LE(nearest, distance + 1.5e-3);
    }
  }
}

TEST(Geometry, NormalsAreDefinedEverywhere) {
  for (const Named& named : shapes()) {
    SCOPED_TRACE(named.name);
    const ShapeGeometry shape(named.shape);
    for (const Vector3& p : {Vector3(0, 0, 0), Vector3(0, 0.025, 0), Vector3(0.02, 0.03, 0.01), Vector3(0, 0.04, 0),
                             Vector3(0.02, 0.025, 0), Vector3(0, -1e-300, 0), Vector3(1e3, 1e3, -1e3)}) {
      const SurfacePoint at = shape.closest(p);
      EXPECT_TRUE(at.point.allFinite());
      EXPECT_NEAR(at.normal.norm(), 1.0, 1e-12);
    }
  }
}

// The reference marches along the segment in small steps.
TEST(Geometry, FirstCrossingIsWhereThePathEnters) {
  for (const Named& named : shapes()) {
    SCOPED_TRACE(named.name);
    const ShapeGeometry shape(named.shape);
    Random random(23);
    int crossings = 0;
    for (int i = 0; i < 3000; ++i) {
      const Vector3 from = random.vector(0.08), to = random.vector(0.08);
      const auto crossing = shape.first_crossing(from, to);
      double sampled = -1;
      if (shape.signed_distance(from) > 0) {
        for (int k = 0; k <= 400; ++k) {
          if (shape.signed_distance(from + k / 400.0 * (to - from)) < -1e-9) {
            sampled = k / 400.0;
            break;
          }
        }
      }
      if (shape.signed_distance(from) < 0) {
        EXPECT_FALSE(crossing) << "the path starts inside";
        continue;
      }
      if (sampled >= 0) {
        ASSERT_TRUE(crossing);
      }
      if (!crossing) continue;
      ++crossings;
      if (sampled >= 0) {
        EXPECT_NEAR(crossing->fraction, sampled, named.name == "thin plate" ? 1.0 : 1.01 / 400 + 1e-6);
      }
      EXPECT_NEAR(shape.signed_distance(crossing->point), 0, 1e-11);
      EXPECT_LE((from + crossing->fraction * (to - from) - crossing->point).norm(), 1e-14);
      EXPECT_LT(crossing->normal.dot(to - from), 1e-12);
      EXPECT_NEAR(crossing->normal.norm(), 1, 1e-9);
    }
    EXPECT_GT(crossings, 100);
  }
}

TEST(Geometry, ThinPlateIsNeverMissed) {
  const ShapeGeometry plate(make(ShapeKind::box, {0.5, 0.00025, 0.5}));
  Random random(29);
  for (int i = 0; i < 1000; ++i) {
    const Vector3 start =
        Vector3(0.3 * random.uniform(), 0.00026 + 0.08 * std::abs(random.uniform()), 0.3 * random.uniform());
    const Vector3 path(0.05 * random.uniform(), -0.0833, 0.05 * random.uniform());
    if (start.y() + path.y() > 0.00025) continue;
    const auto crossing = plate.first_crossing(start, start + path);
    ASSERT_TRUE(crossing);
    EXPECT_EQ(crossing->normal, Vector3::UnitY());
  }
  EXPECT_FALSE(plate.first_crossing({0, 0.00025, 0}, {1, 0.00025, 0})) << "a path along the face does not cross it";
}

TEST(Geometry, VolumeAndInertiaAgreeWithMonteCarlo) {
  for (const Named& named : shapes()) {
    if (named.name == "plane" || named.name == "thin plate") continue;
    SCOPED_TRACE(named.name);
    const ShapeGeometry shape(named.shape);
    Random random(31);
    const double half = 0.045;
    const int samples = 400000;
    double inside = 0;
    Matrix3 inertia = Matrix3::Zero();
    Vector3 centre = Vector3::Zero();
    for (int i = 0; i < samples; ++i) {
      const Vector3 p = random.vector(half);
      if (shape.signed_distance(p) > 0) continue;
      inside += 1;
      centre += p;
      const Vector3 arm = p - shape.solid().centroid;
      inertia += arm.squaredNorm() * Matrix3::Identity() - arm * arm.transpose();
    }
    const double cell = std::pow(2 * half, 3) / samples;
    EXPECT_NEAR(inside * cell, shape.solid().volume, 0.02 * shape.solid().volume);
    EXPECT_LE((inertia * cell - shape.solid().inertia).norm(), 0.03 * shape.solid().inertia.norm());
    EXPECT_LE((centre / inside - shape.solid().centroid).norm(), 3e-4);
  }
}

// For every direction, the lowest resting point is the lowest point of the solid.
TEST(Geometry, LowestRestingPointIsTheLowestPointOfTheSolid) {
  for (const Named& named : shapes()) {
    if (named.name == "plane") continue;
    SCOPED_TRACE(named.name);
    const ShapeGeometry shape(named.shape);
    Random random(37);
    std::vector<Vector3> surface;
    while (surface.size() < 5000) surface.push_back(shape.closest(random.vector(0.05)).point);
    std::vector<RestingPoint> points(ShapeGeometry::most_resting_points);
    const std::size_t count = shape.resting_points(Vector3::UnitY(), points);
    for (int i = 0; i < 50; ++i) {
      const Vector3 up = random.vector(1).normalized();
      ASSERT_EQ(shape.resting_points(up, points), count);
      double lowest = std::numeric_limits<double>::infinity(), sampled = lowest;
      for (std::size_t k = 0; k < count; ++k) lowest = std::min(lowest, up.dot(points[k].centre) - points[k].radius);
      for (const Vector3& s : surface) sampled = std::min(sampled, up.dot(s));
      EXPECT_LE(lowest, sampled + 1e-12);
      EXPECT_GE(lowest, sampled - 4e-3);
      EXPECT_LE(-lowest, shape.bounding_radius() + 1e-12);
    }
  }
}

TEST(Geometry, RefusesBadShapesAndNamesTheReason) {
  const auto refused = [](const Shape& shape, const std::string& word) {
    try {
      const ShapeGeometry geometry(shape);
      ADD_FAILURE() << "accepted; expected an error about " << word;
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
    }
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  refused(make(ShapeKind::sphere, {0, 0, 0}), "radius");
  refused(make(ShapeKind::sphere, {nan, 0, 0}), "radius");
  refused(make(ShapeKind::box, {0.1, -0.1, 0.1}), "half extent");
  refused(make(ShapeKind::cylinder, {0.1, 0, 0}), "half length");
  refused(make(ShapeKind::capsule, {0.1, std::numeric_limits<double>::infinity(), 0}), "half length");
  refused(make(static_cast<ShapeKind>(77)), "kind");
  refused(hull_of({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}), "3 vertices");
  refused(hull_of({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}, {0.5, 0.5, 0}}), "plane");
  refused(hull_of({{0, 0, 0}, {1, 0, 0}, {0, nan, 0}, {1, 1, 1}}), "finite");
}

TEST(PointGroups, FindsEveryNodeInReach) {
  Random random(41);
  const int count = 300;
  Eigen::Matrix3Xd positions(3, count), velocities(3, count);
  std::vector<std::array<std::int32_t, 2>> nodes;
  std::vector<std::uint8_t> group;
  for (int i = 0; i < count; ++i) {
    group.push_back(static_cast<std::uint8_t>(i % 7));
    positions.col(i) = Vector3(0.1 * (i % 7), 0, 0) + random.vector(0.02);
    velocities.col(i) = random.vector(1.0);
    nodes.push_back({i, i - i % 70 + i % 7});  // of the same group
  }
  PointGroups groups(group, [&nodes](std::int32_t point) -> std::span<const std::int32_t> {
    return nodes[static_cast<std::size_t>(point)];
  });
  groups.update(positions, velocities, 1.0 / 90);
  for (const Named& named : shapes()) {
    SCOPED_TRACE(named.name);
    const ShapeGeometry shape(named.shape);
    int visited_of_all = 0;
    for (int trial = 0; trial < 20; ++trial) {
      const Pose pose{random.vector(0.3),
                      Quaternion(random.uniform(), random.uniform(), random.uniform(), random.uniform()).normalized()};
      std::vector<bool> visited(count, false);
      groups.for_each_near(shape, pose, 0.001, [&](std::int32_t node) {
        EXPECT_FALSE(visited[static_cast<std::size_t>(node)]);
        visited[static_cast<std::size_t>(node)] = true;
        ++visited_of_all;
      });
      for (int i = 0; i < count; ++i) {
        for (const double t : {0.0, 1.0 / 90}) {
          const auto at = [&](std::int32_t n) { return Vector3(positions.col(n) + t * velocities.col(n)); };
          const auto& pair = nodes[static_cast<std::size_t>(i)];
          const Vector3 p = 0.25 * at(pair[0]) + 0.75 * at(pair[1]);
          if (shape.signed_distance(pose.inverse() * p) < 0.001) {
            EXPECT_TRUE(visited[static_cast<std::size_t>(i)]);
          }
        }
      }
    }
    if (named.name != "plane") {
      EXPECT_LT(visited_of_all, 20 * count / 2) << "most nodes were visited: groups out of reach are not skipped";
    }
  }
}

}  // namespace
}  // namespace softhand::geometry_test
