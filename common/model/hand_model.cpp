#include "model/hand_model.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "math/tetrahedron.hpp"

namespace softhand {
namespace {

constexpr double kMaximumFingerCap = 20.0;  // N, largest pull on a finger
constexpr double kMaximumHandCap = 100.0;   // N, largest pull on a hand
constexpr double kMaximumHandExtent = 1.0;  // m, so that hand files in millimetres or centimetres are refused

class HandChecker {
 public:
  explicit HandChecker(std::string where) : where_(std::move(where)) {}
  void operator()(bool good, const std::string& field, const std::string& expected) const {
    if (!good) throw std::invalid_argument(where_ + ": " + field + ": expected " + expected);
  }
  void number(double value, double minimum, double maximum, const std::string& field) const {
    if (!(value >= minimum && value <= maximum)) {
      throw std::invalid_argument(where_ + ": " + field + ": expected a number in [" + std::to_string(minimum) + ", " +
                                  std::to_string(maximum) + "], got " + std::to_string(value));
    }
  }

 private:
  std::string where_;
};

std::string at(const char* field, std::size_t i) { return std::string(field) + "[" + std::to_string(i) + "]"; }

void validate_body(const HandModel& hand, std::size_t b, const HandChecker& check) {
  const BodyModel& body = hand.bodies[b];
  const std::string field = "bodies[" + std::string(kBodyNames[b]) + "].";
  check.number(body.mass, 1e-5, 10.0, field + "mass");
  check(body.joint_from_body.position.allFinite() && body.joint_from_body.position.norm() < kMaximumHandExtent,
        field + "centre_of_mass", "a point within 1 m of the joint");
  check(body.inertia.allFinite() && body.inertia.llt().info() == Eigen::Success &&
            body.inertia.isApprox(body.inertia.transpose()),
        field + "inertia", "a symmetric positive definite matrix");
  check(body.bone_start.allFinite() && body.bone_end.allFinite(), field + "bone", "finite points");
  check.number(body.bone_start_radius, 0, 0.1, field + "bone.start_radius");
  check.number(body.bone_end_radius, 0, 0.1, field + "bone.end_radius");
  const JointModel& joint = body.joint;
  check.number(joint.position_stiffness, 0, 1e9, field + "joint.position_stiffness");
  check.number(joint.orientation_stiffness, 0, 1e6, field + "joint.orientation_stiffness");
  check.number(joint.limit_stiffness, 0, 1e6, field + "joint.limit_stiffness");
  for (const auto& [range, name] : {std::pair{joint.flexion_range, "joint.flexion_range"},
                                    std::pair{joint.abduction_range, "joint.abduction_range"}}) {
    check(range[0] >= -M_PI && range[1] <= M_PI && range[0] <= 0 && range[1] >= 0, field + name,
          "radians with -pi <= minimum <= 0 <= maximum <= pi, got " + std::to_string(range[0]) + ", " +
              std::to_string(range[1]));
  }
  check.number(body.coupling_linear_stiffness, 0, 1e6, field + "coupling.linear_stiffness");
  check.number(body.coupling_angular_stiffness, 0, 1e4, field + "coupling.angular_stiffness");
  check.number(body.coupling_force_cap, 0, kMaximumFingerCap, field + "coupling.force_cap");
  check.number(body.coupling_torque_cap, 0, 100.0, field + "coupling.torque_cap");
  // The coupling does not accept a cap of zero. To release a bone, set its stiffnesses to zero.
  check(body.coupling_force_cap > 0, field + "coupling.force_cap", "a number > 0");
  check(body.coupling_torque_cap > 0, field + "coupling.torque_cap", "a number > 0");
}

void validate_caps(const HandModel& hand, const HandChecker& check) {
  std::array<double, 6> finger_cap{};
  double hand_cap = 0;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    finger_cap[static_cast<std::size_t>(finger_of(static_cast<Body>(b)))] += hand.bodies[b].coupling_force_cap;
    hand_cap += hand.bodies[b].coupling_force_cap;
  }
  for (std::size_t f = 0; f < kFingerCount; ++f) {
    check(finger_cap[f] <= kMaximumFingerCap + 1e-9, "bodies.coupling.force_cap",
          "a sum of at most 20 N over the bodies of the " + std::string(kFingerNames[f]) + ", got " +
              std::to_string(finger_cap[f]));
  }
  check(hand_cap <= kMaximumHandCap + 1e-9, "bodies.coupling.force_cap",
        "a sum of at most 100 N over all bodies, got " + std::to_string(hand_cap));
}

void validate_mesh(const HandModel& hand, const HandChecker& check) {
  check(hand.node_body.size() == hand.nodes.size(), "node_body", "one body for each node");
  for (std::size_t n = 0; n < hand.node_body.size(); ++n)
    check(hand.node_body[n] < kBodyCount, at("node_body", n), "a body below 21");
  for (std::size_t s = 0; s < hand.surface.size(); ++s) {
    for (const std::int32_t node : hand.surface[s])
      check(node >= 0 && node < hand.node_count(), at("surface", s), "indices of nodes");
  }
}

void validate_embedding(const HandModel& hand, const HandChecker& check) {
  const auto tetrahedron_count = static_cast<std::int32_t>(hand.tetrahedra.size());
  for (std::size_t a = 0; a < hand.attachments.size(); ++a) {
    const Attachment& attachment = hand.attachments[a];
    check(attachment.body >= 0 && attachment.body < kBodyCount, at("attachment_body", a), "a body below 21");
    check(attachment.tetrahedron >= 0 && attachment.tetrahedron < tetrahedron_count, at("attachment_tetrahedron", a),
          "an index of a tetrahedron");
    check.number(attachment.stiffness, 0, 1e9, at("attachment_stiffness", a));
    double sum = 0;
    for (const double w : attachment.weights) {
      check.number(w, -1e-3, 1.0 + 1e-3, at("attachment_weights", a));
      sum += w;
    }
    check(std::abs(sum - 1.0) < 1e-6, at("attachment_weights", a), "a sum of 1");
  }
  check(!hand.contact_points.empty(), "contact_tetrahedron", "at least one contact point");
  for (std::size_t p = 0; p < hand.contact_points.size(); ++p) {
    const SkinPoint& point = hand.contact_points[p];
    check(point.tetrahedron >= 0 && point.tetrahedron < tetrahedron_count, at("contact_tetrahedron", p),
          "an index of a tetrahedron");
    check.number(point.area, 1e-9, 1e-2, at("contact_area", p));
    check(point.body < kBodyCount, at("contact_body", p), "a body below 21");
    double sum = 0;
    for (const double w : point.weights) {
      check.number(w, 0, 1, at("contact_weights", p));
      sum += w;
    }
    check(std::abs(sum - 1.0) < 1e-6, at("contact_weights", p), "a sum of 1");
  }
  const auto fits = [&check](std::size_t count, std::size_t most, const char* field) {
    check(count <= most, field, "at most " + std::to_string(most) + ", got " + std::to_string(count));
  };
  fits(hand.skin_vertices.size(), kMaxSkinVertices, "skin_tetrahedron");
  fits(hand.skin_triangles.size(), kMaxSkinTriangles, "skin_triangles");
  for (std::size_t v = 0; v < hand.skin_vertices.size(); ++v) {
    check(hand.skin_vertices[v].tetrahedron >= 0 && hand.skin_vertices[v].tetrahedron < tetrahedron_count,
          at("skin_tetrahedron", v), "an index of a tetrahedron");
    double sum = 0;
    for (const float w : hand.skin_vertices[v].weights) sum += static_cast<double>(w);
    check(std::abs(sum - 1.0) < 1e-2, at("skin_weights", v), "a sum of 1");
  }
  const auto vertex_count = static_cast<std::int32_t>(hand.skin_vertices.size());
  for (std::size_t t = 0; t < hand.skin_triangles.size(); ++t) {
    for (const std::int32_t vertex : hand.skin_triangles[t])
      check(vertex >= 0 && vertex < vertex_count, at("skin_triangles", t), "indices of skin vertices");
  }
}

Pose mirrored(const Pose& pose) {
  // S R S with S = diag(-1, 1, 1): the x component of the rotation axis stays, y and z change their sign.
  return {Vector3(-pose.position.x(), pose.position.y(), pose.position.z()),
          Quaternion(pose.orientation.w(), pose.orientation.x(), -pose.orientation.y(), -pose.orientation.z())};
}
Vector3 mirrored(const Vector3& v) { return {-v.x(), v.y(), v.z()}; }

}  // namespace

void validate(const HandModel& hand, const std::string& where) {
  const HandChecker check(where);
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const std::string field = "joints[" + std::string(kJointNames[j]) + "]";
    check(hand.rest_joints[j].position.allFinite() && hand.rest_joints[j].position.norm() < kMaximumHandExtent,
          field + ".position", "finite metres within 1 m of the wrist");
    check(std::abs(hand.rest_joints[j].orientation.norm() - 1.0) < 1e-6, field + ".orientation", "a unit quaternion");
    check.number(hand.joint_radii[j], 0, 0.1, field + ".radius");
  }
  check(hand.rest_joints[index_of(Joint::wrist)].position.norm() < 1e-6 &&
            hand.rest_joints[index_of(Joint::wrist)].orientation.isApprox(Quaternion::Identity(), 1e-6),
        "joints[wrist]", "the identity, because the rest frame is the wrist's");
  for (std::size_t b = 0; b < kBodyCount; ++b) validate_body(hand, b, check);
  validate_caps(hand, check);
  validate_tetrahedra(hand, where);
  validate_mesh(hand, check);
  validate_embedding(hand, check);
}

void drop_loose_nodes(HandModel& hand) {
  const std::size_t count = hand.nodes.size();
  if (hand.node_body.size() != count) return;  // `validate` refuses this hand
  std::vector<std::int32_t> renumbered(count, -1);
  const auto mark_used = [&renumbered](const auto& nodes) {
    for (const std::int32_t node : nodes) {
      if (node >= 0 && static_cast<std::size_t>(node) < renumbered.size())
        renumbered[static_cast<std::size_t>(node)] = 0;
    }
  };
  for (const auto& tetrahedron : hand.tetrahedra) mark_used(tetrahedron);
  for (const auto& triangle : hand.surface) mark_used(triangle);
  std::int32_t used = 0;
  for (std::size_t n = 0; n < count; ++n) {
    if (renumbered[n] < 0) continue;
    hand.nodes[static_cast<std::size_t>(used)] = hand.nodes[n];
    hand.node_body[static_cast<std::size_t>(used)] = hand.node_body[n];
    renumbered[n] = used++;
  }
  if (static_cast<std::size_t>(used) == count) return;
  hand.nodes.resize(static_cast<std::size_t>(used));
  hand.node_body.resize(static_cast<std::size_t>(used));
  const auto renumber = [&renumbered](auto& list) {
    for (auto& nodes : list) {
      for (std::int32_t& node : nodes) {
        if (node >= 0 && static_cast<std::size_t>(node) < renumbered.size())
          node = renumbered[static_cast<std::size_t>(node)];
      }
    }
  };
  renumber(hand.tetrahedra);
  renumber(hand.surface);
}

HandModel mirrored(const HandModel& hand) {
  HandModel out = hand;
  out.side = hand.side == Side::left ? Side::right : Side::left;
  for (Pose& joint : out.rest_joints) joint = mirrored(joint);
  for (BodyModel& body : out.bodies) {
    body.joint_from_body = mirrored(body.joint_from_body);
    const Eigen::DiagonalMatrix<double, 3> s(-1, 1, 1);
    body.inertia = s * body.inertia * s;
    body.bone_start = mirrored(body.bone_start);
    body.bone_end = mirrored(body.bone_end);
    // In a mirror image, rotation about y changes its sign and rotation about x does not.
    body.joint.abduction_range = {-body.joint.abduction_range[1], -body.joint.abduction_range[0]};
  }
  for (Vector3& node : out.nodes) node = mirrored(node);
  // Mirroring inverts every tetrahedron and triangle. So swap two corners, and the weights that belong to them.
  for (auto& tetrahedron : out.tetrahedra) std::swap(tetrahedron[2], tetrahedron[3]);
  for (auto& triangle : out.surface) std::swap(triangle[1], triangle[2]);
  for (auto& triangle : out.skin_triangles) std::swap(triangle[1], triangle[2]);
  for (Attachment& attachment : out.attachments) std::swap(attachment.weights[2], attachment.weights[3]);
  for (SkinPoint& point : out.contact_points) std::swap(point.weights[2], point.weights[3]);
  for (SkinVertex& vertex : out.skin_vertices) std::swap(vertex.weights[2], vertex.weights[3]);
  return out;
}

}  // namespace softhand
