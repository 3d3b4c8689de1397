// What OptiTrack's Motive sends, in NatNet 3.0 to 4.1. For its simulator and for tests.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <vector>

#include "device/landmark_lifter.hpp"
#include "device/packet_bytes.hpp"
#include "trackers/natnet/motive.hpp"
#include "trackers/natnet/natnet_packet.hpp"

namespace softhand {

/// What one frame shows.
struct MotiveScene {
  struct Skeleton {
    std::int32_t id = 0;
    std::vector<NatNetBody> bones;  ///< with the IDs of the definition
  };
  std::int32_t number = 1;
  std::vector<NatNetBody> bodies;
  std::vector<Skeleton> skeletons;
  bool has_extras = false;               ///< markers, a force plate, a device and, from 4.1 on, an asset too
  double time = 0;                       ///< s
  std::array<std::uint64_t, 3> ticks{};  ///< exposure, received, transmit
  std::uint16_t parameters = 0;
};

namespace motive_detail {
using Writer = PacketWriter<std::endian::little>;

inline void add_floats(Writer& out, int count, float value) {
  for (int i = 0; i < count; ++i) out.add(value);
}
inline void add_body(Writer& out, const NatNetBody& body, std::int32_t skeleton) {
  out.add(body.id | skeleton << 16);
  for (const double value : body.pose.position) out.add(static_cast<float>(value));
  for (const double value : body.pose.orientation.coeffs()) out.add(static_cast<float>(value));
  out.add(0.0005f).add(static_cast<std::uint16_t>(body.is_tracked ? 1 : 0));
}
inline void add_section(Writer& out, NatNetVersion version, std::size_t count, const std::string& items) {
  out.add(static_cast<std::int32_t>(count));
  if (version >= NatNetVersion{4, 1}) out.add(static_cast<std::int32_t>(items.size()));
  out.bytes += items;
}
inline std::string labelled_marker() {
  Writer out;
  out.add(std::int32_t{0x20001});
  add_floats(out, 4, 0.01f);
  return out.add(std::uint16_t{10}).add(0.001f).bytes;
}
inline std::string body_definition(NatNetVersion version, std::string_view name, std::int32_t id, std::int32_t parent) {
  Writer out;
  out.add_text(name).add(id).add(parent);
  add_floats(out, 3, 0);
  out.add(std::int32_t{1});
  add_floats(out, 3, 0.02f);
  out.add(std::int32_t{1});
  if (version >= NatNetVersion{4, 0}) out.add_text("Marker1");
  return out.bytes;
}
}  // namespace motive_detail

inline std::string motive_frame(NatNetVersion version, const MotiveScene& scene) {
  using namespace motive_detail;
  Writer out, sets, markers, bodies, skeletons, assets, labelled, plates;
  const std::size_t extras = scene.has_extras ? 1 : 0;
  if (scene.has_extras) {
    sets.add_text("all").add(std::int32_t{2});
    add_floats(sets, 6, 0.5f);
    add_floats(markers, 3, 0.25f);
    assets.add(std::int32_t{7}).add(std::int32_t{1});
    add_body(assets, {1, {}, true}, 0);
    assets.add(std::int32_t{1});
    assets.bytes += labelled_marker();
    labelled.bytes = labelled_marker();
    plates.add(std::int32_t{3}).add(std::int32_t{2});
    for (int i = 0; i < 2; ++i) plates.add(std::int32_t{2}), add_floats(plates, 2, 9.81f);
  }
  for (const NatNetBody& body : scene.bodies) add_body(bodies, body, 0);
  for (const MotiveScene::Skeleton& skeleton : scene.skeletons) {
    skeletons.add(skeleton.id).add(static_cast<std::int32_t>(skeleton.bones.size()));
    for (const NatNetBody& bone : skeleton.bones) add_body(skeletons, bone, skeleton.id);
  }
  out.add(scene.number);
  add_section(out, version, extras, sets.bytes);
  add_section(out, version, extras, markers.bytes);
  add_section(out, version, scene.bodies.size(), bodies.bytes);
  add_section(out, version, scene.skeletons.size(), skeletons.bytes);
  if (version >= NatNetVersion{4, 1}) add_section(out, version, extras, assets.bytes);
  add_section(out, version, extras, labelled.bytes);
  add_section(out, version, extras, plates.bytes);
  add_section(out, version, extras, plates.bytes);  // devices have the same form
  out.add(std::int32_t{0}).add(std::int32_t{0}).add(scene.time);
  for (const std::uint64_t ticks : scene.ticks) out.add(ticks);
  if (version >= NatNetVersion{4, 1}) out.add(std::int32_t{0}).add(std::int32_t{0});
  out.add(scene.parameters).add(std::int32_t{0});
  return natnet_packet(NatNetMessage::frame, out.bytes);
}

/// The bones of the simulated skeleton, after the name of the skeleton.
struct MotiveBone {
  std::string name;
  std::int32_t id, parent;
};
inline std::vector<MotiveBone> motive_bones() {
  std::vector<MotiveBone> bones{{"Hip", 1, 0}, {"Ab", 2, 1}, {"Chest", 3, 2}, {"Neck", 4, 3}, {"Head", 5, 4}};
  for (const char* side : {"L", "R"}) {
    std::int32_t parent = 3;
    const auto add = [&](const std::string& name) {
      bones.push_back({side + name, static_cast<std::int32_t>(bones.size()) + 1, parent});
      parent = bones.back().id;
    };
    for (const char* name : {"Shoulder", "UArm", "FArm", "Hand"}) add(name);
    const std::int32_t hand = parent;
    for (const char* finger : {"Thumb", "Index", "Middle", "Ring", "Pinky"}) {
      parent = hand;
      for (const char* number : {"1", "2", "3"}) add(std::string(finger) + number);
    }
  }
  return bones;
}

/// Model definitions: a marker set, a rigid body, the skeleton and, with `has_extras`, a force plate, a device, a
/// camera and, from 4.1 on, an asset.
inline std::string motive_models(NatNetVersion version, const std::string& skeleton, std::int32_t skeleton_id,
                                 bool has_extras = false) {
  using namespace motive_detail;
  Writer out;
  std::int32_t count = 0;
  const auto add = [&](std::int32_t type, const std::string& model) {
    out.add(type);
    if (version >= NatNetVersion{4, 1}) out.add(static_cast<std::int32_t>(model.size()));
    out.bytes += model;
    ++count;
  };
  Writer set;
  add(0, set.add_text("all").add(std::int32_t{1}).add_text("Marker1").bytes);
  add(1, body_definition(version, "Wrist", 1, -1));
  Writer model;
  const auto bones = motive_bones();
  model.add_text(skeleton).add(skeleton_id).add(static_cast<std::int32_t>(bones.size()));
  for (const MotiveBone& bone : bones)
    model.bytes += body_definition(version, skeleton + "_" + bone.name, bone.id, bone.parent);
  add(2, model.bytes);
  if (has_extras) {
    Writer plate, device, camera, asset;
    plate.add(std::int32_t{1}).add_text("serial");
    add_floats(plate, 2 + 3 + 144 + 12, 1);
    add(3, plate.add(std::int32_t{0}).add(std::int32_t{0}).add(std::int32_t{1}).add_text("Fx").bytes);
    device.add(std::int32_t{1}).add_text("device").add_text("serial").add(std::int32_t{0}).add(std::int32_t{0});
    add(4, device.add(std::int32_t{1}).add_text("channel").bytes);
    camera.add_text("camera");
    add_floats(camera, 7, 0.5f);
    add(5, camera.bytes);
    if (version >= NatNetVersion{4, 1}) add(6, asset.add_text("of a kind that nobody knows").bytes);
  }
  Writer head;
  head.add(count);
  return natnet_packet(NatNetMessage::models, head.bytes + out.bytes);
}

inline std::string motive_server_info(NatNetVersion version, std::uint64_t ticks_per_second,
                                      bool is_multicast = false) {
  motive_detail::Writer out;
  out.add_padded("Motive", 256).add(std::uint8_t{3}).add(std::uint8_t{0}).add(std::uint16_t{0});
  out.add(static_cast<std::uint8_t>(version.major)).add(static_cast<std::uint8_t>(version.minor));
  out.add(std::uint16_t{0}).add(ticks_per_second).add(std::uint16_t{1511});
  out.add(static_cast<std::uint8_t>(is_multicast ? 1 : 0)).add(std::uint8_t{239}).add(std::uint8_t{255});
  out.add(std::uint8_t{42}).add(std::uint8_t{99});
  return natnet_packet(NatNetMessage::server_info, out.bytes);
}

/// The skeleton with these hands (in the world, as OpenXR has them). The axes of its bones are turned against OpenXR's.
/// Local: each pose in the frame of the parent.
inline std::vector<NatNetBody> motive_skeleton(const std::array<JointFrames, 2>& hands, bool is_local) {
  const Pose other_axes{Vector3::Zero(), Quaternion(Eigen::AngleAxisd(1.2, Vector3(1, 2, 3).normalized()))};
  std::vector<NatNetBody> out;
  std::vector<Pose> poses;
  for (const MotiveBone& bone : motive_bones()) {
    Pose pose{Vector3(0.1 * bone.id, 1, 0), Quaternion(Eigen::AngleAxisd(0.2 * bone.id, Vector3::UnitY()))};
    if (const auto place = bone_of_hand(bone.name)) {
      const JointFrames& joints = hands[static_cast<std::size_t>(place->side)];
      const std::size_t landmark =
          place->finger < 0 ? 0 : static_cast<std::size_t>(1 + 4 * place->finger + place->joint);
      pose = joints[static_cast<std::size_t>(index_of(joint_of_landmark(landmark)))] * other_axes;
    }
    poses.push_back(pose);
    if (is_local && bone.parent != 0) pose = poses[static_cast<std::size_t>(bone.parent) - 1].inverse() * pose;
    out.push_back({bone.id, pose, true});
  }
  return out;
}

/// The server's answer to a packet of a client; empty if it has none.
inline std::string motive_answer(std::string_view packet, NatNetVersion version, std::uint64_t ticks,
                                 std::uint64_t ticks_per_second, const std::string& models, bool is_multicast) {
  const auto request = read_natnet(packet);
  if (!request) return "";
  motive_detail::Writer out;
  switch (request->message) {
    case NatNetMessage::connect:
      return motive_server_info(version, ticks_per_second, is_multicast);
    case NatNetMessage::request_models:
      return models;
    case NatNetMessage::echo_request:
      out.bytes = request->payload;
      return natnet_packet(NatNetMessage::echo_response, out.add(ticks).bytes);
    case NatNetMessage::request:
      return natnet_packet(NatNetMessage::response, std::string(4, '\0'));
    default:
      return "";
  }
}

}  // namespace softhand
