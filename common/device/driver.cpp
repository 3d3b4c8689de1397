#include "device/driver.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <utility>

namespace softhand {
namespace {

// A local static exists before the first static RegisterDriver of any file needs it.
Drivers& drivers() {
  static Drivers all;
  return all;
}

}  // namespace

const Drivers& registered_drivers() {
  for (const auto& [section, driver] : drivers()) {
    if (!is_driver_section(section))
      throw std::invalid_argument("section '" + section + "' of a driver: expected tracker_, haptic_ or tactile_");
  }
  return drivers();
}

bool is_driver_section(std::string_view key) {
  constexpr std::array<std::string_view, 3> kinds{"tracker_", "haptic_", "tactile_"};
  return std::any_of(kinds.begin(), kinds.end(),
                     [&](std::string_view kind) { return key.size() > kind.size() && key.starts_with(kind); });
}

std::string driver_program(std::string section) {
  std::replace(section.begin(), section.end(), '_', '-');
  return "softhand-" + section;
}

void device_detail::add_driver(std::string section, Driver driver) {
  drivers().insert_or_assign(std::move(section), std::move(driver));
}

}  // namespace softhand
