// The part of Ultraleap's LeapC that this driver uses: layouts and functions. Loaded at run time, so that no file of
// Ultraleap is needed to build.
#pragma once

#include <cstdint>

namespace softhand::leapc {

#pragma pack(push, 1)
struct Bone {
  float previous_joint[3], next_joint[3];  // mm
  float width;                             // mm
  float rotation[4];                       // xyzw
};
struct Digit {
  std::int32_t id;
  Bone bones[4];  // metacarpal to distal
  std::uint32_t is_extended;
};
struct Palm {
  float position[3], stabilised_position[3], velocity[3], normal[3];
  float width;
  float direction[3];
  float orientation[4];
};
struct Hand {
  std::uint32_t id, flags;
  std::int32_t type;  // 0 left, 1 right
  float confidence;
  std::uint64_t visible_time;
  float pinch_distance, grab_angle, pinch_strength, grab_strength;
  Palm palm;
  Digit digits[5];  // thumb to little finger
  Bone arm;         // its end is the wrist
};
struct TrackingEvent {
  void* reserved;
  std::int64_t frame_id, timestamp, tracking_frame_id;  // us
  std::uint32_t hand_count;
  const Hand* hands;
  float rate;
};
struct Message {
  std::uint32_t size, type;
  const void* event;
  std::uint32_t device;
};
#pragma pack(pop)
static_assert(sizeof(Bone) == 44 && sizeof(Digit) == 184 && sizeof(Palm) == 80 && sizeof(Hand) == 1084);
static_assert(sizeof(TrackingEvent) == 48 && sizeof(Message) == 20);

inline constexpr std::uint32_t kConnected = 1, kConnectionLost = 2, kTracking = 0x100;  // types of messages
inline constexpr std::uint32_t kSuccess = 0, kTimeout = 0xE2010004, kNotConnected = 0xE2010005;
inline constexpr std::uint64_t kBackgroundFrames = 1;

using Connection = void*;
using CreateConnection = std::uint32_t (*)(const void* configuration, Connection*);
using OpenConnection = std::uint32_t (*)(Connection);
using PollConnection = std::uint32_t (*)(Connection, std::uint32_t milliseconds, Message*);
using SetTrackingMode = std::uint32_t (*)(Connection, std::int32_t mode);  // 0 desk, 1 headset, 2 screen
using SetPolicyFlags = std::uint32_t (*)(Connection, std::uint64_t set, std::uint64_t clear);
using GetNow = std::int64_t (*)();  // us
using CloseConnection = void (*)(Connection);
using DestroyConnection = void (*)(Connection);

}  // namespace softhand::leapc
