// softhand-tracker-streamer: both hands and the head from the app Hand Tracking Streamer on a Quest.
#include <cstdio>

#include "device/packet_tracker.hpp"
#include "service/tracker_service.hpp"
#include "trackers/streamer/streamer.hpp"
#include "trackers/streamer/streamer_options.hpp"

namespace {
using namespace softhand;

class StreamerTracker final : public PacketTracker<StreamerDecoder> {
 public:
  StreamerTracker(const HandModel& hand, const StreamerOptions& options)
      : PacketTracker(StreamerDecoder(hand), kLargestStreamerPacket) {
    const unsigned udp = receiver_.listen_udp(options.address, options.udp_port);
    const unsigned tcp = receiver_.listen_tcp(options.address, options.tcp_port, '\n');
    std::printf("listening on %s, UDP port %u and TCP port %u\n", options.address.c_str(), udp, tcp);
    std::fflush(stdout);
    receiver_.start();
  }
};
}  // namespace

int main(int argc, char** argv) {
  return run_tracker(argc, argv,
                     {.name = "streamer",
                      .about = "Tracker that receives hands and head from the app Hand Tracking Streamer on a Quest",
                      .make_source = [](const Scene& scene, const bus::Participant&) {
                        return std::make_unique<StreamerTracker>(load_scene_hand(scene),
                                                                 driver_options<StreamerOptions>(scene.options));
                      }});
}
