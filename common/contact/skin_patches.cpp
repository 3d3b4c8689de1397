#include "contact/skin_patches.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "contact/skin_frame.hpp"
#include "geometry/surface_distance.hpp"
#include "geometry/triangle.hpp"
#include "math/index.hpp"

namespace softhand {
namespace {

constexpr double kPatchRadius = 0.008;  // m, along the skin
constexpr double kFar = std::numeric_limits<double>::infinity();

int part_of_node(const TissueModel& model, std::int32_t node) { return skin_part(model.node_body[at(node)]); }

// The corner whose part the triangle has: a part that two corners share comes first.
std::int32_t leading_corner(const TissueModel& model, const std::array<std::int32_t, 3>& corners) {
  const int b = part_of_node(model, corners[1]);
  return b == part_of_node(model, corners[2]) ? corners[1] : corners[0];
}

}  // namespace

int skin_part(Body body) {
  return is_metacarpal(body) ? static_cast<int>(Finger::palm) : static_cast<int>(finger_of(body));
}

int skin_part(std::uint8_t node_body) {
  if (node_body >= kMostHands * kBodyCount) return kFirstSoftPart + node_body - kMostHands * kBodyCount;
  return node_body / kBodyCount * kSkinParts + skin_part(static_cast<Body>(node_body % kBodyCount));
}

SkinPatches::SkinPatches(const TissueModel& model, const ContactPoints& points) : triangles_(model.surface) {
  int parts = kSkinParts;
  for (const std::uint8_t body : model.node_body) parts = std::max(parts, skin_part(body) + 1);
  of_part_.resize(static_cast<std::size_t>(parts));
  part_boxes_.resize(of_part_.size());
  divide(model);
  several_owners_ = std::any_of(patches_.begin(), patches_.end(), [this](const Patch& patch) {
    return skin_owner(patch.part) != skin_owner(patches_.front().part);
  });
  assign_points(model, points);
  for (Patch& patch : patches_) {
    for (const std::int32_t triangle : patch.triangles) {
      const auto& corners = model.surface[at(triangle)];
      patch.nodes.insert(patch.nodes.end(), corners.begin(), corners.end());
    }
    for (const std::int32_t point : patch.points) {
      const auto nodes = points.nodes(point);
      patch.nodes.insert(patch.nodes.end(), nodes.begin(), nodes.end());
    }
    std::sort(patch.nodes.begin(), patch.nodes.end());
    patch.nodes.erase(std::unique(patch.nodes.begin(), patch.nodes.end()), patch.nodes.end());
  }
  boxes_.resize(patches_.size());
  slabs_.resize(patches_.size());
  is_near_.assign(patches_.size(), 0);
  is_overlapping_.assign(patches_.size(), 0);
  near_patches_.reserve(patches_.size());
  overlapping_patches_.reserve(patches_.size());
  exclude_near_at_rest(model, points);
  near_.reserve(static_cast<std::size_t>(std::count(can_touch_.begin(), can_touch_.end(), std::uint8_t{1})) / 2);
  overlapping_.reserve(near_.capacity());
}

// Each new patch begins at the node of the part that is farthest from all patches so far.
void SkinPatches::divide(const TissueModel& model) {
  const SurfaceDistance surface(model.nodes, model.surface);
  patch_of_node_.assign(model.nodes.size(), -1);
  std::vector<std::uint8_t> is_skin(model.nodes.size(), 0);
  for (const auto& corners : model.surface) {
    for (const std::int32_t node : corners) is_skin[at(node)] = 1;
  }
  std::vector<double> distance(model.nodes.size(), kFar);
  for (int part = 0; part < part_count(); ++part) {
    std::vector<std::int32_t> nodes;
    for (std::int32_t n = 0; n < model.node_count(); ++n) {
      if (is_skin[at(n)] != 0 && part_of_node(model, n) == part) nodes.push_back(n);
    }
    while (!nodes.empty()) {
      const std::int32_t seed = *std::max_element(nodes.begin(), nodes.end(), [&](std::int32_t a, std::int32_t b) {
        return distance[at(a)] < distance[at(b)];
      });
      if (distance[at(seed)] < kPatchRadius) break;
      const auto patch = static_cast<std::int32_t>(patches_.size());
      patches_.push_back({part, {}, {}, {}});
      of_part_[static_cast<std::size_t>(part)].push_back(patch);
      surface.spread(
          std::array{seed}, kFar, distance, [&](std::int32_t node) { return part_of_node(model, node) == part; },
          [&](std::int32_t node) { patch_of_node_[at(node)] = patch; });
    }
  }
  for (const auto& corners : model.surface) {
    const std::int32_t patch = patch_of_node_[at(leading_corner(model, corners))];
    patches_[at(patch)].triangles.push_back(static_cast<std::int32_t>(patch_of_triangle_.size()));
    patch_of_triangle_.push_back(patch);
  }
}

// A point belongs to the patch of one of its nodes: the nearest one of its part, or the nearest one of another part. On
// a coarse mesh other nodes of its part may be nearer, but far along the skin. Then the point would touch its own
// triangle.
void SkinPatches::assign_points(const TissueModel& model, const ContactPoints& points) {
  Eigen::Matrix3Xd rest(3, model.node_count());
  for (std::int32_t n = 0; n < model.node_count(); ++n) rest.col(n) = model.nodes[at(n)];
  around_.resize(model.nodes.size());
  for (std::size_t t = 0; t < model.surface.size(); ++t) {
    for (const std::int32_t node : model.surface[t]) around_[at(node)].push_back(static_cast<std::int32_t>(t));
  }
  for (int i = 0; i < points.count(); ++i) {
    const Vector3 place = points.at(i, rest);
    const int part = skin_part(points[i].body);
    std::int32_t best = -1;
    const auto rank = [&](std::int32_t n) {
      return std::pair(part_of_node(model, n) != part, (model.nodes[at(n)] - place).squaredNorm());
    };
    const auto consider = [&](std::int32_t n) {
      if (patch_of_node_[at(n)] >= 0 && (best < 0 || rank(n) < rank(best))) best = n;
    };
    std::ranges::for_each(points.nodes(i), consider);
    if (best < 0) {  // all nodes of the point are inside the tissue
      for (std::int32_t n = 0; n < model.node_count(); ++n) consider(n);
    }
    patch_of_point_.push_back(patch_of_node_[at(best)]);
    patches_[at(patch_of_point_.back())].points.push_back(i);
    node_of_point_.push_back(best);
  }
}

void SkinPatches::exclude_near_at_rest(const TissueModel& model, const ContactPoints& points) {
  const std::size_t count = patches_.size();
  can_touch_.assign(count * count, 0);
  const auto set = [&](std::size_t a, std::size_t b, std::uint8_t can) {
    can_touch_[a * count + b] = can_touch_[b * count + a] = can;
  };
  for (std::size_t a = 0; a < count; ++a) {
    for (std::size_t b = 0; b < a; ++b) set(a, b, parts_can_touch(patches_[a].part, patches_[b].part) ? 1 : 0);
  }
  // In a scene, owners do not keep the places that they have to each other at rest.
  if (several_owners_) return;
  const SurfaceDistance surface(model.nodes, model.surface);
  std::vector<double> distance(model.nodes.size());
  std::vector<std::int32_t> sources;
  for (std::size_t a = 0; a < count; ++a) {
    sources.clear();
    for (std::int32_t n = 0; n < model.node_count(); ++n) {
      if (patch_of_node_[at(n)] == static_cast<std::int32_t>(a)) sources.push_back(n);
    }
    std::fill(distance.begin(), distance.end(), kFar);
    surface.spread(
        sources, near_at_rest, distance, [](std::int32_t) { return true; },
        [&](std::int32_t node) { set(a, at(patch_of_node_[at(node)]), 0); });
  }
  // On a coarse mesh the edges of a triangle can be longer than that.
  for (const auto& corners : model.surface) {
    for (std::size_t k = 0; k < 3; ++k)
      set(at(patch_of_node_[at(corners[k])]), at(patch_of_node_[at(corners[(k + 1) % 3])]), 0);
  }
  // Pairs with a thin sheet of tissue between them.
  Eigen::Matrix3Xd rest(3, model.node_count());
  for (std::int32_t n = 0; n < model.node_count(); ++n) rest.col(n) = model.nodes[at(n)];
  const auto frame_of = [&](std::int32_t triangle) {
    const auto& corners = model.surface[at(triangle)];
    return SkinFrame(rest.col(corners[0]), rest.col(corners[1]), rest.col(corners[2]));
  };
  for (std::size_t p = 0; p < count; ++p) {
    bound_box(p, rest, rest);
    bound_slab(p, rest, rest);
  }
  for (int point = 0; point < points.count(); ++point) {
    const auto own = at(patch_of_point_[at(point)]);
    const Vector3 place = points.at(point, rest);
    Vector3 outward = Vector3::Zero();
    for (const std::int32_t triangle : triangles_around(node_of_point(point))) outward += frame_of(triangle).n;
    for (std::size_t other = 0; other < count; ++other) {
      if (can_touch_[own * count + other] == 0 || !is_near(place, static_cast<int>(other), deepest)) continue;
      for (const std::int32_t triangle : patches_[other].triangles) {
        const SkinFrame frame = frame_of(triangle);
        const double height = frame.n.dot(place - frame.pose.position);
        const auto& corners = model.surface[at(triangle)];
        const TrianglePoint there =
            nearest_on_triangle(place, rest.col(corners[0]), rest.col(corners[1]), rest.col(corners[2]));
        if (height < 0 && outward.dot(frame.n) < 0 && (there.point - place).norm() < deepest) set(own, other, 0);
      }
    }
  }
}

void SkinPatches::bound_box(std::size_t patch, const Eigen::Matrix3Xd& starts, const Eigen::Matrix3Xd& ends) {
  Eigen::AlignedBox3d& box = boxes_[patch];
  box.setEmpty();
  for (const std::int32_t node : patches_[patch].nodes) {
    box.extend(Vector3(starts.col(node)));
    box.extend(Vector3(ends.col(node)));
  }
}

void SkinPatches::bound_slab(std::size_t patch, const Eigen::Matrix3Xd& starts, const Eigen::Matrix3Xd& ends) {
  Slab& slab = slabs_[patch];
  slab.normal.setZero();
  for (const std::int32_t triangle : patches_[patch].triangles) {
    const auto& c = triangles_[at(triangle)];
    const Vector3 a = starts.col(c[0]);
    slab.normal += (starts.col(c[1]) - a).cross(starts.col(c[2]) - a);
  }
  slab.normal.normalize();
  slab.low = kFar;
  slab.high = -kFar;
  for (const std::int32_t node : patches_[patch].nodes) {
    const double start = slab.normal.dot(starts.col(node)), end = slab.normal.dot(ends.col(node));
    slab.low = std::min({slab.low, start, end});
    slab.high = std::max({slab.high, start, end});
  }
}

std::span<const std::pair<std::int32_t, std::int32_t>> SkinPatches::meet(const Eigen::Matrix3Xd& starts,
                                                                         const Eigen::Matrix3Xd& ends, double margin) {
  for (const std::int32_t patch : near_patches_) bound_box(at(patch), starts, ends);
  for (const std::int32_t patch : overlapping_patches_) is_overlapping_[at(patch)] = 0;
  overlapping_.clear();
  overlapping_patches_.clear();
  for (const auto& [a, b] : near_) {
    if (!(boxes_[at(a)].squaredExteriorDistance(boxes_[at(b)]) <= margin * margin)) continue;
    overlapping_.emplace_back(a, b);
    for (const std::int32_t patch : {a, b}) {
      if (std::exchange(is_overlapping_[at(patch)], std::uint8_t{1}) != 0) continue;
      overlapping_patches_.push_back(patch);
      bound_slab(at(patch), starts, ends);
    }
  }
  return overlapping_;
}

void SkinPatches::find_near(const Eigen::Matrix3Xd& positions, double margin) {
  for (Eigen::AlignedBox3d& box : part_boxes_) box.setEmpty();
  for (std::size_t p = 0; p < patches_.size(); ++p) {
    boxes_[p].setEmpty();
    for (const std::int32_t node : patches_[p].nodes) boxes_[p].extend(Vector3(positions.col(node)));
    part_boxes_[static_cast<std::size_t>(patches_[p].part)].extend(boxes_[p]);
  }
  near_.clear();
  for (const std::int32_t patch : near_patches_) is_near_[at(patch)] = 0;
  near_patches_.clear();
  const double square = margin * margin;
  for (std::size_t a = 1; a < of_part_.size(); ++a) {
    for (std::size_t b = 0; b < a; ++b) {
      if (of_part_[a].empty() || of_part_[b].empty()) continue;
      if (!parts_can_touch(static_cast<int>(a), static_cast<int>(b))) continue;
      ++part_queries_;
      if (!(part_boxes_[a].squaredExteriorDistance(part_boxes_[b]) <= square)) continue;
      for (const int i : of_part_[a]) {
        const Eigen::AlignedBox3d& box = boxes_[at(i)];
        if (!(box.squaredExteriorDistance(part_boxes_[b]) <= square)) continue;
        for (const int j : of_part_[b]) {
          if (!can_touch(i, j) || !(box.squaredExteriorDistance(boxes_[at(j)]) <= square)) continue;
          near_.emplace_back(i, j);
          for (const int patch : {i, j}) {
            if (std::exchange(is_near_[at(patch)], std::uint8_t{1}) == 0) near_patches_.push_back(patch);
          }
        }
      }
    }
  }
}

}  // namespace softhand
