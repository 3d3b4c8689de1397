// Hands and a head from what an OpenXR runtime locates (README.md). Nothing of OpenXR is included here.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <type_traits>

#include "device/arrival_queue.hpp"
#include "device/refusals.hpp"
#include "device/sample_stamps.hpp"
#include "device/tracker_source.hpp"

namespace softhand {

// XrHandJointLocationEXT and XrHandJointVelocityEXT, to the byte.
struct OpenXrJoint {
  std::uint64_t flags = 0;  ///< XrSpaceLocationFlags: 1, 2 orientation, position valid; 4, 8 tracked
  std::array<float, 4> orientation{0, 0, 0, 1};  ///< xyzw
  std::array<float, 3> position{};               ///< m
  float radius = 0;                              ///< m
};
struct OpenXrVelocity {
  std::uint64_t flags = 0;                   ///< XrSpaceVelocityFlags: 1, 2 linear, angular valid
  std::array<float, 3> linear{}, angular{};  ///< m/s, rad/s; axes of the space
};

struct OpenXrHand {
  bool is_active = false;                         ///< else the joints mean nothing
  bool is_from_controller = false;                ///< the runtime guesses the fingers of a hand that holds a controller
  std::array<OpenXrJoint, kJointCount> joints{};  ///< in the order of `Joint`
  std::array<OpenXrVelocity, kJointCount> velocities{};
};
/// Plain bytes, which wait in an ArrivalQueue.
struct OpenXrFrame {
  Nanoseconds time = 0;               ///< of the poses, our clock
  OpenXrJoint head;                   ///< without a radius
  std::array<OpenXrHand, 2> hands{};  ///< left, right

  std::string_view bytes() const { return {reinterpret_cast<const char*>(this), sizeof *this}; }
};
static_assert(std::is_trivially_copyable_v<OpenXrFrame>);

enum class OpenXrRefusal : std::uint8_t { none, content, order };
inline constexpr std::array<std::string_view, 3> kOpenXrRefusalNames{"none", "content", "order"};

class OpenXrDecoder {
 public:
  /// The packet is the bytes of an OpenXrFrame. Does not allocate.
  void take(const Arrival& packet, TrackerSink& out);
  const Refusals<OpenXrRefusal, kOpenXrRefusalNames.size()>& refusals() const { return refusals_; }

 private:
  OpenXrRefusal take_frame(const Arrival& packet, TrackerSink& out);
  // Fills joints and confidence. Returns false if a valid joint has no pose.
  static bool read_hand(const OpenXrHand& from, Skeleton& out);

  Nanoseconds newest_ = 0;
  SampleStamps stamps_;
  std::array<Skeleton, 2> hands_;
  HeadPose head_;
  Refusals<OpenXrRefusal, kOpenXrRefusalNames.size()> refusals_{kOpenXrRefusalNames};
};

}  // namespace softhand
