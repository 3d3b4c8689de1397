// Patches of the skin, and which pairs of them can touch: the broad phase of contact of skin with skin.
//
// The skin is divided into parts: of each hand five digits and the palm with the wrist, and each flexible object.
// Contact is between different parts. Each part is divided into patches of about a centimetre. Two patches of a hand
// cannot touch if they are near at rest. They are near if their distance along the skin is less than `near_at_rest`,
// for example on both sides of a web or a crease. They are also near if only a sheet of tissue thinner than `deepest`
// lies between them.
//
// If the model has the skin of several owners (hands and flexible objects), only pairs of different owners can touch.
// Contact of a hand with itself is a term of its own, over a model of this hand alone.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "contact/contact_point.hpp"
#include "model/skeleton.hpp"
#include "model/tissue_model.hpp"

namespace softhand {

/// Largest number of hands in one simulation. There, `TissueModel::node_body` of bone b of hand h is h * kBodyCount +
/// b, and that of flexible object i is kMostHands * kBodyCount + i.
inline constexpr int kMostHands = 2;
/// Parts of the skin of a hand.
inline constexpr int kSkinParts = 6;
/// Part of the skin around a bone: 0-4 = thumb to little finger without the metacarpals, 5 = palm and wrist.
int skin_part(Body body);
/// Flexible object i is the part kFirstSoftPart + i. Before it come the parts of the hands, hand by hand.
inline constexpr int kFirstSoftPart = kMostHands * kSkinParts;
/// Part of the skin of a node or contact point with this `node_body`.
int skin_part(std::uint8_t node_body);
/// The hand, or kMostHands + i for flexible object i.
constexpr int skin_owner(int part) {
  return part < kFirstSoftPart ? part / kSkinParts : kMostHands + part - kFirstSoftPart;
}

class SkinPatches {
 public:
  /// m, along the edges of the surface at rest.
  static constexpr double near_at_rest = 0.030;
  /// m; skin that is deeper than this in another part is not pushed out.
  static constexpr double deepest = 0.012;

  /// `points`: of the same model; only the first `count()` are used.
  SkinPatches(const TissueModel& model, const ContactPoints& points);

  struct Patch {
    int part = 0;
    std::vector<std::int32_t> triangles, points;
    std::vector<std::int32_t> nodes;  // of the triangles and of the points
  };
  const std::vector<Patch>& patches() const { return patches_; }
  int part_count() const { return static_cast<int>(of_part_.size()); }
  /// Whether the patches belong to different parts and are not near at rest.
  bool can_touch(int a, int b) const {
    return can_touch_[static_cast<std::size_t>(a) * patches_.size() + static_cast<std::size_t>(b)] != 0;
  }
  int patch_of_point(int point) const { return patch_of_point_[static_cast<std::size_t>(point)]; }
  int patch_of_triangle(int triangle) const { return patch_of_triangle_[static_cast<std::size_t>(triangle)]; }
  /// The node of the point that gives it its patch, and the triangles around a node of the surface.
  std::int32_t node_of_point(int point) const { return node_of_point_[static_cast<std::size_t>(point)]; }
  std::span<const std::int32_t> triangles_around(std::int32_t node) const {
    return around_[static_cast<std::size_t>(node)];
  }

  /// Lists the pairs of patches that can touch and whose bounding boxes come within `margin` m of each other. One query
  /// for each pair of parts. Does not allocate.
  void find_near(const Eigen::Matrix3Xd& positions, double margin);
  /// Bounds the paths of the nodes from `starts` to `ends`. Returns the pairs of the last `find_near` that come within
  /// `margin` m of each other, always in the same order.
  std::span<const std::pair<std::int32_t, std::int32_t>> meet(const Eigen::Matrix3Xd& starts,
                                                              const Eigen::Matrix3Xd& ends, double margin);
  /// The patches in these pairs, each once.
  std::span<const std::int32_t> overlapping_patches() const { return overlapping_patches_; }
  /// Whether a place comes within `margin` m of the paths of an overlapping patch. The patch is in a box, and in a slab
  /// between two planes across its mean normal.
  bool is_near(const Vector3& place, int patch, double margin) const {
    const Slab& slab = slabs_[static_cast<std::size_t>(patch)];
    const double height = slab.normal.dot(place);
    return height >= slab.low - margin && height <= slab.high + margin &&
           boxes_[static_cast<std::size_t>(patch)].squaredExteriorDistance(place) <= margin * margin;
  }
  /// Queries of pairs of parts since construction.
  std::uint64_t part_queries() const { return part_queries_; }

 private:
  bool parts_can_touch(int a, int b) const { return a != b && (!several_owners_ || skin_owner(a) != skin_owner(b)); }
  void divide(const TissueModel& model);
  void assign_points(const TissueModel& model, const ContactPoints& points);
  void exclude_near_at_rest(const TissueModel& model, const ContactPoints& points);
  void bound_box(std::size_t patch, const Eigen::Matrix3Xd& starts, const Eigen::Matrix3Xd& ends);
  void bound_slab(std::size_t patch, const Eigen::Matrix3Xd& starts, const Eigen::Matrix3Xd& ends);

  bool several_owners_ = false;
  std::vector<std::array<std::int32_t, 3>> triangles_;
  std::vector<Patch> patches_;
  std::vector<std::int32_t> patch_of_node_;  // -1: not on the surface
  std::vector<std::int32_t> patch_of_triangle_, patch_of_point_, node_of_point_;
  std::vector<std::vector<std::int32_t>> around_;  // by node
  std::vector<std::uint8_t> can_touch_;            // by (patch, patch)
  std::vector<std::vector<int>> of_part_;          // the patches of a part
  std::vector<Eigen::AlignedBox3d> boxes_;
  std::vector<Eigen::AlignedBox3d> part_boxes_;
  struct Slab {
    Vector3 normal = Vector3::Zero();
    double low = 0, high = 0;
  };
  std::vector<Slab> slabs_;  // by patch
  std::vector<std::pair<std::int32_t, std::int32_t>> near_, overlapping_;
  std::vector<std::int32_t> near_patches_, overlapping_patches_;  // each once
  std::vector<std::uint8_t> is_near_, is_overlapping_;            // by patch
  std::uint64_t part_queries_ = 0;
};

}  // namespace softhand
