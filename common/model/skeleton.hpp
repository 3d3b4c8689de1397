// The fixed anatomy: 26 OpenXR joints, 21 rigid bodies and their relations. It is the same for every hand. Sizes and
// ranges of motion are in the hand's file (hand_model.hpp).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace softhand {

inline constexpr int kJointCount = 26;
inline constexpr int kBodyCount = 21;
inline constexpr int kFingerCount = 5;

/// Largest display skin of a hand file. hand_description has room for no more.
inline constexpr std::size_t kMaxSkinVertices = 20000;
inline constexpr std::size_t kMaxSkinTriangles = 40000;

/// OpenXR's hand joints in its order (XrHandJointEXT). A joint has the name of the bone on its distal side. Its frame
/// has -Z along that bone towards the tip and +Y dorsal, on both hands.
enum class Joint : std::uint8_t {
  palm,
  wrist,
  thumb_metacarpal,
  thumb_proximal,
  thumb_distal,
  thumb_tip,
  index_metacarpal,
  index_proximal,
  index_intermediate,
  index_distal,
  index_tip,
  middle_metacarpal,
  middle_proximal,
  middle_intermediate,
  middle_distal,
  middle_tip,
  ring_metacarpal,
  ring_proximal,
  ring_intermediate,
  ring_distal,
  ring_tip,
  little_metacarpal,
  little_proximal,
  little_intermediate,
  little_distal,
  little_tip,
};

/// The rigid bodies of the skeleton. `carpus` and `forearm` are rigid in the wrist joint's frame. `forearm` lies on the
/// proximal side of the wrist.
enum class Body : std::uint8_t {
  forearm,
  carpus,
  thumb_metacarpal,
  thumb_proximal,
  thumb_distal,
  index_metacarpal,
  index_proximal,
  index_intermediate,
  index_distal,
  middle_metacarpal,
  middle_proximal,
  middle_intermediate,
  middle_distal,
  ring_metacarpal,
  ring_proximal,
  ring_intermediate,
  ring_distal,
  little_metacarpal,
  little_proximal,
  little_intermediate,
  little_distal,
};

enum class Side : std::uint8_t { left = 0, right = 1 };

/// The digits, thumb first; `palm` for bodies of no digit (forearm, carpus).
enum class Finger : std::uint8_t { thumb, index, middle, ring, little, palm };

inline constexpr std::array<std::string_view, kJointCount> kJointNames{"palm",
                                                                       "wrist",
                                                                       "thumb_metacarpal",
                                                                       "thumb_proximal",
                                                                       "thumb_distal",
                                                                       "thumb_tip",
                                                                       "index_metacarpal",
                                                                       "index_proximal",
                                                                       "index_intermediate",
                                                                       "index_distal",
                                                                       "index_tip",
                                                                       "middle_metacarpal",
                                                                       "middle_proximal",
                                                                       "middle_intermediate",
                                                                       "middle_distal",
                                                                       "middle_tip",
                                                                       "ring_metacarpal",
                                                                       "ring_proximal",
                                                                       "ring_intermediate",
                                                                       "ring_distal",
                                                                       "ring_tip",
                                                                       "little_metacarpal",
                                                                       "little_proximal",
                                                                       "little_intermediate",
                                                                       "little_distal",
                                                                       "little_tip"};

inline constexpr std::array<std::string_view, kBodyCount> kBodyNames{"forearm",          "carpus",
                                                                     "thumb_metacarpal", "thumb_proximal",
                                                                     "thumb_distal",     "index_metacarpal",
                                                                     "index_proximal",   "index_intermediate",
                                                                     "index_distal",     "middle_metacarpal",
                                                                     "middle_proximal",  "middle_intermediate",
                                                                     "middle_distal",    "ring_metacarpal",
                                                                     "ring_proximal",    "ring_intermediate",
                                                                     "ring_distal",      "little_metacarpal",
                                                                     "little_proximal",  "little_intermediate",
                                                                     "little_distal"};

inline constexpr std::array<std::string_view, 6> kFingerNames{"thumb", "index", "middle", "ring", "little", "palm"};

constexpr int index_of(Joint joint) { return static_cast<int>(joint); }
constexpr int index_of(Body body) { return static_cast<int>(body); }
/// Its index in an array of the standard library that has one element per joint or body.
constexpr std::size_t slot_of(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }
constexpr std::size_t slot_of(Body body) { return static_cast<std::size_t>(index_of(body)); }

/// The joint whose frame moves with the body: its own proximal joint; the wrist for carpus and forearm.
constexpr Joint joint_of(Body body) {
  const int b = index_of(body);
  if (b < 2) return Joint::wrist;
  if (b < 5) return static_cast<Joint>(b);  // thumb: joints 2, 3, 4
  const int finger = (b - 5) / 4;
  return static_cast<Joint>(6 + 5 * finger + (b - 5) % 4);
}

/// The body that the joint moves with: the distal phalanx for a tip, the middle metacarpal for the palm.
constexpr Body body_of(Joint joint) {
  const int j = index_of(joint);
  if (joint == Joint::palm) return Body::middle_metacarpal;
  if (joint == Joint::wrist) return Body::carpus;
  if (j < 6) return static_cast<Body>(j == 5 ? 4 : j);
  const int finger = (j - 6) / 5;
  const int k = (j - 6) % 5;
  return static_cast<Body>(5 + 4 * finger + (k == 4 ? 3 : k));
}

/// The body on the proximal side of the body's joint: the forearm for the carpus, the carpus for metacarpals. The
/// forearm is its own parent.
constexpr Body parent_of(Body body) {
  const int b = index_of(body);
  if (b < 2) return Body::forearm;
  if (b == 2 || (b >= 5 && (b - 5) % 4 == 0)) return Body::carpus;
  return static_cast<Body>(b - 1);
}

/// The next joint towards the tip, at which the body's bone ends. For the forearm: the wrist. For the carpus: the
/// middle metacarpal.
constexpr Joint end_joint_of(Body body) {
  if (body == Body::forearm) return Joint::wrist;
  if (body == Body::carpus) return Joint::middle_metacarpal;
  return static_cast<Joint>(index_of(joint_of(body)) + 1);
}

constexpr Finger finger_of(Body body) {
  const int b = index_of(body);
  if (b < 2) return Finger::palm;
  if (b < 5) return Finger::thumb;
  return static_cast<Finger>(1 + (b - 5) / 4);
}

constexpr bool is_metacarpal(Body body) {
  const int b = index_of(body);
  return b == 2 || (b >= 5 && (b - 5) % 4 == 0);
}

constexpr Joint tip_of(Finger finger) { return static_cast<Joint>(5 + 5 * static_cast<int>(finger)); }
constexpr Body distal_of(Finger finger) { return static_cast<Body>(4 + 4 * static_cast<int>(finger)); }

}  // namespace softhand
