// A frame of an Ultraleap camera, from either of its interfaces.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string_view>

#include "math/types.hpp"
#include "messages/messages.hpp"
#include "model/skeleton.hpp"

namespace softhand {

enum class LeapRefusal : std::uint8_t { none, json, content, order, shape };
inline constexpr std::array<std::string_view, 5> kLeapRefusalNames{"none", "json", "content", "order", "shape"};

struct LeapBone {
  Vec3 from{}, to{};  ///< m
  Vec3 dorsal{};      ///< unit vector out of the back of the hand
  double width = 0;   ///< m; 0 = unknown
};
struct LeapHand {
  std::uint32_t side = 0;  ///< 0 left, 1 right
  double confidence = 1;
  Vec3 palm{};             ///< m
  Vec3 direction{};        ///< unit vector from the palm to the fingers
  Vec3 normal{};           ///< unit vector out of the palm
  bool has_bones = false;  ///< false: no metacarpals, wrist and dorsal vectors, as in beta frames of the protocol
  Vec3 wrist{};            ///< m
  /// Thumb to little finger; metacarpal, proximal, intermediate and distal bone. The thumb's metacarpal has no length:
  /// its other bones are, by the names of the anatomy, metacarpal, proximal and distal.
  std::array<std::array<LeapBone, 4>, kFingerCount> bones{};
};
/// Plain bytes, which wait in an ArrivalQueue. Axes of the camera: right-handed, X along it, Y out of it, Z to the user
/// on a desk.
struct LeapFrame {
  LeapRefusal refusal = LeapRefusal::none;  ///< else there is nothing else
  bool has_our_time = false;                ///< `time` is on our clock, not on that of the service
  Nanoseconds time = 0;
  std::uint32_t hand_count = 0;
  std::array<LeapHand, 2> hands{};

  std::string_view bytes() const { return {reinterpret_cast<const char*>(this), sizeof *this}; }
};
static_assert(std::is_trivially_copyable_v<LeapFrame>);

/// True if the numbers of the hand are those of a hand: finite, within 10 m, with unit vectors.
bool is_plausible(const LeapHand& hand);
/// Adds a hand. A frame with two hands of one side keeps the surer one.
void add_hand(LeapFrame& frame, const LeapHand& hand);

}  // namespace softhand
