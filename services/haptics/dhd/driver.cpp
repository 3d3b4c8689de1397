#include "device/driver.hpp"

#include "device/device_loop.hpp"
#include "haptics/dhd/dhd_library.hpp"
#include "haptics/dhd/dhd_options.hpp"

namespace {
using namespace softhand;
using Options = DeviceOptions<DhdOptions>;

DriverChecks check(const Options& options) {
  const DhdOptions& own = options.driver;
  DriverChecks out;
  const auto library =
      check_library<DhdLibrary>(own.library, "Install the Force Dimension SDK, or correct `library`", out);
  if (library) {
    const int count = library->device_count();
    out.push_back({count > std::max<std::int64_t>(own.index, 0),
                   "it sees " + std::to_string(std::max(count, 0)) + (count == 1 ? " device" : " devices"),
                   "Connect the device and switch it on, or correct `index`"});
  }
  constexpr int kForceDimension = 0x1451, kNovint = 0x0403, kFalcon = 0xcb48;
  for (const DriverChecks& found : {check_usb(kForceDimension), check_usb(kNovint, kFalcon)})
    out.insert(out.end(), found.begin(), found.end());
  return out;
}

const RegisterDriver<Options> driver{"haptic_dhd", "a Force Dimension device or a Falcon, cursor and forces.", check};
}  // namespace
