// From skin, skeleton and mesh to the hand's file.
#pragma once

#include "hand_builder/mesher.hpp"

namespace softhand::builder {

/// Relative edge length of a good mesh: 0.8 in the pulps, 1 in the distal phalanges, coarser to the palm and the
/// forearm, growing at most 0.35 per metre away from bones.
SizingField hand_sizing(const RestSkeleton& rest);

/// Points of the skin that must become nodes: fingertips and the middle of each phalanx, on palm and back.
std::vector<Vector3> hand_seeds(const RestSkeleton& rest, const SkinShape& skin);

/// Puts the whole right hand together: bodies, materials by region, attachments (one per bone and tetrahedron, at the
/// centroid of their intersection), nearest bones, the finer skin in tetrahedra.
HandModel assemble_hand(const RestSkeleton& rest, const TetrahedralMesh& mesh, const TriangleMesh& skin);

}  // namespace softhand::builder
