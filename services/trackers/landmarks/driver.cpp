#include "device/driver.hpp"

#include "trackers/landmarks/landmarks_options.hpp"

namespace {
using namespace softhand;

DriverChecks check(const LandmarksOptions& options) { return web::checks(options.listening); }

const RegisterDriver<LandmarksOptions> driver{"tracker_landmarks", "a camera.", check};
}  // namespace
