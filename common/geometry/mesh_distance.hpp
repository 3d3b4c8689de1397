// Exact signed distance to a closed triangle mesh, and the mass properties of its inside. Not for the real-time path:
// DistanceGrid samples this distance once.
#pragma once

#include <memory>

#include "geometry/shape.hpp"
#include "model/triangle_mesh.hpp"

namespace softhand {

/// The nearest triangle is found with a tree of boxes. The sign is that of the pseudonormal of the nearest feature
/// (Baerentzen and Aanaes 2005, "Signed distance computation using the angle weighted pseudonormal").
class MeshDistance {
 public:
  struct Nearest {
    double distance = 0;              ///< m, negative inside
    Vector3 point = Vector3::Zero();  ///< on the mesh
    std::size_t triangle = 0;         ///< internal number, for `hint`
  };
  /// The mesh is closed and outward, without triangles of zero area.
  explicit MeshDistance(const TriangleMesh& mesh);
  ~MeshDistance();
  MeshDistance(MeshDistance&&) noexcept;

  /// `hint` is the triangle of a point nearby. A good hint saves time; the result does not depend on it.
  Nearest nearest(const Vector3& point, std::size_t hint = 0) const;
  double distance(const Vector3& point) const { return nearest(point).distance; }
  const Vector3& low() const;   ///< corner of the bounding box, m
  const Vector3& high() const;  ///< opposite corner, m

 private:
  struct Tree;
  std::unique_ptr<const Tree> tree_;
};

/// Volume, centroid and inertia of the inside of a closed, outward mesh. Sums over tetrahedra (Tonon 2004).
SolidProperties solid_properties(const TriangleMesh& mesh);

}  // namespace softhand
