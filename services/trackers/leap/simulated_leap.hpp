// What an Ultraleap service sends by WebSocket, or LeapC delivers, for given hands. For its simulator and for tests.
#pragma once

#include <algorithm>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "model/hand_model.hpp"
#include "trackers/leap/leapc.hpp"

namespace softhand {

enum class LeapService {
  old,      ///< the vendor's up to version 3: left hands have bases with determinant -1
  current,  ///< Ultraleap's own server for later services: determinant +1
  beta,     ///< frames of recordings: no bases, metacarpals, tips of bones and wrists
};

inline constexpr const char* kLeapServiceGreeting = R"({"version":6})";

/// A hand of the frame, in the camera's axes, as OpenXR has its joints, metres.
struct SimulatedLeapHand {
  Side side;
  JointFrames joints;
};

inline std::string leap_frame_message(std::int64_t microseconds, const std::vector<SimulatedLeapHand>& hands,
                                      LeapService service) {
  using Json = nlohmann::json;
  const auto vector = [](const Vector3& v) { return Json{v.x(), v.y(), v.z()}; };
  const auto point = [&](const Pose& pose) { return vector(1000 * pose.position); };
  Json frame{{"currentFrameRate", 110.0}, {"id", microseconds / 9000}, {"timestamp", microseconds},
             {"devices", Json::array()},  {"hands", Json::array()},    {"pointables", Json::array()}};
  std::int64_t id = 1;
  for (const SimulatedLeapHand& hand : hands) {
    const auto at = [&](int joint) -> const Pose& { return hand.joints[static_cast<std::size_t>(joint)]; };
    const Quaternion& turn = at(1).orientation;
    Json json{{"id", id},
              {"type", hand.side == Side::left ? "left" : "right"},
              {"confidence", 1.0},
              {"palmPosition", point(at(0))},
              {"palmNormal", vector(turn * -Vector3::UnitY())},
              {"direction", vector(turn * -Vector3::UnitZ())},
              {"palmVelocity", vector(Vector3::Zero())},
              {"timeVisible", 1.5}};
    if (service != LeapService::beta) json["wrist"] = point(at(1));
    frame["hands"].push_back(json);
    for (int finger = 0; finger < kFingerCount; ++finger) {
      const int tip = index_of(tip_of(static_cast<Finger>(finger)));
      Json finger_json{{"handId", id},
                       {"id", 10 * id + finger},
                       {"type", finger},
                       {"mcpPosition", point(at(tip - 3))},
                       {"pipPosition", point(at(tip - 2))},
                       {"dipPosition", point(at(tip - 1))},
                       {"tipPosition", point(at(tip))},
                       {"direction", vector(at(tip).orientation * -Vector3::UnitZ())},
                       {"extended", true},
                       {"tool", false}};
      if (service != LeapService::beta) {
        // The thumb's metacarpal has no length.
        const int first = finger == 0 ? tip - 3 : tip - 4;
        finger_json["carpPosition"] = point(at(first));
        finger_json["btipPosition"] = point(at(tip));
        finger_json["tipPosition"] = vector(1000 * (at(tip) * Vector3(0, 0, -0.005)));  // of the skin
        for (const int joint : {first, tip - 3, tip - 2, tip - 1}) {
          const Matrix3 axes = at(joint).orientation.toRotationMatrix();
          const bool is_mirrored = service == LeapService::old && hand.side == Side::left;
          finger_json["bases"].push_back(
              {vector((is_mirrored ? -1.0 : 1.0) * axes.col(0)), vector(axes.col(1)), vector(axes.col(2))});
        }
      }
      frame["pointables"].push_back(finger_json);
    }
    ++id;
  }
  return frame.dump();
}

/// Moves a hand from the axes of its wrist to a place above the camera.
inline JointFrames above_camera(JointFrames joints, double x) {
  const Pose there = Pose{Vector3(x, 0.2, 0.05), Quaternion::Identity()} * joints[1].inverse();
  for (Pose& joint : joints) joint = there * joint;
  return joints;
}

/// A hand as LeapC has it, in mm.
inline leapc::Hand leapc_hand(const SimulatedLeapHand& from) {
  leapc::Hand hand{};
  const auto set = [](float* to, const Vector3& v) {
    for (int i = 0; i < 3; ++i) to[i] = static_cast<float>(v[i]);
  };
  const auto turn = [](float* to, const Quaternion& q) {
    for (int i = 0; i < 4; ++i) to[i] = static_cast<float>(q.coeffs()[i]);
  };
  const JointFrames& joints = from.joints;
  hand.type = from.side == Side::left ? 0 : 1;
  hand.confidence = 1;
  const Quaternion& palm = joints[1].orientation;
  set(hand.palm.position, 1000 * joints[0].position);
  set(hand.palm.normal, palm * -Vector3::UnitY());
  set(hand.palm.direction, palm * -Vector3::UnitZ());
  turn(hand.palm.orientation, palm);
  set(hand.arm.next_joint, 1000 * joints[1].position);
  for (int finger = 0; finger < kFingerCount; ++finger) {
    const int tip = index_of(tip_of(static_cast<Finger>(finger)));
    for (int k = 0; k < 4; ++k) {
      leapc::Bone& bone = hand.digits[finger].bones[k];
      const Pose& begin = joints[static_cast<std::size_t>(finger == 0 ? std::max(tip - 3, tip - 4 + k) : tip - 4 + k)];
      const Pose& end = joints[static_cast<std::size_t>(tip - 3 + k)];
      set(bone.previous_joint, 1000 * begin.position);
      set(bone.next_joint, 1000 * end.position);
      turn(bone.rotation, begin.orientation);
      bone.width = 16;
    }
  }
  return hand;
}

}  // namespace softhand
