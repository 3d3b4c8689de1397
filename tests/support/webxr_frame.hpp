// A frame as a headset's page sends it (services/trackers/webxr/README.md).
#pragma once

#include <cstdint>
#include <cstring>
#include <string>

namespace softhand::testing {

/// Offsets in bytes.
struct WebXrPlace {
  static constexpr std::size_t head = 24;
  static constexpr std::size_t right_mask = 24 + 32 + 804;
  static constexpr std::size_t right_joints = right_mask + 4;
};

/// The head is 1.6 m up. Joint j (1 to 25) of each hand is at z = -j cm, and at x = -0.2 m on the left and 0.2 m on the
/// right. Times are in ms.
inline std::string webxr_frame(double taken, double sent, std::uint32_t left = 0x1ffffff,
                               std::uint32_t right = 0x1ffffff) {
  std::string bytes;
  const auto add = [&bytes](auto value) {
    char raw[sizeof value];
    std::memcpy(raw, &value, sizeof value);
    bytes.append(raw, sizeof value);
  };
  const auto add_pose = [&add](float x, float y, float z) {
    for (const float value : {x, y, z, 0.0f, 0.6f, 0.0f, 0.8f}) add(value);
  };
  bytes = "SHXR";
  add(std::uint16_t{1});
  add(std::uint16_t{0});
  add(taken);
  add(sent);
  add(std::uint32_t{1});
  add_pose(0, 1.6f, 0);
  for (const std::uint32_t side : {0u, 1u}) {
    add(side == 0 ? left : right);
    for (int j = 1; j < 26; ++j) {
      add_pose(side == 0 ? -0.2f : 0.2f, 1, -0.01f * static_cast<float>(j));
      add(0.008f);
    }
  }
  return bytes;
}

}  // namespace softhand::testing
