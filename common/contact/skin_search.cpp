#include "contact/skin_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "geometry/triangle.hpp"
#include "math/rotation.hpp"

namespace softhand {
namespace {

constexpr double kSlack = 1e-4;   // m; patches and points that come so near are searched
constexpr double kRoom = 1e-3;    // m; so far nodes may move before the near patches are listed again
constexpr double kEdge = 1e-6;    // relative; a place this far outside a triangle is still on it
constexpr double kFacing = 0.25;  // cosine between the normals of skin that faces a triangle, with the opposite sign
// Squared heights whose ratio is larger than this differ, whatever the rounding. So the cheap test of a height leaves
// out no triangle that the exact one accepts.
constexpr double kClearlyFarther = 1 + 1e-6;
constexpr int kMostHops = 8;  // of an anchor from triangle to triangle

}  // namespace

SkinSearch::SkinSearch(const TissueModel& model, const ContactPoints& points)
    : points_(&points), triangles_(model.surface), first_neighbour_{0}, patches_(model, points) {
  std::vector<std::vector<std::int32_t>> around(model.nodes.size());
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    for (const std::int32_t node : triangles_[t])
      around[static_cast<std::size_t>(node)].push_back(static_cast<std::int32_t>(t));
  }
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    const auto begin = static_cast<std::ptrdiff_t>(neighbours_.size());
    for (const std::int32_t node : triangles_[t]) {
      for (const std::int32_t other : around[static_cast<std::size_t>(node)]) {
        if (other != static_cast<std::int32_t>(t)) neighbours_.push_back(other);
      }
    }
    std::sort(neighbours_.begin() + begin, neighbours_.end());
    neighbours_.erase(std::unique(neighbours_.begin() + begin, neighbours_.end()), neighbours_.end());
    first_neighbour_.push_back(neighbours_.size());
  }
  for (const SkinPatches::Patch& patch : patches_.patches())
    skin_nodes_.insert(skin_nodes_.end(), patch.nodes.begin(), patch.nodes.end());
  std::sort(skin_nodes_.begin(), skin_nodes_.end());
  skin_nodes_.erase(std::unique(skin_nodes_.begin(), skin_nodes_.end()), skin_nodes_.end());
  const int owner =
      skin_nodes_.empty() ? 0 : skin_owner(skin_part(model.node_body[static_cast<std::size_t>(skin_nodes_.front())]));
  carpus_ = static_cast<std::size_t>((owner < kMostHands ? owner * kBodyCount : 0) + index_of(Body::carpus));
  starts_ = ends_ = local_starts_ = local_ends_ = listed_ = Eigen::Matrix3Xd::Zero(3, model.node_count());
  const auto places = static_cast<std::size_t>(points.count()) * static_cast<std::size_t>(patches_.part_count());
  paths_.resize(static_cast<std::size_t>(points.count()));
  start_sides_.resize(triangles_.size());
  end_sides_.resize(triangles_.size());
  candidates_.reserve(places);
  candidate_of_.assign(places, -1);
}

void SkinSearch::keep(const SkinCandidate& candidate, int part) {
  std::int32_t& place = candidate_of_[place_of(candidate.point, part)];
  if (place < 0) {
    place = static_cast<std::int32_t>(candidates_.size());
    candidates_.push_back(candidate);
    return;
  }
  SkinCandidate& other = candidates_[static_cast<std::size_t>(place)];
  const auto rank = [](const SkinCandidate& m) {
    return m.recess > 0 ? m.recess - SkinPatches::deepest : m.crossed_at;
  };
  if (rank(candidate) < rank(other)) other = candidate;
}

void SkinSearch::set_local(const Pose& carpus, const Eigen::Matrix3Xd& positions, Eigen::Matrix3Xd& local) const {
  const Matrix3 turn = carpus.orientation.toRotationMatrix().transpose();
  for (const std::int32_t n : skin_nodes_) local.col(n) = turn * (positions.col(n) - carpus.position);
}

void SkinSearch::begin_step(const State& state, double time_step, double reach) {
  starts_ = state.node_positions.leftCols(starts_.cols());
  ends_ = starts_ + time_step * state.node_velocities.leftCols(starts_.cols());
  const bool has_carpus = state.body_poses.size() > carpus_;
  const Pose start = has_carpus ? state.body_poses[carpus_] : Pose{};
  set_local(start, starts_, local_starts_);
  set_local(has_carpus ? advanced(start, state.body_velocities[carpus_], time_step) : start, ends_, local_ends_);
  reach_ = reach;
  follow_paths(std::max(kSlack, reach));
}

void SkinSearch::set_ends(const State& state) {
  ends_ = state.node_positions.leftCols(ends_.cols());
  set_local(state.body_poses.size() > carpus_ ? state.body_poses[carpus_] : Pose{}, ends_, local_ends_);
  follow_paths(kSlack);
}

// Bounds the paths in the list of near patches. Nodes that have moved far may have brought other pairs of patches
// within `margin`. Then the patches are listed again.
void SkinSearch::follow_paths(double margin) {
  margin_ = margin;
  double square = 0, longest = 0;
  for (const std::int32_t n : skin_nodes_) {
    square = std::max({square, (local_starts_.col(n) - listed_.col(n)).squaredNorm(),
                       (local_ends_.col(n) - listed_.col(n)).squaredNorm()});
    longest = std::max(longest, (local_ends_.col(n) - local_starts_.col(n)).squaredNorm());
  }
  const double room = 0.5 * (listed_margin_ - margin), wanted = margin + 2 * (std::sqrt(longest) + kRoom);
  // A list that was made for fast motion is long.
  if (!(room >= 0 && square <= room * room) || listed_margin_ > 2 * wanted) {
    listed_ = local_starts_;
    listed_margin_ = wanted;
    patches_.find_near(listed_, listed_margin_);
  }
  pairs_ = patches_.meet(local_starts_, local_ends_, margin);
  for (const std::int32_t patch : patches_.overlapping_patches()) {
    const SkinPatches::Patch& own = patches_.patches()[static_cast<std::size_t>(patch)];
    for (const std::int32_t point : own.points) {
      const Vector3 start = points_->at(point, local_starts_), end = points_->at(point, local_ends_);
      paths_[static_cast<std::size_t>(point)] = {0.5 * (start + end), 0.5 * (end - start).norm()};
    }
    for (const std::int32_t triangle : own.triangles) {
      start_sides_[static_cast<std::size_t>(triangle)] = side(triangle, starts_);
      end_sides_[static_cast<std::size_t>(triangle)] = side(triangle, ends_);
    }
  }
}

std::optional<SkinCandidate> SkinSearch::inside(int patch, int point) const {
  const Vector3 place = points_->at(point, starts_);
  std::optional<SkinCandidate> result;
  double least = reach_;
  for (const std::int32_t triangle : patches_.patches()[static_cast<std::size_t>(patch)].triangles) {
    const Side& side = start_sides_[static_cast<std::size_t>(triangle)];
    const double volume = side.signed_volume(place);
    if (!(volume < 0)) continue;
    const double square = std::max(side.across.squaredNorm(), SkinPlane::kLeastTwiceArea * SkinPlane::kLeastTwiceArea);
    if (volume * volume > kClearlyFarther * least * least * square) continue;
    const SkinPlane there = plane(triangle, starts_);
    const double height = there.n.dot(place - there.middle);
    if (-height >= least || there.weights(place).minCoeff() < -kEdge) continue;
    least = -height;
    result = SkinCandidate{point, triangle, frame(triangle, starts_).pose.inverse() * place, least};
  }
  if (result) {
    Vector3 outward = Vector3::Zero();
    for (const std::int32_t triangle : patches_.triangles_around(patches_.node_of_point(point)))
      outward += plane(triangle, starts_).n;
    result->faces = outward.dot(plane(result->triangle, starts_).n) < -kFacing * outward.norm();
  }
  return result;
}

std::optional<SkinCandidate> SkinSearch::crossed(int patch, int point) const {
  const Vector3 start = points_->at(point, starts_), end = points_->at(point, ends_);
  std::optional<SkinCandidate> result;
  double first = std::numeric_limits<double>::infinity();
  for (const std::int32_t triangle : patches_.patches()[static_cast<std::size_t>(patch)].triangles) {
    if (!(start_sides_[static_cast<std::size_t>(triangle)].signed_volume(start) >= 0) ||
        !(end_sides_[static_cast<std::size_t>(triangle)].signed_volume(end) < 0))
      continue;
    const SkinFrame before = frame(triangle, starts_), after = frame(triangle, ends_);
    const double from = std::max(0.0, before.n.dot(start - before.pose.position));
    const double to = after.n.dot(end - after.pose.position);
    const double part = from - to > 0 ? from / (from - to) : 0.0;
    if (part >= first) continue;
    const Vector3 weights = (1 - part) * before.weights(start) + part * after.weights(end);
    if (weights.minCoeff() < -kEdge) continue;
    first = part;
    const auto& c = corners(triangle);
    const Vector3 place =
        weights[0] * starts_.col(c[0]) + weights[1] * starts_.col(c[1]) + weights[2] * starts_.col(c[2]);
    result = SkinCandidate{point, triangle, before.pose.inverse() * place, 0, false, part};
  }
  return result;
}

// A point that went round a corner of the skin is far behind the triangle that it crossed. It is just behind or in
// front of the next one. Moves the candidate to that triangle. Returns false if the point is outside there.
bool SkinSearch::turns_corner(SkinCandidate& candidate) const {
  const Vector3 end = points_->at(candidate.point, ends_);
  const SkinFrame crossed = frame(candidate.triangle, ends_);
  const Place nearest = follow(candidate.triangle, crossed.pose.inverse() * end, ends_);
  if (nearest.triangle == candidate.triangle) return true;
  const SkinFrame there = frame(nearest.triangle, ends_);
  // The skin on the far side of a finger does not count: the point passed through the finger.
  if (!(there.n.dot(crossed.n) > kFacing)) return true;
  if (part_of_triangle(nearest.triangle) != part_of_triangle(candidate.triangle)) return true;
  candidate.triangle = nearest.triangle;
  candidate.place = nearest.place;
  return there.n.dot(end - there.pose.position) < 0;
}

SkinSearch::Place SkinSearch::follow(int triangle, const Vector3& place, const Eigen::Matrix3Xd& node_positions) const {
  const Vector3 target = frame(triangle, node_positions).pose * place;
  const auto nearest_on = [&](int t) {
    const auto& c = corners(t);
    return nearest_on_triangle(target, node_positions.col(c[0]), node_positions.col(c[1]), node_positions.col(c[2]))
        .point;
  };
  Vector3 best = nearest_on(triangle);
  for (int hop = 0; hop < kMostHops; ++hop) {
    const int from = triangle;
    for (std::size_t k = first_neighbour_[static_cast<std::size_t>(from)];
         k < first_neighbour_[static_cast<std::size_t>(from) + 1]; ++k) {
      const Vector3 there = nearest_on(neighbours_[k]);
      if ((there - target).squaredNorm() >= (best - target).squaredNorm() * (1 - kEdge)) continue;
      best = there;
      triangle = neighbours_[k];
    }
    if (triangle == from) break;
  }
  return {triangle, frame(triangle, node_positions).pose.inverse() * best};
}

}  // namespace softhand
