// Drivers register themselves. No list of drivers exists. The file driver.cpp in the folder of a driver has, as an
// example, `const RegisterDriver<StreamerOptions> driver{"tracker_streamer", "Hand Tracking Streamer on a Quest."};`.
//
// 1. The template argument is the type of its options.
// 2. The first argument is its section of the scene file.
// 3. The second argument is one line about it.
// 4. The third argument may be a function from the options to checks. `softhand doctor` runs these checks.
//
// The program of a driver links only its own driver.cpp. `softhand` links those of all drivers in this repository, so
// that it can check their sections and print their options (docs/add-a-tracker.md).
#pragma once

#include <any>
#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "device/driver_check.hpp"
#include "runtime/options.hpp"

namespace softhand {

/// The options of one driver: any struct with a `describe`. A copy has its own values.
class DriverOptions {
 public:
  template <typename Options>
  static DriverOptions of() {
    DriverOptions out;
    out.value_ = Options{};
    out.describe_ = [](OptionVisitor& v, std::any& value) { describe(v, *std::any_cast<Options>(&value)); };
    return out;
  }
  /// The options, or null if they are of another type.
  template <typename Options>
  const Options* as() const {
    return std::any_cast<Options>(&value_);
  }
  friend void describe(OptionVisitor& v, DriverOptions& o) { o.describe_(v, o.value_); }

 private:
  std::any value_;
  void (*describe_)(OptionVisitor&, std::any&) = nullptr;
};

struct Driver {
  std::string about;  ///< one line: which devices it drives
  DriverOptions options;
  /// What the driver finds with these options. Null: it needs nothing.
  std::function<DriverChecks(const DriverOptions&)> check{};
};
/// By section of the scene file: "tracker_streamer" is the section of softhand-tracker-streamer.
using Drivers = std::map<std::string, Driver>;

/// The drivers that are linked into this program, with default options. Throws std::invalid_argument if the section of
/// a driver does not begin with its kind: `is_driver_section`.
const Drivers& registered_drivers();

/// True if `key` begins with `tracker_`, `haptic_` or `tactile_`. Only drivers have such sections. A program ignores
/// the sections of drivers that it does not know.
bool is_driver_section(std::string_view key);
/// softhand-tracker-streamer for the section tracker_streamer.
std::string driver_program(std::string section);

namespace device_detail {
void add_driver(std::string section, Driver driver);
}

template <typename Options>
struct RegisterDriver {
  RegisterDriver(std::string section, std::string about, DriverChecks (*check)(const Options&) = nullptr) {
    Driver driver{std::move(about), DriverOptions::of<Options>(), nullptr};
    if (check != nullptr)
      driver.check = [check](const DriverOptions& options) { return check(*options.as<Options>()); };
    device_detail::add_driver(std::move(section), std::move(driver));
  }
};

}  // namespace softhand
