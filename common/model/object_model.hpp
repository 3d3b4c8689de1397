// An object that a hand can touch. Constant data of an object file (docs/object-file.md). An object is either rigid
// (links of any closed shape, and joints between them) or flexible (tetrahedra of one material, docs/soft-objects.md).
// Links share one frame while all joint coordinates are 0.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "model/joint_law.hpp"
#include "model/tissue_model.hpp"
#include "model/triangle_mesh.hpp"

namespace softhand {

inline constexpr std::size_t kMaxObjectLinks = 16;
inline constexpr std::size_t kMaxLinkPieces = 64;
inline constexpr std::size_t kMaxPieceVertices = 256;
inline constexpr std::size_t kMaxLinkTriangles = 100'000;

/// A rigid part. All positions are in the link's frame. At joint coordinates 0 this is the object's frame.
struct ObjectLink {
  std::string name;
  TriangleMesh mesh;                         ///< closed, outward; for display and for the distance grid
  double grid_spacing = 0.001;               ///< m, edge of a cell of the distance grid; walls have two cells
  double mass = 0;                           ///< kg
  Vector3 centre_of_mass = Vector3::Zero();  ///< m
  Matrix3 inertia = Matrix3::Zero();         ///< kg m^2, about the centre of mass, axes of the link's frame
  double friction = 0;                       ///< Coulomb coefficient
  std::vector<std::vector<Vector3>> pieces;  ///< convex hulls whose union approximates the link, for an engine
};

struct LinkJoint {
  std::size_t parent = 0;  ///< index of a link
  std::size_t child = 0;   ///< index of a link; each link but the first is the child of exactly one joint
  Pose parent_from_joint;  ///< the joint's frame in the parent's link frame; the axis is +y
  Pose child_from_joint;   ///< the joint's frame in the child's link frame
  JointLaw law;
};

/// A flexible object. It has the law of the hand's tissue (ES2725128A1 eqs. 21-30).
struct SoftBody {
  std::vector<Vector3> nodes;                           ///< m at rest, in the object's frame
  std::vector<std::array<std::int32_t, 4>> tetrahedra;  ///< positively oriented; each node belongs to one
  Material material;
  double friction = 0;  ///< Coulomb coefficient, against the hand and against other flexible objects
};

/// Most nodes of a flexible object. The hand's process solves for all of them in each step.
inline constexpr std::size_t kMaxSoftNodes = 4000;

struct ObjectModel {
  std::string name;    ///< letters, digits, _ and -; at most 63 characters
  std::string notice;  ///< licence notice of the shape
  std::vector<ObjectLink> links;
  std::vector<LinkJoint> joints;  ///< a tree; a joint comes after the joint whose child is its parent
  std::optional<SoftBody> soft;   ///< then the object has no links and no joints
};

/// Throws std::runtime_error with file, field and what was expected.
void validate(const ObjectModel& object, const std::string& file);
/// Reads the text of an object file. `file` is its name in error messages. Validates.
ObjectModel parse_object(std::string_view text, const std::string& file);
/// Writes an object file with rounded numbers (lengths to 1e-6 m). A file that is read and written again has the same
/// bytes.
void save_object(const ObjectModel& object, const std::string& path);
/// The position as `save_object` writes it. Checks of a mesh that is to be saved need the rounded mesh.
Vector3 rounded_position(const Vector3& position);

/// Poses of the links' frames in the frame of the first link, for these coordinates (one per joint, rad or m). A ball
/// joint and a fixed joint have no coordinate; theirs is ignored.
std::vector<Pose> link_poses(const ObjectModel& object, const std::vector<double>& coordinates);

}  // namespace softhand
