#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "cli/commands.hpp"
#include "device/driver.hpp"
#include "runtime/config.hpp"
#include "scene_file.hpp"

namespace softhand {
namespace {

// "natnet" of "tracker_natnet".
std::string_view device_of(std::string_view section) { return section.substr(section.find('_') + 1); }

SceneOptions options_of(const DoctorArguments& arguments) {
  if (!arguments.scene.empty()) return read_scene(arguments.scene, arguments.overrides).options;
  SceneOptions options;
  for (const std::string& assignment : arguments.overrides) apply_override(options, assignment);
  return options;
}

}  // namespace

int run_doctor(const DoctorArguments& arguments) {
  const SceneOptions options = options_of(arguments);
  if (arguments.device.empty()) {
    for (const auto& [section, driver] : options.drivers)
      fmt::print("{:<12} {:<18} {}\n", device_of(section), section, driver.about);
    return 0;
  }
  int bad = 0, known = 0;
  for (const auto& [section, driver] : options.drivers) {
    if (section != arguments.device && device_of(section) != arguments.device) continue;
    ++known;
    const DriverChecks checks = driver.check ? driver.check(driver.options) : DriverChecks{};
    fmt::print("[{}]\n", section);
    if (checks.empty()) fmt::print("  ok       it needs nothing on this machine\n");
    for (const DriverCheck& check : checks) {
      fmt::print("  {:<8} {}\n", check.is_good ? "ok" : "missing", check.found);
      if (!check.is_good) fmt::print("           {}\n", check.advice);
      bad += check.is_good ? 0 : 1;
    }
  }
  if (known == 0)
    throw std::runtime_error("no driver '" + arguments.device + "'; `softhand doctor` lists those of this build");
  return bad == 0 ? 0 : 1;
}

}  // namespace softhand
