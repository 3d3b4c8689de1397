// The device behind the stand-in library. A test shares it with the driver's process through a file.
#pragma once

#include <array>
#include <atomic>

namespace softhand {

/// Environment variable with the path of the file. Without it, the device is present and stands still.
inline constexpr const char* kDhdStandInFile = "SOFTHAND_DHD_STAND_IN";

/// In the axes of the device: x to the user, y to the right, z up.
struct DhdStandIn {
  std::atomic<bool> is_present{true};
  std::array<std::atomic<double>, 3> position{};  // m
  std::array<std::atomic<double>, 3> force{};     // N, of the last call
  std::atomic<bool> is_enabled{false};
  std::atomic<int> opened{0}, closed{0}, forces{0};
  std::atomic<bool> was_zero_at_close{false};
};

}  // namespace softhand
