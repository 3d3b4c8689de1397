// Frames that a headset's page sends (README.md): checked and converted to messages of the topics.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "device/clock_mapping.hpp"
#include "messages/messages.hpp"

namespace softhand {

inline constexpr std::uint32_t kWebXrMagic = 0x52584853;  ///< "SHXR"
inline constexpr std::uint16_t kWebXrVersion = 1;
inline constexpr std::size_t kWebXrFrameSize = 1664;  ///< bytes

enum class WebXrRefusal : std::uint8_t { none, type, size, magic, version, content, order };
inline constexpr std::array<std::string_view, 7> kWebXrRefusalNames{"none",    "type",    "size", "magic",
                                                                    "version", "content", "order"};

struct WebXrSample {
  Nanoseconds sample_time = 0;    ///< the page's clock
  Nanoseconds sent = 0;           ///< the page's clock
  HeadPose head;                  ///< its `valid` says whether it was seen
  std::array<Skeleton, 2> hands;  ///< left, right; confidence 0 = not seen; user, source and stamps are not set
};

/// Decodes a frame. `out` is unchanged if the frame is refused.
WebXrRefusal decode_webxr(std::string_view bytes, WebXrSample& out);

/// Converts the times of decoded samples to our clock. Each connection has its own clock.
class WebXrClock {
 public:
  /// Stamps both hands and the head. Returns `order` if the sample is not newer than the previous one of this
  /// connection. No stamp is later than `arrival`, although browsers predict poses for the time of display.
  WebXrRefusal stamp(WebXrSample& sample, std::uint64_t connection, Nanoseconds arrival);

 private:
  ClockMapping mapping_;
  std::uint64_t connection_ = 0;
  Nanoseconds last_ = 0;
  Nanoseconds last_mapped_ = 0;
  std::uint64_t sequence_ = 0;
};

}  // namespace softhand
