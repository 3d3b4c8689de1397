// HandModel: all data of a hand that do not change while it is simulated. SI units.
//
// All quantities are in the hand's rest frame: the OpenXR frame of the wrist joint in the rest pose. Its origin is the
// wrist. -Z points towards the middle finger and +Y is dorsal. The axis +X points towards the thumb on a LEFT hand and
// away from the thumb on a right hand.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "math/types.hpp"
#include "model/skeleton.hpp"
#include "model/tissue_model.hpp"

namespace softhand {

/// A pose for each joint, indexed by Joint.
using JointFrames = std::array<Pose, kJointCount>;

/// How a body may rotate relative to its parent; see `JointModel`.
enum class JointKind : std::uint8_t {
  /// No joint energy. Used for the forearm. The wrist joint holds the carpus to the forearm, as a ball without limits.
  free,
  ball,    ///< position held; orientation held to rest by `orientation_stiffness` (metacarpals II-V)
  saddle,  ///< position held; rotation about Z (twist) held to rest; X (flexion) and Y (abduction) limited
  hinge,   ///< position held; rotation about Y and Z held to rest; X (flexion) limited
};

/// The joint between a body and its parent, at the body's proximal joint frame. Its angles are the components of a
/// rotation vector: from the parent's rest-aligned joint frame to the body's joint frame, in the parent's frame. Angle
/// x is flexion, y is abduction, z is twist. Flexion is negative for a flexed finger, as in OpenXR: a flexed finger
/// rotates about -X. All angles are zero in the hand's *neutral* pose, which is the rest pose.
struct JointModel {
  JointKind kind = JointKind::free;
  double position_stiffness = 0;                ///< N/m, k of eq. 20
  double orientation_stiffness = 0;             ///< N m/rad, about the axes that the kind holds
  double limit_stiffness = 0;                   ///< N m/rad, beyond the range of motion
  std::array<double, 2> flexion_range{0, 0};    ///< radians about x, min <= 0 <= max
  std::array<double, 2> abduction_range{0, 0};  ///< radians about y, min <= 0 <= max (saddle only)
};

/// A rigid bone: a rounded cone along its joint's -Z, and the mass of its body.
struct BodyModel {
  /// The body frame in its joint's frame. Its origin is the centre of mass. Its axes need not be the principal axes.
  Pose joint_from_body;
  double mass = 0;                    ///< kg, > 0
  Matrix3 inertia = Matrix3::Zero();  ///< kg m^2 about the centre of mass, body axes; symmetric positive definite
  // The rounded cone of the bone in the joint's frame, for drawing and for attachments.
  Vector3 bone_start = Vector3::Zero();
  Vector3 bone_end = Vector3::Zero();
  double bone_start_radius = 0;
  double bone_end_radius = 0;
  JointModel joint;
  // Coupling (eq. 18) of this body to the intermediate (or tracked) skeleton.
  double coupling_linear_stiffness = 0;   ///< N/m, k_l
  double coupling_angular_stiffness = 0;  ///< N m/rad, k_a
  double coupling_force_cap = 0;          ///< N, secant cap; the sum is at most 20 N per finger and 100 N per hand
  double coupling_torque_cap = 0;         ///< N m
};

/// An attachment of a tetrahedron to a bone: eq. 31 at the centroid of their intersection.
struct Attachment {
  std::int32_t body = 0;
  std::int32_t tetrahedron = 0;
  std::array<double, 4> weights{};  ///< barycentric, sum 1
  double stiffness = 0;             ///< N/m = kappa * volume of the intersection
};

/// A vertex of the finer display skin, embedded in a tetrahedron. Weights may be slightly negative outside the
/// tetrahedron.
struct SkinVertex {
  std::int32_t tetrahedron = 0;
  std::array<float, 4> weights{};
};

/// What only a hand has.
struct HandAnatomy {
  std::string name;
  Side side = Side::right;
  std::string notice;  ///< licence notice of the asset that the mesh was made from; empty for a parametric hand

  std::array<Pose, kJointCount> rest_joints{};    ///< joint frames in the rest frame
  std::array<double, kJointCount> joint_radii{};  ///< metres, distance to the skin as in OpenXR
  std::array<BodyModel, kBodyCount> bodies{};

  std::vector<Attachment> attachments;
  std::vector<SkinVertex> skin_vertices;  ///< finer skin for display
  std::vector<std::array<std::int32_t, 3>> skin_triangles;
};

/// All data are in its bases, which can be visited member by member (messages/members.hpp).
struct HandModel : HandAnatomy, TissueModel {
  using TissueModel::position_of;
  /// The rest position of a vertex of the display skin.
  Vector3 position_of(const SkinVertex& vertex) const {
    Vector3 position = Vector3::Zero();
    for (std::size_t k = 0; k < 4; ++k) {
      const std::int32_t node = tetrahedra[static_cast<std::size_t>(vertex.tetrahedron)][k];
      position += static_cast<double>(vertex.weights[k]) * nodes[static_cast<std::size_t>(node)];
    }
    return position;
  }
  /// The body frame in the rest frame.
  Pose body_rest_pose(Body body) const {
    return rest_joints[static_cast<std::size_t>(index_of(joint_of(body)))] *
           bodies[static_cast<std::size_t>(index_of(body))].joint_from_body;
  }
};

/// Checks sizes, ranges, finite numbers, orientation and quality of the tetrahedra, positive symmetric inertia and
/// caps. Throws std::invalid_argument with the bad field and what was expected. The message starts with `where` (a file
/// name).
void validate(const HandModel& hand, const std::string& where);

/// Removes nodes that belong to no tetrahedron and to no surface triangle. Some meshers leave such nodes, and they have
/// no mass. The nodes after a removed node get lower numbers.
void drop_loose_nodes(HandModel& hand);

/// Reads a hand file (docs/hand-file.md; JSON, version 2), drops its loose nodes and validates it. Throws
/// std::runtime_error with file and field.
HandModel load_hand(const std::string& path);
/// The same for the text of a hand file. `path` is its name in error messages.
HandModel parse_hand(const std::string& text, const std::string& path);
void save_hand(const HandModel& hand, const std::string& path);

/// The same hand for the other side: every frame is mirrored as S R S with S = diag(-1, 1, 1).
HandModel mirrored(const HandModel& hand);

/// The properties of a user's skeleton in a tracker's frames that do not depend on the pose.
struct MeasuredSkeleton {
  /// Origin of each joint in the frame of the joint that moves the proximal end of its bone, metres. This is the joint
  /// of `parent_of(body_of(joint))`; for tips, their own distal joint. Wrist: zero.
  std::array<Vector3, kJointCount> offsets{};
  /// Orientation of each joint in the same frame, one entry per frame of the measurement.
  std::vector<std::array<Quaternion, kJointCount>> orientations;
  std::array<double, kJointCount> radii{};  ///< metres; <= 0 if the source has no radius
};

/// Mean over `frames` (each with all 26 joints in any common frame). Throws std::invalid_argument if `frames` is empty.
MeasuredSkeleton measure_skeleton(std::span<const std::array<Pose, kJointCount>> frames,
                                  const std::array<double, kJointCount>& radii);

/// The hand fitted to a user. Bone lengths, joint offsets and thickness become the user's. Mesh, bones and attachments
/// are deformed with them, without remeshing. The rotation of joint frames about the bone is a convention of the
/// source. So on all axes except flexion, the rest angle becomes the mean of the measured angles. Ranges of motion grow
/// to include the measured angles. Throws std::invalid_argument if a length ratio is outside [0.5, 2] or a tetrahedron
/// would be inverted.
HandModel fitted(const HandModel& hand, const MeasuredSkeleton& user);

}  // namespace softhand
