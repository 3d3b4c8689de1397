// A rigged hand from a binary glTF file (GLB): WebXR's generic hand, or a user's own hand with the same 25 joint names.
#pragma once

#include <iosfwd>
#include <memory>
#include <string>

#include "hand_builder/anatomy.hpp"
#include "hand_builder/mesher.hpp"

namespace softhand {
class MeshDistance;
}

namespace softhand::builder {

/// The content of the file as a right hand in its wrist's frame. Metres.
struct RiggedHand {
  RestSkeleton rest;        ///< bind pose with an added palm; radii are the distances from the joints to the skin
  TriangleMesh skin;        ///< welded, closed, outward
  Side side = Side::right;  ///< side in the file; a left hand was mirrored
  std::string copyright;    ///< copyright of the file's asset; may be empty
};

/// Reads the only skin of the file and the mesh that it moves: positions, triangles, joints, weights, inverse bind
/// matrices. An inverse bind matrix is the inverse of its joint's frame in OpenXR's sense: -Z along the bone, +Y
/// dorsal. All data must be in the binary chunk of the file. The 25 WebXR joints must exist and point along their
/// bones. The weights must sum to 1. The mesh must be one closed 2-manifold after welding of vertices nearer than a
/// micrometre. Throws std::runtime_error with file and field.
RiggedHand load_rigged_hand(const std::string& path);
RiggedHand parse_rigged_hand(std::istream& in, const std::string& name);

/// The exact signed distance to a closed triangle mesh with outward orientation.
class MeshSkin : public SkinShape {
 public:
  explicit MeshSkin(const TriangleMesh& mesh);
  ~MeshSkin() override;
  double distance(const Vector3& point) const override;
  std::array<Vector3, 2> bounds() const override;

 private:
  std::unique_ptr<const MeshDistance> mesh_;
};

}  // namespace softhand::builder
