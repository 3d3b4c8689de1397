// The device behind the stand-in library. A test shares it with the driver's process through a file.
#pragma once

#include <array>
#include <atomic>

namespace softhand {

/// Environment variable with the path of the file. Without it, the device is present and stands still.
inline constexpr const char* kHdStandInFile = "SOFTHAND_HD_STAND_IN";

struct HdStandIn {
  std::atomic<bool> is_present{true};
  std::atomic<unsigned> error{0};                 // that each frame reports
  std::atomic<unsigned> init_error{0};            // that the next opening reports, although it succeeds
  std::atomic<int> older_errors{0};               // of communication, that wait behind the newest
  std::array<std::atomic<double>, 3> position{};  // mm
  std::array<std::atomic<double>, 3> force{};     // N, of the last frame
  std::atomic<bool> is_enabled{false};
  std::atomic<int> opened{0}, closed{0}, frames{0};
  std::atomic<int> outside{0};  // calls that belong into a frame of the scheduler's thread, but were not made there
  std::atomic<bool> was_zero_at_close{false};
};

}  // namespace softhand
