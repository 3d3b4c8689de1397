// Scales a hand to a user without remeshing. Each bone moves its surroundings with it, blended by distance.
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "math/rotation.hpp"
#include "math/tetrahedron.hpp"
#include "model/hand_model.hpp"
#include "model/kinematics.hpp"

namespace softhand {
namespace {

// Maps the surroundings of a bone from the old rest pose to the new one:
//
//   p -> new_origin + turn * S * (p - old_origin)
//
// S scales by `length` along the bone and by `thickness` across it. The map uses only the position and direction of
// bones. The rotation of their frames about the bone is a convention of the source.
struct BoneMap {
  Vector3 old_origin = Vector3::Zero();
  Vector3 new_origin = Vector3::Zero();
  Vector3 direction = -Vector3::UnitZ();  // of the old bone
  Quaternion turn = Quaternion::Identity();
  double length = 1;
  double thickness = 1;

  Vector3 operator()(const Vector3& rest) const {
    const Vector3 p = rest - old_origin;
    const Vector3 along = direction * direction.dot(p);
    return new_origin + turn * (length * along + thickness * (p - along));
  }
};

// Limits of the thickness ratio. The mesh was shown to stay valid within them.
constexpr double kThinnest = 0.85;
constexpr double kThickest = 1.15;

double finger_thickness(const std::array<double, kJointCount>& user, const std::array<double, kJointCount>& model,
                        std::size_t joint, std::size_t end) {
  double ratio = 0;
  int count = 0;
  for (const std::size_t j : {joint, end}) {
    if (user[j] > 0 && model[j] > 0) {
      ratio += user[j] / model[j];
      ++count;
    }
  }
  return count == 0 ? 1.0 : std::clamp(ratio / count, kThinnest, kThickest);
}

// Volume divided by the cube of the root mean square edge length. It is 0 for a flat tetrahedron, negative for an
// inverted one, and largest for a regular one.
double shape_quality(const std::array<std::int32_t, 4>& t, const std::vector<Vector3>& nodes) {
  const auto x = [&](std::size_t k) -> const Vector3& { return nodes[static_cast<std::size_t>(t[k])]; };
  double edges = 0;
  for (std::size_t a = 0; a < 4; ++a) {
    for (std::size_t b = a + 1; b < 4; ++b) edges += (x(a) - x(b)).squaredNorm();
  }
  return tetrahedron_volume(nodes, t) / std::pow(edges / 6, 1.5);
}

// Smooths the displacements of neighbouring nodes. The first passes smooth a little everywhere. Later passes smooth
// only near tetrahedra that have lost most of their shape, where bones with different rotations meet (the web of the
// thumb). Neighbours that move alike keep the shape of their tetrahedra, so the passes end.
void smooth_displacements(const HandModel& hand, std::vector<Vector3>& nodes) {
  constexpr int kPassesEverywhere = 4;
  constexpr int kMostPasses = 500;
  constexpr double kLeastQualityRatio = 0.4;
  const std::size_t count = nodes.size();
  std::vector<std::vector<std::size_t>> neighbours(count);
  for (const auto& t : hand.tetrahedra) {
    for (const std::int32_t a : t) {
      for (const std::int32_t b : t) {
        if (a != b) neighbours[static_cast<std::size_t>(a)].push_back(static_cast<std::size_t>(b));
      }
    }
  }
  std::vector<Vector3> displacement(count), before(count);
  for (std::size_t n = 0; n < count; ++n) displacement[n] = nodes[n] - hand.nodes[n];
  std::vector<bool> chosen(count, true);
  for (int pass = 0; pass < kMostPasses; ++pass) {
    if (pass >= kPassesEverywhere) {
      std::fill(chosen.begin(), chosen.end(), false);
      bool any = false;
      for (std::size_t n = 0; n < count; ++n) nodes[n] = hand.nodes[n] + displacement[n];
      for (const auto& t : hand.tetrahedra) {
        if (shape_quality(t, nodes) >= kLeastQualityRatio * shape_quality(t, hand.nodes)) continue;
        any = true;
        Vector3 mean = Vector3::Zero();
        for (const std::int32_t a : t) mean += 0.25 * displacement[static_cast<std::size_t>(a)];
        for (const std::int32_t a : t) {
          displacement[static_cast<std::size_t>(a)] = 0.5 * (displacement[static_cast<std::size_t>(a)] + mean);
          chosen[static_cast<std::size_t>(a)] = true;
          for (const std::size_t b : neighbours[static_cast<std::size_t>(a)]) chosen[b] = true;
        }
      }
      if (!any) break;
    }
    before = displacement;
    for (std::size_t n = 0; n < count; ++n) {
      if (!chosen[n]) continue;
      Vector3 mean = Vector3::Zero();
      for (const std::size_t b : neighbours[n]) mean += before[b];
      displacement[n] = 0.5 * (before[n] + mean / static_cast<double>(neighbours[n].size()));
    }
  }
  for (std::size_t n = 0; n < count; ++n) nodes[n] = hand.nodes[n] + displacement[n];
}

// Rotates the joint's rest orientation (in its parent joint's frame) so that the measured angles have mean zero on all
// axes except flexion. Widens the ranges to the measured angles.
void fit_joint(const MeasuredSkeleton& user, std::size_t joint, Quaternion& rest, JointModel& model) {
  const bool holds_x = model.kind == JointKind::ball;
  const bool holds_y = model.kind == JointKind::ball || model.kind == JointKind::hinge;
  // Rotating the axes changes the angles only in second order, so a few passes are enough.
  for (int pass = 0; pass < 3; ++pass) {
    Vector3 mean = Vector3::Zero();
    for (const auto& frame : user.orientations) mean += rotation_log(rest.conjugate() * frame[joint]);
    mean /= static_cast<double>(user.orientations.size());
    rest = (rest * rotation_exp(Vector3(holds_x ? mean.x() : 0, mean.y(), mean.z()))).normalized();
  }
  for (const auto& frame : user.orientations) {
    const Vector3 angles = rotation_log(rest.conjugate() * frame[joint]);
    if (!holds_x)
      model.flexion_range = {std::min(model.flexion_range[0], angles.x()),
                             std::max(model.flexion_range[1], angles.x())};
    if (!holds_y)
      model.abduction_range = {std::min(model.abduction_range[0], angles.y()),
                               std::max(model.abduction_range[1], angles.y())};
  }
}

double distance_to_segment(const Vector3& p, const Vector3& a, const Vector3& b) {
  const Vector3 d = b - a;
  const double length = d.squaredNorm();
  const double t = length > 0 ? std::clamp((p - a).dot(d) / length, 0.0, 1.0) : 0.0;
  return (p - a - t * d).norm();
}

}  // namespace

MeasuredSkeleton measure_skeleton(std::span<const std::array<Pose, kJointCount>> frames,
                                  const std::array<double, kJointCount>& radii) {
  if (frames.empty()) throw std::invalid_argument("measure_skeleton: no frame with all joints valid");
  MeasuredSkeleton user;
  user.radii = radii;
  user.orientations.resize(frames.size());
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const std::size_t parent = slot_of(parent_of(static_cast<Joint>(j)));
    Vector3 offset = Vector3::Zero();
    for (std::size_t f = 0; f < frames.size(); ++f) {
      const Pose local = frames[f][parent].inverse() * frames[f][j];
      offset += local.position;
      user.orientations[f][j] = local.orientation;
    }
    user.offsets[j] = offset / static_cast<double>(frames.size());
  }
  return user;
}

HandModel fitted(const HandModel& hand, const MeasuredSkeleton& user) {
  HandModel out = hand;
  // The new rest skeleton has the user's offsets. It has the model's rest angles on the axes that move, and the user's
  // on the axes that are held.
  for (std::size_t j = 2; j < kJointCount; ++j) {
    const Joint joint = static_cast<Joint>(j);
    const std::size_t frame = slot_of(parent_of(joint));
    Pose& pose = out.rest_joints[j];
    pose.position = out.rest_joints[frame] * user.offsets[j];
    Quaternion rest = hand.rest_joints[frame].orientation.conjugate() * hand.rest_joints[j].orientation;
    const Body body = body_of(joint);
    if (joint_of(body) == joint) fit_joint(user, j, rest, out.bodies[static_cast<std::size_t>(index_of(body))].joint);
    pose.orientation = out.rest_joints[frame].orientation * rest;
  }
  const std::size_t palm = slot_of(Joint::palm);
  const Pose& palm_frame = out.rest_joints[slot_of(Joint::middle_metacarpal)];
  out.rest_joints[palm].position = palm_frame * user.offsets[palm];
  out.rest_joints[palm].orientation =
      palm_frame.orientation * (hand.rest_joints[slot_of(Joint::middle_metacarpal)].orientation.conjugate() *
                                hand.rest_joints[palm].orientation);

  const auto knuckles = [](const HandModel& model) {
    return (model.rest_joints[slot_of(Joint::index_proximal)].position -
            model.rest_joints[slot_of(Joint::little_proximal)].position)
        .norm();
  };
  const double breadth = std::clamp(knuckles(out) / knuckles(hand), kThinnest, kThickest);
  std::array<BoneMap, kBodyCount> maps;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    const std::size_t joint = slot_of(joint_of(body));
    const std::size_t end = slot_of(end_joint_of(body));
    BoneMap& map = maps[b];
    map.old_origin = hand.rest_joints[joint].position;
    map.new_origin = out.rest_joints[joint].position;
    if (index_of(body) >= 2) {
      const Vector3 before = hand.rest_joints[end].position - map.old_origin;
      const Vector3 after = out.rest_joints[end].position - map.new_origin;
      map.length = after.norm() / before.norm();
      if (!(map.length >= 0.5 && map.length <= 2.0)) {
        throw std::invalid_argument(
            "fitted: bone " + std::string(kBodyNames[b]) + ": expected a length within a factor of 2 of the model's " +
            std::to_string(before.norm() * 1e3) + " mm, got " + std::to_string(after.norm() * 1e3) + " mm");
      }
      if (is_metacarpal(body)) {
        // Sources agree where a metacarpal ends, but not where it begins. So its position follows from its knuckle, and
        // its length changes little.
        map.old_origin += before;
        map.new_origin += after;
        map.length = std::clamp(map.length, 0.9, 1.1);
      }
      map.direction = before.normalized();
      map.turn = Quaternion::FromTwoVectors(before, after);
    }
    // The palm's thickness scales with its breadth, because sources define the radius of a metacarpal or wrist
    // differently.
    const bool palm_bone = index_of(body) < 2 || is_metacarpal(body);
    map.thickness = palm_bone ? breadth : finger_thickness(user.radii, hand.joint_radii, joint, end);
  }

  // Nodes move with the bones around them. The weight of a bone is the inverse sixth power of its distance. This is
  // continuous everywhere, and a neighbouring finger has hardly any effect.
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
    Vector3 moved = Vector3::Zero();
    double total = 0;
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const Pose& joint = hand.rest_joints[slot_of(joint_of(static_cast<Body>(b)))];
      const double distance =
          distance_to_segment(hand.nodes[n], joint * hand.bodies[b].bone_start, joint * hand.bodies[b].bone_end);
      const double weight = std::pow(distance + 1e-3, -6.0);
      moved += weight * maps[b](hand.nodes[n]);
      total += weight;
    }
    out.nodes[n] = moved / total;
  }
  smooth_displacements(hand, out.nodes);
  for (SkinPoint& point : out.contact_points) {
    const auto& corners = hand.tetrahedra[static_cast<std::size_t>(point.tetrahedron)];
    const double growth = tetrahedron_volume(out.nodes, corners) / tetrahedron_volume(hand.nodes, corners);
    point.area *= std::pow(std::max(growth, 0.0), 2.0 / 3);
  }
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    BodyModel& body = out.bodies[b];
    const BoneMap& map = maps[b];
    const std::size_t joint = slot_of(joint_of(static_cast<Body>(b)));
    const Pose& from = hand.rest_joints[joint];
    const Pose back = out.rest_joints[joint].inverse();
    const auto moved = [&](const Vector3& local) { return back * map(from * local); };
    body.bone_start = moved(body.bone_start);
    body.bone_end = moved(body.bone_end);
    body.bone_start_radius *= map.thickness;
    body.bone_end_radius *= map.thickness;
    body.joint_from_body = {
        moved(body.joint_from_body.position),
        (back.orientation * map.turn * from.orientation * body.joint_from_body.orientation).normalized()};
    const double volume = map.length * map.thickness * map.thickness;
    body.mass *= volume;
    body.inertia *= volume * 0.5 * (map.length * map.length + map.thickness * map.thickness);
  }
  for (std::size_t j = 0; j < kJointCount; ++j) {
    if (user.radii[j] > 0) out.joint_radii[j] = user.radii[j];
  }
  validate(out, hand.name + " fitted to the user");
  return out;
}

}  // namespace softhand
