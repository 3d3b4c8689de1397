// Rigged hands: the surface and the skeleton of a shipped hand are written as a GLB and read back.
#include "hand_builder/rigged_hand.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cstring>
#include <functional>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>
#include <sstream>

#include "hand_builder/assemble.hpp"
#include "hand_builder/parametric_skin.hpp"
#include "trackers/replay/recording.hpp"

namespace softhand::builder {
namespace {

using nlohmann::json;

struct Source {
  RestSkeleton rest;
  TriangleMesh skin;
};
const Source& source() {
  static const Source made = [] {
    const HandModel hand = load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_3000.hand.json");
    Source out{{hand.rest_joints, hand.joint_radii}, {}};
    std::vector<std::int32_t> number(hand.nodes.size(), -1);
    for (auto triangle : hand.surface) {
      for (std::int32_t& v : triangle) {
        std::int32_t& n = number[static_cast<std::size_t>(v)];
        if (n < 0) {
          n = static_cast<std::int32_t>(out.skin.vertices.size());
          out.skin.vertices.push_back(hand.nodes[static_cast<std::size_t>(v)]);
        }
        v = n;
      }
      out.skin.triangles.push_back(triangle);
    }
    return out;
  }();
  return made;
}

// The parts of a GLB. A test can corrupt single parts.
struct Parts {
  std::vector<std::array<float, 3>> positions;
  std::vector<std::uint32_t> indices;
  std::vector<std::array<float, 4>> weights;
  std::vector<Eigen::Matrix4f> matrices;
  json document;
};

Parts parts_of(const Source& hand, const Pose& place, bool left) {
  Parts parts;
  const auto put = [&](Vector3 x) {
    if (left) x.x() = -x.x();
    x = place * x;
    return std::array<float, 3>{static_cast<float>(x.x()), static_cast<float>(x.y()), static_cast<float>(x.z())};
  };
  // Every vertex occurs twice, because exporters split vertices at seams.
  for (int copy = 0; copy < 2; ++copy) {
    for (const Vector3& v : hand.skin.vertices) parts.positions.push_back(put(v));
  }
  const auto count = static_cast<std::uint32_t>(hand.skin.vertices.size());
  for (std::size_t t = 0; t < hand.skin.triangles.size(); ++t) {
    auto triangle = hand.skin.triangles[t];
    if (left) std::swap(triangle[1], triangle[2]);
    for (const std::int32_t v : triangle) parts.indices.push_back(static_cast<std::uint32_t>(v) + (t % 2 ? count : 0));
  }
  parts.weights.assign(parts.positions.size(), {0.75f, 0.25f, 0, 0});
  json nodes = json::array(), joints = json::array();
  for (std::size_t j = kJointCount - 1; j >= 1; --j) {
    Pose frame = hand.rest.joints[j];
    if (left) {
      frame.position.x() = -frame.position.x();
      frame.orientation =
          Quaternion(frame.orientation.w(), frame.orientation.x(), -frame.orientation.y(), -frame.orientation.z());
    }
    const Pose inverse = (place * frame).inverse();
    Eigen::Matrix4f matrix = Eigen::Matrix4f::Identity();
    matrix.topLeftCorner<3, 3>() = inverse.orientation.toRotationMatrix().cast<float>();
    matrix.topRightCorner<3, 1>() = inverse.position.cast<float>();
    parts.matrices.push_back(matrix);
    joints.push_back(nodes.size());
    nodes.push_back({{"name", webxr_name(static_cast<Joint>(j))}});
  }
  nodes.push_back({{"mesh", 0}, {"skin", 0}});
  parts.document = {
      {"asset", {{"version", "2.0"}, {"copyright", "nobody's"}}},
      {"nodes", nodes},
      {"skins", {{{"joints", joints}, {"inverseBindMatrices", 4}}}},
      {"meshes",
       {{{"primitives", {{{"attributes", {{"POSITION", 0}, {"JOINTS_0", 1}, {"WEIGHTS_0", 2}}}, {"indices", 3}}}}}}}};
  return parts;
}

std::string glb(Parts parts) {
  std::string data;
  json views = json::array(), accessors = json::array();
  const auto append = [&](const void* bytes, std::size_t size, std::size_t count, int component, const char* type) {
    views.push_back({{"buffer", 0}, {"byteOffset", data.size()}, {"byteLength", size}});
    accessors.push_back(
        {{"bufferView", accessors.size()}, {"componentType", component}, {"count", count}, {"type", type}});
    data.append(static_cast<const char*>(bytes), size);
    data.resize((data.size() + 3) / 4 * 4);
  };
  const std::vector<std::array<std::uint8_t, 4>> joints(parts.positions.size(), {0, 24, 0, 0});
  append(parts.positions.data(), 12 * parts.positions.size(), parts.positions.size(), 5126, "VEC3");
  append(joints.data(), 4 * joints.size(), joints.size(), 5121, "VEC4");
  append(parts.weights.data(), 16 * parts.weights.size(), parts.weights.size(), 5126, "VEC4");
  append(parts.indices.data(), 4 * parts.indices.size(), parts.indices.size(), 5125, "SCALAR");
  append(parts.matrices.data(), 64 * parts.matrices.size(), parts.matrices.size(), 5126, "MAT4");
  parts.document["bufferViews"] = views;
  parts.document["accessors"] = accessors;
  parts.document["buffers"] = {{{"byteLength", data.size()}}};
  std::string text = parts.document.dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');
  std::string out;
  const auto word = [&out](std::size_t value) {
    const auto narrow = static_cast<std::uint32_t>(value);
    out.append(reinterpret_cast<const char*>(&narrow), 4);
  };
  word(0x46546C67), word(2), word(28 + text.size() + data.size());
  word(text.size()), word(0x4E4F534A);
  out += text;
  word(data.size()), word(0x004E4942);
  return out + data;
}

RiggedHand parsed(const std::string& bytes) {
  std::istringstream in(bytes);
  return parse_rigged_hand(in, "hand.glb");
}
// A pose far from the wrist's frame: turned, and more than a metre away.
Pose elsewhere() {
  return {Vector3(0.3, 1.2, -0.4), Quaternion(Eigen::AngleAxisd(2.1, Vector3(1, 2, -1).normalized()))};
}

TEST(RiggedHandFile, ReadsSkeletonAndSkinOfEitherSide) {
  for (const bool left : {false, true}) {
    const RiggedHand hand = parsed(glb(parts_of(source(), elsewhere(), left)));
    EXPECT_EQ(hand.side, left ? Side::left : Side::right);
    EXPECT_EQ(hand.copyright, "nobody's");
    for (std::size_t j = 0; j < kJointCount; ++j) {
      const Pose& expected = source().rest.joints[j];
      EXPECT_LT((hand.rest.joints[j].position - expected.position).norm(), 1e-6) << kJointNames[j];
      EXPECT_LT(hand.rest.joints[j].orientation.angularDistance(expected.orientation), 1e-4) << kJointNames[j];
      // The depth of a finger's joint is its radius. The radii of other joints depend on the flesh around them.
      if (j > index_of(Joint::index_proximal) && j != slot_of(tip_of(Finger::index)) &&
          finger_of(body_of(static_cast<Joint>(j))) == Finger::index) {
        EXPECT_NEAR(hand.rest.radii[j], source().rest.radii[j], 1e-3) << kJointNames[j];
      }
    }
    ASSERT_EQ(hand.skin.vertices.size(), source().skin.vertices.size());
    ASSERT_EQ(hand.skin.triangles.size(), source().skin.triangles.size());
    EXPECT_NEAR(hand.rest.stump, 0.045, 1e-3);
    const MeshSkin skin(source().skin);
    for (const Vector3& vertex : hand.skin.vertices) ASSERT_LT(std::abs(skin.distance(vertex)), 1e-6);
  }
}

TEST(RiggedHandFile, BonesLieInsideTheSkin) {
  const RiggedHand hand = parsed(glb(parts_of(source(), elsewhere(), false)));
  const MeshSkin skin(hand.skin);
  const auto bodies = make_bodies(hand.rest);
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Pose& joint = hand.rest.joints[slot_of(joint_of(static_cast<Body>(b)))];
    for (const double s : {0.0, 0.5, 1.0}) {
      const double radius = (1 - s) * bodies[b].bone_start_radius + s * bodies[b].bone_end_radius;
      EXPECT_LT(skin.distance(joint * ((1 - s) * bodies[b].bone_start + s * bodies[b].bone_end)) + radius, -0.5e-3)
          << kBodyNames[b] << " at " << s;
    }
  }
}

TEST(MeshSkin, ReturnsTheSignedDistanceToItsSurface) {
  const ParametricSkin exact(source().rest);
  const MeshSkin skin(source().skin);
  const auto box = skin.bounds();
  // No point of a triangle is farther from its nearest corner than the longest edge divided by the square root of 3.
  double longest_edge = 0;
  for (const auto& t : source().skin.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto corner = [&](std::size_t i) { return source().skin.vertices[static_cast<std::size_t>(t[i % 3])]; };
      longest_edge = std::max(longest_edge, (corner(k) - corner(k + 1)).norm());
    }
  }
  std::mt19937 generator(5);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (int i = 0; i < 1000; ++i) {
    const Vector3 p =
        box[0] + Vector3(uniform(generator), uniform(generator), uniform(generator)).cwiseProduct(box[1] - box[0]);
    double least = 1;
    for (const Vector3& v : source().skin.vertices) least = std::min(least, (p - v).norm());
    const double distance = skin.distance(p);
    EXPECT_LE(std::abs(distance), least + 1e-12);
    EXPECT_GE(std::abs(distance), least - longest_edge / std::sqrt(3.0));
    // The facets cut the sharp edge of the forearm's stump.
    constexpr double kEdge = 0.01;  // m
    if (std::abs(exact.distance(p)) > 2e-3 && p.z() < source().rest.stump - kEdge) {
      EXPECT_EQ(distance < 0, exact.distance(p) < 0) << p.transpose();
    }
  }
}

TEST(RiggedHandFile, RefusesUnusableFilesAndNamesFileAndField) {
  const auto error_of = [](const std::function<void(Parts&)>& corrupt) -> std::string {
    Parts parts = parts_of(source(), Pose{}, false);
    corrupt(parts);
    try {
      parsed(glb(parts));
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "accepted";
  };
  const auto expect_error = [&](const char* expected, const std::function<void(Parts&)>& corrupt) {
    EXPECT_NE(error_of(corrupt).find(expected), std::string::npos) << "actual error: " << error_of(corrupt);
  };
  EXPECT_EQ(error_of([](Parts&) {}), "accepted");
  expect_error("hand.glb: skins[0].joints: expected a joint named pinky-finger-tip",
               [](Parts& p) { p.document["nodes"][0]["name"] = "Bone.025"; });
  expect_error("hand.glb: indices: expected a closed surface",
               [](Parts& p) { p.indices.resize(p.indices.size() - 3); });
  expect_error("hand.glb: indices: expected triangles with outward orientation", [](Parts& p) {
    for (std::size_t i = 0; i < p.indices.size(); i += 3) std::swap(p.indices[i], p.indices[i + 1]);
  });
  expect_error("(indices): expected indices below", [](Parts& p) { p.indices[7] = 1000000; });
  expect_error("hand.glb: WEIGHTS_0: expected weights that sum to 1", [](Parts& p) { p.weights[3] = {0.5f, 0, 0, 0}; });
  expect_error("(POSITION): expected finite numbers", [](Parts& p) { p.positions[5][1] = std::nanf(""); });
  expect_error("inverseBindMatrices (thumb-tip): expected a rotation and a translation",
               [](Parts& p) { p.matrices[kJointCount - 1 - slot_of(Joint::thumb_tip)] *= 0.01f; });
  expect_error("inverseBindMatrices (ring-finger-phalanx-distal): expected -Z within 30 degrees", [](Parts& p) {
    const Eigen::Matrix4f turn = Eigen::Affine3f(Eigen::AngleAxisf(1.5f, Eigen::Vector3f::UnitX())).matrix();
    auto& matrix = p.matrices[kJointCount - 1 - slot_of(Joint::ring_distal)];
    matrix = turn * matrix;
  });
  expect_error("hand.glb: skins: expected exactly one", [](Parts& p) { p.document.erase("skins"); });
  expect_error("hand.glb: ", [](Parts& p) { p.document["asset"]["copyright"] = 2026; });
  expect_error("hand.glb: ", [](Parts& p) { p.document["meshes"][0]["primitives"][0]["mode"] = "triangles"; });
  std::string bytes = glb(parts_of(source(), Pose{}, false));
  for (const std::size_t length : {std::size_t{3}, std::size_t{19}, std::size_t{200}, bytes.size() - 100}) {
    EXPECT_THROW(parsed(bytes.substr(0, length)), std::runtime_error) << length;
  }
}

}  // namespace
}  // namespace softhand::builder
