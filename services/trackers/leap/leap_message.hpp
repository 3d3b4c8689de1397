// Messages of the WebSocket protocol, version 6 (README.md).
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "device/arrival_queue.hpp"
#include "trackers/leap/leap_frame.hpp"

namespace softhand {

inline constexpr std::size_t kLargestLeapMessage = 65536;  ///< bytes; a frame with two hands has about 8,000

/// What a client says first: it wants frames without the focus of the desktop. Some servers compare the bytes.
std::vector<std::string> leap_greeting(bool is_on_headset);

/// Reads a message. Returns false if it is no frame, but of another known kind. Allocates.
bool read_leap_message(std::string_view text, LeapFrame& out);

/// Turns messages into the bytes of a LeapFrame, in the thread that receives them.
Translate translate_leap_messages();

}  // namespace softhand
