// A library in place of Ultraleap's LeapC. It has two hands at 100 Hz while the file in the environment variable
// STAND_IN_SERVICE exists: this file is the service.
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <thread>

#include "trackers/leap/leapc.hpp"

namespace {
using namespace softhand::leapc;

struct State {
  bool is_open = false, is_connected = false;
  std::int32_t mode = -1;
  std::uint64_t policy = 0;
  std::int64_t frame = 0;
  std::array<Hand, 2> hands{};
  TrackingEvent event{};
};

std::int64_t microseconds() {
  using namespace std::chrono;
  return duration_cast<std::chrono::microseconds>(steady_clock::now().time_since_epoch()).count() - 5'000'000;
}
bool service_runs() {
  const char* const file = std::getenv("STAND_IN_SERVICE");
  return file != nullptr && access(file, F_OK) == 0;
}
void set(float* to, float x, float y, float z) { to[0] = x, to[1] = y, to[2] = z; }

// Straight fingers, 25 mm a bone, at a height of 200 mm.
Hand hand_at(std::int32_t type, float x) {
  Hand hand{};
  hand.type = type;
  hand.confidence = 1;
  set(hand.palm.position, x, 200, -40);
  set(hand.palm.normal, 0, -1, 0);
  set(hand.palm.direction, 0, 0, -1);
  hand.palm.orientation[3] = 1;
  set(hand.arm.next_joint, x, 200, 0);
  for (int finger = 0; finger < 5; ++finger) {
    const float side = static_cast<float>(finger - 2) * (type == 0 ? -20.0f : 20.0f);
    float z = -10;
    for (int k = 0; k < 4; ++k) {
      Bone& bone = hand.digits[finger].bones[k];
      const float length = finger == 0 && k == 0 ? 0.0f : k == 0 ? 60.0f : 25.0f;
      set(bone.previous_joint, x + side, 200, z);
      z -= length;
      set(bone.next_joint, x + side, 200, z);
      bone.rotation[3] = 1;
      bone.width = 16;
    }
  }
  return hand;
}

}  // namespace

extern "C" {

std::uint32_t LeapCreateConnection(const void*, Connection* out) {
  *out = new State;
  return kSuccess;
}
std::uint32_t LeapOpenConnection(Connection connection) {
  static_cast<State*>(connection)->is_open = true;
  return kSuccess;
}
std::uint32_t LeapPollConnection(Connection connection, std::uint32_t timeout, Message* out) {
  State& state = *static_cast<State*>(connection);
  if (!state.is_open) return kNotConnected;
  *out = {sizeof *out, 0, nullptr, 0};
  if (!service_runs()) {
    if (state.is_connected) {
      out->type = kConnectionLost;
      state.is_connected = false;
      return kSuccess;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(timeout));
    return kTimeout;
  }
  if (!state.is_connected) {
    state.is_connected = true;
    out->type = kConnected;
    return kSuccess;
  }
  // Without the background policy a program gets no frames.
  if ((state.policy & kBackgroundFrames) == 0 || state.mode != 0) {
    std::this_thread::sleep_for(std::chrono::milliseconds(timeout));
    return kTimeout;
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(10));
  state.hands = {hand_at(0, -100), hand_at(1, 100)};
  ++state.frame;
  state.event = {nullptr, state.frame, microseconds(), state.frame, 2, state.hands.data(), 100};
  out->type = kTracking;
  out->event = &state.event;
  return kSuccess;
}
std::uint32_t LeapSetTrackingMode(Connection connection, std::int32_t mode) {
  static_cast<State*>(connection)->mode = mode;
  return kSuccess;
}
std::uint32_t LeapSetPolicyFlags(Connection connection, std::uint64_t set, std::uint64_t clear) {
  State& state = *static_cast<State*>(connection);
  state.policy = (state.policy | set) & ~clear;
  return kSuccess;
}
std::int64_t LeapGetNow() { return microseconds(); }
void LeapCloseConnection(Connection connection) { static_cast<State*>(connection)->is_open = false; }
void LeapDestroyConnection(Connection connection) { delete static_cast<State*>(connection); }

}  // extern "C"
