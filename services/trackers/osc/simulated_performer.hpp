// What a VMC performer, or a sender of plain hands, sends for given hands. For the simulator and for tests.
#pragma once

#include <bit>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "trackers/osc/performer.hpp"

namespace softhand {

namespace osc_detail {
inline void add_text(std::string& bytes, std::string_view text) {
  bytes += text;
  bytes.append(4 - text.size() % 4, '\0');
}
inline void add_word(std::string& bytes, std::uint32_t word) {
  for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(word >> shift & 255);
}
}  // namespace osc_detail

/// A message with numbers, after a text if it is not empty.
inline std::string osc_message(std::string_view address, std::string_view text, const std::vector<double>& numbers) {
  std::string bytes;
  osc_detail::add_text(bytes, address);
  osc_detail::add_text(bytes, (text.empty() ? "," : ",s") + std::string(numbers.size(), 'f'));
  if (!text.empty()) osc_detail::add_text(bytes, text);
  for (const double number : numbers)
    osc_detail::add_word(bytes, std::bit_cast<std::uint32_t>(static_cast<float>(number)));
  return bytes;
}
inline std::string osc_bundle(const std::vector<std::string>& elements) {
  std::string bytes("#bundle\0\0\0\0\0\0\0\0\1", 16);
  for (const std::string& element : elements) {
    osc_detail::add_word(bytes, static_cast<std::uint32_t>(element.size()));
    bytes += element;
  }
  return bytes;
}
/// A pose in Unity's axes.
inline std::string vmc_pose(std::string_view address, std::string_view name, const Pose& pose) {
  const Vector3& p = pose.position;
  const Quaternion& q = pose.orientation;
  return osc_message(address, name, {p.x(), p.y(), -p.z(), -q.x(), -q.y(), q.z(), q.w()});
}

/// A plain hand: first the curls of the fingers, from the thumb to the little finger, then the wrist.
inline std::vector<std::string> plain_hand(Side side, const Pose& wrist, const std::vector<double>& curls) {
  const std::string hand = side == Side::left ? "/hand/left/" : "/hand/right/";
  const Vector3& p = wrist.position;
  const Quaternion& q = wrist.orientation;
  return {osc_message(hand + "curls", "", curls),
          osc_message(hand + "wrist", "", {p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), q.w()})};
}

/// One frame: time, root, head, trunk, arms and both hands. The joints are in the world, as OpenXR has them.
inline std::vector<std::string> performer_frame(double time, const Pose& root, const Pose& head,
                                                const std::array<JointFrames, 2>& hands) {
  std::vector<std::string> frame{osc_message("/VMC/Ext/T", "", {time}), vmc_pose("/VMC/Ext/Root/Pos", "root", root),
                                 vmc_pose("/VMC/Ext/Hmd/Pos", "head", head)};
  const auto bone = [&](const std::string& name, const Pose& local) {
    frame.push_back(vmc_pose("/VMC/Ext/Bone/Pos", name, local));
  };
  Pose chest = root;
  for (const std::string_view name : kTrunkNames) {
    const Pose local{Vector3(0, name == "Hips" ? 1 : 0.15, 0), Quaternion(Eigen::AngleAxisd(0.05, Vector3::UnitX()))};
    bone(std::string(name), local);
    chest = chest * local;
  }
  for (std::size_t side = 0; side < 2; ++side) {
    const std::string prefix = side == 0 ? "Left" : "Right";
    const auto at = [&](Joint joint) { return hands[side][static_cast<std::size_t>(index_of(joint))]; };
    Pose arm = chest;
    for (std::size_t i = 0; i + 1 < kArmBones; ++i) {
      const Pose local{Vector3(side == 0 ? -0.2 : 0.2, 0, 0), Quaternion(Eigen::AngleAxisd(0.3, Vector3::UnitZ()))};
      bone(prefix + std::string(kHandNames[i]), local);
      arm = arm * local;
    }
    bone(prefix + "Hand", arm.inverse() * at(Joint::wrist));
    for (std::size_t i = 0; i < kFingerBones; ++i) {
      const Joint joint = joint_of_landmark(1 + i / 3 * 4 + i % 3);
      const Pose parent = i % 3 == 0 ? at(Joint::wrist) : at(joint_of_landmark(i / 3 * 4 + i % 3));
      bone(prefix + std::string(kHandNames[kArmBones + i]), parent.inverse() * at(joint));
    }
  }
  return frame;
}

}  // namespace softhand
