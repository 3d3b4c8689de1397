// CGAL's Polygon_mesh_processing is GPL-3.0+. A program that links this file is under this licence. The object files
// that it writes are not.
#include "object_builder/cgal_solid.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/corefinement.h>
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>

#include <cstdio>
#include <stdexcept>

namespace softhand::builder {
namespace {

namespace processing = CGAL::Polygon_mesh_processing;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;

std::optional<Mesh> to_cgal(const TriangleMesh& mesh) {
  std::vector<std::array<std::size_t, 3>> polygons;
  for (const auto& t : mesh.triangles)
    polygons.push_back(
        {static_cast<std::size_t>(t[0]), static_cast<std::size_t>(t[1]), static_cast<std::size_t>(t[2])});
  if (!processing::is_polygon_soup_a_polygon_mesh(polygons)) return std::nullopt;
  std::vector<Kernel::Point_3> points;
  for (const Vector3& v : mesh.vertices) points.emplace_back(v.x(), v.y(), v.z());
  Mesh out;
  processing::polygon_soup_to_polygon_mesh(points, polygons, out);
  return out;
}

std::string place_of(const Mesh& mesh, Mesh::Face_index face) {
  const auto& p = mesh.point(mesh.target(mesh.halfedge(face)));
  char text[80];
  std::snprintf(text, sizeof text, "(%.4f, %.4f, %.4f) m", p.x(), p.y(), p.z());
  return text;
}

}  // namespace

std::optional<std::string> fault_of_solid(const TriangleMesh& mesh) {
  const std::optional<Mesh> cgal = to_cgal(mesh);
  if (!cgal) {
    return "consistently oriented triangles that form a 2-manifold, but an edge has more than two triangles, or two "
           "triangles with opposite orientation";
  }
  for (const auto halfedge : cgal->halfedges()) {
    if (!cgal->is_border(halfedge)) continue;
    const auto& p = cgal->point(cgal->target(halfedge));
    char text[120];
    std::snprintf(text, sizeof text, "a closed surface, but it has a hole at (%.4f, %.4f, %.4f) m", p.x(), p.y(),
                  p.z());
    return text;
  }
  std::vector<std::pair<Mesh::Face_index, Mesh::Face_index>> pairs;
  processing::self_intersections(*cgal, std::back_inserter(pairs));
  if (!pairs.empty()) {
    return "no self-intersections, but " + std::to_string(pairs.size()) +
           " pairs of triangles intersect, the first at " + place_of(*cgal, pairs.front().first) +
           "; give overlapping parts as separate meshes of one link";
  }
  if (!processing::does_bound_a_volume(*cgal))
    return "triangles with outward orientation (counter-clockwise from outside), but a part of the surface is inward";
  return std::nullopt;
}

TriangleMesh united(const std::vector<TriangleMesh>& meshes) {
  Mesh all = to_cgal(meshes.at(0)).value();
  for (std::size_t i = 1; i < meshes.size(); ++i) {
    Mesh next = to_cgal(meshes[i]).value(), out;
    if (!processing::corefine_and_compute_union(all, next, out))
      throw std::runtime_error("mesh " + std::to_string(i + 1) + ": the union with the meshes before it is not a " +
                               "2-manifold; expected meshes that overlap and do not only touch");
    all = std::move(out);
  }
  all.collect_garbage();
  TriangleMesh result;
  for (const auto v : all.vertices())
    result.vertices.emplace_back(all.point(v).x(), all.point(v).y(), all.point(v).z());
  for (const auto f : all.faces()) {
    std::array<std::int32_t, 3> triangle{};
    std::size_t k = 0;
    for (const auto v : all.vertices_around_face(all.halfedge(f))) triangle[k++] = static_cast<std::int32_t>(v.idx());
    result.triangles.push_back(triangle);
  }
  return result;
}

}  // namespace softhand::builder
