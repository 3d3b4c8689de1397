// Assembles the hand file from skin, skeleton and mesh.
#pragma once

#include "hand_builder/anatomy.hpp"
#include "hand_builder/mesher.hpp"

namespace softhand::builder {

/// Relative edge length of a good mesh: 0.55 in the pulps, 1 in the distal phalanges, larger towards the palm and the
/// forearm. It grows by at most 0.5 per 10 mm of distance from a bone.
SizingField hand_sizing(const RestSkeleton& rest);

/// Points of the skin that must become nodes: fingertips, and the middle of each phalanx on the palmar and dorsal
/// sides.
std::vector<Vector3> hand_seeds(const RestSkeleton& rest, const SkinShape& skin);

/// Assembles the right hand: bodies, materials by region, attachments, nearest bones, contact points, and the finer
/// skin embedded in tetrahedra. Flat ears of the mesh between two digits are removed (`remove_flat_ears`). There is one
/// attachment per bone and tetrahedron, at the centroid of their intersection.
HandModel assemble_hand(const RestSkeleton& rest, TetrahedralMesh mesh, const TriangleMesh& skin);

/// Replaces the contact points of a right hand by points of `skin`: about 2 mm apart on the pulps and 4.5 mm elsewhere.
/// They depend on skin and skeleton only, so they are the same for every mesh. Each is embedded at the nearest point of
/// the mesh's surface. The result depends only on what a hand file keeps of the mesh.
void add_contact_points(HandModel& hand, const RestSkeleton& rest, const TriangleMesh& skin);

}  // namespace softhand::builder
