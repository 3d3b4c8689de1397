// Flexible objects for tests, and a table for them.
#pragma once

#include <memory>

#include "geometry/shape.hpp"
#include "model/object_model.hpp"
#include "scene/hand_simulation.hpp"
#include "support/box_mesh.hpp"
#include "support/shapes.hpp"

namespace softhand::testing {

/// A material without strain limit.
inline Material soft_material(double youngs_modulus, double poisson_ratio = 0.3, double density = 100) {
  return {"sponge", density, youngs_modulus, poisson_ratio, 1e12, 0};
}

/// A box with its centre at the origin.
inline std::shared_ptr<const SoftBody> soft_box(std::array<int, 3> cells, const Vector3& size, const Material& material,
                                                double friction = 0.8) {
  const HandModel box = box_mesh(cells, size, material);
  auto body = std::make_shared<SoftBody>();
  for (const Vector3& node : box.nodes) body->nodes.push_back(node - 0.5 * size);
  body->tetrahedra = box.tetrahedra;
  body->material = material;
  body->friction = friction;
  return body;
}

inline const Vector3 kGravity(0, -9.81, 0);

/// Puts a table with its top at y = 0 into a slot that does not move. `shape` must outlive the simulation.
inline void set_table(HandSimulation& simulation, int slot, const ShapeGeometry& shape, double half_height) {
  simulation.set_slot(slot, {.id = 1, .shape = &shape, .friction = 0.8});
  simulation.set_slot_motion(slot, {.position = {0, -half_height, 0}}, {});
}

inline Vector3 centre_of_mass(const SoftObjects& soft, int i, const State& state) {
  Vector3 sum = Vector3::Zero();
  for (int n = soft.first_node(i); n < soft.first_node(i + 1); ++n)
    sum += soft.node_masses()[static_cast<std::size_t>(n)] * state.node_positions.col(n);
  return sum / soft.mass(i);
}

}  // namespace softhand::testing
