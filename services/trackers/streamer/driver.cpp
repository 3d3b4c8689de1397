#include "device/driver.hpp"

#include "trackers/streamer/streamer_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::StreamerOptions> driver{"tracker_streamer",
                                                                 "the app Hand Tracking Streamer on a Quest."};
}
