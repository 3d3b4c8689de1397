// The skin of a rigged hand as a SkinShape.
#include "geometry/mesh_distance.hpp"

#include "hand_builder/rigged_hand.hpp"

namespace softhand::builder {

MeshSkin::MeshSkin(const TriangleMesh& mesh) : mesh_(std::make_unique<const MeshDistance>(mesh)) {}
MeshSkin::~MeshSkin() = default;

double MeshSkin::distance(const Vector3& point) const { return mesh_->distance(point); }

std::array<Vector3, 2> MeshSkin::bounds() const {
  const Vector3 margin = Vector3::Constant(0.006);
  return {mesh_->low() - margin, mesh_->high() + margin};
}

}  // namespace softhand::builder
