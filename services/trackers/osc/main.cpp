// softhand-tracker-osc: hands and head from a VMC performer, head and wrists from OSC trackers, and plain hands.
#include <cstdio>

#include "device/packet_tracker.hpp"
#include "service/tracker_service.hpp"
#include "trackers/osc/performer.hpp"

namespace {
using namespace softhand;

class OscTracker final : public PacketTracker<PerformerDecoder> {
 public:
  OscTracker(const HandModel& hand, const OscOptions& options)
      : PacketTracker(PerformerDecoder(hand, options), kLargestOscPacket, kOscSlots) {
    std::printf("listening on UDP port %u\n", receiver_.listen_udp(options.address, options.port));
    std::fflush(stdout);
    receiver_.start();
  }
};
}  // namespace

int main(int argc, char** argv) {
  return run_tracker(argc, argv,
                     {.name = "osc",
                      .about = "Tracker that receives VMC, OSC trackers and plain OSC hands",
                      .make_source = [](const Scene& scene, const bus::Participant&) {
                        return std::make_unique<OscTracker>(load_scene_hand(scene),
                                                            driver_options<OscOptions>(scene.options));
                      }});
}
