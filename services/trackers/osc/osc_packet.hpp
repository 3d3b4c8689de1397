// Packets of Open Sound Control 1.0: messages and bundles of messages.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string_view>

namespace softhand {

struct OscMessage {
  std::string_view address;
  std::string_view text;            ///< the first string argument; empty without one
  std::array<float, 16> numbers{};  ///< the first arguments of type f
  std::size_t count = 0;            ///< of these
};

/// Calls `take` for each message of the packet, in order. Bundles may be nested four deep. If any part of the packet is
/// malformed, returns false and calls nothing. Does not allocate.
bool read_osc(std::string_view packet, const std::function<void(const OscMessage&)>& take);

}  // namespace softhand
