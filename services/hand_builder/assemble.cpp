#include "hand_builder/assemble.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>

#include "geometry/mesh_distance.hpp"
#include "hand_builder/contact_samples.hpp"

namespace softhand::builder {
namespace {

// N/m per cubic metre of bone inside a tetrahedron. A phalanx (0.4-2 cm^3) is attached with 4e4 to 2e5 N/m in total.
// This is a hundred times stiffer than the surrounding tissue. A value a hundred times stiffer would spoil the
// conditioning of the step.
constexpr double kAttachmentStiffness = 1e11;

enum Region : std::uint8_t { pulp, palm, back, knuckle };

std::vector<Material> make_materials(std::size_t nodes) {
  // The energy limit is W_max = E e^2 / 2 at the strain e at which limiting starts.
  // The limiting stiffness is k_s = ratio * W_max, which multiplies the stiffness at the kink by 1 + 2 ratio.
  // Only the pulp does not bend with a joint. It has the stiffness of skin, fitted to people's fingertips
  // (docs/human-data.md). Elsewhere softer tetrahedra represent skin that folds and slides. Limiting from 30 % strain
  // spreads the stretch over a knuckle to the neighbouring tissue and prevents inversion in creases. With the ramp a
  // default step needs fewer iterations (docs/performance.md).
  constexpr double kRamp = 0.25;
  const auto material = [](const char* name, double youngs_modulus, double poisson_ratio, double strain, double ratio) {
    const double energy = 0.5 * youngs_modulus * strain * strain;
    return Material{name, 1050, youngs_modulus, poisson_ratio, energy, ratio * energy, kRamp};
  };
  // Coarse linear tetrahedra are too stiff, so the moduli fall with the number of nodes.
  const double fineness = std::sqrt(static_cast<double>(nodes) / 1450), coarseness = std::min(fineness, 1.0);
  return {material("pulp", 18e3 * fineness, 0.45, 0.17, 4), material("palm", 2e4 * coarseness, 0.40, 0.35, 2),
          material("back", 8e3 * coarseness, 0.35, 0.30, 2), material("knuckle", 1e4 * coarseness, 0.35, 0.30, 2)};
}

struct Bones {
  std::array<Pose, kBodyCount> joints;
  const std::array<BodyModel, kBodyCount>* bodies;

  Bones(const RestSkeleton& rest, const std::array<BodyModel, kBodyCount>& of_hand) : bodies(&of_hand) {
    for (std::size_t b = 0; b < kBodyCount; ++b)
      joints[b] = rest.joints[static_cast<std::size_t>(index_of(joint_of(static_cast<Body>(b))))];
  }
  double distance(std::size_t b, const Vector3& point) const {
    const BodyModel& body = (*bodies)[b];
    return rounded_cone_distance(joints[b].inverse() * point, body.bone_start, body.bone_end, body.bone_start_radius,
                                 body.bone_end_radius);
  }
  std::size_t nearest(const Vector3& point) const {
    std::size_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const double d = distance(b, point);
      if (d < least) {
        least = d;
        best = b;
      }
    }
    return best;
  }
};

bool is_phalanx(Body body) { return finger_of(body) != Finger::palm && !is_metacarpal(body); }

std::uint8_t region_of(const RestSkeleton& rest, const Bones& bones, const Vector3& point) {
  const auto b = bones.nearest(point);
  const Body body = static_cast<Body>(b);
  const Vector3 local = bones.joints[b].inverse() * point;
  const BodyModel& model = (*bones.bodies)[b];
  const double bone_height = 0.5 * (model.bone_start.y() + model.bone_end.y());
  const bool palmar = local.y() < bone_height + 0.3 * model.bone_end_radius;
  if (is_phalanx(body) && body == distal_of(finger_of(body)) && (palmar || local.z() < model.bone_end.z())) return pulp;
  if (palmar) return palm;
  // The dorsal skin over MCP, PIP and DIP is attached tightly.
  for (std::size_t j = 3; j < kJointCount; ++j) {
    const Joint joint = static_cast<Joint>(j);
    const bool knuckle_joint = joint_of(body_of(joint)) == joint && !is_metacarpal(body_of(joint));
    if (knuckle_joint && (rest.joints[j].position - point).norm() < 1.2 * rest.radii[j]) return knuckle;
  }
  return back;
}

// Finds the tetrahedron that contains a point with a uniform grid of bounding boxes.
class Locator {
 public:
  Locator(const std::vector<Vector3>& nodes, const std::vector<std::array<std::int32_t, 4>>& tetrahedra)
      : nodes_(nodes), tetrahedra_(tetrahedra) {
    inverse_.reserve(tetrahedra.size());
    for (std::size_t t = 0; t < tetrahedra.size(); ++t) {
      const auto x = [&](std::size_t k) { return nodes[static_cast<std::size_t>(tetrahedra[t][k])]; };
      Matrix3 edges;
      edges << x(1) - x(0), x(2) - x(0), x(3) - x(0);
      inverse_.push_back(edges.inverse());
      const Vector3 low = x(0).cwiseMin(x(1)).cwiseMin(x(2)).cwiseMin(x(3));
      const Vector3 high = x(0).cwiseMax(x(1)).cwiseMax(x(2)).cwiseMax(x(3));
      const auto a = cell_of(low), b = cell_of(high);
      for (int i = a[0] - 1; i <= b[0] + 1; ++i) {
        for (int j = a[1] - 1; j <= b[1] + 1; ++j) {
          for (int k = a[2] - 1; k <= b[2] + 1; ++k) cells_[{i, j, k}].push_back(static_cast<std::int32_t>(t));
        }
      }
    }
  }

  /// Returns the tetrahedron in which the smallest weight of the point is largest. This is the tetrahedron that
  /// contains the point, or the nearest one. Returns -1 if none is near.
  std::int32_t find(const Vector3& point, std::array<double, 4>& weights) const {
    const auto found = cells_.find(cell_of(point));
    if (found == cells_.end()) return -1;
    std::int32_t best = -1;
    double least = -std::numeric_limits<double>::infinity();
    for (const std::int32_t t : found->second) {
      const auto w = weights_in(t, point);
      const double smallest = *std::min_element(w.begin(), w.end());
      if (smallest > least) {
        least = smallest;
        best = t;
        weights = w;
      }
    }
    return best;
  }

  std::array<double, 4> weights_in(std::int32_t t, const Vector3& point) const {
    const Vector3 w = inverse_[static_cast<std::size_t>(t)] *
                      (point - nodes_[static_cast<std::size_t>(tetrahedra_[static_cast<std::size_t>(t)][0])]);
    return {1 - w.sum(), w.x(), w.y(), w.z()};
  }

 private:
  static constexpr double kCell = 0.005;
  static std::array<int, 3> cell_of(const Vector3& p) {
    return {static_cast<int>(std::floor(p.x() / kCell)), static_cast<int>(std::floor(p.y() / kCell)),
            static_cast<int>(std::floor(p.z() / kCell))};
  }
  const std::vector<Vector3>& nodes_;
  const std::vector<std::array<std::int32_t, 4>>& tetrahedra_;
  std::vector<Matrix3> inverse_;
  std::map<std::array<int, 3>, std::vector<std::int32_t>> cells_;
};

// Around a moving joint the tissue slides on the bones. If it were attached to both bones, it would be torn, and the
// stretch of the skin over the knuckle could not spread. Returns spheres (centre in this body's frame, radius) in which
// the bone is not attached to tissue.
std::vector<std::pair<Vector3, double>> free_of_bone(const HandModel& hand, const Bones& bones, std::size_t b) {
  constexpr double kBoneRadii = 1.6;
  std::vector<std::pair<Vector3, double>> spheres;
  for (std::size_t c = 0; c < kBodyCount; ++c) {
    const JointKind kind = hand.bodies[c].joint.kind;
    if (kind != JointKind::hinge && kind != JointKind::saddle) continue;
    const Body child = static_cast<Body>(c);
    if (c != b && static_cast<std::size_t>(index_of(parent_of(child))) != b) continue;
    if (child == Body::thumb_metacarpal) continue;  // deep in the palm and with little rotation
    const double radius = c == b ? hand.bodies[b].bone_start_radius : hand.bodies[b].bone_end_radius;
    spheres.emplace_back(bones.joints[b].inverse() * bones.joints[c].position, kBoneRadii * radius);
  }
  return spheres;
}

void attach(HandModel& hand, const Bones& bones, const Locator& locator) {
  constexpr double kSample = 0.0007;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const BodyModel& body = hand.bodies[b];
    const auto bare = free_of_bone(hand, bones, b);
    const double reach = std::max(body.bone_start_radius, body.bone_end_radius);
    const Vector3 low = body.bone_start.cwiseMin(body.bone_end) - Vector3::Constant(reach);
    const Vector3 high = body.bone_start.cwiseMax(body.bone_end) + Vector3::Constant(reach);
    struct Part {
      Vector3 sum = Vector3::Zero();
      int samples = 0;
    };
    std::map<std::int32_t, Part> parts;
    const auto steps = [&](int k) { return static_cast<int>(std::ceil((high[k] - low[k]) / kSample)); };
    for (int i = 0; i < steps(0); ++i) {
      for (int j = 0; j < steps(1); ++j) {
        for (int k = 0; k < steps(2); ++k) {
          const Vector3 local = low + kSample * Vector3(i + 0.5, j + 0.5, k + 0.5);
          if (rounded_cone_distance(local, body.bone_start, body.bone_end, body.bone_start_radius,
                                    body.bone_end_radius) > 0)
            continue;
          if (std::any_of(bare.begin(), bare.end(),
                          [&local](const auto& sphere) { return (local - sphere.first).norm() < sphere.second; }))
            continue;
          const Vector3 point = bones.joints[b] * local;
          std::array<double, 4> weights{};
          const std::int32_t t = locator.find(point, weights);
          if (t < 0 || *std::min_element(weights.begin(), weights.end()) < -1e-9) continue;
          Part& part = parts[t];
          part.sum += point;
          ++part.samples;
        }
      }
    }
    for (const auto& [t, part] : parts) {
      const double volume = part.samples * kSample * kSample * kSample;
      hand.attachments.push_back({static_cast<std::int32_t>(b), t, locator.weights_in(t, part.sum / part.samples),
                                  kAttachmentStiffness * volume});
    }
  }
}

// Rounds weights as a hand file does, to 1e-4. None is negative, and the sum stays 1.
void round_weights(std::array<double, 4>& weights) {
  const auto largest = std::max_element(weights.begin(), weights.end());
  double rest = 1;
  for (auto w = weights.begin(); w != weights.end(); ++w) {
    if (w == largest) continue;
    *w = 1e-4 * std::max(0.0, std::round(1e4 * *w));
    rest -= *w;
  }
  *largest = rest;
}

}  // namespace

SizingField hand_sizing(const RestSkeleton& rest) {
  struct Piece {
    Vector3 a, b;
    double size;
    double radius = 0.007;  // m, around the line from a to b
  };
  std::vector<Piece> pieces;
  const auto joint_at = [&rest](Joint joint) -> const Pose& {
    return rest.joints[static_cast<std::size_t>(index_of(joint))];
  };
  for (int b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    const Joint joint = joint_of(body), end = end_joint_of(body);
    const bool digit = is_phalanx(body);
    const double to_tip = index_of(tip_of(digit ? finger_of(body) : Finger::thumb)) - index_of(joint);
    const double size = !digit ? (is_metacarpal(body) ? 2.4 : 3.2) : to_tip <= 1 ? 1.0 : to_tip <= 2 ? 1.4 : 1.65;
    const Vector3 start = body == Body::forearm ? Vector3(0, 0, rest.stump) : joint_at(joint).position;
    pieces.push_back({start, joint_at(end).position, size});
    if (!digit || to_tip > 1) continue;
    // The pulp, from the middle of the distal bone to the tip, between bone and skin. Its contact area and stiffness
    // matter most.
    const double depth = 0.6 * rest.radii[static_cast<std::size_t>(index_of(end))];
    const Vector3 palmar = -depth * (joint_at(joint).orientation * Vector3::UnitY());
    pieces.push_back(
        {0.6 * start + 0.4 * joint_at(end).position + palmar, joint_at(end).position + palmar, 0.55, 0.004});
  }
  // The webs: coarse facets would bridge the gap between two fingers.
  for (int j = index_of(Joint::index_proximal); j < index_of(Joint::little_proximal); j += 5) {
    const auto web = [&rest](int joint) {
      return Vector3(rest.joints[static_cast<std::size_t>(joint)] * Vector3(0, 0, -0.016));
    };
    const Vector3 middle = 0.5 * (web(j) + web(j + 5));
    pieces.push_back(
        {middle, middle + 0.008 * (web(j) - rest.joints[static_cast<std::size_t>(j)].position).normalized(), 0.9});
  }
  return [pieces](const Vector3& point) {
    double least = 3.6;
    for (const Piece& piece : pieces) {
      // In units of the common scale (about 4 mm): an edge may be half a scale longer every 10 mm.
      const double distance = rounded_cone_distance(point, piece.a, piece.b, piece.radius, piece.radius);
      least = std::min(least, piece.size + 50 * std::max(distance, 0.0));
    }
    return least;
  };
}

std::vector<Vector3> hand_seeds(const RestSkeleton& rest, const SkinShape& skin) {
  std::vector<Vector3> seeds;
  for (int f = 0; f < kFingerCount; ++f) {
    const int tip = index_of(tip_of(static_cast<Finger>(f)));
    const Pose& end = rest.joints[static_cast<std::size_t>(tip)];
    seeds.push_back(skin.project(end * Vector3(0, 0, -rest.radii[static_cast<std::size_t>(tip)])));
    // The middle line of the pad from the tip backwards, and its sides. It touches first in a pinch.
    const double radius = rest.radii[static_cast<std::size_t>(tip)];
    for (const double back : {-0.5, 0.5})
      seeds.push_back(skin.project(end * Vector3(0, -radius * std::cos(std::max(-back, 0.0)), radius * back)));
    for (const double side : {-0.6, 0.6}) seeds.push_back(skin.project(end * Vector3(radius * side, -radius, 0)));
    for (int j = f == 0 ? 3 : tip - 3; j < tip; ++j) {
      const Pose& joint = rest.joints[static_cast<std::size_t>(j)];
      const Vector3 middle = 0.5 * (joint.position + rest.joints[static_cast<std::size_t>(j + 1)].position);
      for (const double side : {1.0, -1.0})
        seeds.push_back(
            skin.project(middle + joint.orientation * Vector3(0, side * rest.radii[static_cast<std::size_t>(j)], 0)));
    }
  }
  return seeds;
}

HandModel assemble_hand(const RestSkeleton& rest, TetrahedralMesh mesh, const TriangleMesh& skin) {
  HandModel hand;
  hand.side = Side::right;
  hand.rest_joints = rest.joints;
  hand.joint_radii = rest.radii;
  hand.bodies = make_bodies(rest);
  const Bones bones(rest, hand.bodies);
  std::vector<int> digits;  // of the nodes
  for (const Vector3& node : mesh.nodes) {
    const auto body = static_cast<Body>(bones.nearest(node));
    hand.node_body.push_back(static_cast<std::uint8_t>(body));
    digits.push_back(is_phalanx(body) ? static_cast<int>(finger_of(body)) : -1);
  }
  remove_flat_ears(mesh, digits);
  hand.nodes = std::move(mesh.nodes);
  hand.tetrahedra = std::move(mesh.tetrahedra);
  hand.surface = std::move(mesh.surface);
  hand.materials = make_materials(hand.nodes.size());

  for (const auto& t : hand.tetrahedra) {
    Vector3 centre = Vector3::Zero();
    for (const std::int32_t n : t) centre += 0.25 * hand.nodes[static_cast<std::size_t>(n)];
    hand.tetrahedron_material.push_back(region_of(rest, bones, centre));
  }
  const Locator locator(hand.nodes, hand.tetrahedra);
  attach(hand, bones, locator);

  hand.skin_triangles = skin.triangles;
  for (const Vector3& vertex : skin.vertices) {
    SkinVertex embedded;
    std::array<double, 4> weights{};
    embedded.tetrahedron = locator.find(vertex, weights);
    if (embedded.tetrahedron < 0) throw std::runtime_error("skin: a vertex is more than 5 mm outside the tetrahedra");
    double sum = 0;
    for (double& w : weights) sum += w = std::clamp(w, -3.0, 4.0);
    for (std::size_t k = 0; k < 4; ++k) embedded.weights[k] = static_cast<float>(weights[k] / sum);
    hand.skin_vertices.push_back(embedded);
  }
  add_contact_points(hand, rest, skin);
  return hand;
}

void add_contact_points(HandModel& hand, const RestSkeleton& rest, const TriangleMesh& skin) {
  constexpr double kPulpSpacing = 0.0017, kSpacing = 0.004;  // m; the mean distance of neighbours is a fifth more
  const auto bodies = make_bodies(rest);
  const Bones bones(rest, bodies);
  const auto samples = sample_contacts(
      skin, [&](const Vector3& point) { return region_of(rest, bones, point) == pulp ? kPulpSpacing : kSpacing; });
  // As a hand file rounds them.
  std::vector<Vector3> nodes = hand.nodes;
  for (Vector3& node : nodes) node = 1e-7 * (1e7 * node).array().round().matrix();
  const Locator locator(nodes, hand.tetrahedra);
  const MeshDistance surface({nodes, hand.surface});
  hand.contact_points.clear();
  for (const ContactSample& sample : samples) {
    SkinPoint point;
    const Vector3 place = surface.nearest(sample.position).point;
    point.tetrahedron = locator.find(place, point.weights);
    round_weights(point.weights);
    point.area = sample.area;
    point.body = static_cast<std::uint8_t>(bones.nearest(sample.position));
    hand.contact_points.push_back(point);
  }
}

}  // namespace softhand::builder
