#include "device/user_hand.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iomanip>
#include <sstream>
#include <stdexcept>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "model/kinematics.hpp"
#include "runtime/config.hpp"

namespace softhand {
namespace {

constexpr double kShortest = 1e-3, kLongest = 0.3;  // m, of an offset
constexpr int kDigits = 9;

bool has_bone(Joint joint) { return joint != Joint::wrist && joint_of(body_of(joint)) == joint; }

// The four ends of the joint's range.
std::array<Quaternion, 4> ends_of(const UserJoint& joint) {
  const auto &f = joint.flexion, &a = joint.abduction;
  const double mid_flexion = 0.5 * (f[0] + f[1]), mid_abduction = 0.5 * (a[0] + a[1]);
  const Quaternion median = to_quaternion(joint.orientation).normalized();
  const auto turned = [&median](double flexion, double abduction) {
    return median * rotation_exp(Vector3(flexion, abduction, 0));
  };
  return {turned(f[0], mid_abduction), turned(f[1], mid_abduction), turned(mid_flexion, a[0]),
          turned(mid_flexion, a[1])};
}

template <std::size_t n>
void write(std::ostream& out, const char* key, const std::array<double, n>& values) {
  out << key << " = [";
  for (std::size_t i = 0; i < n; ++i) out << (i == 0 ? "" : ", ") << values[i];
  out << "]\n";
}

}  // namespace

void describe(OptionVisitor& v, UserHand& o) {
  v.choice("side", o.side, {"left", "right"}, "Side of the hand.");
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Joint joint = static_cast<Joint>(j);
    if (joint == Joint::wrist) continue;
    UserJoint& user = o.joints[j];
    v.section(kJointNames[j], "A joint.", [&](OptionVisitor& inner) {
      inner.numbers("offset", user.offset.data(), 3, "m", {-kLongest, kLongest}, "Origin in the parent's frame.");
      inner.number("radius", user.radius, "m", {0, 0.1}, "Distance to the skin. 0 = unknown.");
      if (!has_bone(joint)) return;
      inner.numbers("orientation", user.orientation.data(), 4, "1", {-1, 1}, "Median orientation there, xyzw.");
      inner.numbers("flexion", user.flexion.data(), 2, "rad", {-M_PI, M_PI}, "Range about X from this orientation.");
      inner.numbers("abduction", user.abduction.data(), 2, "rad", {-M_PI, M_PI}, "The same about Y.");
    });
  }
}

UserHand read_user_hand(const std::string& text, const std::string& path) {
  UserHand user;
  read_toml_text(user, text, path);
  for (std::size_t j = 0; j < kJointCount; ++j) {
    if (static_cast<Joint>(j) == Joint::wrist) continue;
    const UserJoint& joint = user.joints[j];
    const auto refuse = [&](const char* key, const char* expected) {
      throw ConfigError(path + ": key '" + std::string(kJointNames[j]) + "." + key + "': expected " + expected);
    };
    const double length = to_vector(joint.offset).norm();
    if (!(length >= kShortest && length <= kLongest)) refuse("offset", "a length from 1 mm to 0.3 m");
    if (!(std::abs(to_quaternion(joint.orientation).norm() - 1) < 1e-3))
      refuse("orientation", "a unit quaternion xyzw");
    if (joint.flexion[0] > joint.flexion[1]) refuse("flexion", "ascending numbers");
    if (joint.abduction[0] > joint.abduction[1]) refuse("abduction", "ascending numbers");
  }
  return user;
}

std::string user_hand_text(const UserHand& user) {
  std::ostringstream out;
  out << std::setprecision(kDigits) << "# Measured by `softhand calibrate`: docs/calibration.md\nside = \"" << user.side
      << "\"\n";
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Joint joint = static_cast<Joint>(j);
    if (joint == Joint::wrist) continue;
    out << "\n[" << kJointNames[j] << "]\n";
    write(out, "offset", user.joints[j].offset);
    out << "radius = " << user.joints[j].radius << "\n";
    if (!has_bone(joint)) continue;
    write(out, "orientation", user.joints[j].orientation);
    write(out, "flexion", user.joints[j].flexion);
    write(out, "abduction", user.joints[j].abduction);
  }
  return out.str();
}

HandModel fitted(const HandModel& hand, const UserHand& user) {
  if (user.side != (hand.side == Side::left ? "left" : "right"))
    throw std::invalid_argument("fitted: expected a " + std::string(hand.side == Side::left ? "left" : "right") +
                                " hand, got a " + user.side + " one");
  MeasuredSkeleton skeleton;
  skeleton.orientations.resize(4);
  for (std::size_t j = 0; j < kJointCount; ++j) {
    skeleton.offsets[j] = to_vector(user.joints[j].offset);
    skeleton.radii[j] = user.joints[j].radius;
    const std::array<Quaternion, 4> ends = ends_of(user.joints[j]);
    for (std::size_t end = 0; end < ends.size(); ++end) skeleton.orientations[end][j] = ends[end];
  }
  HandModel out = fitted(hand, skeleton);
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    const Finger finger = finger_of(body);
    if (finger == Finger::palm || finger == Finger::thumb || is_metacarpal(body)) continue;
    const auto joint = static_cast<std::size_t>(index_of(joint_of(body)));
    const auto parent = static_cast<std::size_t>(index_of(joint_of(parent_of(body))));
    const Quaternion rest = out.rest_joints[parent].orientation.conjugate() * out.rest_joints[joint].orientation;
    double closed = 0;
    for (const auto& end : skeleton.orientations)
      closed = std::min(closed, rotation_log(rest.conjugate() * end[joint]).x());
    out.bodies[b].joint.flexion_range[0] = closed;
  }
  return out;
}

std::filesystem::path user_hand_path(const HandKey& hand) {
  const auto folder = [](const char* variable) {
    const char* const value = std::getenv(variable);
    return value != nullptr && *value == '/' ? std::filesystem::path(value) : std::filesystem::path();
  };
  std::filesystem::path data = folder("XDG_DATA_HOME");
  if (data.empty()) {
    if (folder("HOME").empty()) return {};
    data = folder("HOME") / ".local/share";
  }
  return data / "softhand/users" / (std::to_string(hand.user) + (hand.side == 0 ? "-left.toml" : "-right.toml"));
}

}  // namespace softhand
