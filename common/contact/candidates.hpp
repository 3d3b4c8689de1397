// Candidates: which contact points meet a collider in a step, and where. Finds points that are predicted to reach the
// surface, points that the surface passed or that start inside, and points that crossed it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "contact/collider.hpp"
#include "contact/contact_point.hpp"
#include "geometry/point_groups.hpp"

namespace softhand {

/// A contact point that meets a collider. Vectors in the object's frame.
struct ContactCandidate {
  int point = 0;
  Vector3 place = Vector3::Zero();    ///< on the surface; the point's own position if it starts inside
  Vector3 normal = Vector3::UnitY();  ///< outward
  double recess = 0;                  ///< > 0: the point starts inside, this far below the surface, m
  bool predicted = false;             ///< the point is outside and will reach the surface in this step
  int sharp = -1;                     ///< sharp point of the object that enters the skin at `point`, a triangle's point
  Vector3 weights = Vector3::Zero();  ///< of the triangle's corners, if `sharp` >= 0
};

/// Holds the positions of all nodes within a step. Allocates only at construction.
class Candidates {
 public:
  Candidates(const ContactPoints& points, int slots);

  /// Call this at the start of a step with any collider.
  void begin_step(const State& state, double time_step);
  /// Call this before `for_each_crossed`. `state`: the end of the paths that begin at the step's start.
  void set_ends(const State& state);
  const PointGroups& groups() const { return groups_; }

  Vector3 start(int point) const { return points_->at(point, starts_); }
  /// The end of a point's path in this step if it keeps its velocity.
  Vector3 predicted_end(int point) const { return start(point) + time_step_ * points_->at(point, velocities_); }

  /// Calls found(ContactCandidate) for the points that touch the collider of a slot at the step's start or will reach
  /// it in the step. Points with taken(point) are left out. Points of a bone that start inside leave on the side where
  /// they are least far inside. But if these are opposite sides, all of them leave in one direction.
  template <typename Taken, typename Found>
  void for_each_predicted(int slot, const Collider& collider, Taken&& taken, Found&& found) {
    const double margin =
        collider.reach(collider.start_pose(), collider.end_pose(), groups_) +
        (collider.jumped() ? collider.reach(collider.last_pose(), collider.start_pose(), groups_) : 0.0);
    const auto clearances = clearances_of(slot);
    std::fill(clearances.begin(), clearances.end(), 0.0);
    met_.clear();
    groups_.for_each_near(*collider.geometry(), collider.start_pose(), margin, [&](std::int32_t point) {
      ContactCandidate candidate;
      if (!taken(point) && predicted(collider, point, margin, clearances[static_cast<std::size_t>(point)], candidate))
        met_.push_back(candidate);
    });
    choose_exits(*collider.geometry());
    for (const ContactCandidate& candidate : met_) found(candidate);
  }
  /// The same for the points that crossed the surface on their path from the step's start to the state of `set_ends`.
  template <typename Taken, typename Found>
  void for_each_crossed(int slot, const Collider& collider, Taken&& taken, Found&& found) {
    const double margin = collider.reach(collider.start_pose(), collider.end_pose(), groups_);
    const auto clearances = clearances_of(slot);
    groups_.for_each_near(*collider.geometry(), collider.end_pose(), margin, [&](std::int32_t point) {
      ContactCandidate candidate;
      // Nearly all points stay farther from the surface than they move.
      const double rest = clearances[static_cast<std::size_t>(point)] - margin;
      if (rest > 0 && points_->at(point, displacements_).squaredNorm() < rest * rest) return;
      if (!taken(point) && crossed(collider, point, candidate)) found(candidate);
    });
  }
  /// Calls found(ContactCandidate) for the sharp points of the collider that enter the skin in the step. `predicted`:
  /// by the predicted paths. Otherwise on the paths to the state of `set_ends`.
  template <typename Found>
  void for_each_entering(const Collider& collider, bool predicted, Found&& found) {
    const auto sharp = collider.geometry()->sharp_points();
    if (!sharp.empty()) update_triangles();
    for (std::size_t i = 0; i < sharp.size(); ++i) {
      ContactCandidate candidate;
      if (enters(collider, sharp[i], predicted, candidate)) {
        candidate.sharp = static_cast<int>(i);
        found(candidate);
      }
    }
  }
  /// The place of the skin that is nearest to `place` (world), at most `distance` m away.
  struct SkinPlace {
    int point = -1;  ///< the point of the triangle; -1: none
    Vector3 weights = Vector3::Zero(), position = Vector3::Zero();
    Vector3 normal = Vector3::UnitY();  ///< outward of the hand, world
  };
  SkinPlace nearest_on_skin(const Vector3& place, double distance, const Eigen::Matrix3Xd& node_positions) const;
  /// Whether a point may come within `margin` m of the object from the start to the end of the step, if both keep their
  /// velocities.
  bool may_reach(const Collider& collider, const State& state, double margin);
  /// Number of points that were searched for a contact since construction.
  std::uint64_t queries() const { return queries_; }

 private:
  std::span<double> clearances_of(int slot) {
    const auto count = static_cast<std::size_t>(points_->count());
    return std::span(clearances_).subspan(static_cast<std::size_t>(slot) * count, count);
  }
  bool predicted(const Collider& collider, int point, double margin, double& clearance, ContactCandidate& candidate);
  bool crossed(const Collider& collider, int point, ContactCandidate& candidate);
  void choose_exits(const ShapeGeometry& geometry);
  void choose_exit(const ShapeGeometry& geometry, std::span<ContactCandidate> of_bone);
  void update_triangles();
  bool enters(const Collider& collider, const RestingPoint& sharp, bool predicted, ContactCandidate& candidate) const;

  const ContactPoints* points_;
  PointGroups groups_;
  std::vector<ContactCandidate> met_;  // of a slot, in the order of the bones
  std::vector<Vector3> exits_;         // scratch: normals at points of a bone that start inside
  PointGroups triangles_;              // of the points of the triangles
  double longest_path_ = 0;            // of a node between start and end, m
  bool triangles_are_old_ = true;
  Eigen::Matrix3Xd starts_, velocities_, ends_, displacements_;  // by node; the ends are predicted until `set_ends`
  std::vector<double> clearances_;  // by (slot, point): lower bound of the distance at the step's start, m; 0: unknown
  double time_step_ = 0;
  std::uint64_t queries_ = 0;
};

}  // namespace softhand
