// Distance grids and compounds: known answers, continuity, crossings of thin walls.
#include "geometry/distance_grid.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <random>

#include "geometry/mesh_distance.hpp"
#include "geometry/shape.hpp"
#include "support/count_allocations.hpp"
#include "support/meshes.hpp"
#include "support/shapes.hpp"

namespace distance_grid_test {
namespace {

using namespace softhand;

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double uniform(double low = -1, double high = 1) {
    return low + (high - low) * (static_cast<double>(engine_() >> 11) * 0x1p-53);
  }
  Vector3 in_box(const Vector3& half) {
    const double x = uniform(), y = uniform(), z = uniform();
    return half.cwiseProduct(Vector3(x, y, z));
  }

 private:
  std::mt19937_64 engine_;
};

struct Solid {
  const char* name;
  DistanceGrid::Exact distance;
  Vector3 half;
};

std::vector<Solid> smooth_solids() {
  return {{"sphere", [](const Vector3& p) { return p.norm() - 0.02; }, Vector3::Constant(0.02)},
          {"torus", [](const Vector3& p) { return std::hypot(std::hypot(p.x(), p.z()) - 0.03, p.y()) - 0.008; },
           Vector3(0.038, 0.008, 0.038)}};
}

Vector3 gradient(const DistanceGrid::Exact& f, const Vector3& p) {
  Vector3 g;
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3 e = 1e-6 * Vector3::Unit(axis);
    g[axis] = (f(p + e) - f(p - e)) / 2e-6;
  }
  return g;
}

struct Errors {
  double distance = 0, normal = 0;
};
// Largest errors at points nearer to the surface than one and a half cells.
Errors errors_of(const Solid& solid, double spacing) {
  const DistanceGrid grid(solid.distance, -solid.half, solid.half, spacing);
  Random random(5);
  Errors errors;
  for (int i = 0; i < 200000; ++i) {
    const Vector3 p = random.in_box(1.2 * solid.half);
    const double exact = solid.distance(p);
    if (std::abs(exact) > 1.5 * spacing) continue;
    const SurfacePoint at = grid.closest(p);
    errors.distance = std::max(errors.distance, std::abs(at.distance - exact));
    errors.normal = std::max(errors.normal, (at.normal - gradient(solid.distance, p)).norm());
  }
  return errors;
}

TEST(DistanceGrid, ErrorFallsWithTheThirdPowerOfTheSpacing) {
  for (const Solid& solid : smooth_solids()) {
    SCOPED_TRACE(solid.name);
    const Errors coarse = errors_of(solid, 0.002), fine = errors_of(solid, 0.001), finest = errors_of(solid, 0.0005);
    for (const auto& [spacing, e] : {std::pair{2.0, coarse}, {1.0, fine}, {0.5, finest}})
      std::printf("%s, cells of %.1f mm: distance %.3f um, normal %.5f\n", solid.name, spacing, 1e6 * e.distance,
                  e.normal);
    std::printf("%s: order of distance %.2f, of normal %.2f\n", solid.name,
                0.5 * std::log2(coarse.distance / finest.distance), 0.5 * std::log2(coarse.normal / finest.normal));
    EXPECT_LT(fine.distance, 2e-6);
    EXPECT_LT(fine.normal, 0.004);
    EXPECT_GT(std::log2(coarse.distance / fine.distance), 2.7);
    EXPECT_GT(std::log2(fine.distance / finest.distance), 2.7);
    EXPECT_GT(std::log2(coarse.normal / fine.normal), 1.8);
    EXPECT_GT(std::log2(fine.normal / finest.normal), 1.8);
  }
}

// The contact force is k_c times the depth.
TEST(DistanceGrid, ForceOfSphereAndTorusMeshesIsWithinOnePercent) {
  const ShapeGeometry sphere(softhand::testing::sphere_mesh(0.02, 0.0007), 0.001);
  const ShapeGeometry torus(softhand::testing::torus_mesh(0.03, 0.008, 0.0005), 0.001);
  const ShapeGeometry* grids[] = {&sphere, &torus};
  const auto solids = smooth_solids();
  for (std::size_t s = 0; s < 2; ++s) {
    SCOPED_TRACE(solids[s].name);
    Random random(6);
    double worst = 0, worst_angle = 0, off_surface = 0;
    int tested = 0;
    while (tested < 20000) {
      const Vector3 p = random.in_box(solids[s].half);
      const double exact = solids[s].distance(p);
      if (exact > -0.001 || exact < -0.003) continue;
      ++tested;
      const SurfacePoint at = grids[s]->closest(p);
      worst = std::max(worst, std::abs(at.distance / exact - 1));
      worst_angle = std::max(worst_angle, (at.normal - gradient(solids[s].distance, p)).norm());
      off_surface = std::max(off_surface, std::abs(solids[s].distance(at.point)));
    }
    std::printf("%s mesh at 1 to 3 mm depth: force error %.3f %%, normal error %.4f\n", solids[s].name, 100 * worst,
                worst_angle);
    EXPECT_LT(worst, 0.01);
    EXPECT_LT(worst_angle, 0.03);
    EXPECT_LT(off_surface, 2e-5);
  }
}

TEST(DistanceGrid, SlidingPointFeelsNoStep) {
  const DistanceGrid grid(softhand::testing::torus_mesh(0.03, 0.008, 0.0012), 0.001);
  const DistanceGrid plate(softhand::testing::box_mesh({0.02, 0.002, 0.03}), 0.001);
  for (const auto& [g, half] :
       {std::pair{&grid, Vector3(0.042, 0.012, 0.042)}, {&plate, Vector3(0.025, 0.008, 0.035)}}) {
    Random random(7);
    double worst_distance = 0, worst_gradient = 0;
    // Long paths through the grid cross every kind of face: between cells, between blocks, between the two levels.
    const double step = 1e-7;
    for (int path = 0; path < 200; ++path) {
      const Vector3 from = random.in_box(half);
      const Vector3 direction = random.in_box(Vector3::Ones()).normalized();
      // The faces between cells are 1 mm apart; each path follows one cell's length in steps of 0.1 um.
      DistanceGrid::Sample last = g->sample(from);
      for (int i = 1; i <= 12000; ++i) {
        const DistanceGrid::Sample here = g->sample(from + i * step * direction);
        worst_distance = std::max(worst_distance, std::abs(here.distance - last.distance));
        worst_gradient = std::max(worst_gradient, (here.gradient - last.gradient).norm());
        last = here;
      }
    }
    // A step would not shrink with the step of the path. A kink of 1 degree would be 0.017.
    EXPECT_LT(worst_distance, 1.01 * step * g->lipschitz());
    EXPECT_LT(worst_gradient, 5 * step / g->spacing());
  }
}

TEST(DistanceGrid, KnowsInsideFromOutsideEverywhere) {
  const double spacing = 0.001;
  for (const TriangleMesh& mesh :
       {softhand::testing::torus_mesh(0.03, 0.008, 0.002), softhand::testing::shell_mesh(0.03, 0.027, 0.002),
        softhand::testing::box_mesh({0.03, 0.0015, 0.02})}) {
    const MeshDistance exact(mesh);
    const DistanceGrid grid(mesh, spacing);
    Random random(8);
    double over = 0, under = 0;
    for (int i = 0; i < 20000; ++i) {
      const Vector3 p = random.in_box(Vector3::Constant(i % 2 == 0 ? 0.04 : 0.2));
      const double d = exact.distance(p), found = grid.sample(p).distance;
      if (std::abs(d) > 0.3 * spacing) {
        EXPECT_EQ(d > 0, found > 0) << p.transpose() << " exact " << d << " found " << found;
      }
      if (d > 0) {
        over = std::max(over, found - d);
        if (d > spacing) under = std::max(under, (d - found) / d);
      }
      const SurfacePoint at = grid.closest(p);
      EXPECT_NEAR(at.normal.norm(), 1, 1e-9);
      EXPECT_NEAR((p - at.distance * at.normal - at.point).norm(), 0, 1e-12);
    }
    std::printf("outside: distance too large by up to %.3f mm, too small by up to %.1f %%\n", 1e3 * over, 100 * under);
    // Broad phases rely on the distance as a lower bound; their margins are larger than this.
    EXPECT_LT(over, 0.5 * spacing);
  }
}

TEST(DistanceGrid, FirstCrossingNeverMissesThinWalls) {
  struct Wall {
    const char* name;
    TriangleMesh mesh;
    Vector3 half;
  };
  const double spacing = 0.001;
  int crossings = 0, misses = 0;
  for (const Wall& wall : {Wall{"plate", softhand::testing::box_mesh({0.03, 0.001, 0.03}), {0.03, 0.02, 0.03}},
                           Wall{"shell", softhand::testing::shell_mesh(0.025, 0.023, 0.0015), {0.03, 0.03, 0.03}}}) {
    SCOPED_TRACE(wall.name);
    const MeshDistance exact(wall.mesh);
    const ShapeGeometry shape(wall.mesh, spacing);
    Random random(9);
    for (int i = 0; i < 5000; ++i) {
      const Vector3 from = random.in_box(wall.half), to = random.in_box(wall.half);
      const auto crossing = shape.first_crossing(from, to);
      if (exact.distance(from) < 0.3 * spacing) continue;
      // Steps of the exact distance find the first point that is surely inside, and whether the path stays clear.
      const double length = (to - from).norm();
      double inside = -1, clearance = 1;
      for (double s = 0; s < length;) {
        const double d = exact.distance(from + s / length * (to - from));
        clearance = std::min(clearance, d);
        if (d < -0.3 * spacing) {
          inside = s;
          break;
        }
        s += std::max(std::abs(d), 0.02 * spacing);
      }
      if (clearance > 0.3 * spacing) {
        EXPECT_FALSE(crossing);
      }
      if (inside < 0) continue;
      ++crossings;
      if (!crossing) {
        ++misses;
        continue;
      }
      EXPECT_LE(crossing->fraction * length, inside + 1e-6);
      EXPECT_LT(std::abs(exact.distance(crossing->point)), 0.3 * spacing);
      EXPECT_LT(std::abs(shape.signed_distance(crossing->point)), 1e-10);
      EXPECT_LE((from + crossing->fraction * (to - from) - crossing->point).norm(), 1e-14);
    }
  }
  std::printf("10000 segments: %d cross a wall, %d missed\n", crossings, misses);
  EXPECT_GT(crossings, 2000);
  EXPECT_EQ(misses, 0);
}

TEST(DistanceGrid, PathThatStartsInsideOrPassesByDoesNotCross) {
  const ShapeGeometry torus(softhand::testing::torus_mesh(0.03, 0.008, 0.002), 0.001);
  EXPECT_FALSE(torus.first_crossing({0.03, 0, 0}, {0.3, 0, 0})) << "starts inside";
  EXPECT_FALSE(torus.first_crossing({0, -0.1, 0}, {0, 0.1, 0})) << "through the hole";
  EXPECT_FALSE(torus.first_crossing({0.1, 0, 0}, {0.1, 0, 0})) << "no length";
  const auto far = torus.first_crossing({0.5, 0, 0}, {-0.5, 0, 0});
  ASSERT_TRUE(far);
  EXPECT_NEAR(far->point.x(), 0.038, 1e-4) << "but for the flat triangles";
  EXPECT_GT(far->normal.x(), 0.999);
}

TEST(DistanceGrid, MassPropertiesAndRestingPointsAreThoseOfTheMesh) {
  const ShapeGeometry exact(softhand::testing::box_shape({0.01, 0.02, 0.03}));
  const ShapeGeometry grid(softhand::testing::box_mesh({0.01, 0.02, 0.03}, 3), 0.001);
  EXPECT_NEAR(grid.solid().volume, exact.solid().volume, 1e-12);
  EXPECT_LT((grid.solid().inertia - exact.solid().inertia).norm(), 1e-9 * exact.solid().inertia.norm());
  EXPECT_DOUBLE_EQ(grid.bounding_radius(), exact.bounding_radius());
  std::vector<RestingPoint> points(ShapeGeometry::most_resting_points);
  EXPECT_EQ(grid.resting_points(Vector3::UnitY(), points), 8u);
  const ShapeGeometry sphere(softhand::testing::sphere_mesh(0.02, 0.002), 0.001);
  const std::size_t count = sphere.resting_points(Vector3::UnitY(), points);
  EXPECT_EQ(count, 64u);
  double lowest = 0;
  for (std::size_t i = 0; i < count; ++i) lowest = std::min(lowest, points[i].centre.y());
  EXPECT_NEAR(lowest, -0.02, 1e-4);
}

// Corners that pass between two contact points of the skin. The 64 corners of a smooth ball pressed beside the skin's
// own points, and the force was 14 % too large.
TEST(DistanceGrid, OnlyRealCornersAreSharp) {
  const auto count = [](const ShapeGeometry& shape) { return shape.sharp_points().size(); };
  EXPECT_EQ(count(ShapeGeometry(softhand::testing::box_shape({0.01, 0.02, 0.03}))), 8u);
  EXPECT_EQ(count(ShapeGeometry(softhand::testing::box_mesh({0.01, 0.02, 0.03}, 3), 0.001)), 8u);
  EXPECT_EQ(count(ShapeGeometry(softhand::testing::box_mesh({0.01, 0.0005, 0.01}, 3), 0.0005)), 8u);
  EXPECT_EQ(count(ShapeGeometry(softhand::testing::sphere_mesh(0.02, 0.0004), 0.001)), 0u);
  EXPECT_EQ(count(ShapeGeometry(softhand::testing::sphere_mesh(0.006, 0.0002), 0.0005)), 0u);
  EXPECT_EQ(count(ShapeGeometry(softhand::testing::sphere_mesh(0.001, 0.0001), 0.00025)), 64u)
      << "smaller than the gap";
}

TEST(Compound, UnionOfTwoBoxesIsTheLongBox) {
  const auto box = std::make_shared<const ShapeGeometry>(softhand::testing::box_shape({0.01, 0.02, 0.03}));
  const Quaternion turn(Eigen::AngleAxisd(M_PI / 2, Vector3::UnitX()));  // maps y to z
  const auto turned = std::make_shared<const ShapeGeometry>(softhand::testing::box_shape({0.01, 0.03, 0.02}));
  const ShapeGeometry both(
      std::vector<PosedShape>{{box, {{-0.01, 0, 0}, Quaternion::Identity()}}, {turned, {{0.01, 0, 0}, turn}}});
  const ShapeGeometry whole(softhand::testing::box_shape({0.02, 0.02, 0.03}));
  Random random(10);
  int crossings = 0;
  for (int i = 0; i < 5000; ++i) {
    const Vector3 p = random.in_box({0.05, 0.05, 0.05}), q = random.in_box({0.05, 0.05, 0.05});
    const double exact = whole.signed_distance(p);
    if (exact > 0) {
      EXPECT_NEAR(both.signed_distance(p), exact, 1e-12);
    } else {
      EXPECT_LE(both.signed_distance(p), 0);
    }
    const auto expected = whole.first_crossing(p, q), found = both.first_crossing(p, q);
    ASSERT_EQ(expected.has_value(), found.has_value());
    if (!expected) continue;
    ++crossings;
    EXPECT_NEAR(expected->fraction, found->fraction, 1e-12);
    EXPECT_LT((expected->normal - found->normal).norm(), 1e-12);
  }
  EXPECT_GT(crossings, 500);
  EXPECT_NEAR(both.solid().volume, whole.solid().volume, 1e-15);
  EXPECT_LT((both.solid().inertia - whole.solid().inertia).norm(), 1e-12 * whole.solid().inertia.norm() + 1e-18);
  std::vector<RestingPoint> points(ShapeGeometry::most_resting_points);
  EXPECT_EQ(both.resting_points(Vector3::UnitY(), points), 16u);
  for (std::size_t i = 0; i < 16; ++i) EXPECT_NEAR(whole.signed_distance(points[i].centre), 0, 1e-12);
}

template <typename Make>
std::string refusal(const Make& make) {
  try {
    make();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(DistanceGrid, RefusesBadArguments) {
  const TriangleMesh box = softhand::testing::box_mesh({0.01, 0.01, 0.01});
  for (const double spacing :
       {0.0, -1.0, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()})
    EXPECT_NE(refusal([&] { ShapeGeometry(box, spacing); }).find("spacing"), std::string::npos) << spacing;
  EXPECT_NE(refusal([&] { ShapeGeometry(box, 1e-6); }).find("samples"), std::string::npos);
  EXPECT_NE(refusal([&] { ShapeGeometry(TriangleMesh{}, 1e-3); }).find("empty"), std::string::npos);
  TriangleMesh inward = box;
  for (auto& t : inward.triangles) std::swap(t[1], t[2]);
  EXPECT_NE(refusal([&] { ShapeGeometry(inward, 1e-3); }).find("volume"), std::string::npos);
  EXPECT_NE(refusal([&] { ShapeGeometry(std::vector<PosedShape>{}); }).find("without parts"), std::string::npos);
  Shape plane;
  plane.kind = static_cast<std::uint32_t>(ShapeKind::plane);
  const auto ground = std::make_shared<const ShapeGeometry>(plane);
  EXPECT_NE(refusal([&] { ShapeGeometry(std::vector<PosedShape>{{ground, {}}}); }).find("plane"), std::string::npos);
  EXPECT_NE(refusal([&] {
              ShapeGeometry(std::vector<PosedShape>{{nullptr, {}}});
            }).find("empty part"),
            std::string::npos);
}

// Prints the cost per query. Counts the allocations, which must be zero.
TEST(DistanceGrid, QueriesDoNotAllocate) {
  Shape hull;
  hull.kind = static_cast<std::uint32_t>(ShapeKind::convex_hull);
  for (const Vector3& v : softhand::testing::sphere_mesh(0.02, 0.006).vertices) {
    if (hull.vertices.size() < kMaxHullVertices) hull.vertices.push_back({v.x(), v.y(), v.z()});
  }
  const ShapeGeometry shapes[] = {ShapeGeometry(softhand::testing::box_shape({0.02, 0.02, 0.02})), ShapeGeometry(hull),
                                  ShapeGeometry(softhand::testing::sphere_mesh(0.02, 0.002), 0.001)};
  const char* names[] = {"box", "hull of 200 to 256 vertices", "grid"};
  std::vector<Vector3> points, ends;
  for (int i = 0; i < 20000; ++i) {
    const double angle = 1e-3 * i, height = 0.02 * std::sin(1.7e-4 * i), across = std::sqrt(4e-4 - height * height);
    const Vector3 normal = Vector3(across * std::cos(angle), height, across * std::sin(angle)) / 0.02;
    points.push_back((0.02 + 0.002 * std::sin(0.1 * i)) * normal);
    ends.push_back(points.back() - 0.005 * normal);
  }
  allocations = 0;
  for (std::size_t s = 0; s < 3; ++s) {
    double sum = 0;
    const auto measure = [&](const auto& query) {
      double best = 1e9;
      for (int repeat = 0; repeat < 5; ++repeat) {
        const auto start = std::chrono::steady_clock::now();
        counting = true;
        for (std::size_t i = 0; i < points.size(); ++i) query(i);
        counting = false;
        best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
      }
      return 1e9 * best / static_cast<double>(points.size());
    };
    const double closest = measure([&](std::size_t i) { sum += shapes[s].closest(points[i]).distance; });
    const double crossing = measure([&](std::size_t i) {
      const auto found = shapes[s].first_crossing(points[i], ends[i]);
      if (found) sum += found->fraction;
    });
    std::printf("%s: closest %.0f ns, first crossing of 5 mm %.0f ns\n", names[s], closest, crossing);
    EXPECT_TRUE(std::isfinite(sum));
  }
  EXPECT_EQ(allocations, 0);
}

}  // namespace
}  // namespace distance_grid_test
