// Mesh files, and softhand-build-object's checks, mass properties and convex pieces.
#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>

#include "geometry/mesh_distance.hpp"
#include "math/tetrahedron.hpp"
#include "mesh_files/mesh_file.hpp"
#include "object_builder/build_object.hpp"
#include "object_builder/cgal_solid.hpp"
#include "object_builder/convex_pieces.hpp"
#include "object_builder/soft_body.hpp"
#include "support/meshes.hpp"

namespace {

using namespace softhand;
namespace fs = std::filesystem;

class ObjectBuilder : public ::testing::Test {
 protected:
  ObjectBuilder() : folder_(fs::temp_directory_path() / ("softhand_builder_" + std::to_string(getpid()))) {
    fs::create_directories(folder_);
  }
  ~ObjectBuilder() override { fs::remove_all(folder_); }

  std::string write(const std::string& name, const std::string& text) const {
    const std::string path = (folder_ / name).string();
    std::ofstream(path, std::ios::binary) << text;
    return path;
  }
  std::string write_obj(const std::string& name, const TriangleMesh& mesh) const {
    std::string text = "# a comment\no object\n";
    char line[120];
    for (const Vector3& v : mesh.vertices) {
      std::snprintf(line, sizeof line, "v %.9f %.9f %.9f\n", v.x(), v.y(), v.z());
      text += line;
    }
    for (const auto& t : mesh.triangles) {
      std::snprintf(line, sizeof line, "f %d/1/1 %d//2 %d\n", t[0] + 1, t[1] + 1, t[2] + 1);
      text += line;
    }
    return write(name, text);
  }

  fs::path folder_;
};

std::string message(const std::function<void()>& action) {
  try {
    action();
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "no error";
}

std::string bytes_of(const void* data, std::size_t size) { return {static_cast<const char*>(data), size}; }

std::string binary_stl(const TriangleMesh& mesh) {
  std::string text(80, ' ');
  std::memcpy(text.data(), "solid", 5);  // as some programs write
  const auto count = static_cast<std::uint32_t>(mesh.triangles.size());
  text += bytes_of(&count, 4);
  for (const auto& t : mesh.triangles) {
    std::array<float, 12> values{};
    for (std::size_t k = 0; k < 9; ++k)
      values[3 + k] =
          static_cast<float>(mesh.vertices[static_cast<std::size_t>(t[k / 3])][static_cast<Eigen::Index>(k % 3)]);
    text += bytes_of(values.data(), sizeof values) + std::string(2, '\0');
  }
  return text;
}

std::string ascii_stl(const TriangleMesh& mesh) {
  std::string text = "solid box\n";
  char line[120];
  for (const auto& t : mesh.triangles) {
    text += "facet normal 0 0 0\n outer loop\n";
    for (const auto i : t) {
      const Vector3& v = mesh.vertices[static_cast<std::size_t>(i)];
      std::snprintf(line, sizeof line, "  vertex %.9e %.9e %.9e\n", v.x(), v.y(), v.z());
      text += line;
    }
    text += " endloop\nendfacet\n";
  }
  return text + "endsolid box\n";
}

// A glTF file whose node stretches by 2 along x and moves by 1 m; indices and positions are in one buffer.
std::string gltf(const TriangleMesh& mesh, const std::string& buffer_uri, std::string& buffer) {
  for (const auto& t : mesh.triangles)
    for (const auto i : t) {
      const auto index = static_cast<std::uint16_t>(i);
      buffer += bytes_of(&index, 2);
    }
  const std::size_t start = buffer.size();
  for (const Vector3& v : mesh.vertices)
    for (int k = 0; k < 3; ++k) {
      const auto value = static_cast<float>(v[k]);
      buffer += bytes_of(&value, 4);
    }
  return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],)"
         R"("nodes":[{"children":[1],"translation":[1,0,0]},)"
         R"({"mesh":0,"scale":[2,1,1]}],"meshes":[{"primitives":[{"attributes":{"POSITION":1},"indices":0}]}],)"
         R"("accessors":[{"bufferView":0,"componentType":5123,"count":)" +
         std::to_string(3 * mesh.triangles.size()) +
         R"(,"type":"SCALAR"},{"bufferView":1,"componentType":5126,"count":)" + std::to_string(mesh.vertices.size()) +
         R"(,"type":"VEC3"}],"bufferViews":[{"buffer":0,"byteLength":)" + std::to_string(start) +
         R"(},{"buffer":0,"byteOffset":)" + std::to_string(start) + R"(,"byteLength":)" +
         std::to_string(buffer.size() - start) + R"(}],"buffers":[{)" +
         (buffer_uri.empty() ? "" : R"("uri":")" + buffer_uri + R"(",)") + R"("byteLength":)" +
         std::to_string(buffer.size()) + "}]}";
}

TEST_F(ObjectBuilder, ReadsTheSameMeshFromEveryFormat) {
  const TriangleMesh box = softhand::testing::box_mesh({0.01, 0.02, 0.03}, 2);
  const double volume = solid_properties(box).volume;
  std::string buffer, again;
  const std::string document = gltf(box, "a%20box.bin", buffer);
  write("a box.bin", buffer);
  std::string text = gltf(box, "", again);
  text.resize((text.size() + 3) / 4 * 4, ' ');
  const auto word = [](std::size_t n) {
    const auto value = static_cast<std::uint32_t>(n);
    return bytes_of(&value, 4);
  };
  const std::string glb = "glTF" + word(2) + word(28 + text.size() + again.size()) + word(text.size()) + "JSON" + text +
                          word(again.size()) + std::string("BIN\0", 4) + again;
  for (const std::string& path :
       {write_obj("box.obj", box), write("a.STL", ascii_stl(box)), write("b.stl", binary_stl(box)),
        write("box.gltf", document), write("box.glb", glb)}) {
    SCOPED_TRACE(path);
    const TriangleMesh mesh = load_mesh(path);
    EXPECT_EQ(mesh.vertices.size(), box.vertices.size());
    EXPECT_EQ(mesh.triangles.size(), box.triangles.size());
    const bool stretched = path.find(".gl") != std::string::npos;
    const SolidProperties solid = solid_properties(mesh);
    EXPECT_NEAR(solid.volume, (stretched ? 2 : 1) * volume, 1e-6 * volume);
    EXPECT_NEAR(solid.centroid.x(), stretched ? 1 : 0, 1e-6);
  }
  EXPECT_NEAR(solid_properties(load_mesh(write_obj("c.obj", box), 10)).volume, 1000 * volume, 1e-3 * volume);
  EXPECT_EQ(load_mesh(write("d.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf -4 -3 -2 -1\n")).triangles.size(), 2u);
}

TEST_F(ObjectBuilder, RefusesBadMeshFiles) {
  std::string buffer;
  const TriangleMesh box = softhand::testing::box_mesh({0.01, 0.02, 0.03});
  const std::string document = gltf(box, "missing.bin", buffer);
  std::string data;
  const std::string good = gltf(box, "box.bin", data);
  write("box.bin", data);
  const auto with = [&good](const std::string& old, const std::string& changed) {
    std::string text = good;
    return text.replace(text.find(old), old.size(), changed);
  };
  // The y of the vertices is the difference of two infinities, NaN. Their x and z are finite.
  std::string infinities = with("\"translation\":[1,0,0]", "\"scale\":[1,1e300,1]");
  const std::string stretch = "\"scale\":[2,1,1]";
  infinities.replace(infinities.find(stretch), stretch.size(), "\"matrix\":[1,1e300,0,0,0,-1e300,0,0,0,0,1,0,0,0,0,1]");
  const std::pair<std::string, const char*> cases[] = {
      {write("a.obj", "v 0 0\n"), ":1: expected 3 finite numbers"},
      {write("b.obj", "v 0 0 nan\n"), ":1: expected 3 finite numbers"},
      {write("c.obj", "v 0 0 0\nf 1 2 3\n"), ":2: expected indices of vertices that"},
      {write("d.obj", "v 0 0 0\nf 1 1\n"), ":2: expected at least 3"},
      {write("e.obj", "v 0 0 0\nf a b c\n"), ":2: expected indices"},
      {write("f.obj", "v 0 0 0\nf 1 1 1\n"), "expected triangles"},
      {write("g.stl", binary_stl(box).substr(0, 200)), "expected 'endsolid'"},
      {write("h.stl", "not an STL file"), "expected an STL file"},
      {write("i.stl", "solid\nfacet\nvertex 0 0 0\nendfacet\nendsolid"), ":4: expected 3 vertices"},
      {write("j.gltf", document), "buffers[0].uri: expected a file"},
      {write("k.gltf", "{}"), "scenes: expected"},
      {write("l.glb", "glTF"), "header: expected"},
      {write("m.ply", "ply"), "expected .obj, .stl, .glb or .gltf"},
      {write("n.gltf", with("\"componentType\":5123", "\"componentType\":5126")),
       "accessors[0] (indices): expected whole"},
      {write("o.gltf", with("\"children\":[1]", "\"children\":[0]")), "nodes[0]: expected one parent"},
      {write("r.gltf", with("\"children\":[1]", "\"children\":[1,1]")), "nodes[1]: expected one parent"},
      {write("s.gltf", infinities), "finite coordinates"},
      {write("t.gltf", with("\"indices\":0", "\"indices\":0,\"mode\":4.5")), "mode: expected a whole number from 0"},
      {write("u.gltf", with("\"byteOffset\":", "\"byteStride\":0.5,\"byteOffset\":")),
       "byteStride: expected a whole number from 0"},
      {write("v.gltf", with("\"byteOffset\":", "\"byteOffset\":5e55,\"was\":")),
       "byteOffset: expected a whole number from 0"},
      {write("p.gltf", with("box.bin", "/dev/zero")), "buffers[0].uri: expected a file in the folder"},
      {write("q.gltf", with("box.bin", "../box.bin")), "buffers[0].uri: expected a file in the folder"},
      {(folder_ / "none.obj").string(), "cannot be opened"},
  };
  for (const auto& [path, expected] : cases) {
    const std::string text = message([&p = path] { load_mesh(p); });
    EXPECT_EQ(text.rfind(path, 0), 0u) << text;
    EXPECT_NE(text.find(expected), std::string::npos) << text;
  }
}

TEST_F(ObjectBuilder, RefusesAFlexibleMeshInMillimetresBeforeItIsMeshed) {
  builder::SoftSource source;
  source.mesh = write_obj("ball.obj", softhand::testing::box_mesh({10, 20, 30}, 2));
  source.nodes = 100;
  EXPECT_NE(message([&] { builder::build_soft_body(source, 1); }).find("see --scale"), std::string::npos);
}

TEST_F(ObjectBuilder, RefusesMeshesThatAreNoSolid) {
  const auto built = [&](const TriangleMesh& mesh, double spacing = 0.001) {
    builder::ObjectSource source;
    source.name = "thing";
    builder::LinkSource link;
    link.name = "thing";
    link.meshes = {write_obj("thing.obj", mesh)};
    link.spacing = spacing;
    source.links = {link};
    return message([&] {
      std::vector<builder::LinkReport> reports;
      builder::build_object(source, reports);
    });
  };
  const TriangleMesh box = softhand::testing::box_mesh({0.01, 0.02, 0.03}, 4);
  EXPECT_EQ(built(box), "no error");
  TriangleMesh open = box;
  open.triangles.pop_back();
  EXPECT_NE(built(open).find("thing.obj: expected a closed surface, but it has a hole at ("), std::string::npos);
  TriangleMesh inward = box;
  for (auto& t : inward.triangles) std::swap(t[0], t[1]);
  EXPECT_NE(built(inward).find("outward orientation"), std::string::npos);
  TriangleMesh turned = box;
  std::swap(turned.triangles[0][0], turned.triangles[0][1]);
  EXPECT_NE(built(turned).find("2-manifold"), std::string::npos);
  TriangleMesh twice = box;
  const auto first = static_cast<std::int32_t>(box.vertices.size());
  for (const Vector3& v : box.vertices) twice.vertices.push_back(v + Vector3(0.005, 0.006, 0.007));
  for (const auto& t : box.triangles) twice.triangles.push_back({first + t[0], first + t[1], first + t[2]});
  EXPECT_NE(built(twice).find("no self-intersections"), std::string::npos);
  // A wall of 1.5 mm needs cells of 0.75 mm.
  const TriangleMesh plate = softhand::testing::box_mesh({0.02, 0.00075, 0.03}, 8);
  const std::string thin = built(plate, 0.001);
  EXPECT_NE(thin.find("link 'thing'"), std::string::npos) << thin;
  EXPECT_NE(thin.find("walls thinner than two cells of 1.00 mm, for example 1.5"), std::string::npos) << thin;
  EXPECT_EQ(built(plate, 0.00074), "no error");
  // The walls of a shell count too.
  EXPECT_NE(built(softhand::testing::shell_mesh(0.02, 0.0185, 0.004)).find("walls thinner"), std::string::npos);
}

TEST_F(ObjectBuilder, UnitesMeshesAndWeighsThem) {
  write_obj("a.obj", softhand::testing::box_mesh({0.01, 0.02, 0.03}, 2));
  TriangleMesh other = softhand::testing::box_mesh({0.01, 0.015, 0.025}, 2);
  for (Vector3& v : other.vertices) v.x() += 0.01;
  write_obj("b.obj", other);
  const std::string path = write("thing.json", R"({"name": "thing", "notice": "none", "links": [
    {"name": "one", "meshes": ["a.obj", "b.obj"], "density": 2000, "friction": 0.7},
    {"name": "two", "meshes": ["a.obj"], "mass": 0.3, "spacing": 0.002}],
    "joints": [{"kind": "hinge", "parent": "one", "child": "two", "origin": [0, 0, 0.05], "axis": [0, 0, 2],
                "minimum": -1, "maximum": 1, "friction": 0.01}]})");
  std::vector<builder::LinkReport> reports;
  const ObjectModel object = builder::build_object(builder::load_description(path), reports);
  const double volume = 8 * 0.01 * 0.02 * 0.03 + 4 * 0.01 * 0.015 * 0.025;  // without the overlap of 10 mm
  EXPECT_NEAR(reports.at(0).volume, volume, 1e-5 * volume);
  EXPECT_NEAR(object.links[0].mass, 2000 * volume, 1e-5 * 2000 * volume);
  EXPECT_EQ(object.links[0].friction, 0.7);
  EXPECT_DOUBLE_EQ(object.links[1].mass, 0.3);
  EXPECT_EQ(object.links[1].grid_spacing, 0.002);
  const Matrix3 box = 0.3 / 3 * Vector3(0.0013, 0.001, 0.0005).asDiagonal().toDenseMatrix();
  EXPECT_LT((object.links[1].inertia - box).norm(), 1e-9);
  // The joint's axis +y is the z of the description.
  EXPECT_LT((object.joints[0].parent_from_joint * Vector3(0, 1, 0) - Vector3(0, 0, 1.05)).norm(), 1e-12);
  EXPECT_EQ(object.joints[0].law.maximum, 1);
}

TEST_F(ObjectBuilder, RefusesBadDescriptions) {
  const std::pair<const char*, const char*> cases[] = {
      {R"({"name": "a"})", "links: missing"},
      {R"({"name": "a", "links": [{"name": "b", "meshes": []}]})", "either `mass` or `density`"},
      {R"({"name": "a", "links": [{"name": "b", "meshes": [], "mass": -1}]})",
       "links[0].mass: expected a number above"},
      {R"({"name": "a", "links": [], "pieces": 1000})", "pieces: expected 1 to 64"},
      {R"({"name": "a", "links": [], "joints": [{"parent": "x"}]})", "joints[0].parent: expected the name of a link"},
      {R"({"name": "a", "link": []})", "link: unknown field"},
      {"{", "not a description"},
  };
  for (const auto& [text, expected] : cases) {
    const std::string found = message([&, t = text] { builder::load_description(write("bad.json", t)); });
    EXPECT_NE(found.find(expected), std::string::npos) << found;
    EXPECT_NE(found.find("bad.json: "), std::string::npos) << found;
  }
}

TEST_F(ObjectBuilder, ConvexPiecesCoverTheSolid) {
  const auto box = builder::convex_pieces(softhand::testing::box_mesh({0.01, 0.02, 0.03}), 32, 64, 0.05);
  EXPECT_EQ(box.pieces.size(), 1u);
  EXPECT_EQ(box.pieces[0].size(), 8u);
  EXPECT_LT(box.missing + box.excess, 1e-3);
  const TriangleMesh torus = softhand::testing::torus_mesh(0.03, 0.008, 0.004);
  double before = 1e9;
  for (const std::size_t most : {1, 8, 24}) {
    const auto pieces = builder::convex_pieces(torus, most, 32, 0.01);
    std::printf("torus, %zu pieces: missing %.1f %%, excess %.1f %%\n", pieces.pieces.size(), 100 * pieces.missing,
                100 * pieces.excess);
    EXPECT_LE(pieces.pieces.size(), most);
    for (const auto& piece : pieces.pieces) EXPECT_LE(piece.size(), 32u);
    EXPECT_LT(pieces.missing, most == 1 ? 0.2 : 0.06) << "of hulls with 32 corners";
    EXPECT_LT(pieces.excess, before);
    before = pieces.excess;
  }
  EXPECT_LT(before, 0.15);
}

TEST_F(ObjectBuilder, MakesAFlexibleObjectOfTheChosenNodes) {
  write_obj("box.obj", softhand::testing::box_mesh({0.02, 0.015, 0.025}));
  const std::string description = write("soft.json", R"({"name": "soft", "soft": {"mesh": "box.obj", "nodes": 200,
      "density": 50, "youngs_modulus": 2e4, "poisson_ratio": 0.1, "friction": 0.6}})");
  std::vector<builder::LinkReport> reports;
  const ObjectModel object = builder::build_object(builder::load_description(description), reports);
  ASSERT_TRUE(object.soft);
  EXPECT_TRUE(object.links.empty());
  EXPECT_GE(object.soft->nodes.size(), 200u);
  EXPECT_LE(object.soft->nodes.size(), 214u);
  EXPECT_EQ(object.soft->material.youngs_modulus, 2e4);
  EXPECT_EQ(object.soft->friction, 0.6);
  double volume = 0;
  for (const auto& t : object.soft->tetrahedra) volume += tetrahedron_volume(object.soft->nodes, t);
  EXPECT_NEAR(volume, 8 * 0.02 * 0.015 * 0.025, 0.03 * volume);
  const ObjectModel again = builder::build_object(builder::load_description(description), reports);
  EXPECT_EQ(again.soft->nodes, object.soft->nodes);
  EXPECT_EQ(again.soft->tetrahedra, object.soft->tetrahedra);
}

TEST_F(ObjectBuilder, RefusesABadFlexibleObject) {
  TriangleMesh open = softhand::testing::box_mesh({0.02, 0.015, 0.025});
  open.triangles.pop_back();
  write_obj("open.obj", open);
  std::vector<builder::LinkReport> reports;
  const auto refusal = [&](const std::string& soft) {
    return message([&] {
      const std::string path = write("soft.json", "{\"name\": \"soft\", \"soft\": " + soft + "}");
      builder::build_object(builder::load_description(path), reports);
    });
  };
  EXPECT_NE(refusal(R"({"mesh": "open.obj"})").find("open.obj: expected a closed surface"), std::string::npos);
  EXPECT_NE(refusal(R"({"mesh": "open.obj", "nodes": 5})").find("soft.nodes: expected 30 to"), std::string::npos);
  EXPECT_NE(refusal(R"({"mesh": "open.obj", "mass": 1})").find("soft.mass: unknown field"), std::string::npos);
  const std::string both = write("both.json", R"({"name": "soft", "soft": {"mesh": "open.obj"}, "links": []})");
  EXPECT_NE(message([&] { builder::load_description(both); }).find("no links and no joints"), std::string::npos);
}

}  // namespace
