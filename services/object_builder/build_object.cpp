#include "object_builder/build_object.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <stdexcept>

#include "geometry/mesh_distance.hpp"
#include "mesh_files/mesh_file.hpp"
#include "model/json_fields.hpp"
#include "object_builder/cgal_solid.hpp"
#include "object_builder/convex_pieces.hpp"
#include "object_builder/soft_body.hpp"

namespace softhand::builder {
namespace {

// Fraction of the surface that may have walls thinner than two cells, for example the edges of blades.
constexpr double kMostThinArea = 0.02;

Pose read_frame(const FieldReader& reader) {
  const Vector3 axis = reader["axis"].vector();
  if (!(axis.norm() > 1e-9 && axis.allFinite())) reader["axis"].fail("a direction");
  return {reader["origin"].vector(), Quaternion::FromTwoVectors(Vector3::UnitY(), axis.normalized())};
}

LinkJoint read_joint(const FieldReader& reader, const std::vector<LinkSource>& links) {
  reader.expect_keys({"kind", "parent", "child", "origin", "axis", "pitch", "minimum", "maximum", "friction",
                      "load_friction", "damping", "stiffness", "rest", "detents"});
  LinkJoint joint;
  const auto link = [&](const char* key) {
    const std::string name = reader[key].string();
    for (std::size_t i = 0; i < links.size(); ++i)
      if (links[i].name == name) return i;
    reader[key].fail("the name of a link, found '" + name + "'");
  };
  joint.parent = link("parent");
  joint.child = link("child");
  joint.parent_from_joint = joint.child_from_joint = read_frame(reader);
  joint.law = read_joint_law(reader);
  return joint;
}

// The mesh as the file will hold it: rounded, welded, without triangles that this leaves without an area. Vertices and
// triangles are sorted, because the order of CGAL's unions depends on addresses.
TriangleMesh rounded(const TriangleMesh& mesh) {
  std::map<std::array<double, 3>, std::int32_t> places;
  const auto key = [&mesh](std::int32_t v) {
    const Vector3 x = rounded_position(mesh.vertices[static_cast<std::size_t>(v)]);
    return std::array<double, 3>{x.x(), x.y(), x.z()};
  };
  for (const auto& triangle : mesh.triangles)
    for (const std::int32_t v : triangle) places.try_emplace(key(v), 0);
  TriangleMesh out;
  for (auto& [place, number] : places) {
    number = static_cast<std::int32_t>(out.vertices.size());
    out.vertices.emplace_back(place[0], place[1], place[2]);
  }
  for (const auto& triangle : mesh.triangles) {
    std::array<std::int32_t, 3> corners{places.at(key(triangle[0])), places.at(key(triangle[1])),
                                        places.at(key(triangle[2]))};
    if (corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0]) continue;
    std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
    out.triangles.push_back(corners);
  }
  std::sort(out.triangles.begin(), out.triangles.end());
  return out;
}

std::string millimetres(double metres) {
  char text[40];
  std::snprintf(text, sizeof text, "%.2f mm", 1e3 * metres);
  return text;
}

// The fraction of the surface with walls thinner than two cells. A point of the surface has a thin wall if the nearest
// surface, seen from one cell below it, faces the other way. Throws if the fraction is too large.
double thin_area(const TriangleMesh& mesh, double spacing, const std::string& where) {
  const MeshDistance distance(mesh);
  double area = 0, thin = 0, thinnest = 2 * spacing;
  Vector3 place = Vector3::Zero();
  for (const auto& t : mesh.triangles) {
    const auto x = [&](std::size_t k) { return mesh.vertices[static_cast<std::size_t>(t[k])]; };
    const Vector3 cross = (x(1) - x(0)).cross(x(2) - x(0));
    const double own = 0.5 * cross.norm();
    area += own;
    if (!(own > 0)) continue;
    const Vector3 normal = cross.normalized(), centre = (x(0) + x(1) + x(2)) / 3;
    const Vector3 below = centre - spacing * normal;
    const auto nearest = distance.nearest(below);
    const bool inside = nearest.distance < 0;
    // The outward normal at the nearest point.
    const Vector3 outward = (inside ? 1.0 : -1.0) * (nearest.point - below).normalized();
    if (inside && (nearest.distance < -0.98 * spacing || outward.dot(normal) > -0.5)) continue;
    thin += own;
    double solid = 0, empty = 2 * spacing;  // depth below the surface
    for (double depth = 0.05 * spacing; depth < empty; depth += 0.05 * spacing) {
      if (distance.distance(centre - depth * normal) < 0)
        solid = depth;
      else
        empty = depth;
    }
    if (solid < thinnest) {
      thinnest = solid;
      place = centre;
    }
  }
  if (thin > kMostThinArea * area) {
    char text[300];
    std::snprintf(
        text, sizeof text,
        "%.0f %% of the surface has walls thinner than two cells of %s, for example %s at (%.4f, %.4f, %.4f) m; "
        "expected at most 2 %%. Use a smaller spacing or thicker walls",
        100 * thin / area, millimetres(spacing).c_str(), millimetres(thinnest).c_str(), place.x(), place.y(),
        place.z());
    throw std::runtime_error(where + ": " + text);
  }
  return thin / area;
}

SoftSource read_soft(const FieldReader& reader, const std::filesystem::path& folder) {
  reader.expect_keys({"mesh", "nodes", "density", "youngs_modulus", "poisson_ratio", "strain_limit_energy",
                      "strain_limit_stiffness", "strain_limit_ramp", "friction"});
  SoftSource source;
  source.mesh = (folder / reader["mesh"].string()).string();
  if (reader.has("nodes")) source.nodes = reader["nodes"].index();
  for (const auto& [key, value] : {std::pair{"density", &source.density},
                                   {"youngs_modulus", &source.youngs_modulus},
                                   {"poisson_ratio", &source.poisson_ratio},
                                   {"strain_limit_energy", &source.strain_limit_energy},
                                   {"strain_limit_stiffness", &source.strain_limit_stiffness},
                                   {"strain_limit_ramp", &source.strain_limit_ramp},
                                   {"friction", &source.friction}}) {
    if (reader.has(key)) *value = reader[key].number();
  }
  return source;
}

ObjectLink build_link(const LinkSource& source, const ObjectSource& object, LinkReport& report) {
  const std::string where = "link '" + source.name + "'";
  std::vector<TriangleMesh> meshes;
  for (const std::string& file : source.meshes) {
    meshes.push_back(rounded(load_mesh(file, object.scale)));
    if (const auto fault = fault_of_solid(meshes.back())) throw std::runtime_error(file + ": expected " + *fault);
  }
  if (meshes.empty()) throw std::runtime_error(where + ": meshes: expected at least one file");
  ObjectLink link;
  link.name = source.name;
  try {
    link.mesh = meshes.size() == 1 ? meshes[0] : rounded(united(meshes));
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(where + ": " + error.what());
  }
  if (meshes.size() > 1) {
    if (const auto fault = fault_of_solid(link.mesh))
      throw std::runtime_error(where + ": the union of its meshes: expected " + *fault);
  }
  link.grid_spacing = source.spacing;
  link.friction = source.friction;
  report.thin_area = thin_area(link.mesh, source.spacing, where);
  const SolidProperties solid = solid_properties(link.mesh);
  report.volume = solid.volume;
  const double density = source.mass > 0 ? source.mass / solid.volume : source.density;
  link.mass = density * solid.volume;
  link.centre_of_mass = solid.centroid;
  link.inertia = density * solid.inertia;
  ConvexPieces pieces =
      convex_pieces(link.mesh, object.most_pieces, object.most_piece_vertices, object.piece_tolerance);
  link.pieces = std::move(pieces.pieces);
  report.missing = pieces.missing;
  report.excess = pieces.excess;
  return link;
}

}  // namespace

ObjectSource load_description(const std::string& path) {
  std::ifstream in(path);
  if (!in || std::filesystem::is_directory(path)) throw std::runtime_error(path + ": cannot be opened");
  Json json;
  try {
    json = Json::parse(in);
  } catch (const Json::exception& error) {
    throw std::runtime_error(path + ": not a description: " + error.what());
  }
  const FieldReader root(json, path, "");
  root.expect_keys(
      {"name", "notice", "scale", "pieces", "piece_vertices", "piece_tolerance", "links", "joints", "soft"});
  const auto positive = [](const FieldReader& reader, const char* key, double& value) {
    if (!reader.has(key)) return;
    value = reader[key].number();
    if (!(value > 0)) reader[key].fail("a number above 0");
  };
  const auto count = [](const FieldReader& reader, const char* key, std::size_t& value, std::size_t least,
                        std::size_t most) {
    if (!reader.has(key)) return;
    value = static_cast<std::size_t>(reader[key].index());
    if (value < least || value > most) reader[key].fail(std::to_string(least) + " to " + std::to_string(most));
  };
  ObjectSource source;
  source.name = root["name"].string();
  if (root.has("notice")) source.notice = root["notice"].string();
  positive(root, "scale", source.scale);
  positive(root, "piece_tolerance", source.piece_tolerance);
  count(root, "pieces", source.most_pieces, 1, kMaxLinkPieces);
  count(root, "piece_vertices", source.most_piece_vertices, 4, kMaxPieceVertices);
  if (root.has("soft")) {
    if (root.has("links") || root.has("joints")) root["soft"].fail("no links and no joints beside it");
    source.soft = read_soft(root["soft"], std::filesystem::path(path).parent_path());
    return source;
  }
  const FieldReader links = root["links"];
  for (std::size_t i = 0; i < links.size(); ++i) {
    const FieldReader reader = links.at(i);
    reader.expect_keys({"name", "meshes", "density", "mass", "friction", "spacing"});
    LinkSource link;
    link.name = reader["name"].string();
    const FieldReader meshes = reader["meshes"];
    for (std::size_t m = 0; m < meshes.size(); ++m)
      link.meshes.push_back((std::filesystem::path(path).parent_path() / meshes.at(m).string()).string());
    if (reader.has("mass") == reader.has("density")) reader.fail("either `mass` or `density`");
    positive(reader, "density", link.density);
    positive(reader, "mass", link.mass);
    positive(reader, "spacing", link.spacing);
    if (reader.has("friction")) link.friction = reader["friction"].number();
    source.links.push_back(std::move(link));
  }
  if (root.has("joints")) {
    const FieldReader joints = root["joints"];
    for (std::size_t i = 0; i < joints.size(); ++i) source.joints.push_back(read_joint(joints.at(i), source.links));
  }
  return source;
}

ObjectModel build_object(const ObjectSource& source, std::vector<LinkReport>& reports) {
  ObjectModel object;
  object.name = source.name;
  object.notice = source.notice;
  reports.assign(source.links.size(), {});
  if (source.soft) object.soft = build_soft_body(*source.soft, source.scale);
  for (std::size_t i = 0; i < source.links.size(); ++i)
    object.links.push_back(build_link(source.links[i], source, reports[i]));
  object.joints = source.joints;
  validate(object, "object '" + source.name + "'");
  return object;
}

}  // namespace softhand::builder
