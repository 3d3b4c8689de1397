#include "hand_builder/rigged_hand.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "mesh_files/gltf_file.hpp"
#include "trackers/replay/recording.hpp"

namespace softhand::builder {
namespace {

using nlohmann::json;

// Merges all primitives of the skinned mesh, in the file's frame. Corners at the same place are welded.
TriangleMesh read_mesh(const GltfFile& file, const json& mesh, std::size_t joint_count) {
  TriangleMesh out;
  std::map<std::array<long long, 3>, std::int32_t> places;
  const auto primitives = mesh.find("primitives");
  file.check(primitives != mesh.end() && primitives->is_array() && !primitives->empty(), "meshes.primitives",
             "at least one");
  for (const json& primitive : *primitives) {
    file.check(file.index(primitive, "mode", "meshes.primitives", 4) == 4, "meshes.primitives.mode", "4 (triangles)");
    const auto attributes = primitive.find("attributes");
    file.check(attributes != primitive.end() && attributes->is_object(), "meshes.primitives.attributes", "a table");
    const auto attribute = [&](const char* key, const char* type) {
      return file.numbers(file.index(*attributes, key, "meshes.primitives.attributes"), type, key);
    };
    const auto positions = attribute("POSITION", "VEC3"), weights = attribute("WEIGHTS_0", "VEC4");
    const std::size_t count = positions.size() / 3;
    const auto joints = file.indices(file.index(*attributes, "JOINTS_0", "meshes.primitives.attributes"), "VEC4",
                                     "JOINTS_0", joint_count);
    const auto indices =
        file.indices(file.index(primitive, "indices", "meshes.primitives"), "SCALAR", "indices", count);
    file.check(joints.size() == 4 * count && weights.size() == 4 * count, "JOINTS_0, WEIGHTS_0",
               "as many rows as POSITION");
    std::vector<std::int32_t> welded;
    for (std::size_t v = 0; v < count; ++v) {
      double sum = 0;
      for (std::size_t k = 4 * v; k < 4 * v + 4; ++k) sum += weights[k];
      file.check(std::abs(sum - 1) < 0.02, "WEIGHTS_0", "weights that sum to 1 at every vertex");
      const Vector3 x(positions[3 * v], positions[3 * v + 1], positions[3 * v + 2]);
      const auto [found, fresh] =
          places.try_emplace({std::llround(x.x() * 1e6), std::llround(x.y() * 1e6), std::llround(x.z() * 1e6)},
                             static_cast<std::int32_t>(out.vertices.size()));
      if (fresh) out.vertices.push_back(x);
      welded.push_back(found->second);
    }
    file.check(indices.size() % 3 == 0, "indices", "whole triangles");
    for (std::size_t i = 0; i < indices.size(); i += 3) {
      std::array<std::int32_t, 3> triangle{};
      for (std::size_t k = 0; k < 3; ++k) triangle[k] = welded[indices[i + k]];
      out.triangles.push_back(triangle);
    }
  }
  return out;
}

void check_closed(const GltfFile& file, const TriangleMesh& mesh) {
  std::map<std::array<std::int32_t, 2>, int> edges;
  std::vector<bool> used(mesh.vertices.size(), false);
  double volume = 0;
  for (const auto& t : mesh.triangles) {
    const auto x = [&](std::size_t k) { return mesh.vertices[static_cast<std::size_t>(t[k])]; };
    file.check((x(1) - x(0)).cross(x(2) - x(0)).norm() > 1e-14, "indices",
               "triangles with an area once vertices are welded");
    volume += x(0).dot(x(1).cross(x(2))) / 6;
    for (std::size_t k = 0; k < 3; ++k) {
      used[static_cast<std::size_t>(t[k])] = true;
      file.check(++edges[{t[k], t[(k + 1) % 3]}] == 1, "indices",
                 "a 2-manifold, but an edge has more than two triangles, or two of opposite orientation");
    }
  }
  for (const auto& [edge, count] : edges)
    file.check(edges.count({edge[1], edge[0]}) == 1, "indices", "a closed surface, but an edge has only one triangle");
  const auto vertices = std::count(used.begin(), used.end(), true);
  file.check(vertices == static_cast<std::ptrdiff_t>(mesh.vertices.size()), "POSITION",
             "every vertex to belong to a triangle");
  file.check(2 * static_cast<std::size_t>(vertices) == 4 + mesh.triangles.size(), "indices",
             "one closed surface without handles");
  file.check(volume > 0, "indices", "triangles with outward orientation");
}

}  // namespace

RiggedHand load_rigged_hand(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw std::runtime_error(path + ": cannot be read");
  return parse_rigged_hand(in, path);
}

RiggedHand parse_rigged_hand(std::istream& in, const std::string& name) try {
  const GltfFile file(in, name);
  const json& document = file.document();
  file.check(document.contains("skins") && document["skins"].is_array() && document["skins"].size() == 1, "skins",
             "exactly one");
  const json& skin = file.element("skins", 0);
  file.check(skin.contains("joints") && skin["joints"].is_array(), "skins[0].joints", "a list");
  const json& joints = skin["joints"];
  const auto matrices =
      file.numbers(file.index(skin, "inverseBindMatrices", "skins[0]"), "MAT4", "inverseBindMatrices");
  file.check(matrices.size() == 16 * joints.size(), "skins[0].inverseBindMatrices", "one for each joint");
  std::map<std::string, Pose> frames;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const std::string where = "skins[0].joints[" + std::to_string(j) + "]";
    file.check(joints[j].is_number_unsigned(), where, "an index");
    const std::string joint_name = file.element("nodes", joints[j].get<std::size_t>()).value("name", std::string());
    // glTF stores matrices column by column.
    const Eigen::Matrix4d frame = Eigen::Map<const Eigen::Matrix4d>(matrices.data() + 16 * j).inverse();
    const Matrix3 turn = frame.topLeftCorner<3, 3>();
    file.check(
        frame.allFinite() && (turn.transpose() * turn - Matrix3::Identity()).norm() < 0.02 && turn.determinant() > 0,
        "skins[0].inverseBindMatrices (" + joint_name + ")", "a rotation and a translation in metres, without scale");
    frames[joint_name] = {frame.topRightCorner<3, 1>(), Quaternion(turn).normalized()};
  }

  RiggedHand hand;
  for (std::size_t j = 1; j < kJointCount; ++j) {
    const std::string expected(webxr_name(static_cast<Joint>(j)));
    const auto found = frames.find(expected);
    file.check(found != frames.end(), "skins[0].joints", "a joint named " + expected);
    hand.rest.joints[j] = found->second;
  }
  std::size_t node = 0;
  while (node < document["nodes"].size() && !document["nodes"][node].contains("skin")) ++node;
  const json& skinned = file.element("nodes", node);
  hand.skin = read_mesh(
      file, file.element("meshes", file.index(skinned, "mesh", "nodes[" + std::to_string(node) + "]")), joints.size());

  // Transform to the wrist's frame and mirror to the right side. A mirrored frame is S R S.
  const Pose to_wrist = hand.rest.joints[slot_of(Joint::wrist)].inverse();
  for (Pose& joint : hand.rest.joints) joint = to_wrist * joint;
  for (Vector3& vertex : hand.skin.vertices) vertex = to_wrist * vertex;
  if (hand.rest.joints[slot_of(Joint::thumb_proximal)].position.x() >
      hand.rest.joints[slot_of(Joint::little_proximal)].position.x()) {
    hand.side = Side::left;
    for (Pose& joint : hand.rest.joints) {
      joint.position.x() = -joint.position.x();
      const Quaternion q = joint.orientation;
      joint.orientation = Quaternion(q.w(), q.x(), -q.y(), -q.z());
    }
    for (Vector3& vertex : hand.skin.vertices) vertex.x() = -vertex.x();
    for (auto& triangle : hand.skin.triangles) std::swap(triangle[1], triangle[2]);
  }
  check_closed(file, hand.skin);

  for (std::size_t b = 1; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    const Pose& joint = hand.rest.joints[slot_of(joint_of(body))];
    const Vector3 along = (hand.rest.joints[slot_of(end_joint_of(body))].position - joint.position).normalized();
    file.check(along.dot(joint.orientation * -Vector3::UnitZ()) > std::cos(30 * M_PI / 180),
               "skins[0].inverseBindMatrices (" + std::string(webxr_name(joint_of(body))) + ")",
               "-Z within 30 degrees of the bone");
  }
  const Pose& metacarpal = hand.rest.joints[slot_of(Joint::middle_metacarpal)];
  hand.rest.joints[slot_of(Joint::palm)] = {
      0.5 * (metacarpal.position + hand.rest.joints[slot_of(Joint::middle_proximal)].position), metacarpal.orientation};

  const MeshSkin shape(hand.skin);
  for (std::size_t j = 0; j < kJointCount; ++j) {
    hand.rest.radii[j] = -shape.distance(hand.rest.joints[j].position);
    file.check(hand.rest.radii[j] > 0.002 && hand.rest.radii[j] < 0.05,
               "skins[0].inverseBindMatrices (" + std::string(kJointNames[j]) + ")",
               "a joint 2 to 50 mm inside the skin");
  }
  // Deep in the palm the distance to the skin does not give the thickness of one bone.
  for (int f = 1; f < kFingerCount; ++f) {
    const std::size_t proximal = static_cast<std::size_t>(index_of(tip_of(static_cast<Finger>(f)))) - 3;
    hand.rest.radii[proximal - 1] = std::min(hand.rest.radii[proximal - 1], 1.25 * hand.rest.radii[proximal]);
  }
  hand.rest.stump = 0;
  for (const Vector3& vertex : hand.skin.vertices) hand.rest.stump = std::max(hand.rest.stump, vertex.z());
  if (document.contains("asset") && document["asset"].is_object())
    hand.copyright = document["asset"].value("copyright", std::string());
  return hand;
} catch (const json::exception& error) {  // for example text instead of a number
  throw std::runtime_error(name + ": " + error.what());
}

}  // namespace softhand::builder
