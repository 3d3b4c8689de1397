// Which contact points of a hand meet its own skin in a step, and where. The narrow phase of contact of skin with skin.
//
// A point meets a triangle of another part of the skin (skin_patches.hpp) in one of two ways.
//
// It crosses the triangle from outside. The path is taken in the triangle's frame. Height and place in the triangle
// change linearly from the step's start to its end. So two fingers that pass each other in one step meet.
//
// Or it is inside the other part at the step's start. Then it is below the triangle, which is the nearest one, and the
// skin around the point faces it. So a finger that is inside another one leaves on the side where it is least deep.
// Skin that faces away from the nearest triangle is not pushed. It follows its finger.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "contact/contact_point.hpp"
#include "contact/skin_frame.hpp"
#include "contact/skin_patches.hpp"
#include "geometry/shape.hpp"
#include "model/state.hpp"

namespace softhand {

/// A contact point that meets a triangle. Places are in the triangle's frame (skin_frame.hpp).
struct SkinCandidate {
  int point = 0;
  int triangle = 0;
  Vector3 place = Vector3::Zero();  ///< on the triangle; the point's own position if it starts inside
  double recess = 0;                ///< > 0: the point starts inside, this far below the triangle, m
  bool predicted = false;           ///< the point is outside and will reach the triangle in this step
  double crossed_at = 0;            ///< the fraction of the step at which the point crosses the triangle
  bool faces = true;                ///< the skin around the point faces the triangle
};

/// Holds the positions of all nodes within a step. Allocates only at construction.
class SkinSearch {
 public:
  SkinSearch(const TissueModel& model, const ContactPoints& points);

  const SkinPatches& patches() const { return patches_; }
  const std::array<std::int32_t, 3>& corners(int triangle) const {
    return triangles_[static_cast<std::size_t>(triangle)];
  }
  int part_of_triangle(int triangle) const {
    return patches_.patches()[static_cast<std::size_t>(patches_.patch_of_triangle(triangle))].part;
  }
  SkinFrame frame(int triangle, const Eigen::Matrix3Xd& node_positions) const {
    const auto& c = corners(triangle);
    return {node_positions.col(c[0]), node_positions.col(c[1]), node_positions.col(c[2])};
  }

  /// Call this at the start of a step. `reach`: m; points farther inside are not looked for.
  void begin_step(const State& state, double time_step, double reach);
  /// Call this before `for_each_crossed`. `state`: the end of the paths that begin at the step's start.
  void set_ends(const State& state);
  const Eigen::Matrix3Xd& starts() const { return starts_; }
  /// Predicted until `set_ends`.
  const Eigen::Matrix3Xd& ends() const { return ends_; }

  /// Calls found(SkinCandidate) for the points that are inside another part at the step's start or will cross its
  /// surface in the step. Points with taken(point, part) are left out. One candidate for each point and part: the place
  /// where it is least far inside, or the first crossing.
  template <typename Taken, typename Found>
  void for_each_predicted(Taken&& taken, Found&& found) {
    for_each_pair([&](int patch, int point, int part) {
      if (taken(point, part)) return;
      ++queries_;
      auto candidate = inside(patch, point);
      if (!candidate && (candidate = crossed(patch, point))) candidate->predicted = true;
      if (candidate) keep(*candidate, part);
    });
    hand_over(found);
  }
  /// The same for the points that crossed the surface on their path to the state of `set_ends`.
  template <typename Taken, typename Found>
  void for_each_crossed(Taken&& taken, Found&& found) {
    for_each_pair([&](int patch, int point, int part) {
      if (taken(point, part)) return;
      ++queries_;
      if (auto candidate = crossed(patch, point); candidate && turns_corner(*candidate)) keep(*candidate, part);
    });
    hand_over(found);
  }

  /// Where a place on the skin continues: the nearest place on the triangles around `triangle`, or around one of these.
  /// `place` is in the frame of `triangle`, the result in that of the new triangle. All at `node_positions`.
  struct Place {
    int triangle = 0;
    Vector3 place = Vector3::Zero();
  };
  Place follow(int triangle, const Vector3& place, const Eigen::Matrix3Xd& node_positions) const;

  /// Number of points that were tested against the triangles of a near patch since construction.
  std::uint64_t queries() const { return queries_; }

 private:
  template <typename Visit>
  void for_each_pair(Visit&& visit) const {
    for (const auto& [a, b] : pairs_) {
      for (const auto& [of_points, of_triangles] : {std::pair(a, b), std::pair(b, a)}) {
        const int part = patches_.patches()[static_cast<std::size_t>(of_triangles)].part;
        for (const std::int32_t point : patches_.patches()[static_cast<std::size_t>(of_points)].points) {
          // The ball around the point's path may reach the paths of the patch.
          const auto& path = paths_[static_cast<std::size_t>(point)];
          if (patches_.is_near(path.middle, of_triangles, path.half + margin_)) visit(of_triangles, point, part);
        }
      }
    }
  }
  template <typename Found>
  void hand_over(Found&& found) {
    for (const SkinCandidate& candidate : candidates_) {
      candidate_of_[place_of(candidate.point, part_of_triangle(candidate.triangle))] = -1;
      if (candidate.faces) found(candidate);
    }
    candidates_.clear();
  }
  std::size_t place_of(int point, int part) const {
    return static_cast<std::size_t>(point) * static_cast<std::size_t>(patches_.part_count()) +
           static_cast<std::size_t>(part);
  }
  void keep(const SkinCandidate& candidate, int part);
  void follow_paths(double margin);
  bool turns_corner(SkinCandidate& candidate) const;
  // Which side of a triangle a place is on. Nearly all triangles need no more.
  struct Side {
    Vector3 corner, across;  // the first corner; the outward normal times twice the area
    // Has the sign of the height of `place` above the triangle.
    double signed_volume(const Vector3& place) const { return across.dot(place - corner); }
  };
  Side side(int triangle, const Eigen::Matrix3Xd& node_positions) const {
    const auto& c = corners(triangle);
    const Vector3 a = node_positions.col(c[0]);
    return {a, (node_positions.col(c[1]) - a).cross(node_positions.col(c[2]) - a)};
  }
  SkinPlane plane(int triangle, const Eigen::Matrix3Xd& node_positions) const {
    const auto& c = corners(triangle);
    return {node_positions.col(c[0]), node_positions.col(c[1]), node_positions.col(c[2])};
  }
  void set_local(const Pose& carpus, const Eigen::Matrix3Xd& positions, Eigen::Matrix3Xd& local) const;
  std::optional<SkinCandidate> inside(int patch, int point) const;
  std::optional<SkinCandidate> crossed(int patch, int point) const;

  const ContactPoints* points_;
  std::vector<std::array<std::int32_t, 3>> triangles_;
  std::vector<std::size_t> first_neighbour_;  // by triangle, and the total at the end
  std::vector<std::int32_t> neighbours_;      // triangles that share a corner
  SkinPatches patches_;
  std::vector<std::int32_t> skin_nodes_;  // of all patches, ascending
  std::size_t carpus_ = 0;                // body of the state
  Eigen::Matrix3Xd starts_, ends_;        // by node
  // The same for the nodes of the skin, in the frame of the carpus of the first hand of the model. A motion of this
  // hand brings nothing near.
  Eigen::Matrix3Xd local_starts_, local_ends_;
  Eigen::Matrix3Xd listed_;    // when the near patches were listed
  double listed_margin_ = -1;  // m, of this list; < 0: there is none
  struct Path {
    Vector3 middle = Vector3::Zero();
    double half = 0;  // of its length, m
  };
  // Valid in overlapping patches.
  std::vector<Path> paths_;                                       // by point, in the frame of the carpus
  std::vector<Side> start_sides_, end_sides_;                     // by triangle
  std::span<const std::pair<std::int32_t, std::int32_t>> pairs_;  // patches that meet
  std::vector<SkinCandidate> candidates_;                         // scratch of a search
  std::vector<std::int32_t> candidate_of_;                        // by (point, part): place in `candidates_`; -1: none
  double reach_ = 0;
  double margin_ = 0;  // of the search, m
  std::uint64_t queries_ = 0;
};

}  // namespace softhand
