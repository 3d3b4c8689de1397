// softhand-tracker-natnet: wrists and a head from rigid bodies, and hands of a skeleton, from OptiTrack's Motive.
#include <cstdio>

#include "device/packet_tracker.hpp"
#include "service/tracker_service.hpp"
#include "trackers/natnet/motive.hpp"

namespace {
using namespace softhand;

class NatNetTracker final : public PacketTracker<MotiveDecoder> {
 public:
  NatNetTracker(const HandModel& hand, const NatNetOptions& options)
      : PacketTracker(MotiveDecoder(hand, options), kLargestNatNetPacket) {
    receiver_.connect_udp(options.server, options.command_port);
    if (options.multicast) receiver_.join_udp(options.server, options.group, options.data_port, options.network);
    std::printf("asking %s, UDP port %d\n", options.server.c_str(), static_cast<int>(options.command_port));
    std::fflush(stdout);
    receiver_.start();
  }
};
}  // namespace

int main(int argc, char** argv) {
  return run_tracker(argc, argv,
                     {.name = "natnet",
                      .about = "Tracker that receives wrists, a head and hands from OptiTrack's Motive (NatNet)",
                      .make_source = [](const Scene& scene, const bus::Participant&) {
                        return std::make_unique<NatNetTracker>(load_scene_hand(scene),
                                                               driver_options<NatNetOptions>(scene.options));
                      }});
}
