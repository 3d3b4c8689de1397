// A hand for tests that need the whole structure but no realistic shape: the real skeleton in one coarse block of
// tissue.
#pragma once

#include <algorithm>
#include <cmath>

#include "math/tetrahedron.hpp"
#include "model/hand_model.hpp"
#include "support/box_mesh.hpp"
#include "support/node_contact.hpp"

namespace softhand::testing {

/// Rest joints of a flat right hand about 190 mm long, in the wrist's frame (-Z to the fingers, +Y dorsal, thumb at
/// -X).
inline std::array<Pose, kJointCount> flat_rest_joints() {
  std::array<Pose, kJointCount> joints;
  const auto set = [&joints](Joint joint, double x, double y, double z) {
    joints[static_cast<std::size_t>(index_of(joint))].position = Vector3(x, y, z) * 1e-3;
  };
  const auto chain = [&set](Joint first, double x, std::array<double, 5> depth) {
    for (int k = 0; k < 5; ++k) set(static_cast<Joint>(index_of(first) + k), x, 0, -depth[static_cast<std::size_t>(k)]);
  };
  set(Joint::wrist, 0, 0, 0);
  chain(Joint::index_metacarpal, -24, {20, 90, 132, 157, 175});
  chain(Joint::middle_metacarpal, -4, {20, 92, 138, 167, 187});
  chain(Joint::ring_metacarpal, 15, {20, 86, 128, 156, 175});
  chain(Joint::little_metacarpal, 32, {20, 78, 112, 133, 150});
  // The thumb's chain points sideways: its frames turn by 60 degrees about y.
  const Quaternion sideways(Eigen::AngleAxisd(M_PI / 3, Vector3::UnitY()));
  const Vector3 base(-0.022, -0.005, -0.022);
  const std::array<double, 4> depth{0, 0.046, 0.080, 0.106};
  for (int k = 0; k < 4; ++k) {
    joints[static_cast<std::size_t>(2 + k)] = {base + sideways * Vector3(0, 0, -depth[static_cast<std::size_t>(k)]),
                                               sideways};
  }
  joints[0].position = 0.5 * (joints[11].position + joints[12].position);
  return joints;
}

/// Sets the boundary triangles: the faces that only one tetrahedron has.
inline void add_surface(HandModel& hand) {
  std::vector<std::pair<std::array<std::int32_t, 3>, std::array<std::int32_t, 3>>> all;
  for (const auto& t : hand.tetrahedra) {
    for (const auto& corners : kTetrahedronFaces) {
      const std::array<std::int32_t, 3> face{t[corners[0]], t[corners[1]], t[corners[2]]};
      auto sorted = face;
      std::sort(sorted.begin(), sorted.end());
      all.emplace_back(sorted, face);
    }
  }
  std::sort(all.begin(), all.end());
  for (std::size_t f = 0; f < all.size(); ++f) {
    const bool before = f > 0 && all[f - 1].first == all[f].first;
    const bool after = f + 1 < all.size() && all[f + 1].first == all[f].first;
    if (!before && !after) hand.surface.push_back(all[f].second);
  }
}

/// `cells` is the number of cells along the block's shortest edge. A value of 1 gives about 100 nodes.
inline HandModel block_hand(int cells = 1) {
  HandModel hand =
      box_mesh({5 * cells, cells, 6 * cells}, 0.036 * Vector3(5, 1, 6), {"palm", 1000, 1e5, 0.45, 1000, 1000});
  hand.name = "block";
  for (Vector3& node : hand.nodes) node += Vector3(-0.12, -0.018, -0.2);
  hand.rest_joints = flat_rest_joints();
  hand.joint_radii.fill(0.01);
  add_surface(hand);

  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Body which = static_cast<Body>(b);
    BodyModel& body = hand.bodies[b];
    const Pose& joint = hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(which)))];
    const Vector3 end =
        which == Body::forearm
            ? Vector3(0, 0, 0.03)
            : joint.inverse() * hand.rest_joints[static_cast<std::size_t>(index_of(end_joint_of(which)))].position;
    body.bone_end = end;
    body.bone_start_radius = body.bone_end_radius = 0.004;
    body.mass = 0.02;
    body.inertia = Matrix3::Identity() * 4e-6;
    body.joint_from_body.position = 0.5 * end;
    body.joint.kind = which == Body::forearm                          ? JointKind::free
                      : is_metacarpal(which) || which == Body::carpus ? JointKind::ball
                                                                      : JointKind::hinge;
    body.joint.position_stiffness = 1e5;
    body.joint.orientation_stiffness = which == Body::carpus ? 0 : 10;
    body.joint.limit_stiffness = 3;
    body.joint.flexion_range = {-1.6, 0.2};
    body.coupling_linear_stiffness = 500;
    body.coupling_angular_stiffness = 0.5;
    body.coupling_force_cap = 4;
    body.coupling_torque_cap = 1;
    // One attachment at the bone's middle, in the tetrahedron that holds it.
    const Vector3 middle = joint * Vector3(0.5 * end);
    for (std::size_t t = 0; t < hand.tetrahedra.size(); ++t) {
      const auto& n = hand.tetrahedra[t];
      Matrix3 edges;
      for (int k = 0; k < 3; ++k)
        edges.col(k) = hand.nodes[static_cast<std::size_t>(n[static_cast<std::size_t>(k) + 1])] -
                       hand.nodes[static_cast<std::size_t>(n[0])];
      const Vector3 w = edges.inverse() * (middle - hand.nodes[static_cast<std::size_t>(n[0])]);
      if (w.minCoeff() < -1e-9 || w.sum() > 1 + 1e-9) continue;
      hand.attachments.push_back(
          {static_cast<std::int32_t>(b), static_cast<std::int32_t>(t), {1 - w.sum(), w[0], w[1], w[2]}, 2e4});
      break;
    }
  }
  for (const Vector3& x : hand.nodes) {
    std::size_t nearest = 0;
    double best = 1e9;
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const Pose& joint = hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(static_cast<Body>(b))))];
      const double distance = (x - joint * Vector3(0.5 * hand.bodies[b].bone_end)).norm();
      if (distance < best) {
        best = distance;
        nearest = b;
      }
    }
    hand.node_body.push_back(static_cast<std::uint8_t>(nearest));
  }
  // The skin is the tissue's own surface, each vertex at a corner of a tetrahedron.
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
    for (std::size_t t = 0; t < hand.tetrahedra.size(); ++t) {
      const auto corner = std::find(hand.tetrahedra[t].begin(), hand.tetrahedra[t].end(), static_cast<std::int32_t>(n));
      if (corner == hand.tetrahedra[t].end()) continue;
      SkinVertex vertex{static_cast<std::int32_t>(t), {}};
      vertex.weights[static_cast<std::size_t>(corner - hand.tetrahedra[t].begin())] = 1;
      hand.skin_vertices.push_back(vertex);
      break;
    }
  }
  hand.skin_triangles = hand.surface;
  const std::vector<double> areas = nodal_areas(hand);
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
    if (!(areas[n] > 0)) continue;
    const SkinVertex& at = hand.skin_vertices[n];
    hand.contact_points.push_back(
        {at.tetrahedron, {at.weights[0], at.weights[1], at.weights[2], at.weights[3]}, areas[n], hand.node_body[n]});
  }
  return hand;
}

}  // namespace softhand::testing
