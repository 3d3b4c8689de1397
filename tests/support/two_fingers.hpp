// Two blocks of tissue that count as the tips of index and middle finger, for tests of contact of skin with skin.
#pragma once

#include "support/block_hand.hpp"

namespace softhand::testing {

/// Block 0 fills [0, size] and belongs to the index finger. Block 1 has the same shape, is moved by `pose`, and belongs
/// to the middle finger. Contact points are at the nodes of the surface. No skeleton.
inline HandModel two_fingers(std::array<int, 3> cells, const Vector3& size, const Pose& pose,
                             double youngs_modulus = 1e5) {
  HandModel hand = box_mesh(cells, size, {"pulp", 1000, youngs_modulus, 0.4, 1e12, 0});
  const auto nodes = static_cast<std::int32_t>(hand.nodes.size());
  const std::size_t tetrahedra = hand.tetrahedra.size();
  for (std::int32_t n = 0; n < nodes; ++n) {
    hand.nodes.push_back(pose * hand.nodes[static_cast<std::size_t>(n)]);
    hand.node_body.push_back(static_cast<std::uint8_t>(index_of(Body::index_distal)));
  }
  for (std::int32_t n = 0; n < nodes; ++n)
    hand.node_body.push_back(static_cast<std::uint8_t>(index_of(Body::middle_distal)));
  for (std::size_t t = 0; t < tetrahedra; ++t) {
    auto corners = hand.tetrahedra[t];
    for (std::int32_t& node : corners) node += nodes;
    hand.tetrahedra.push_back(corners);
    hand.tetrahedron_material.push_back(0);
  }
  add_surface(hand);
  const std::vector<double> areas = nodal_areas(hand);
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
    if (!(areas[n] > 0)) continue;
    for (std::size_t t = 0; t < hand.tetrahedra.size(); ++t) {
      const auto corner = std::find(hand.tetrahedra[t].begin(), hand.tetrahedra[t].end(), static_cast<std::int32_t>(n));
      if (corner == hand.tetrahedra[t].end()) continue;
      SkinPoint point{static_cast<std::int32_t>(t), {}, areas[n], hand.node_body[n]};
      point.weights[static_cast<std::size_t>(corner - hand.tetrahedra[t].begin())] = 1;
      hand.contact_points.push_back(point);
      break;
    }
  }
  return hand;
}

}  // namespace softhand::testing
