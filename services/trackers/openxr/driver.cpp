#include "device/driver.hpp"

#include <cstdlib>
#include <filesystem>

#include "trackers/openxr/openxr_options.hpp"

namespace {
using namespace softhand;

// The places where the loader looks for the runtime of this machine.
std::string runtime_manifest() {
  if (const char* const chosen = std::getenv("XR_RUNTIME_JSON")) return chosen;
  const char *const config = std::getenv("XDG_CONFIG_HOME"), *const home = std::getenv("HOME");
  const std::string own = config != nullptr ? config : home != nullptr ? std::string(home) + "/.config" : "";
  for (const std::string& folder : {own, std::string("/etc/xdg"), std::string("/etc")}) {
    const std::string path = folder + "/openxr/1/active_runtime.json";
    if (std::filesystem::exists(path)) return path;
  }
  return "";
}

DriverChecks check(const OpenXrOptions&) {
  const std::string manifest = runtime_manifest();
  if (manifest.empty())
    return {{false, "no OpenXR runtime is active", "Install one that offers headless sessions, as Monado"}};
  return {check_file("the manifest of the OpenXR runtime", manifest)};
}

const RegisterDriver<OpenXrOptions> driver{"tracker_openxr", "headsets with an OpenXR runtime.", check};
}  // namespace
