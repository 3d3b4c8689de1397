// HandModel: everything about one hand that does not change while it is simulated. SI units.
//
// Rest pose: all quantities are given in the hand's rest frame, which is the wrist joint's OpenXR frame in the rest
// pose (origin at the wrist, -Z towards the middle finger, +Y dorsal; +X towards the thumb on a LEFT hand, away from it
// on a right).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "math/types.hpp"
#include "model/skeleton.hpp"

namespace softhand {

/// How a body may turn against its parent; see `JointModel`.
enum class JointKind : std::uint8_t {
  free,  ///< not held by a joint energy (the forearm; the wrist joint holds carpus to forearm as a ball without limits)
  ball,  ///< position held; orientation held to rest by `orientation_stiffness` (metacarpals II-V)
  saddle,  ///< position held; rotation about Z (twist) held to rest; X (flexion) and Y (abduction) limited
  hinge,   ///< position held; rotation about Y and Z held to rest; X (flexion) limited
};

/// The joint that ties a body to its parent, at the body's proximal joint frame. Angles are the components of the
/// rotation vector from the parent's rest-aligned joint frame to the body's joint frame, in that frame: x flexion
/// (negative = flexed, the OpenXR sense: a flexed finger turns about -X), y abduction, z twist. Zero in the hand's
/// *neutral* pose, which is the rest pose.
struct JointModel {
  JointKind kind = JointKind::free;
  double position_stiffness = 0;                ///< N/m, k of eq. 20
  double orientation_stiffness = 0;             ///< N m/rad, on the axes that the kind holds
  double limit_stiffness = 0;                   ///< N m/rad, beyond the range of motion
  std::array<double, 2> flexion_range{0, 0};    ///< radians about x, min <= 0 <= max
  std::array<double, 2> abduction_range{0, 0};  ///< radians about y, min <= 0 <= max (saddle only)
};

/// One rigid bone: a rounded cone along its joint's -Z, and the mass that its body carries.
struct BodyModel {
  Pose joint_from_body;  ///< the body frame (centre of mass, principal axes not required) in its joint's frame
  double mass = 0;       ///< kg, > 0
  Matrix3 inertia = Matrix3::Zero();  ///< kg m^2 about the centre of mass, body axes; symmetric positive definite
  // The rounded cone of the bone, in the joint's frame; for drawing and for attachments.
  Vector3 bone_start = Vector3::Zero();
  Vector3 bone_end = Vector3::Zero();
  double bone_start_radius = 0;
  double bone_end_radius = 0;
  JointModel joint;
  // Coupling (eq. 18) of this body to the intermediate (or tracked) skeleton.
  double coupling_linear_stiffness = 0;   ///< N/m, k_l
  double coupling_angular_stiffness = 0;  ///< N m/rad, k_a
  double coupling_force_cap = 0;   ///< N, secant cap; the caps of one finger sum to <= 20 N, of the hand to <= 100 N
  double coupling_torque_cap = 0;  ///< N m
};

/// Co-rotational tissue with strain limiting (eqs. 21-30).
struct Material {
  std::string name;                   ///< pulp, palm, back, knuckle
  double density = 1000;              ///< kg/m^3
  double youngs_modulus = 0;          ///< Pa
  double poisson_ratio = 0;           ///< [0, 0.5)
  double strain_limit_energy = 0;     ///< J/m^3, W_max of eq. 22; > 0
  double strain_limit_stiffness = 0;  ///< J/m^3, k_s of eq. 22 (the text's k_c); 0 = no limiting
};

/// One attachment a (bone, tetrahedron): eq. 31 at the centroid of their intersection.
struct Attachment {
  std::int32_t body = 0;
  std::int32_t tetrahedron = 0;
  std::array<double, 4> weights{};  ///< barycentric, sum 1
  double stiffness = 0;             ///< N/m = kappa * volume of the intersection
};

/// A vertex of the finer skin, embedded in a tetrahedron (for display; weights may be slightly negative outside it).
struct SkinVertex {
  std::int32_t tetrahedron = 0;
  std::array<float, 4> weights{};
};

struct HandModel {
  std::string name;
  Side side = Side::right;
  std::string notice;  ///< licence notice of the asset the mesh was made from; empty when parametric

  std::array<Pose, kJointCount> rest_joints{};    ///< joint frames in the rest frame
  std::array<double, kJointCount> joint_radii{};  ///< metres, skin distance as OpenXR reports it
  std::array<BodyModel, kBodyCount> bodies{};

  std::vector<Vector3> nodes;                           ///< rest positions, metres
  std::vector<std::array<std::int32_t, 4>> tetrahedra;  ///< positively oriented: det[x1-x0, x2-x0, x3-x0] > 0
  std::vector<std::uint8_t> tetrahedron_material;       ///< index into `materials`
  std::vector<Material> materials;
  std::vector<std::array<std::int32_t, 3>> surface;  ///< boundary triangles of the tetrahedra, outward, node indices
  std::vector<std::uint8_t> node_body;               ///< nearest bone: tells the finger of a contact
  std::vector<Attachment> attachments;
  std::vector<SkinVertex> skin_vertices;  ///< finer skin for display
  std::vector<std::array<std::int32_t, 3>> skin_triangles;

  int node_count() const { return static_cast<int>(nodes.size()); }
  /// The body frame in the rest frame.
  Pose body_rest_pose(Body body) const {
    return rest_joints[static_cast<std::size_t>(index_of(joint_of(body)))] *
           bodies[static_cast<std::size_t>(index_of(body))].joint_from_body;
  }
};

/// kg, by node: a quarter of the mass of each of its tetrahedra.
std::vector<double> lumped_masses(const HandModel& hand);

/// Throws std::invalid_argument with the offending field and what was expected (sizes, ranges, finite numbers,
/// orientation and quality of tetrahedra, symmetric positive inertia, caps). `where` (a file name) leads the message.
void validate(const HandModel& hand, const std::string& where);

/// Takes out nodes that neither a tetrahedron nor a triangle of the surface has: some meshers leave them, and they have
/// no mass. Those behind them get lower numbers.
void drop_loose_nodes(HandModel& hand);

/// Reads a hand file (docs/hand-file.md; JSON, version 1), drops its loose nodes and validates it. Throws
/// std::runtime_error naming file and field.
HandModel load_hand(const std::string& path);
void save_hand(const HandModel& hand, const std::string& path);

/// The same hand for the other side: every frame mirrored as S R S, S = diag(-1, 1, 1).
HandModel mirrored(const HandModel& hand);

/// What a tracker's frames tell of a user's skeleton, whatever the pose.
struct MeasuredSkeleton {
  /// Origin of each joint in the frame of the joint that carries its bone's proximal end (`parent_of(body_of(joint))`'s
  /// joint; for tips their own distal joint), metres. Wrist: zero.
  std::array<Vector3, kJointCount> offsets{};
  /// Orientation of each joint in the same frame, one entry a frame of the measurement.
  std::vector<std::array<Quaternion, kJointCount>> orientations;
  std::array<double, kJointCount> radii{};  ///< metres; <= 0 where the source has none
};

/// Mean over `frames` (each: all 26 joints in any common frame). Throws std::invalid_argument when there is none.
MeasuredSkeleton measure_skeleton(std::span<const std::array<Pose, kJointCount>> frames,
                                  const std::array<double, kJointCount>& radii);

/// The hand fitted to a user: bone lengths, joint offsets and thickness become the user's; mesh, bones and attachments
/// are blended along, without remeshing. How a source lays its joint frames about the bone is its convention: on all
/// axes but flexion, rest becomes the mean of what was measured; ranges of motion grow to hold what was measured.
/// Throws std::invalid_argument where a length ratio is outside [0.5, 2] or a tetrahedron would turn over.
HandModel fitted(const HandModel& hand, const MeasuredSkeleton& user);

}  // namespace softhand
