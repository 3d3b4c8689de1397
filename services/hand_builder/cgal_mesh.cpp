// The only file that includes CGAL (Mesh_3 is GPL-3.0+). A program that links it is under this licence. The meshes that
// it writes are not.
#include "hand_builder/cgal_mesh.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Labeled_mesh_domain_3.h>
#include <CGAL/Mesh_complex_3_in_triangulation_3.h>
#include <CGAL/Mesh_criteria_3.h>
#include <CGAL/Mesh_triangulation_3.h>
#include <CGAL/Random.h>
#include <CGAL/make_mesh_3.h>

#include <map>

namespace softhand::builder {

namespace {
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Domain = CGAL::Labeled_mesh_domain_3<Kernel>;
using Triangulation = CGAL::Mesh_triangulation_3<Domain>::type;
using Complex = CGAL::Mesh_complex_3_in_triangulation_3<Triangulation>;
using Criteria = CGAL::Mesh_criteria_3<Triangulation>;

Vector3 to_vector(const Kernel::Point_3& p) { return {p.x(), p.y(), p.z()}; }

struct ScaledField {
  using FT = Kernel::FT;
  using Point_3 = Kernel::Point_3;
  using Index = Domain::Index;
  const SizingField* sizing;
  double scale;
  FT operator()(const Point_3& p, int, const Index&) const { return scale * (*sizing)(to_vector(p)); }
};
}  // namespace

TetrahedralMesh cgal_mesh(const SkinShape& skin, const SizingField& sizing, double scale,
                          const std::vector<Vector3>& seeds) {
  namespace params = CGAL::parameters;
  CGAL::get_default_random() = CGAL::Random(42);
  CGAL::Random random(42);
  const auto function = [&skin](const Kernel::Point_3& p) { return skin.distance(to_vector(p)); };
  const auto box = skin.bounds();
  const Vector3 centre = 0.5 * (box[0] + box[1]);
  const double radius = 0.6 * (box[1] - box[0]).norm();
  Domain domain = Domain::create_implicit_mesh_domain(
      function, Kernel::Sphere_3(Kernel::Point_3(centre.x(), centre.y(), centre.z()), radius * radius),
      params::relative_error_bound = 1e-5, params::p_rng = &random);
  Complex complex;
  using Seed = std::pair<Kernel::Point_3, Domain::Index>;
  std::vector<Seed> points;
  domain.construct_initial_points_object()(std::back_inserter(points), 12);
  for (const Vector3& seed : seeds)
    points.emplace_back(Kernel::Point_3(seed.x(), seed.y(), seed.z()), points.front().second);
  complex.insert_surface_points(points.begin(), points.end());

  Criteria criteria(params::facet_angle = 25, params::facet_size = ScaledField{&sizing, 1.25 * scale},
                    params::facet_distance = ScaledField{&sizing, 0.3 * scale}, params::cell_radius_edge_ratio = 2.0,
                    params::cell_size = ScaledField{&sizing, 0.85 * scale});
  CGAL::refine_mesh_3(complex, domain, criteria, params::no_odt(), params::no_lloyd(), params::no_perturb(),
                      params::no_exude());
  CGAL::odt_optimize_mesh_3(complex, domain, params::time_limit = 0, params::max_iteration_number = 20,
                            params::convergence = 0.02, params::freeze_bound = 0.01, params::do_freeze = true);
  CGAL::perturb_mesh_3(complex, domain, params::time_limit = 0, params::sliver_bound = 14);
  CGAL::exude_mesh_3(complex, params::time_limit = 0, params::sliver_bound = 14);

  TetrahedralMesh mesh;
  std::map<Triangulation::Vertex_handle, std::int32_t> numbers;
  for (auto cell = complex.cells_in_complex_begin(); cell != complex.cells_in_complex_end(); ++cell) {
    std::array<std::int32_t, 4> tetrahedron{};
    for (int k = 0; k < 4; ++k) {
      const auto vertex = cell->vertex(k);
      const auto [found, fresh] = numbers.try_emplace(vertex, static_cast<std::int32_t>(mesh.nodes.size()));
      if (fresh) mesh.nodes.push_back(to_vector(vertex->point().point()));
      tetrahedron[static_cast<std::size_t>(k)] = found->second;
    }
    mesh.tetrahedra.push_back(tetrahedron);
  }
  return mesh;
}

}  // namespace softhand::builder
