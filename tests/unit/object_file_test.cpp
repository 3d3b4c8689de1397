// Object files: reading, writing, refusals, search by name and hash, and the objects of config/objects.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "geometry/mesh_distance.hpp"
#include "model/object_model.hpp"
#include "runtime/object_store.hpp"
#include "support/meshes.hpp"

namespace {

using namespace softhand;
namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

const char* const kShipped[] = {"mug", "bottle", "scissors", "drawer", "button", "key", "pen", "die"};

std::string folder() { return std::string(SOFTHAND_SOURCE_DIR) + "/config/objects"; }

std::string content(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

class Folder {
 public:
  Folder() : path_(fs::temp_directory_path() / ("softhand_objects_" + std::to_string(getpid()))) {
    fs::create_directories(path_);
  }
  ~Folder() { fs::remove_all(path_); }
  std::string operator/(const std::string& name) const { return (path_ / name).string(); }

 private:
  fs::path path_;
};

// A box on a box with a slider between them.
ObjectModel two_boxes() {
  ObjectModel object;
  object.name = "two_boxes";
  object.notice = "none";
  for (const char* name : {"lower", "upper"}) {
    ObjectLink link;
    link.name = name;
    link.mesh = softhand::testing::box_mesh({0.01, 0.02, 0.03});
    const SolidProperties solid = solid_properties(link.mesh);
    link.mass = 1000 * solid.volume;
    link.centre_of_mass = solid.centroid;
    link.inertia = 1000 * solid.inertia;
    link.friction = 0.5;
    link.pieces = {link.mesh.vertices};
    object.links.push_back(link);
  }
  LinkJoint joint;
  joint.child = 1;
  joint.parent_from_joint.position = {0, 0.01, 0};
  joint.law.kind = ObjectJointKind::slider;
  joint.law.minimum = -0.01;
  joint.law.maximum = 0.02;
  joint.law.friction = 1.5;
  joint.law.load_friction = 0.004;
  joint.law.stiffness = 100;
  joint.law.rest = 0.005;
  joint.law.detents[0] = {0.01, 0.001, 0.002, 0};
  joint.law.detent_count = 1;
  object.joints.push_back(joint);
  return object;
}

std::string message(const std::function<void()>& action) {
  try {
    action();
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "no error";
}

// A cube of five tetrahedra.
ObjectModel soft_cube() {
  ObjectModel object;
  object.name = "soft_cube";
  SoftBody body;
  for (int n = 0; n < 8; ++n) body.nodes.emplace_back(0.02 * (n & 1), 0.02 * ((n >> 1) & 1), 0.02 * (n >> 2));
  body.tetrahedra = {{0, 1, 2, 4}, {1, 3, 2, 7}, {1, 2, 4, 7}, {1, 4, 5, 7}, {2, 4, 7, 6}};
  body.material = {"soft", 60, 1e4, 0.2, 1e9, 0, 0.5};
  body.friction = 0.7;
  object.soft = body;
  return object;
}

TEST(ObjectFile, FlexibleObjectIsReadAsItWasWritten) {
  const Folder temporary;
  const std::string first = temporary / "a.object.json", second = temporary / "b.object.json";
  save_object(soft_cube(), first);
  const ObjectModel loaded = load_object(first).model;
  ASSERT_TRUE(loaded.soft);
  EXPECT_EQ(loaded.soft->nodes, soft_cube().soft->nodes);
  EXPECT_EQ(loaded.soft->tetrahedra, soft_cube().soft->tetrahedra);
  EXPECT_EQ(loaded.soft->friction, 0.7);
  EXPECT_EQ(loaded.soft->material.youngs_modulus, 1e4);
  EXPECT_EQ(loaded.soft->material.strain_limit_ramp, 0.5);
  save_object(loaded, second);
  EXPECT_EQ(content(first), content(second));
}

TEST(ObjectFile, RefusesABadFlexibleObjectWithItsField) {
  const Folder temporary;
  save_object(soft_cube(), temporary / "a.object.json");
  const Json good = Json::parse(content(temporary / "a.object.json"));
  const auto refusal = [&good](const char* field, const Json& value) {
    Json bad = good;
    bad["soft"][field] = value;
    return message([&] { parse_object(bad.dump(), "cube.json"); });
  };
  EXPECT_EQ(refusal("friction", -1), "cube.json: soft.friction: expected 0 to 10");
  EXPECT_NE(refusal("strain_limit_ramp", -1).find("cube.json: soft: materials[0].strain_limit_ramp: expected"),
            std::string::npos);
  EXPECT_EQ(refusal("density", "heavy"), "cube.json: soft.density: expected a number");
  EXPECT_NE(refusal("poisson_ratio", 0.6).find("cube.json: soft: materials[0].poisson_ratio: expected"),
            std::string::npos);
  EXPECT_NE(refusal("youngs_modulus", 0).find("cube.json: soft: materials[0].youngs_modulus: expected"),
            std::string::npos);
  EXPECT_NE(refusal("tetrahedra", {0, 1, 2, 9}).find("cube.json: soft: tetrahedra[0]: expected indices of nodes"),
            std::string::npos);
  EXPECT_NE(refusal("tetrahedra", {0, 2, 1, 4}).find("cube.json: soft: tetrahedra[0]: expected positive volume"),
            std::string::npos);
  EXPECT_NE(refusal("tetrahedra", {0, 1, 2, 4}).find("cube.json: soft: nodes[3]: expected a node that some"),
            std::string::npos);
  EXPECT_NE(refusal("tetrahedra", {0, 1, 2}).find("cube.json: soft.tetrahedra: expected a multiple of 4"),
            std::string::npos);
  EXPECT_EQ(refusal("colour", 1), "cube.json: soft.colour: unknown field");
  Json both = good;
  both["links"] = Json::array();
  EXPECT_EQ(message([&] { parse_object(both.dump(), "cube.json"); }), "cube.json: links: unknown field");
}

TEST(ObjectFile, ShippedFlexibleObjectsAreValid) {
  const LoadedObject ball = load_object(folder() + "/sponge_ball.object.json");
  ASSERT_TRUE(ball.model.soft);
  EXPECT_GE(ball.model.soft->nodes.size(), 500u);
  for (const Vector3& node : ball.model.soft->nodes) EXPECT_LE(node.norm(), 0.0315);
}

TEST(ObjectFile, ReadingAndWritingGivesTheSameBytes) {
  const Folder temporary;
  const std::string first = temporary / "a.object.json", second = temporary / "b.object.json";
  save_object(two_boxes(), first);
  const LoadedObject loaded = load_object(first);
  save_object(loaded.model, second);
  EXPECT_EQ(content(first), content(second));
  EXPECT_EQ(loaded.sha256, load_object(second).sha256);
  EXPECT_EQ(loaded.sha256.size(), 64u);
  const LinkJoint& joint = loaded.model.joints.at(0);
  EXPECT_EQ(joint.law.kind, ObjectJointKind::slider);
  EXPECT_EQ(joint.law.maximum, 0.02);
  EXPECT_EQ(joint.law.friction, 1.5);
  EXPECT_EQ(joint.law.load_friction, 0.004);
  EXPECT_EQ(joint.law.rest, 0.005);
  EXPECT_EQ(joint.law.detent_count, 1u);
  EXPECT_EQ(joint.law.detents[0].depth, 0.001);
  EXPECT_EQ(joint.parent_from_joint.position.y(), 0.01);
  for (const char* name : kShipped) {
    const std::string path = folder() + "/" + name + std::string(kObjectSuffix);
    save_object(load_object(path).model, second);
    EXPECT_EQ(content(path), content(second)) << name;
  }
}

TEST(ObjectFile, BadFilesAreRefusedWithFileAndField) {
  const Folder temporary;
  const std::string path = temporary / "a.object.json";
  save_object(two_boxes(), path);
  const std::string good = content(path);
  struct Case {
    const char* what;
    std::function<void(Json&)> change;
    const char* expected;
  };
  const Case cases[] = {
      {"other format", [](Json& j) { j["format"] = "softhand-hand"; }, "format: expected 'softhand-object'"},
      {"newer version", [](Json& j) { j["version"] = 2; }, "version: expected 1"},
      {"unknown field", [](Json& j) { j["colour"] = 1; }, "colour: unknown field"},
      {"bad name", [](Json& j) { j["name"] = "../mug"; }, "name: expected 1 to 63 letters"},
      {"no links", [](Json& j) { j["links"] = j["joints"] = Json::array(); }, "links: expected 1 to 16"},
      {"missing mass", [](Json& j) { j["links"][0].erase("mass"); }, "links[0].mass: missing"},
      {"negative mass", [](Json& j) { j["links"][0]["mass"] = -1; }, "links[0].mass: expected a number above 0"},
      {"text as mass", [](Json& j) { j["links"][0]["mass"] = "1"; }, "links[0].mass: expected a number"},
      {"flat inertia", [](Json& j) { j["links"][1]["inertia"] = {0, 0, 0, 0, 0, 0}; }, "links[1].inertia: expected"},
      {"huge inertia", [](Json& j) { j["links"][1]["inertia"] = {1, 1, 1, 0, 0, 0}; }, "links[1].inertia: expected"},
      {"centre outside",
       [](Json& j) {
         j["links"][0]["centre_of_mass"] = {1, 0, 0};
       },
       "links[0].centre_of_mass"},
      {"friction", [](Json& j) { j["links"][0]["friction"] = 11; }, "links[0].friction: expected 0 to 10"},
      {"spacing", [](Json& j) { j["links"][0]["grid_spacing"] = 0; }, "links[0].grid_spacing: expected"},
      {"open mesh",
       [](Json& j) {
         for (int k = 0; k < 3; ++k) j["links"][0]["triangles"].erase(0);
       },
       "links[0].triangles: expected a closed surface"},
      {"inward mesh",
       [](Json& j) {
         Json& t = j["links"][0]["triangles"];
         for (std::size_t i = 0; i < t.size(); i += 3) std::swap(t[i], t[i + 1]);
       },
       "links[0].triangles: expected outward"},
      {"index", [](Json& j) { j["links"][0]["triangles"][0] = 99; }, "links[0].triangles: expected indices"},
      {"half a vertex", [](Json& j) { j["links"][0]["vertices"].erase(0); }, "links[0].vertices: expected a multiple"},
      {"far vertex", [](Json& j) { j["links"][0]["vertices"][0] = 11; }, "links[0].vertices: expected coordinates"},
      {"piece",
       [](Json& j) {
         j["links"][0]["pieces"][0] = {0, 0, 0};
       },
       "links[0].pieces[0]: expected 4 to 256"},
      {"same names", [](Json& j) { j["links"][1]["name"] = j["joints"][0]["child"] = "lower"; },
       "links[1].name: expected a name that no"},
      {"no joint", [](Json& j) { j["joints"] = Json::array(); }, "joints: expected one joint for each link but"},
      {"kind", [](Json& j) { j["joints"][0]["kind"] = "glue"; }, "joints[0].kind: expected fixed, hinge"},
      {"parent", [](Json& j) { j["joints"][0]["parent"] = "x"; }, "joints[0].parent: expected the name of a link"},
      {"own child", [](Json& j) { j["joints"][0]["child"] = "lower"; }, "joints[0].child: expected a link that"},
      {"limits", [](Json& j) { j["joints"][0]["minimum"] = 1; }, "joints[0]: limits"},
      {"load friction", [](Json& j) { j["joints"][0]["load_friction"] = 11; },
       "joints[0]: load_friction is 11.000000, expected 0 to 10"},
      {"detent", [](Json& j) { j["joints"][0]["detents"][0]["width"] = 0; }, "joints[0]: detents.width"},
      {"detent field", [](Json& j) { j["joints"][0]["detents"][0].erase("at"); }, "joints[0].detents[0].at: missing"},
      {"no rotation",
       [](Json& j) {
         j["joints"][0]["child_from_joint"]["orientation"] = {0, 0, 0, 0};
       },
       "joints[0].child_from_joint.orientation: expected a unit quaternion"},
  };
  for (const Case& c : cases) {
    Json json = Json::parse(good);
    c.change(json);
    std::ofstream(path) << json.dump();
    const std::string text = message([&] { load_object(path); });
    EXPECT_EQ(text.rfind(path + ": ", 0), 0u) << c.what << ": " << text;
    EXPECT_NE(text.find(c.expected), std::string::npos) << c.what << ": " << text;
  }
  std::ofstream(path) << good.substr(0, good.size() / 2);
  EXPECT_NE(message([&] { load_object(path); }).find("not an object file"), std::string::npos);
  EXPECT_NE(message([&] { load_object(temporary / "none"); }).find("cannot be opened"), std::string::npos);
}

// Every damaged file is either refused with a message or still valid.
TEST(ObjectFile, DamagedFilesDoNotCrash) {
  const Folder temporary;
  save_object(two_boxes(), temporary / "a.object.json");
  const std::string good = content(temporary / "a.object.json");
  std::mt19937 random(11);
  const std::string characters = "0123456789-+.eE,:[]{}\"\\ntfx \x80";
  int refused = 0;
  for (int i = 0; i < 2000; ++i) {
    std::string text = good;
    for (int k = 0; k < 1 + i % 4; ++k) {
      const std::size_t place = random() % text.size();
      switch (random() % 3) {
        case 0:
          text[place] = characters[random() % characters.size()];
          break;
        case 1:
          text.erase(place, 1 + random() % 20);
          break;
        default:
          text.insert(place, 1 + random() % 3, characters[random() % characters.size()]);
          break;
      }
    }
    try {
      parse_object(text, "file");
    } catch (const std::runtime_error& error) {
      ++refused;
      EXPECT_EQ(std::string(error.what()).rfind("file: ", 0), 0u) << error.what();
    }
  }
  EXPECT_GT(refused, 1000);
}

TEST(ObjectFile, FindsAnObjectByNameAndHash) {
  const Folder temporary;
  fs::create_directories(temporary / "one");
  fs::create_directories(temporary / "two");
  ObjectModel object = two_boxes();
  save_object(object, temporary / "one/two_boxes.object.json");
  object.links[0].mass = 2;
  object.links[0].inertia *= 2;
  save_object(object, temporary / "two/two_boxes.object.json");
  const std::vector<std::string> folders{temporary / "none", temporary / "one", temporary / "two"};
  const std::string second = load_object(temporary / "two/two_boxes.object.json").sha256;
  const auto any = find_object("two_boxes", "", folders), exact = find_object("two_boxes", second, folders);
  ASSERT_TRUE(any && exact);
  EXPECT_EQ(any->path, temporary / "one/two_boxes.object.json");
  EXPECT_EQ(exact->path, temporary / "two/two_boxes.object.json");
  EXPECT_EQ(exact->sha256, second);
  EXPECT_FALSE(find_object("another", "", folders));
  EXPECT_NE(message([&] { find_object("two_boxes", std::string(64, '0'), folders); }).find("has the SHA-256"),
            std::string::npos);
  for (const char* name : {"", "../one/two_boxes", "/etc/passwd", ".hidden"})
    EXPECT_NE(message([&] { find_object(name, "", folders); }).find("without folders"), std::string::npos) << name;
}

TEST(ObjectFile, LinksFollowTheirJoints) {
  ObjectModel object = two_boxes();
  EXPECT_LT((link_poses(object, {0.015})[1].position - Vector3(0, 0.025, 0)).norm(), 1e-12);
  object.joints[0].law.kind = ObjectJointKind::screw;
  object.joints[0].law.pitch = 0.004;
  const Pose screwed = link_poses(object, {M_PI})[1];
  EXPECT_NEAR(screwed.position.y(), 0.012, 1e-12);
  EXPECT_LT((screwed.orientation * Vector3::UnitX() + Vector3::UnitX()).norm(), 1e-12);
}

// Points on the triangles of a mesh, with their corners, edges and middles.
std::vector<Vector3> samples(const TriangleMesh& mesh) {
  std::vector<Vector3> points;
  for (const auto& t : mesh.triangles)
    for (int i = 0; i <= 6; ++i)
      for (int j = 0; i + j <= 6; ++j)
        points.push_back((i * mesh.vertices[static_cast<std::size_t>(t[0])] +
                          j * mesh.vertices[static_cast<std::size_t>(t[1])] +
                          (6 - i - j) * mesh.vertices[static_cast<std::size_t>(t[2])]) /
                         6);
  return points;
}

// The objects in their whole range: links do not overlap, and the pieces lie about on the mesh.
TEST(ShippedObjects, LinksDoNotOverlap) {
  for (const char* name : kShipped) {
    SCOPED_TRACE(name);
    const ObjectModel object = load_object(folder() + "/" + name + std::string(kObjectSuffix)).model;
    EXPECT_EQ(object.name, name);
    EXPECT_FALSE(object.notice.empty());
    EXPECT_LT(fs::file_size(folder() + "/" + name + std::string(kObjectSuffix)), 200'000u);
    for (const ObjectLink& link : object.links) {
      EXPECT_LE(link.pieces.size(), 32u);
      const MeshDistance distance(link.mesh);
      for (const auto& piece : link.pieces) {
        EXPECT_LE(piece.size(), 64u);
        for (const Vector3& p : piece) EXPECT_LT(std::abs(distance.distance(p)), 0.004);
      }
    }
    for (const LinkJoint& joint : object.joints) {
      const MeshDistance parent(object.links[joint.parent].mesh), child(object.links[joint.child].mesh);
      for (const double part : {0.0, 0.25, 0.5, 1.0}) {
        const double q = joint.law.minimum + part * (joint.law.maximum - joint.law.minimum);
        const Pose pose = link_poses(object, {q})[joint.child], back = pose.inverse();
        for (const Vector3& v : samples(object.links[joint.child].mesh))
          ASSERT_GT(parent.distance(pose * v), 0) << "q " << q << ", child's point " << v.transpose();
        for (const Vector3& v : samples(object.links[joint.parent].mesh))
          ASSERT_GT(child.distance(back * v), 0) << "q " << q << ", parent's point " << v.transpose();
      }
    }
  }
}

TEST(ShippedObjects, ScissorsHaveLoopsForFingers) {
  const ObjectModel object = load_object(folder() + "/scissors.object.json").model;
  const MeshDistance right(object.links[1].mesh);
  // The loop's centre, and points 15 and 22.5 mm from it.
  EXPECT_GT(right.distance({0.024, -0.067, 0.0016}), 0.014);
  EXPECT_NEAR(right.distance({0.024 + 0.015, -0.067, 0.0016}), 0, 3e-4);
  EXPECT_NEAR(right.distance({0.024, -0.067 - 0.0225, 0.0016}), 0, 3e-4);
}

}  // namespace
