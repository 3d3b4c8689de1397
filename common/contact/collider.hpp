// Colliders: the surfaces that contact points touch. This file knows shapes, motions and unknowns. It knows nothing of
// anchors and energies.
//
// A collider is the surface of one object in motion within a step. It answers where the surface is: the closest point,
// the first crossing of a path, and the normal at the step's end. It also adds forces and stiffnesses on the surface to
// the unknowns of the object's body.
//
// A fixed object moves within the step by its velocity. Energies use its pose at the step's end, because they are
// functions of the positions at the step's end. Paths use the pose at the step's start. So only relative motion counts.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "contact/contact_point.hpp"
#include "geometry/point_groups.hpp"
#include "geometry/shape.hpp"
#include "math/block_matrix.hpp"
#include "math/rotation.hpp"
#include "model/state.hpp"

namespace softhand {

/// How the object in a slot reacts to contact.
enum class ContactObject : std::uint8_t {
  moving,  ///< movable: the opposite force acts on the degrees of freedom of its body
  fixed,   ///< prescribed motion: the state has the pose of the step's start; the wrench is only reported
};

inline Vector3 to_local(const Pose& pose, const Vector3& point) {
  return pose.orientation.conjugate() * (point - pose.position);
}

/// Where the contact points add gradients and Hessians to the unknowns of their nodes.
class PointBlocks {
 public:
  explicit PointBlocks(const ContactPoints& points);
  /// Adds the blocks between the nodes of each point.
  void add_pattern(BlockPattern& pattern) const;
  void bind(const BlockMatrix& matrix);

  void add_gradient(int point, const Vector3& y, VectorX& gradient) const {
    const ContactPoint& p = (*points_)[point];
    if (p.node_count == 1) {
      gradient.segment<3>(3 * p.nodes[0]) += y;
      return;
    }
    for (std::size_t k = 0; k < static_cast<std::size_t>(p.node_count); ++k)
      gradient.segment<3>(3 * p.nodes[k]) += p.weights[k] * y;
  }
  void add_hessian(int point, const Matrix3& stiffness, BlockMatrix& hessian) const;
  /// Number of the point's first node, if the nodes of all points are counted one after the other.
  std::size_t first_node(int point) const { return first_node_[static_cast<std::size_t>(point)]; }
  std::size_t node_count() const { return first_node_.back(); }

 private:
  const ContactPoints* points_;
  std::vector<std::size_t> first_node_;   // by point, and the total at the end
  std::vector<std::size_t> first_block_;  // by point
  std::vector<BlockSlot> blocks_;         // lower triangle of each point's nodes: (0,0), (1,0), (1,1), (2,0), ...
};

class Collider {
 public:
  /// `body`: index into State::body_poses. `block`: of the body's translation in the matrix; the rotation follows.
  Collider(int body, int block, bool can_move) : body_(body), block_(block), can_move_(can_move) {}

  void set(const ShapeGeometry& geometry, ContactObject kind);
  void clear();
  /// No path starts at the old pose.
  void forget_motion() { memory_.seen = false; }
  bool is_set() const { return geometry_ != nullptr; }
  const ShapeGeometry* geometry() const { return geometry_; }
  bool can_move() const { return can_move_; }
  bool is_fixed() const { return memory_.kind == ContactObject::fixed; }

  /// All that a step carries to the next one.
  struct Memory {
    ContactObject kind = ContactObject::fixed;
    bool seen = false;  // last_pose is valid
    Pose last_pose;     // at the end of the last step
  };
  const Memory& memory() const { return memory_; }
  void load(const Memory& memory);

  /// Sets the poses of the step. Returns false if the object was teleported: then no contact persists.
  bool begin_step(const State& state, double time_step, const PointGroups& points);
  /// Sets the pose at the end of a path, for a search of crossed points.
  void set_end(const State& state) { end_pose_ = pose(state); }
  /// Sets pose and movement at the end of the step.
  void end_step(const State& state);
  /// Stores the pose at the end of the step.
  void remember() {
    memory_.last_pose = end_pose_;
    memory_.seen = true;
  }

  const Pose& last_pose() const { return memory_.last_pose; }
  const Pose& start_pose() const { return start_pose_; }
  const Pose& end_pose() const { return end_pose_; }
  /// The caller moved the object between the last step's end and this step's start.
  bool jumped() const { return jumped_; }
  /// Movement within the step by the solver: of the centre of mass, and the rotation vector. Zero for a fixed object.
  const Vector3& moved() const { return moved_; }
  const Vector3& turned() const { return turned_; }
  /// The pose that energies use.
  const Pose& pose(const State& state) const { return is_fixed() ? end_pose_ : body_pose(state); }
  /// The pose in `state`, which for a fixed object is the pose of the step's start.
  const Pose& body_pose(const State& state) const { return state.body_poses[static_cast<std::size_t>(body_)]; }

  /// Velocity of the object at `place`, m/s. Both are in the world.
  Vector3 velocity_at(const State& state, const Vector3& place) const {
    const Twist& velocity = state.body_velocities[static_cast<std::size_t>(body_)];
    return velocity.linear + velocity.angular.cross(place - body_pose(state).position);
  }
  /// The pose after `seconds` if the object keeps its velocity.
  Pose predicted_pose(const State& state, double seconds) const {
    return advanced(body_pose(state), state.body_velocities[static_cast<std::size_t>(body_)], seconds);
  }
  /// Upper bound of the movement of any point of the object near the hand between two poses, m.
  double reach(const Pose& from, const Pose& to, const PointGroups& points) const;
  /// Closest point of the surface. `place` and the result are in the object's frame.
  SurfacePoint closest(const Vector3& place) const { return geometry_->closest(place); }
  /// The same, but on the side to which `normal` points. A wall that is thinner than twice the depth of `place` has its
  /// closest surface on the other side. Returns nothing if no such surface is found within `distance` m.
  std::optional<SurfacePoint> closest_on_side(const Vector3& place, const Vector3& normal, double distance) const;
  /// Where an anchor lies that slid from the surface point `from` with outward normal `normal` by `movement` in its
  /// tangent plane. This is the closest surface, but never the far side of a thin wall: a wall in the way stops the
  /// anchor, and the side of `normal` comes before the other side.
  SurfacePoint slid(const Vector3& from, const Vector3& normal, const Vector3& movement) const;
  /// The point where the surface meets a point that moves from `start` to `end` in the world during this step. If the
  /// object turns, the path in the object's frame is an arc, and the crossing is that of its chord.
  std::optional<Crossing> crossing(const Vector3& start, const Vector3& end) const;
  /// The object moved from pose `from` to pose `to`. Returns whether the normal `now` points to the same side in the
  /// world as the normal `before` did. Otherwise `now` belongs to the far side of the object. Normals are in the
  /// object's frame.
  static bool same_side(const Pose& from, const Vector3& before, const Pose& to, const Vector3& now) {
    return (from.orientation * before).dot(to.orientation * now) > 0;
  }
  /// Whether the object turns so far in the step that a plane that rotates with it is no longer the surface under a
  /// point.
  bool turns_far() const;
  /// Whether a surface with normal `now` needs another plane than the one with normal `before`.
  static bool needs_new_plane(const Vector3& before, const Vector3& now);
  /// Whether the object has a prescribed rotation in this step.
  bool is_turned() const { return is_fixed() && start_pose_.orientation.coeffs() != end_pose_.orientation.coeffs(); }

  /// The border rows of a movable object.
  void add_pattern(const ContactPoints& points, BlockPattern& pattern) const;
  void bind(const ContactPoints& points, const PointBlocks& blocks, const BlockMatrix& matrix);
  /// Add gradient and Hessian of a function of e = R^T (x_p - x_b) with gradient y (N, world axes) and stiffness K
  /// (N/m). `lever` is x_p - x_b.
  void scatter_gradient(const PointBlocks& blocks, int point, const Vector3& lever, const Vector3& y,
                        VectorX& gradient) const {
    blocks.add_gradient(point, y, gradient);
    if (is_fixed()) return;
    gradient.segment<3>(3 * block_) -= y;
    gradient.segment<3>(3 * block_ + 3) -= lever.cross(y);
  }
  void scatter_hessian(const ContactPoints& points, const PointBlocks& blocks, int point, const Vector3& lever,
                       const Vector3& y, const Matrix3& stiffness, bool exact, BlockMatrix& hessian) const;

 private:
  static bool only_turns_past(const ShapeGeometry& geometry, const Pose& from, const Pose& to, const Vector3& start,
                              const Vector3& end);

  int body_;
  int block_;
  bool can_move_;
  const ShapeGeometry* geometry_ = nullptr;
  Memory memory_;
  Pose start_pose_;
  bool jumped_ = false;
  Pose end_pose_;  // by the object's twist: exact if fixed, predicted if moving
  Vector3 moved_ = Vector3::Zero(), turned_ = Vector3::Zero();
  struct NodeBlocks {
    BlockSlot translation, rotation;
  };
  std::vector<NodeBlocks> node_blocks_;  // for the nodes of all points
  BlockSlot translation_, rotation_translation_, rotation_;
};

}  // namespace softhand
