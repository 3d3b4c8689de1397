// softhand-tracker-vrpn: wrists and a head from the trackers of a VRPN server.
#include <cstdio>

#include "device/packet_tracker.hpp"
#include "service/tracker_service.hpp"
#include "trackers/vrpn/vrpn_server.hpp"

namespace {
using namespace softhand;

class VrpnTracker final : public PacketTracker<VrpnDecoder> {
 public:
  explicit VrpnTracker(const VrpnOptions& options)
      : PacketTracker(VrpnDecoder(options), kLargestVrpnMessage, kVrpnSlots) {
    receiver_.connect_tcp(options.server, options.port, vrpn_packet_size, vrpn_cookie());
    std::printf("connecting to %s, TCP port %d\n", options.server.c_str(), static_cast<int>(options.port));
    std::fflush(stdout);
    receiver_.start();
  }
};
}  // namespace

int main(int argc, char** argv) {
  return run_tracker(argc, argv,
                     {.name = "vrpn",
                      .about = "Tracker that receives wrists and a head from a VRPN server",
                      .make_source = [](const Scene& scene, const bus::Participant&) {
                        return std::make_unique<VrpnTracker>(driver_options<VrpnOptions>(scene.options));
                      }});
}
