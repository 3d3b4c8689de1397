// softhand-tracker-openxr: both hands and the head from an OpenXR runtime with XR_EXT_hand_tracking.
#include <cstdio>

#include "device/device_thread.hpp"
#include "device/packet_tracker.hpp"
#include "service/tracker_service.hpp"
#include "trackers/openxr/openxr_hands.hpp"
#include "trackers/openxr/openxr_session.hpp"

namespace {
using namespace softhand;

class OpenXrTracker final : public PacketTracker<OpenXrDecoder, DeviceThread> {
 public:
  explicit OpenXrTracker(const OpenXrOptions& options) : PacketTracker(OpenXrDecoder(), sizeof(OpenXrFrame)) {
    std::printf("asking the OpenXR runtime, %g times a second\n", options.rate);
    std::fflush(stdout);
    receiver_.start(openxr_session(options));
  }
};
}  // namespace

int main(int argc, char** argv) {
  return run_tracker(argc, argv,
                     {.name = "openxr",
                      .about = "Tracker that receives both hands and the head from an OpenXR runtime",
                      .make_source = [](const Scene& scene, const bus::Participant&) {
                        return std::make_unique<OpenXrTracker>(driver_options<OpenXrOptions>(scene.options));
                      }});
}
