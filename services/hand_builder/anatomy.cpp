#include "hand_builder/anatomy.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "math/rotation.hpp"

namespace softhand::builder {
namespace {

constexpr double kDegree = M_PI / 180.0;
constexpr double kReferenceLength = 0.189;
constexpr double kReferenceBreadth = 0.085;

Joint joint_of_finger(int finger, int k) { return static_cast<Joint>(6 + 5 * (finger - 1) + k); }

// One long finger. Lengths are fractions of the hand length. Palm positions are fractions of the breadth (x) and
// millimetres of the reference hand (y).
struct FingerRow {
  double palm_length;               // wrist to MCP, Buchholz
  std::array<double, 3> phalanges;  // Buchholz
  double mcp_x, mcp_y;              // head of the metacarpal
  double base_x, base_y, base_z;    // base of the metacarpal; z is a fraction of length
  double spread;                    // degrees about the dorsal axis, positive to the thumb
  double roll;                      // degrees about the finger; the transverse arch turns the pads to the thumb
  std::array<double, 3> flexion;    // degrees at rest: MCP, PIP, DIP
  std::array<double, 5> radii;  // millimetres of the reference hand: metacarpal, proximal, intermediate, distal, tip
};

// Flexion of a relaxed hand: about 40, 35 and 15 degrees, more towards the little finger (the natural cascade). In this
// pose the tissue is unstrained, so it is strained in both directions from here. A fist at MCP 82, PIP 100 and DIP 60
// stretches the back half as much as it would from the flat hand.
constexpr std::array<FingerRow, 4> kFingers{{
    {0.447,
     {0.245, 0.143, 0.097},
     -0.290,
     0.0,
     -0.150,
     1.0,
     0.150,
     5.0,
     -5.0,
     {36, 33, 14},
     {12.5, 10.8, 9.4, 8.3, 7.0}},
    {0.446,
     {0.266, 0.170, 0.108},
     -0.035,
     2.5,
     -0.025,
     3.0,
     0.150,
     1.0,
     0.0,
     {40, 35, 15},
     {12.5, 11.0, 9.6, 8.5, 7.2}},
    {0.421,
     {0.244, 0.165, 0.107},
     0.200,
     0.5,
     0.085,
     2.0,
     0.145,
     -4.0,
     -2.0,
     {43, 37, 16},
     {12.0, 10.3, 9.0, 7.9, 6.8}},
    {0.414,
     {0.204, 0.117, 0.093},
     0.408,
     -4.0,
     0.190,
     -1.0,
     0.135,
     -11.0,
     -5.0,
     {46, 38, 16},
     {11.5, 9.3, 8.0, 7.1, 6.1}},
}};

// The thumb, all angles in degrees. It rests half opposed. The joint model fixes the twist of each bone about its own
// axis. Therefore the rest pose contains the rotation that opposition adds, and the flexion axes of MCP and IP rotate
// with it. Cooney et al. 1981: the axes of the trapezium are 80 degrees pronated against those of the third metacarpal
// (48 flexed, 38 abducted). Pronation goes with flexion (Li and Tang 2007). A recorded Quest 3 hand has 83 at the
// metacarpal and 104 at the distal phalanx on average. The further rotation of a full pinch, 26 + 20 + 8, is set so
// that the pads face each other (docs/hand-builder.md).
struct ThumbRow {
  std::array<double, 3> lengths;    // fractions of hand length: metacarpal, proximal, distal; Buchholz
  std::array<double, 4> radii;      // millimetres of the reference hand: metacarpal, proximal, distal, tip
  double radial, palmar;            // direction of the metacarpal relative to that of the middle metacarpal
  std::array<double, 3> pronation;  // about the bones' own axes: metacarpal against the palm, MCP, IP
  std::array<double, 2> flexion;    // MCP, IP
};
constexpr ThumbRow kThumb{{0.251, 0.196, 0.158}, {13.0, 11.3, 10.2, 8.2}, 34, 42, {106, 20, 8}, {10, 10}};

// Frame with -Z along `along` and +Y as near to `dorsal` as possible.
Quaternion frame(const Vector3& along, const Vector3& dorsal) {
  Matrix3 r;
  r.col(2) = -along.normalized();
  r.col(0) = dorsal.cross(r.col(2)).normalized();
  r.col(1) = r.col(2).cross(r.col(0));
  return Quaternion(r);
}
Quaternion about(const Vector3& axis, double degrees) { return Quaternion(Eigen::AngleAxisd(degrees * kDegree, axis)); }
Quaternion thumb_metacarpal_orientation() {
  const double radial = kThumb.radial * kDegree, palmar = kThumb.palmar * kDegree;
  const Vector3 along(-std::sin(radial) * std::cos(palmar), -std::sin(palmar), -std::cos(radial) * std::cos(palmar));
  return frame(along, Vector3::UnitY()) * about(Vector3::UnitZ(), kThumb.pronation[0]);
}

// Orientations of the natural pose. They are the same for all hands. Those of metacarpals II-V follow from their ends.
void natural_orientations(std::array<Pose, kJointCount>& joints) {
  for (int f = 1; f < kFingerCount; ++f) {
    const FingerRow& row = kFingers[static_cast<std::size_t>(f - 1)];
    Quaternion q = about(Vector3::UnitY(), row.spread) * about(Vector3::UnitZ(), row.roll);
    for (int k = 1; k <= 3; ++k) {
      q = q * about(Vector3::UnitX(), -row.flexion[static_cast<std::size_t>(k - 1)]);
      joints[slot_of(joint_of_finger(f, k))].orientation = q;
    }
    joints[slot_of(joint_of_finger(f, 4))].orientation = q;
  }
  Quaternion q = thumb_metacarpal_orientation();
  joints[slot_of(Joint::thumb_metacarpal)].orientation = q;
  q = q * about(Vector3::UnitZ(), kThumb.pronation[1]) * about(Vector3::UnitX(), -kThumb.flexion[0]);
  joints[slot_of(Joint::thumb_proximal)].orientation = q;
  q = q * about(Vector3::UnitZ(), kThumb.pronation[2]) * about(Vector3::UnitX(), -kThumb.flexion[1]);
  joints[slot_of(Joint::thumb_distal)].orientation = q;
  joints[slot_of(Joint::thumb_tip)].orientation = q;
}

void place_palm(std::array<Pose, kJointCount>& joints) {
  joints[slot_of(Joint::palm)].position =
      0.5 * (joints[slot_of(Joint::middle_metacarpal)].position + joints[slot_of(Joint::middle_proximal)].position);
  joints[slot_of(Joint::palm)].orientation = joints[slot_of(Joint::middle_metacarpal)].orientation;
}

double reference_radius(Joint joint) {
  const int j = index_of(joint);
  if (joint == Joint::palm) return 14.0e-3;
  if (joint == Joint::wrist) return 19.0e-3;
  if (j < 6) return 1e-3 * kThumb.radii[static_cast<std::size_t>(j - 2)];
  return 1e-3 * kFingers[static_cast<std::size_t>((j - 6) / 5)].radii[static_cast<std::size_t>((j - 6) % 5)];
}

}  // namespace

double rounded_cone_distance(const Vector3& point, const Vector3& a, const Vector3& b, double radius_a,
                             double radius_b) {
  const Vector3 axis = b - a;
  const double length = axis.norm();
  const double taper = radius_a - radius_b;
  // One sphere contains the other. The hull is the larger sphere.
  if (length <= std::abs(taper)) return taper > 0 ? (point - a).norm() - radius_a : (point - b).norm() - radius_b;
  // In the half plane of the axis: the cone touches both spheres where its normal has the slope `sine` towards b.
  const Vector3 direction = axis / length;
  const double along = (point - a).dot(direction);
  const double across = (point - a - along * direction).norm();
  const double sine = taper / length;
  const double cosine = std::sqrt(1 - sine * sine);
  const double foot = along * cosine - across * sine;  // coordinate along the generator
  if (foot <= 0) return std::hypot(along, across) - radius_a;
  if (foot >= length * cosine) return std::hypot(along - length, across) - radius_b;
  return along * sine + across * cosine - radius_a;
}

RestSkeleton natural_rest(const HandSize& size) {
  if (!(size.length >= 0.10 && size.length <= 0.26))
    throw std::invalid_argument("length: expected metres in [0.10, 0.26]");
  if (!(size.breadth >= 0.05 && size.breadth <= 0.13))
    throw std::invalid_argument("breadth: expected metres in [0.05, 0.13]");
  RestSkeleton rest;
  const double thickness = size.breadth / kReferenceBreadth;
  for (std::size_t j = 0; j < kJointCount; ++j) rest.radii[j] = thickness * reference_radius(static_cast<Joint>(j));

  // Buchholz' lengths end at the skin of the fingertip. The tip joint is one radius before it.
  const double tip_radius = rest.radii[slot_of(Joint::middle_tip)];
  const FingerRow& middle = kFingers[1];
  const double sum = middle.palm_length + middle.phalanges[0] + middle.phalanges[1] + middle.phalanges[2];
  const double scale = (size.length - tip_radius) / sum;
  const double millimetre = 1e-3 * size.length / kReferenceLength;

  natural_orientations(rest.joints);
  for (int f = 1; f < kFingerCount; ++f) {
    const FingerRow& row = kFingers[static_cast<std::size_t>(f - 1)];
    const Vector3 base(row.base_x * size.breadth, row.base_y * millimetre, -row.base_z * size.length);
    Vector3 head(row.mcp_x * size.breadth, row.mcp_y * millimetre, 0);
    const double reach = row.palm_length * scale;
    if (!(reach > head.norm()))
      throw std::invalid_argument("breadth: too large for this length, the knuckles do not fit beside each other");
    head.z() = -std::sqrt(reach * reach - head.squaredNorm());
    rest.joints[slot_of(joint_of_finger(f, 0))] = {
        base, frame(head - base, about(Vector3::UnitZ(), row.roll) * Vector3::UnitY())};
    for (int k = 1; k <= 4; ++k) {
      rest.joints[slot_of(joint_of_finger(f, k))].position = head;
      if (k <= 3) {
        head -= rest.joints[slot_of(joint_of_finger(f, k))].orientation * Vector3::UnitZ() *
                row.phalanges[static_cast<std::size_t>(k - 1)] * scale;
      }
    }
  }
  Vector3 thumb(-0.235 * size.breadth, -9.0 * millimetre, -0.118 * size.length);
  for (int k = 0; k < 4; ++k) {
    Pose& joint = rest.joints[static_cast<std::size_t>(2 + k)];
    joint.position = thumb;
    if (k < 3) thumb -= joint.orientation * Vector3::UnitZ() * kThumb.lengths[static_cast<std::size_t>(k)] * scale;
  }
  place_palm(rest.joints);
  return rest;
}

RestSkeleton natural_rest(const MeasuredSkeleton& user, Side side) {
  constexpr double kShortestReach = 0.05, kLongestReach = 0.4;  // m
  const auto to_right = [side](Vector3 v) {
    if (side == Side::left) v.x() = -v.x();
    return v;
  };
  RestSkeleton rest;
  natural_orientations(rest.joints);
  const auto follow = [&](Joint joint, Joint parent) {
    const Pose& frame_of_parent = rest.joints[slot_of(parent)];
    rest.joints[slot_of(joint)].position = frame_of_parent * to_right(user.offsets[slot_of(joint)]);
  };
  for (int f = 1; f < kFingerCount; ++f) {
    // The convention of metacarpal frames differs between sources. Therefore only the positions of their ends are used.
    const Joint metacarpal = joint_of_finger(f, 0);
    const Joint proximal = joint_of_finger(f, 1);
    follow(metacarpal, Joint::wrist);
    Eigen::Vector4d mean = Eigen::Vector4d::Zero();
    for (const auto& frame_of_user : user.orientations) {
      const Eigen::Vector4d q = frame_of_user[slot_of(metacarpal)].coeffs();
      mean += q.dot(mean) < 0 ? Eigen::Vector4d(-q) : q;
    }
    Quaternion measured_rotation = Quaternion(mean).normalized();
    if (side == Side::left)
      measured_rotation =
          Quaternion(measured_rotation.w(), measured_rotation.x(), -measured_rotation.y(), -measured_rotation.z());
    const Vector3 along = measured_rotation * to_right(user.offsets[slot_of(proximal)]);
    rest.joints[slot_of(metacarpal)].orientation = frame(along, measured_rotation * Vector3::UnitY());
    rest.joints[slot_of(proximal)].position = rest.joints[slot_of(metacarpal)].position + along;
    for (int k = 2; k <= 4; ++k) follow(joint_of_finger(f, k), joint_of_finger(f, k - 1));
  }
  follow(Joint::thumb_metacarpal, Joint::wrist);
  for (const Joint joint : {Joint::thumb_proximal, Joint::thumb_distal, Joint::thumb_tip}) {
    follow(joint, static_cast<Joint>(index_of(joint) - 1));
  }
  place_palm(rest.joints);
  // Without this check, meshing a skeleton that is not a hand runs out of memory or finds no mesh. The error then would
  // not mention the recording.
  const double reach = rest.joints[slot_of(Joint::middle_tip)].position.norm();
  if (!(reach > kShortestReach && reach < kLongestReach))
    throw std::invalid_argument(
        "expected positions in metres, with the middle fingertip 0.05 to 0.4 m from the wrist, got " +
        std::to_string(reach) + " m");
  if (!(rest.joints[slot_of(Joint::thumb_metacarpal)].position.x() <
        rest.joints[slot_of(Joint::little_proximal)].position.x()))
    throw std::invalid_argument(std::string("expected a ") + (side == Side::left ? "left" : "right") +
                                " hand, got the thumb on the other side; set --side");
  // If a source gives no radius, use that of the reference hand, scaled by the palm length of the middle finger.
  const double ratio = rest.joints[slot_of(Joint::middle_proximal)].position.norm() / (0.446 * kReferenceLength);
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const double measured_radius = user.radii[j];
    rest.radii[j] = measured_radius > 0 ? measured_radius : ratio * reference_radius(static_cast<Joint>(j));
  }
  return rest;
}

namespace {

// Bone radii of the reference hand at start and end, in millimetres. They leave a pulp of 2.5 to 3.4 mm on the palmar
// side of a finger.
struct BoneRow {
  double start, end;
};
BoneRow bone_row(Body body) {
  if (body == Body::forearm) return {9.0, 10.0};
  if (body == Body::carpus) return {10.0, 8.0};
  if (is_metacarpal(body)) return {5.5, 5.5};
  const int b = index_of(body);
  const int k = b < 5 ? (b == 3 ? 1 : 3) : (b - 5) % 4;
  if (k == 1) return {5.0, 4.2};
  if (k == 2) return {4.2, 3.5};
  return {3.6, 2.6};
}

void set_mass(BodyModel& body) {
  // Bone of 1,700 kg/m^3. The nodes have the mass of the tissue. The lower bound keeps the ratio of stiffness to mass
  // within the resolution of one step.
  constexpr double kDensity = 1700.0, kLightest = 0.004, kThinnest = 0.006;
  const Vector3 axis = body.bone_end - body.bone_start;
  const double length = axis.norm();
  const double r = 0.5 * (body.bone_start_radius + body.bone_end_radius);
  const double volume = M_PI * r * r * length + 4.0 / 3.0 * M_PI * r * r * r;
  body.mass = std::max(kDensity * volume, kLightest);
  // A solid cylinder as long as the rounded cone, and at least as thick as the soft tissue that rotates with it.
  const double gyration = std::max(r, kThinnest);
  const double full = length + 2 * r;
  const double across = body.mass * (3 * gyration * gyration + full * full) / 12.0;
  const double along = body.mass * gyration * gyration / 2.0;
  const Vector3 d = axis / length;
  body.inertia = across * Matrix3::Identity() + (along - across) * (d * d.transpose());
  body.joint_from_body.position = 0.5 * (body.bone_start + body.bone_end);
}

// Ranges of motion in degrees: flexion and extension from the straight finger, abduction. The 60 degrees of abduction
// at the thumb's root lie between 42 (Cooney et al. 1981) and 67 (CT of a whole circumduction, PMC3940763).
struct MotionRow {
  double flexion, extension, abduction;
};
MotionRow motion_row(Body body) {
  switch (body) {
    case Body::thumb_metacarpal:
      return {50, 15, 30};
    case Body::thumb_proximal:
      return {55, 10, 12};
    case Body::thumb_distal:
      return {80, 15, 0};
    default:
      break;
  }
  const int k = (index_of(body) - 5) % 4;
  if (k == 1) return {90, 45, 20};
  if (k == 2) return {100, 0, 0};
  return {80, 0, 0};
}

JointModel make_joint(const RestSkeleton& rest, Body body) {
  JointModel joint;
  if (body == Body::forearm) return joint;
  // The roots of the thumb and of the index finger are compliant. Trackers see them move by up to 16 and 9 mm against
  // the wrist, because the carpus is not one rigid bone.
  joint.position_stiffness = body == Body::thumb_metacarpal ? 2e3 : body == Body::index_metacarpal ? 2e4 : 1e5;
  joint.kind = JointKind::ball;
  if (body == Body::carpus) return joint;  // the wrist is free under the coupling
  if (is_metacarpal(body) && body != Body::thumb_metacarpal) {
    joint.orientation_stiffness = 50;
    return joint;
  }
  const int b = index_of(body);
  const bool saddle = b < 4 || (b >= 5 && (b - 5) % 4 == 1);
  joint.kind = saddle ? JointKind::saddle : JointKind::hinge;
  joint.orientation_stiffness = saddle ? 8 : 10;
  joint.limit_stiffness = body == Body::thumb_metacarpal ? 5 : 3;
  // Published ranges are measured from the straight finger, and those of the file from the rest pose. The thumb's CMC
  // has no straight pose, so its range is measured from rest.
  double flexed = 0, abducted = 0;
  if (body != Body::thumb_metacarpal) {
    const Quaternion parent = rest.joints[slot_of(joint_of(parent_of(body)))].orientation;
    const Vector3 angle = rotation_log(parent.conjugate() * rest.joints[slot_of(joint_of(body))].orientation);
    flexed = angle.x();  // negative at rest
    abducted = angle.y();
  }
  const MotionRow row = motion_row(body);
  joint.flexion_range = {std::min(0.0, -row.flexion * kDegree - flexed),
                         std::max(0.0, row.extension * kDegree - flexed)};
  if (saddle) {
    // Abduction is measured from half the rest spread. A resting hand is slightly spread and may close further than it
    // may open.
    joint.abduction_range = {std::min(-0.1, -row.abduction * kDegree - 0.5 * abducted),
                             std::max(0.1, row.abduction * kDegree - 0.5 * abducted)};
  }
  return joint;
}

void set_coupling(BodyModel& body, Body which) {
  const bool wrist = finger_of(which) == Finger::palm;
  const bool palm = wrist || (is_metacarpal(which) && which != Body::thumb_metacarpal);
  const bool distal = which == distal_of(finger_of(which)) && !palm;
  body.coupling_linear_stiffness = wrist ? 4000 : palm ? 2000 : which == Body::thumb_metacarpal ? 1500 : 800;
  body.coupling_angular_stiffness = wrist ? 10 : palm ? 5 : which == Body::thumb_metacarpal ? 1.5 : distal ? 0.5 : 1;
  // 15 N a finger, 75 N for five. The two bodies of the wrist share the rest of the hand's 100 N.
  const double bodies_of_finger = finger_of(which) == Finger::thumb ? 3 : 4;
  body.coupling_force_cap = wrist ? 12.0 : 15.0 / bodies_of_finger;
  body.coupling_torque_cap = palm ? 2.0 : 0.5;
}

}  // namespace

std::array<BodyModel, kBodyCount> make_bodies(const RestSkeleton& rest) {
  std::array<BodyModel, kBodyCount> bodies;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Body which = static_cast<Body>(b);
    BodyModel& body = bodies[b];
    const Pose& joint = rest.joints[slot_of(joint_of(which))];
    const double skin_start = rest.radii[slot_of(joint_of(which))] / reference_radius(joint_of(which));
    const double skin_end = rest.radii[slot_of(end_joint_of(which))] / reference_radius(end_joint_of(which));
    const BoneRow row = bone_row(which);
    const double finger_scale = finger_of(which) == Finger::thumb    ? 1.2
                                : finger_of(which) == Finger::little ? 0.88
                                                                     : 1.0;
    body.bone_start_radius = 1e-3 * row.start * skin_start * finger_scale;
    body.bone_end_radius = 1e-3 * row.end * skin_end * finger_scale;
    if (which == Body::forearm) {
      // A scanned hand may end close behind the wrist.
      body.bone_start = Vector3(0, 0, rest.stump - 0.015);
      body.bone_end = Vector3(0, 0, std::max(rest.stump - 0.029, 0.002));
    } else {
      // Gaps at the joints prevent neighbouring bones from sharing tissue. The distal bone reaches to its tip joint.
      const Vector3 end = joint.inverse() * rest.joints[slot_of(end_joint_of(which))].position;
      const double length = end.norm();
      const Vector3 along = end / length;
      const bool distal = which == distal_of(finger_of(which)) && finger_of(which) != Finger::palm;
      body.bone_start = along * 0.6 * body.bone_start_radius;
      body.bone_end = along * (distal                  ? length
                               : which == Body::carpus ? length - 0.6 * body.bone_end_radius
                                                       : length - 0.7 * body.bone_end_radius);
      if (which == Body::carpus) {
        // The base of the middle metacarpal is dorsal of the middle of the wrist.
        body.bone_start = along * 0.002 - 0.002 * Vector3::UnitY();
        body.bone_end.y() -= 0.005;
      }
      // The distal bone is 1 mm nearer to the nail, which leaves room for the pulp.
      if (distal) {
        body.bone_start.y() += 0.5e-3;
        body.bone_end.y() += 1.0e-3;
      }
    }
    set_mass(body);
    if (which == Body::forearm) {
      // Light, because the user's arm supports the forearm. The force that accelerates it is taken from the 24 N of the
      // wrist's couplings.
      body.mass = 0.06;
      body.inertia = Vector3(6e-5, 6e-5, 3e-5).asDiagonal();
    }
    body.joint = make_joint(rest, which);
    set_coupling(body, which);
  }
  return bodies;
}

}  // namespace softhand::builder
