// Triangles of skin and one object, for the tests of contact and friction.
#pragma once

#include <cmath>
#include <vector>

#include "energies/contact.hpp"
#include "energies/dense_step.hpp"
#include "energies/friction.hpp"
#include "energies/inertia.hpp"
#include "support/node_contact.hpp"

namespace softhand::testing {

inline constexpr double kGravity = 9.81;

inline Shape shape_of(ShapeKind kind, Vec3 size = {}) {
  Shape shape;
  shape.kind = static_cast<std::uint32_t>(kind);
  shape.size = size;
  return shape;
}

/// `triangles` separate triangles of skin, all of the same size, so that all nodes have the same stiffness.
inline HandModel skin_triangles(int triangles) {
  HandModel hand;
  for (int t = 0; t < triangles; ++t) {
    const Vector3 centre(0.05 * t, 0, 0);
    for (const Vector3& corner : {Vector3(0, 0, 0), Vector3(0, 0, 0.01), Vector3(0.01, 0, 0)})
      hand.nodes.push_back(centre + corner);
    hand.surface.push_back({3 * t, 3 * t + 1, 3 * t + 2});
  }
  hand.node_body.assign(hand.nodes.size(), static_cast<std::uint8_t>(index_of(Body::index_distal)));
  return hand;
}

struct ContactRig {
  ContactRig(int triangles, double stiffness, double node_mass, int moving_slots = 1, int slots = 1)
      : hand(skin_triangles(triangles)),
        contacts(contact_at_nodes(hand, std::vector<double>(hand.nodes.size(), node_mass)), hand.node_count(),
                 contact_stiffness(hand, stiffness), 0, moving_slots, slots),
        contact(contacts),
        friction(contacts),
        inertia(std::vector<double>(hand.nodes.size(), node_mass), slots) {
    state.node_positions.resize(3, hand.node_count());
    state.node_velocities = Eigen::Matrix3Xd::Zero(3, hand.node_count());
    for (int n = 0; n < hand.node_count(); ++n) state.node_positions.col(n) = hand.nodes[static_cast<std::size_t>(n)];
    state.body_poses.resize(static_cast<std::size_t>(slots));
    state.body_velocities.resize(static_cast<std::size_t>(slots));
  }
  DenseStepper stepper() { return DenseStepper({&inertia, &contact, &friction}, state); }

  HandModel hand;
  ContactSet contacts;
  ContactEnergy contact;
  FrictionEnergy friction;
  Inertia inertia;
  State state;
};

/// Nodes of mass m on a fixed plane under gravity g.
struct NodesOnPlane {
  explicit NodesOnPlane(double mu, double stiffness = 500, double mass = 0.01, double height = 0.0)
      : plane(shape_of(ShapeKind::plane)), rig(1, stiffness, mass), step(rig.stepper()) {
    rig.contacts.set_object(0, &plane, mu, 1, ContactObject::fixed);
    rig.inertia.hold(0);
    rig.state.node_positions.row(1).setConstant(height);
  }
  void gravity(double angle) { rig.inertia.set_node_gravity(kGravity * Vector3(std::sin(angle), -std::cos(angle), 0)); }
  void run(int steps, double dt, double tolerance = 1e-13) {
    for (int i = 0; i < steps; ++i) step.step(rig.state, dt, tolerance);
  }
  Vector3 position() const { return rig.state.node_positions.col(0); }
  Vector3 velocity() const { return rig.state.node_velocities.col(0); }
  ShapeGeometry plane;
  ContactRig rig;
  DenseStepper step;
};

}  // namespace softhand::testing
