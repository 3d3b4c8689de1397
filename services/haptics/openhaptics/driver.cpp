#include "device/driver.hpp"

#include "device/device_loop.hpp"
#include "haptics/openhaptics/hd_library.hpp"
#include "haptics/openhaptics/openhaptics_options.hpp"

namespace {
using namespace softhand;
using Options = DeviceOptions<OpenHapticsOptions>;

DriverChecks check(const Options& options) {
  const OpenHapticsOptions& own = options.driver;
  DriverChecks out;
  const auto library = check_library<HdLibrary>(own.library, "Install OpenHaptics, or correct `library`", out);
  if (library) {
    // HD does not count devices.
    unsigned error = 0;
    const unsigned device = library->open(own.device, error);
    if (device != HdLibrary::kNoDevice) library->disable_device(device);
    const std::string name = own.device.empty() ? "the default device" : "device '" + own.device + "'";
    std::array<char, 16> code{};
    std::snprintf(code.data(), code.size(), "0x%04x", error);
    const bool is_open = device != HdLibrary::kNoDevice;
    out.push_back({is_open, name + (is_open ? " can be opened" : ": HD error " + std::string(code.data())),
                   "Connect the device, set it up with the vendor's tool, and end other programs that use it"});
  }
  constexpr int kTouch = 0x2988;
  const DriverChecks found = check_usb(kTouch);
  out.insert(out.end(), found.begin(), found.end());
  return out;
}

const RegisterDriver<Options> driver{"haptic_openhaptics", "a Touch or Phantom of 3D Systems, cursor and forces.",
                                     check};
}  // namespace
