#include "mesh_files/mesh_file.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <numeric>
#include <set>
#include <sstream>
#include <stdexcept>

#include "mesh_files/gltf_file.hpp"

namespace softhand {
namespace {

using nlohmann::json;

constexpr double kWeld = 1e-6;  // m
constexpr std::size_t kMostVertices = 10'000'000;

[[noreturn]] void fail(const std::string& path, std::size_t line, const std::string& expected) {
  throw std::runtime_error(path + ":" + std::to_string(line) + ": expected " + expected);
}

bool read_number(std::istream& in, double& value) {
  std::string word;
  if (!(in >> word)) return false;
  const char* begin = word.data() + (word.front() == '+' ? 1 : 0);
  const auto [end, error] = std::from_chars(begin, word.data() + word.size(), value);
  return error == std::errc() && end == word.data() + word.size() && std::isfinite(value);
}

Vector3 read_vector(std::istream& in, const std::string& path, std::size_t line) {
  Vector3 out;
  for (int k = 0; k < 3; ++k)
    if (!read_number(in, out[k])) fail(path, line, "3 finite numbers");
  return out;
}

TriangleMesh read_obj(std::istream& in, const std::string& path) {
  TriangleMesh mesh;
  std::size_t number = 0;
  for (std::string line; std::getline(in, line);) {
    ++number;
    std::istringstream words(line);
    std::string word;
    if (!(words >> word)) continue;
    if (word == "v") mesh.vertices.push_back(read_vector(words, path, number));
    if (word != "f") continue;
    std::vector<std::int32_t> corners;
    while (words >> word) {
      long index = 0;
      const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), index);
      if (error != std::errc() || (end != word.data() + word.size() && *end != '/'))
        fail(path, number, "indices of vertices");
      const long count = static_cast<long>(mesh.vertices.size());
      if (index < 0) index += count + 1;
      if (index < 1 || index > count) fail(path, number, "indices of vertices that were defined before");
      corners.push_back(static_cast<std::int32_t>(index - 1));
    }
    if (corners.size() < 3) fail(path, number, "at least 3 vertices in a face");
    for (std::size_t k = 2; k < corners.size(); ++k) mesh.triangles.push_back({corners[0], corners[k - 1], corners[k]});
  }
  return mesh;
}

void add_triangle(TriangleMesh& mesh, const std::array<Vector3, 3>& corners) {
  const auto first = static_cast<std::int32_t>(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), corners.begin(), corners.end());
  mesh.triangles.push_back({first, first + 1, first + 2});
}

TriangleMesh read_stl(std::istream& in, const std::string& path) {
  const std::string bytes{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  TriangleMesh mesh;
  std::uint32_t count = 0;
  if (bytes.size() >= 84) std::memcpy(&count, bytes.data() + 80, sizeof count);
  // Binary files may also start with "solid"; their size decides.
  if (bytes.size() >= 84 && bytes.size() == 84 + 50 * static_cast<std::size_t>(count)) {
    for (std::size_t t = 0; t < count; ++t) {
      std::array<float, 12> values{};  // normal, then three corners
      std::memcpy(values.data(), bytes.data() + 84 + 50 * t, sizeof values);
      std::array<Vector3, 3> corners;
      for (std::size_t k = 0; k < 9; ++k) {
        const double value = static_cast<double>(values[3 + k]);
        if (!std::isfinite(value))
          throw std::runtime_error(path + ": triangle " + std::to_string(t) + ": expected finite numbers");
        corners[k / 3][static_cast<Eigen::Index>(k % 3)] = value;
      }
      add_triangle(mesh, corners);
    }
    return mesh;
  }
  if (bytes.rfind("solid", 0) != 0)
    throw std::runtime_error(path + ": expected an STL file: 'solid' at the start, or a binary file of " +
                             std::to_string(84 + 50 * static_cast<std::size_t>(count)) + " bytes, found " +
                             std::to_string(bytes.size()));
  std::istringstream lines(bytes);
  std::size_t number = 0;
  std::vector<Vector3> corners;
  bool ended = false;
  for (std::string line; std::getline(lines, line);) {
    ++number;
    std::istringstream words(line);
    std::string word;
    if (!(words >> word)) continue;
    ended = word == "endsolid";
    if (word == "vertex") corners.push_back(read_vector(words, path, number));
    if (word == "endfacet") {
      if (corners.size() != 3) fail(path, number, "3 vertices in a facet");
      add_triangle(mesh, {corners[0], corners[1], corners[2]});
      corners.clear();
    }
  }
  if (!ended) fail(path, number, "'endsolid' at the end");
  return mesh;
}

Eigen::Affine3d transformation(const GltfFile& file, const json& node, const std::string& where) {
  const auto numbers = [&](const char* key, std::size_t count) {
    std::vector<double> out;
    const auto found = node.find(key);
    if (found == node.end()) return out;
    file.check(found->is_array() && found->size() == count, where + "." + key, std::to_string(count) + " numbers");
    for (const json& value : *found) {
      file.check(value.is_number(), where + "." + key, "numbers");
      out.push_back(value.get<double>());
    }
    return out;
  };
  const auto matrix = numbers("matrix", 16), move = numbers("translation", 3), turn = numbers("rotation", 4),
             stretch = numbers("scale", 3);
  Eigen::Affine3d out = Eigen::Affine3d::Identity();
  if (!matrix.empty()) out.matrix() = Eigen::Map<const Eigen::Matrix4d>(matrix.data());  // column by column
  if (!move.empty()) out.translate(Vector3(move[0], move[1], move[2]));
  if (!turn.empty()) out.rotate(Quaternion(turn[3], turn[0], turn[1], turn[2]).normalized());
  if (!stretch.empty()) out.scale(Vector3(stretch[0], stretch[1], stretch[2]));
  return out;
}

void add_gltf_mesh(const GltfFile& file, std::size_t index, const Eigen::Affine3d& to_scene, TriangleMesh& out) {
  const json& mesh = file.element("meshes", index);
  const std::string where = "meshes[" + std::to_string(index) + "].primitives";
  const auto primitives = mesh.find("primitives");
  file.check(primitives != mesh.end() && primitives->is_array(), where, "a list");
  for (const json& primitive : *primitives) {
    file.check(primitive.is_object() && file.index(primitive, "mode", where, 4) == 4, where + ".mode", "4 (triangles)");
    const auto attributes = primitive.find("attributes");
    file.check(attributes != primitive.end() && attributes->is_object(), where + ".attributes", "a table");
    const auto positions = file.numbers(file.index(*attributes, "POSITION", where + ".attributes"), "VEC3", "POSITION");
    const auto first = static_cast<std::int32_t>(out.vertices.size());
    const std::size_t count = positions.size() / 3;
    // Nodes can repeat a mesh.
    file.check(out.vertices.size() + count <= kMostVertices, where, "at most 10 million vertices in the scene");
    for (std::size_t v = 0; v < count; ++v)
      out.vertices.push_back(to_scene * Vector3(positions[3 * v], positions[3 * v + 1], positions[3 * v + 2]));
    std::vector<std::size_t> indices(count);
    if (primitive.contains("indices")) {
      indices = file.indices(file.index(primitive, "indices", where), "SCALAR", "indices", count);
    } else {
      std::iota(indices.begin(), indices.end(), 0);
    }
    file.check(indices.size() % 3 == 0, where + ".indices", "whole triangles");
    const bool mirrors = to_scene.linear().determinant() < 0;
    for (std::size_t i = 0; i < indices.size(); i += 3) {
      std::array<std::int32_t, 3> triangle{};
      for (std::size_t k = 0; k < 3; ++k) triangle[k] = first + static_cast<std::int32_t>(indices[i + k]);
      if (mirrors) std::swap(triangle[1], triangle[2]);
      out.triangles.push_back(triangle);
    }
  }
}

TriangleMesh read_gltf(std::istream& in, const std::string& path) try {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  const GltfFile file(in, path, &folder);
  TriangleMesh out;
  std::set<std::size_t> visited;
  const std::function<void(std::size_t, const Eigen::Affine3d&, int)> visit =
      [&](std::size_t index, const Eigen::Affine3d& parent, int depth) {
        const json& node = file.element("nodes", index);
        const std::string where = "nodes[" + std::to_string(index) + "]";
        // In glTF a node has at most one parent. With two parents a node, a document of 3 kB can mean millions of
        // triangles.
        file.check(visited.insert(index).second && depth <= 256, where, "one parent and at most 256 levels");
        const Eigen::Affine3d here = parent * transformation(file, node, where);
        if (node.contains("mesh")) add_gltf_mesh(file, file.index(node, "mesh", where), here, out);
        if (!node.contains("children")) return;
        file.check(node["children"].is_array(), where + ".children", "a list");
        for (const json& child : node["children"]) {
          file.check(child.is_number_unsigned(), where + ".children", "indices of nodes");
          visit(child.get<std::size_t>(), here, depth + 1);
        }
      };
  const json& document = file.document();
  const std::size_t scene = document.contains("scene") ? file.index(document, "scene", "document") : 0;
  const json& nodes = file.element("scenes", scene);
  file.check(nodes.contains("nodes") && nodes["nodes"].is_array(), "scenes.nodes", "a list");
  for (const json& root : nodes["nodes"]) {
    file.check(root.is_number_unsigned(), "scenes.nodes", "indices of nodes");
    visit(root.get<std::size_t>(), Eigen::Affine3d::Identity(), 1);
  }
  return out;
} catch (const json::exception& error) {  // for example text instead of a number
  throw std::runtime_error(path + ": " + error.what());
}

// Welds vertices in the same cell of a grid of a micrometre. Drops triangles with fewer than three corners after that,
// and vertices without a triangle.
TriangleMesh welded(const TriangleMesh& mesh, double scale) {
  TriangleMesh out;
  std::map<std::array<long long, 3>, std::int32_t> places;
  for (const auto& triangle : mesh.triangles) {
    std::array<std::int32_t, 3> corners{};
    for (std::size_t k = 0; k < 3; ++k) {
      const Vector3 x = scale * mesh.vertices[static_cast<std::size_t>(triangle[k])];
      const auto [found, fresh] =
          places.try_emplace({std::llround(x.x() / kWeld), std::llround(x.y() / kWeld), std::llround(x.z() / kWeld)},
                             static_cast<std::int32_t>(out.vertices.size()));
      if (fresh) out.vertices.push_back(x);
      corners[k] = found->second;
    }
    if (corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0])
      out.triangles.push_back(corners);
  }
  return out;
}

}  // namespace

TriangleMesh load_mesh(const std::string& path, double scale) {
  std::ifstream in(path, std::ios::binary);
  if (!in || std::filesystem::is_directory(path)) throw std::runtime_error(path + ": cannot be opened");
  std::string suffix = std::filesystem::path(path).extension().string();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(), [](unsigned char c) { return std::tolower(c); });
  TriangleMesh mesh;
  if (suffix == ".obj") {
    mesh = read_obj(in, path);
  } else if (suffix == ".stl") {
    mesh = read_stl(in, path);
  } else if (suffix == ".glb" || suffix == ".gltf") {
    mesh = read_gltf(in, path);
  } else {
    throw std::runtime_error(path + ": suffix '" + suffix + "', expected .obj, .stl, .glb or .gltf");
  }
  // The cells of the weld are integers. The comparison is false for NaN, which Eigen's maximum can pass over.
  for (const Vector3& v : mesh.vertices)
    if (!(scale * v.array().abs() < 1e6).all()) throw std::runtime_error(path + ": expected finite coordinates");
  mesh = welded(mesh, scale);
  if (mesh.triangles.empty()) throw std::runtime_error(path + ": expected triangles, found none with an area");
  return mesh;
}

}  // namespace softhand
