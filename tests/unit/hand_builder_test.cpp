#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <numbers>
#include <random>

#include "hand_builder/assemble.hpp"
#include "hand_builder/contact_samples.hpp"
#include "hand_builder/parametric_skin.hpp"
#include "trackers/replay/generator.hpp"

namespace softhand::builder {
namespace {

double degrees(double radians) { return radians * 180.0 / std::numbers::pi; }
std::size_t at(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }
std::size_t at(std::int32_t index) { return static_cast<std::size_t>(index); }
std::size_t at(Body body) { return static_cast<std::size_t>(index_of(body)); }

class Ball : public SkinShape {
 public:
  double distance(const Vector3& point) const override { return point.norm() - 0.03; }
  std::array<Vector3, 2> bounds() const override { return {Vector3::Constant(-0.04), Vector3::Constant(0.04)}; }
};

TEST(RoundedCone, ReturnsTheDistanceToTheHullOfTwoSpheres) {
  // The exact distance to the hull of two spheres is the least distance to the interpolated spheres between them.
  const Vector3 a(0.01, -0.02, 0.003), b(0.05, 0.01, -0.01);
  std::mt19937 generator(1);
  std::uniform_real_distribution<double> uniform(-0.1, 0.1);
  for (int i = 0; i < 200; ++i) {
    const Vector3 p(uniform(generator), uniform(generator), uniform(generator));
    double least = 1;
    for (int k = 0; k <= 20000; ++k) {
      const double s = k / 20000.0;
      least = std::min(least, (p - a - s * (b - a)).norm() - (0.012 + s * (0.004 - 0.012)));
    }
    const double distance = rounded_cone_distance(p, a, b, 0.012, 0.004);
    if (distance > 0) {
      EXPECT_NEAR(distance, least, 1e-8);
    }
    EXPECT_EQ(distance > 0, least > 0);
  }
}

TEST(RoundedCone, AcceptsASphereInsideTheOther) {
  EXPECT_NEAR(rounded_cone_distance({0.05, 0, 0}, {0, 0, 0}, {0.001, 0, 0}, 0.02, 0.005), 0.03, 1e-12);
}

TEST(Proportions, MatchTheRequestedLengthAndBreadth) {
  for (const double length : {0.15, 0.189, 0.22}) {
    const RestSkeleton rest = natural_rest({length, 0.45 * length});
    double chain = rest.radii[at(Joint::middle_tip)] + rest.joints[at(Joint::middle_proximal)].position.norm();
    for (int j = index_of(Joint::middle_proximal); j < index_of(Joint::middle_tip); ++j) {
      chain +=
          (rest.joints[static_cast<std::size_t>(j + 1)].position - rest.joints[static_cast<std::size_t>(j)].position)
              .norm();
    }
    EXPECT_NEAR(chain, length, 1e-9);
    const double across = rest.joints[at(Joint::little_proximal)].position.x() -
                          rest.joints[at(Joint::index_proximal)].position.x() + rest.radii[at(Joint::little_proximal)] +
                          rest.radii[at(Joint::index_proximal)];
    EXPECT_NEAR(across, 0.45 * length, 0.1 * 0.45 * length);
  }
  EXPECT_THROW(natural_rest({0.05, 0.085}), std::invalid_argument);
  EXPECT_THROW(natural_rest({0.19, std::nan("")}), std::invalid_argument);
  EXPECT_THROW(natural_rest({0.12, 0.115}), std::invalid_argument) << "the little finger's metacarpal is too short";
}

TEST(Proportions, FramesPointAlongTheBonesWithTheNailOnTheBack) {
  const RestSkeleton rest = natural_rest(HandSize{});
  for (std::size_t b = 2; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    const Pose& joint = rest.joints[at(joint_of(body))];
    const Vector3 along = (rest.joints[at(end_joint_of(body))].position - joint.position).normalized();
    EXPECT_GT(along.dot(-(joint.orientation * Vector3::UnitZ())), 1 - 1e-9) << kBodyNames[b];
    // The fingernails point up, and forward if the finger is curled. The resting thumb's nail points to the thumb's own
    // side and a little down, because the thumb's pad faces the fingers.
    const Vector3 nail = joint.orientation * Vector3::UnitY();
    if (finger_of(body) == Finger::thumb) {
      EXPECT_LT(nail.x(), -0.4) << kBodyNames[b];
      EXPECT_LT(nail.y(), 0) << kBodyNames[b];
    } else {
      EXPECT_GT(nail.y() - nail.z(), 0.7) << kBodyNames[b];
      EXPECT_GT(nail.y(), -0.2) << kBodyNames[b];
      EXPECT_LT(std::abs(nail.x()), 0.25) << kBodyNames[b];
    }
  }
}

TEST(Proportions, ThumbPadFacesTheFingers) {
  const RestSkeleton rest = natural_rest(HandSize{});
  const Pose& thumb = rest.joints[at(Joint::thumb_tip)];
  const Vector3 pad = -(thumb.orientation * Vector3::UnitY());
  const Vector3 to_fingers = (rest.joints[at(Joint::middle_tip)].position - thumb.position).normalized();
  EXPECT_GT(pad.dot(to_fingers), 0.2);
  EXPECT_LT(thumb.position.y(), -0.02);  // away from the palm's plane
}

TEST(Proportions, PadsFaceEachOtherInAPinch) {
  HandModel hand;  // only its bones are used
  const RestSkeleton rest = natural_rest(HandSize{});
  hand.rest_joints = rest.joints;
  hand.joint_radii = rest.radii;
  hand.bodies = make_bodies(rest);
  for (const double width : {0.025, 0.04}) {
    GeneratorOptions options;
    options.object_width = width;
    const JointFrames grip = make_motion(hand, options)->at(options.approach_time + options.close_time);
    const auto pad = [&grip](Joint distal) { return Vector3(grip[at(distal)].orientation * -Vector3::UnitY()); };
    const double facing = -pad(Joint::thumb_distal).dot(pad(Joint::index_distal));
    EXPECT_LT(degrees(std::acos(std::clamp(facing, -1.0, 1.0))), 20) << width;
  }
}

TEST(Proportions, MeasuredHandKeepsItsJointOffsets) {
  const RestSkeleton rest = natural_rest({0.17, 0.08});
  const std::array<Pose, kJointCount> frames[] = {rest.joints};
  const RestSkeleton again = natural_rest(measure_skeleton(frames, rest.radii), Side::right);
  for (std::size_t j = 0; j < kJointCount; ++j)
    EXPECT_LT((again.joints[j].position - rest.joints[j].position).norm(), 1e-9) << kJointNames[j];
}

TEST(Proportions, RefuseMillimetresAndAHandOfTheOtherSide) {
  const RestSkeleton right = natural_rest({0.17, 0.08});
  const auto error_of = [&right](double scale, Side side) -> std::string {
    std::array<Pose, kJointCount> frames[] = {right.joints};
    for (Pose& joint : frames[0]) joint.position *= scale;
    try {
      natural_rest(measure_skeleton(frames, right.radii), side);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(error_of(0.6, Side::right), "") << "the size of a small child's hand";
  EXPECT_NE(error_of(1000, Side::right).find("expected positions in metres"), std::string::npos);
  EXPECT_NE(error_of(0, Side::right).find("expected positions in metres"), std::string::npos);
  EXPECT_NE(error_of(1, Side::left).find("expected a left hand"), std::string::npos);
}

TEST(Skin, GradientIsAtMostOneAndTheWristIsInside) {
  const RestSkeleton rest = natural_rest(HandSize{});
  const ParametricSkin skin(rest);
  std::mt19937 generator(3);
  const auto box = skin.bounds();
  std::uniform_real_distribution<double> uniform(0, 1);
  for (int i = 0; i < 2000; ++i) {
    const Vector3 p =
        box[0] + Vector3(uniform(generator), uniform(generator), uniform(generator)).cwiseProduct(box[1] - box[0]);
    const Vector3 step = 1e-4 * Vector3(uniform(generator) - 0.5, uniform(generator) - 0.5, uniform(generator) - 0.5);
    EXPECT_LE(std::abs(skin.distance(p + step) - skin.distance(p)), 1.3 * step.norm() + 1e-12);
  }
  for (const Pose& joint : rest.joints) EXPECT_LT(skin.distance(joint.position), -0.004);
}

TEST(Skin, KnucklesDoNotBulge) {
  // Along a finger, from the proximal phalanx to the distal joint, the dorsal skin's distance from the bones never
  // grows by more than 0.6 mm.
  const RestSkeleton rest = natural_rest(HandSize{});
  const ParametricSkin skin(rest);
  for (int f = 1; f < kFingerCount; ++f) {
    double narrowest = 1;
    for (int j = index_of(tip_of(static_cast<Finger>(f))) - 3; j < index_of(tip_of(static_cast<Finger>(f))); ++j) {
      const Pose& a = rest.joints[static_cast<std::size_t>(j)];
      const double length = (rest.joints[static_cast<std::size_t>(j + 1)].position - a.position).norm();
      const bool first = j == index_of(tip_of(static_cast<Finger>(f))) - 3;
      for (double s = first ? 0.6 : 0.0; s <= 1; s += 0.05) {
        const double thickness = -skin.distance(a * Vector3(0, 0, -s * length));
        EXPECT_LT(thickness, narrowest + 0.6e-3) << "finger " << f << " joint " << j << " at " << s;
        narrowest = std::min(narrowest, thickness);
      }
    }
  }
}

TEST(Bones, LieInsideTheSkinAndLeaveRoomForThePulp) {
  for (const HandSize size : {HandSize{}, HandSize{0.16, 0.072}, HandSize{0.21, 0.095}}) {
    const RestSkeleton rest = natural_rest(size);
    const ParametricSkin skin(rest);
    const auto bodies = make_bodies(rest);
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const Pose& joint = rest.joints[at(joint_of(static_cast<Body>(b)))];
      for (const double s : {0.0, 0.25, 0.5, 0.75, 1.0}) {
        const double radius = (1 - s) * bodies[b].bone_start_radius + s * bodies[b].bone_end_radius;
        // These are points of the bone's own surface. Inside a union of shapes, the skin's distance function is only a
        // lower bound of the depth.
        const Vector3 axis = (bodies[b].bone_end - bodies[b].bone_start).normalized();
        const Vector3 across = axis.unitOrthogonal();
        for (int k = 0; k < 16; ++k) {
          const Vector3 outward = Eigen::AngleAxisd(2 * std::numbers::pi * k / 16, axis) * across;
          const Vector3 local = (1 - s) * bodies[b].bone_start + s * bodies[b].bone_end + radius * outward;
          EXPECT_LT(skin.distance(joint * local), -0.001) << kBodyNames[b] << " at " << s;
        }
      }
    }
    for (int f = 0; f < kFingerCount; ++f) {
      const std::size_t b = at(distal_of(static_cast<Finger>(f)));
      const Pose& joint = rest.joints[at(joint_of(static_cast<Body>(b)))];
      const auto thickness = [&](const Vector3& from, const Vector3& direction, double radius) {
        double reach = 0;
        while (reach < 0.03 && skin.distance(joint * (from + reach * direction)) < 0) reach += 1e-5;
        return reach - radius;
      };
      const Vector3 middle = 0.25 * bodies[b].bone_start + 0.75 * bodies[b].bone_end;
      const double palmar =
          thickness(middle, -Vector3::UnitY(), 0.25 * bodies[b].bone_start_radius + 0.75 * bodies[b].bone_end_radius);
      const double beyond = thickness(bodies[b].bone_end, -Vector3::UnitZ(), bodies[b].bone_end_radius);
      EXPECT_GT(palmar, 0.0025) << "finger " << f;
      EXPECT_LT(palmar, 0.0075) << "finger " << f;
      EXPECT_GT(beyond, 0.003) << "finger " << f;
      EXPECT_LT(beyond, 0.007) << "finger " << f;
    }
  }
}

TEST(Bodies, RangesAreRelativeToTheRestPose) {
  const auto bodies = make_bodies(natural_rest(HandSize{}));
  // PIP of the index finger: the range is 100 degrees from straight, and the joint is flexed by 33 degrees at rest.
  const JointModel& pip = bodies[at(Body::index_intermediate)].joint;
  EXPECT_EQ(pip.kind, JointKind::hinge);
  EXPECT_NEAR(degrees(pip.flexion_range[0]), -67, 0.5);
  EXPECT_NEAR(degrees(pip.flexion_range[1]), 33, 0.5);
  EXPECT_EQ(bodies[at(Body::thumb_metacarpal)].joint.kind, JointKind::saddle);
  EXPECT_EQ(bodies[at(Body::thumb_distal)].joint.kind, JointKind::hinge);
  EXPECT_EQ(bodies[at(Body::ring_metacarpal)].joint.kind, JointKind::ball);
  EXPECT_EQ(bodies[at(Body::forearm)].joint.kind, JointKind::free);
}

TEST(Bodies, RestIsRelaxedAndRangesIncludeAFlatHandAndAFist) {
  const RestSkeleton rest = natural_rest(HandSize{});
  const auto bodies = make_bodies(rest);
  constexpr double kRelaxed[] = {40, 35, 15}, kFist[] = {82, 100, 60};  // degrees of MCP, PIP and DIP
  for (int f = 1; f < kFingerCount; ++f) {
    for (int k = 1; k <= 3; ++k) {
      const auto joint = static_cast<std::size_t>(index_of(tip_of(static_cast<Finger>(f))) - 4 + k);
      const Quaternion turn = rest.joints[joint - 1].orientation.conjugate() * rest.joints[joint].orientation;
      const double flexed = -degrees(2 * std::atan2(turn.x(), turn.w()));
      // A metacarpal's frame follows the slope of the metacarpal. So the proximal phalanx is compared with the hand.
      const Quaternion in_hand = rest.joints[joint].orientation;
      const double relaxed = k == 1 ? -degrees(2 * std::atan2(in_hand.x(), in_hand.w())) : flexed;
      EXPECT_NEAR(relaxed, kRelaxed[k - 1], 7) << "finger " << f << " joint " << k;
      const JointModel& model = bodies[at(body_of(static_cast<Joint>(joint)))].joint;
      EXPECT_LE(kFist[k - 1] - flexed, -degrees(model.flexion_range[0]) + 0.5) << "finger " << f << " joint " << k;
      EXPECT_LE(flexed, degrees(model.flexion_range[1]) + 0.5) << "finger " << f << " joint " << k;
    }
  }
}

TEST(SkinTriangles, OfABallAreClosedPointOutwardAndLieOnTheBall) {
  const Ball ball;
  const TriangleMesh mesh = triangulate_skin(ball, 0.003);
  double volume = 0;
  std::map<std::pair<std::int32_t, std::int32_t>, int> edges;
  for (const auto& t : mesh.triangles) {
    const auto x = [&](std::size_t k) { return mesh.vertices[static_cast<std::size_t>(t[k])]; };
    volume += x(0).dot(x(1).cross(x(2))) / 6;
    for (std::size_t k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
  }
  for (const auto& [edge, uses] : edges) EXPECT_EQ(edges.count({edge.second, edge.first}), 1u);
  for (const Vector3& v : mesh.vertices) EXPECT_NEAR(ball.distance(v), 0, 1e-6);
  const double exact = 4.0 / 3.0 * std::numbers::pi * 2.7e-5;
  EXPECT_NEAR(volume, exact, 0.02 * exact);
  EXPECT_NEAR(skin_volume(ball, 0.001), exact, 0.005 * exact);
}

TEST(Smoother, RaisesTheWorstAngle) {
  // An octahedron whose centre node lies nearly in one face.
  const Ball ball;
  TetrahedralMesh mesh;
  for (int k = 0; k < 3; ++k)
    for (const double s : {1.0, -1.0}) mesh.nodes.push_back(0.03 * s * Vector3::Unit(k));
  mesh.nodes.push_back(Vector3(0.009, 0.009, 0.009));
  for (std::int32_t x = 0; x < 2; ++x)
    for (std::int32_t y = 2; y < 4; ++y)
      for (std::int32_t z = 4; z < 6; ++z) {
        std::array<std::int32_t, 4> t{6, x, y, z};
        if ((x + y + z) % 2) std::swap(t[2], t[3]);
        mesh.tetrahedra.push_back(t);
      }
  mesh.surface = boundary(mesh.tetrahedra);
  ASSERT_EQ(mesh.surface.size(), 8u);
  const double before = mesh.minimum_dihedral_degrees();
  improve(
      mesh, ball, [](const Vector3&) { return 1.0; }, {}, mesh.volume());
  EXPECT_GT(mesh.minimum_dihedral_degrees(), before + 20);
}

// Four ears around the long axis of a stretched octahedron. If one is removed, the axis is on the surface, and the
// others stay.
TEST(FlatEars, AreRemovedBetweenTwoParts) {
  const auto octahedron = [](double height) {
    TetrahedralMesh mesh;
    mesh.nodes = {{0, 0, height}, {0, 0, -height}, {0.01, 0, 0}, {0, 0.01, 0}, {-0.01, 0, 0}, {0, -0.01, 0}};
    for (std::int32_t k = 0; k < 4; ++k) mesh.tetrahedra.push_back({1, 0, 2 + k, 2 + (k + 1) % 4});
    mesh.surface = boundary(mesh.tetrahedra);
    return mesh;
  };
  TetrahedralMesh mesh = octahedron(0.03);  // the outer faces meet at 153 degrees
  ASSERT_EQ(mesh.surface.size(), 8u);
  ASSERT_GT(mesh.minimum_dihedral_degrees(), 1);
  remove_flat_ears(mesh, {-1, -1, -1, 4, 4, 4});
  EXPECT_EQ(mesh.tetrahedra.size(), 4u);
  remove_flat_ears(mesh, {-1, -1, 3, 4, 4, 4});
  EXPECT_EQ(mesh.tetrahedra, (std::vector<std::array<std::int32_t, 4>>{{1, 0, 3, 4}, {1, 0, 4, 5}, {1, 0, 5, 2}}));
  EXPECT_EQ(mesh.nodes.size(), 6u);
  std::map<std::pair<std::int32_t, std::int32_t>, int> edges;
  for (const auto& f : mesh.surface)
    for (std::size_t k = 0; k < 3; ++k) ++edges[std::minmax({f[k], f[(k + 1) % 3]})];
  EXPECT_EQ(edges.size(), 12u);
  for (const auto& [edge, count] : edges) EXPECT_EQ(count, 2);
  mesh = octahedron(0.015);  // 130 degrees
  remove_flat_ears(mesh, {-1, -1, 3, 4, 5, 6});
  EXPECT_EQ(mesh.tetrahedra.size(), 4u);
}

double area_of(const TriangleMesh& mesh) {
  double area = 0;
  for (const auto& t : mesh.triangles) {
    const auto x = [&](std::size_t k) { return mesh.vertices[at(t[k])]; };
    area += 0.5 * (x(1) - x(0)).cross(x(2) - x(0)).norm();
  }
  return area;
}

// Samples keep their distance, leave no hole, and share the area. Half of the sphere is sampled twice as finely.
TEST(ContactSamples, CoverASphere) {
  constexpr double kFine = 2e-3, kCoarse = 4e-3;
  const Ball ball;
  const TriangleMesh mesh = triangulate_skin(ball, 0.003);
  const auto spacing = [](const Vector3& x) { return x.y() < 0 ? kFine : kCoarse; };
  const std::vector<ContactSample> samples = sample_contacts(mesh, spacing);
  double area = 0, fine_area = 0, fine = 0;
  for (const ContactSample& a : samples) {
    area += a.area;
    if (a.position.y() < -kCoarse) fine_area += a.area, ++fine;
    EXPECT_GT(a.area, 0);
    for (const ContactSample& b : samples) {
      if (&a != &b) {
        EXPECT_GE((a.position - b.position).norm(), std::min(spacing(a.position), spacing(b.position)));
      }
    }
  }
  EXPECT_NEAR(area, area_of(mesh), 1e-12);
  // Between a hexagonal lattice of this spacing and one of 1.4 times the spacing.
  EXPECT_GT(fine_area / fine, 0.87 * kFine * kFine);
  EXPECT_LT(fine_area / fine, 1.7 * kFine * kFine);
  for (const Vector3& x : mesh.vertices) {
    double nearest = 1;
    for (const ContactSample& sample : samples) nearest = std::min(nearest, (sample.position - x).norm());
    EXPECT_LE(nearest, spacing(x) + 1e-3);
  }
  EXPECT_THROW(sample_contacts({}, spacing), std::invalid_argument);
}

// A hand file has all that its contact points need, and a full build makes the same points.
TEST(ContactSamples, OfAShippedHandAreRemadeFromItsMesh) {
  const HandModel hand = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  const RestSkeleton rest = natural_rest(HandSize{});
  const ParametricSkin skin(rest);
  const TriangleMesh display = triangulate_skin(skin, 0.0030);
  HandModel same = hand, unrounded = hand;
  // A mesh before it is written.
  for (Vector3& node : unrounded.nodes) node += Vector3(4e-8, -3e-8, 2e-8);
  for (HandModel* remade : {&same, &unrounded}) {
    add_contact_points(*remade, rest, display);
    ASSERT_EQ(remade->contact_points.size(), hand.contact_points.size());
    for (std::size_t p = 0; p < hand.contact_points.size(); ++p) {
      const SkinPoint &a = remade->contact_points[p], &b = hand.contact_points[p];
      ASSERT_EQ(a.tetrahedron, b.tetrahedron) << p;
      ASSERT_EQ(a.body, b.body) << p;
      ASSERT_NEAR(a.area, b.area, 1e-3 * b.area) << p;
      for (std::size_t k = 0; k < 4; ++k) ASSERT_NEAR(a.weights[k], b.weights[k], 1e-9) << p;
    }
  }
}

class ShippedHand : public testing::TestWithParam<int> {};

TEST_P(ShippedHand, IsValidAndMatchesTheSkin) {
  const std::string path =
      std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_" + std::to_string(GetParam()) + ".hand.json";
  const HandModel hand = load_hand(path);  // validates
  EXPECT_GE(hand.node_count(), GetParam());
  EXPECT_LE(hand.node_count(), 1.07 * GetParam());
  const TetrahedralMesh mesh{hand.nodes, hand.tetrahedra, hand.surface};
  EXPECT_GE(mesh.minimum_dihedral_degrees(), 15);

  const RestSkeleton rest{hand.rest_joints, hand.joint_radii};
  const ParametricSkin skin(rest);
  const double exact = skin_volume(skin, 0.0015);
  EXPECT_NEAR(mesh.volume(), exact, 0.03 * exact);

  // One closed surface whose triangles point outward. Each edge occurs once in each direction. The enclosed volume is
  // that of the tetrahedra. The Euler characteristic is that of a sphere.
  std::map<std::pair<std::int32_t, std::int32_t>, int> edges;
  double volume = 0;
  std::vector<bool> outer(hand.nodes.size(), false);
  for (const auto& t : hand.surface) {
    const auto x = [&](std::size_t k) { return hand.nodes[static_cast<std::size_t>(t[k])]; };
    volume += x(0).dot(x(1).cross(x(2))) / 6;
    for (std::size_t k = 0; k < 3; ++k) {
      ++edges[{t[k], t[(k + 1) % 3]}];
      outer[static_cast<std::size_t>(t[k])] = true;
    }
  }
  for (const auto& [edge, uses] : edges) {
    ASSERT_EQ(uses, 1);
    ASSERT_EQ(edges.count({edge.second, edge.first}), 1u);
  }
  EXPECT_NEAR(volume, mesh.volume(), 1e-9);
  const auto outer_count = static_cast<int>(std::count(outer.begin(), outer.end(), true));
  EXPECT_EQ(outer_count - static_cast<int>(edges.size() / 2) + static_cast<int>(hand.surface.size()), 2);

  // The mesh reaches the end of the skin at each fingertip: no finger is cut off.
  for (int f = 0; f < kFingerCount; ++f) {
    const Pose& tip = hand.rest_joints[at(tip_of(static_cast<Finger>(f)))];
    double reach = -1;
    for (const Vector3& node : hand.nodes) {
      const Vector3 local = tip.inverse() * node;
      if (local.head<2>().norm() < 0.008) reach = std::max(reach, -local.z());
    }
    EXPECT_GT(reach, 0.85 * hand.joint_radii[at(tip_of(static_cast<Finger>(f)))]) << "finger " << f;
  }
  // Each bone is attached to its tissue, at most once per tetrahedron, and only at points inside the tetrahedron.
  std::array<double, kBodyCount> held{};
  std::map<std::pair<int, int>, int> pairs;
  for (const Attachment& a : hand.attachments) {
    held[static_cast<std::size_t>(a.body)] += a.stiffness;
    EXPECT_EQ(++pairs[std::make_pair(a.body, a.tetrahedron)], 1);
    for (const double w : a.weights) EXPECT_GE(w, -1e-6);
  }
  for (std::size_t b = 0; b < kBodyCount; ++b) EXPECT_GT(held[b], 1.5e4) << kBodyNames[b];
  // The display's skin is finer than the tissue's surface. It lies on the parametric skin.
  EXPECT_GE(hand.skin_vertices.size(), 4000u);
  EXPECT_LE(hand.skin_vertices.size(), 20000u);
  for (const SkinVertex& v : hand.skin_vertices) {
    Vector3 x = Vector3::Zero();
    for (std::size_t k = 0; k < 4; ++k) {
      x += static_cast<double>(v.weights[k]) *
           hand.nodes[static_cast<std::size_t>(hand.tetrahedra[static_cast<std::size_t>(v.tetrahedron)][k])];
    }
    ASSERT_LT(std::abs(skin.distance(x)), 0.0015);
  }
}

TEST_P(ShippedHand, HasTheSameContactPointsOnEachMesh) {
  const std::string folder = std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_";
  const HandModel reference = load_hand(folder + "6000.hand.json");
  const HandModel hand = load_hand(folder + std::to_string(GetParam()) + ".hand.json");
  const auto places_of = [](const HandModel& h) {
    std::vector<Vector3> places;
    for (const SkinPoint& p : h.contact_points) places.push_back(h.position_of(p));
    return places;
  };
  const std::vector<Vector3> places = places_of(hand), there = places_of(reference);
  ASSERT_EQ(places.size(), there.size());
  double area = 0, apart = 0, fine = 0, fine_apart = 0, fine_gap = 0;
  for (std::size_t p = 0; p < places.size(); ++p) {
    const SkinPoint& point = hand.contact_points[p];
    ASSERT_EQ(point.area, reference.contact_points[p].area);
    ASSERT_EQ(point.body, reference.contact_points[p].body);
    area += point.area;
    apart += (places[p] - there[p]).norm() / static_cast<double>(places.size());
    if (point.area > 7e-6) continue;
    double gap = 1;
    for (std::size_t q = 0; q < places.size(); ++q) {
      if (q != p) gap = std::min(gap, (places[q] - places[p]).norm());
    }
    ++fine;
    fine_gap += gap;
    fine_apart += (places[p] - there[p]).norm();
  }
  // A coarse mesh departs from the skin, most at palm and forearm.
  EXPECT_LT(apart, 1.5e-3);
  EXPECT_LT(fine_apart / fine, 0.8e-3);
  EXPECT_GT(fine, 600) << "points on the pulps";
  EXPECT_NEAR(fine_gap / fine, 2e-3, 0.3e-3);
  TriangleMesh skin;
  for (const SkinVertex& v : reference.skin_vertices) {
    skin.vertices.push_back(Vector3::Zero());
    for (std::size_t k = 0; k < 4; ++k)
      skin.vertices.back() +=
          static_cast<double>(v.weights[k]) * reference.nodes[at(reference.tetrahedra[at(v.tetrahedron)][k])];
  }
  skin.triangles = reference.skin_triangles;
  EXPECT_NEAR(area, area_of(skin), 1e-4 * area);
}

INSTANTIATE_TEST_SUITE_P(Sizes, ShippedHand, testing::Values(400, 750, 1450, 3000, 6000),
                         testing::PrintToStringParamName());

}  // namespace
}  // namespace softhand::builder
