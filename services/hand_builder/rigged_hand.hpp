// A rigged hand from a binary glTF file (GLB): WebXR's generic hand, or a user's own with the same 25 joint names.
#pragma once

#include <iosfwd>
#include <memory>
#include <string>

#include "hand_builder/mesher.hpp"

namespace softhand::builder {

/// What a rigged hand's file tells, as a right hand in its wrist's frame. Metres.
struct RiggedHand {
  RestSkeleton rest;        ///< the bind pose; the palm is placed, radii are the skin's distance from each joint
  TriangleMesh skin;        ///< welded, closed, outward
  Side side = Side::right;  ///< what the file holds; a left hand was mirrored
  std::string copyright;    ///< of the file's asset, empty where it tells none
};

/// Reads the file's only skin and the mesh that it moves: positions, triangles, joints, weights, inverse bind matrices
/// (each the inverse of its joint's frame in OpenXR's sense: -Z along the bone, +Y dorsal). Everything must lie in the
/// file's own binary chunk. Checks that the 25 WebXR joints are there and point along their bones, that weights sum to
/// 1, and that the mesh is one closed 2-manifold once vertices nearer than a micrometre are welded. Throws
/// std::runtime_error naming file and field.
RiggedHand load_rigged_hand(const std::string& path);
RiggedHand parse_rigged_hand(std::istream& in, const std::string& name);

/// The exact signed distance to a closed, outward triangle mesh.
class MeshSkin : public SkinShape {
 public:
  explicit MeshSkin(const TriangleMesh& mesh);
  ~MeshSkin() override;
  double distance(const Vector3& point) const override;
  std::array<Vector3, 2> bounds() const override;

 private:
  struct Tree;
  std::unique_ptr<const Tree> tree_;
};

}  // namespace softhand::builder
