#include "device/driver.hpp"

#include "trackers/landmarks/landmarks_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::LandmarksOptions> driver{"tracker_landmarks", "a camera."};
}
