// Candidates: which contact points meet a collider in a step, and where. Finds points that are predicted to reach the
// surface, points that the surface passed or that start inside, and points that crossed it.
#pragma once

#include <cstdint>

#include "contact/collider.hpp"
#include "contact/contact_point.hpp"
#include "geometry/point_groups.hpp"

namespace softhand {

/// A contact point that meets a collider. Vectors in the object's frame.
struct Meeting {
  int point = 0;
  Vector3 place = Vector3::Zero();    ///< on the surface; the point's own position if it starts inside
  Vector3 normal = Vector3::UnitY();  ///< outward
  double recess = 0;                  ///< > 0: the point starts inside, this far below the surface, m
  bool predicted = false;             ///< the point is outside and will reach the surface in this step
};

/// Holds the positions of all points within a step. Allocates only at construction.
class Candidates {
 public:
  explicit Candidates(const ContactPoints& points);

  /// Call this at the start of a step with any collider.
  void begin_step(const State& state, double time_step);
  /// Call this before `for_each_crossed`. `state`: the end of the paths that begin at the step's start.
  void set_ends(const State& state);
  const PointGroups& groups() const { return groups_; }

  Vector3 start(int point) const { return starts_.col(point); }
  /// The end of a point's path in this step if it keeps its velocity.
  Vector3 predicted_end(int point) const { return starts_.col(point) + time_step_ * velocities_.col(point); }

  /// Calls found(Meeting) for the points that touch `collider` at the step's start or will reach it in the step. Points
  /// with taken(point) are left out.
  template <typename Taken, typename Found>
  void for_each_predicted(const Collider& collider, Taken&& taken, Found&& found) {
    const double margin =
        collider.reach(collider.start_pose(), collider.end_pose(), groups_) +
        (collider.jumped() ? collider.reach(collider.last_pose(), collider.start_pose(), groups_) : 0.0);
    groups_.for_each_near(*collider.geometry(), collider.start_pose(), margin, [&](std::int32_t point) {
      Meeting meeting;
      if (!taken(point) && predicted(collider, point, meeting)) found(meeting);
    });
  }
  /// The same for the points that crossed the surface on their path from the step's start to the state of `set_ends`.
  template <typename Taken, typename Found>
  void for_each_crossed(const Collider& collider, Taken&& taken, Found&& found) {
    const double margin = collider.reach(collider.start_pose(), collider.end_pose(), groups_);
    groups_.for_each_near(*collider.geometry(), collider.end_pose(), margin, [&](std::int32_t point) {
      Meeting meeting;
      if (!taken(point) && crossed(collider, point, meeting)) found(meeting);
    });
  }
  /// Whether a point may come within `margin` m of the object in the next `seconds`, if both keep their velocities.
  /// Call this between steps.
  bool may_reach(const Collider& collider, const State& state, double seconds, double margin);
  /// Number of points that were searched for a contact since construction.
  std::uint64_t queries() const { return queries_; }

 private:
  bool predicted(const Collider& collider, int point, Meeting& meeting);
  bool crossed(const Collider& collider, int point, Meeting& meeting);

  const ContactPoints* points_;
  PointGroups groups_;
  Eigen::Matrix3Xd starts_, velocities_, ends_, displacements_;  // by point
  double time_step_ = 0;
  std::uint64_t queries_ = 0;
};

}  // namespace softhand
