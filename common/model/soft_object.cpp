#include "model/soft_object.hpp"

#include <span>

#include "math/tetrahedron.hpp"

namespace softhand {

double mass_of(const SoftBody& body) {
  double volume = 0;
  for (const auto& corners : body.tetrahedra) volume += tetrahedron_volume(body.nodes, corners);
  return body.material.density * volume;
}

void append_body(TissueModel& model, const SoftBody& body, std::int32_t first, std::uint8_t node_body) {
  const auto material = static_cast<std::uint8_t>(model.materials.size());
  const std::size_t first_tetrahedron = model.tetrahedra.size();
  model.materials.push_back(body.material);
  std::vector<SkinPoint> of_node(body.nodes.size());
  for (const auto& local : body.tetrahedra) {
    auto corners = local;
    for (std::size_t k = 0; k < 4; ++k) {
      SkinPoint& point = of_node[static_cast<std::size_t>(local[k])];
      point.tetrahedron = static_cast<std::int32_t>(model.tetrahedra.size());
      point.weights = {};
      point.weights[k] = 1;
      corners[k] += first;
    }
    model.tetrahedra.push_back(corners);
    model.tetrahedron_material.push_back(material);
  }
  const std::vector<std::array<std::int32_t, 3>> surface =
      boundary(std::span(model.tetrahedra).subspan(first_tetrahedron));
  model.surface.insert(model.surface.end(), surface.begin(), surface.end());
  for (const auto& t : surface) {
    const auto x = [&](std::size_t k) { return body.nodes[static_cast<std::size_t>(t[k] - first)]; };
    const double share = (x(1) - x(0)).cross(x(2) - x(0)).norm() / 6;
    for (const std::int32_t node : t) of_node[static_cast<std::size_t>(node - first)].area += share;
  }
  for (SkinPoint& point : of_node) {
    if (!(point.area > 0)) continue;
    point.body = node_body;
    model.contact_points.push_back(point);
  }
}

}  // namespace softhand
