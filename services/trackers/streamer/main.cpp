// softhand-tracker-streamer: both hands and the head from the app Hand Tracking Streamer on a Quest.
#include <cstdio>

#include "device/intake.hpp"
#include "service/tracker_service.hpp"
#include "trackers/streamer/streamer.hpp"
#include "trackers/streamer/streamer_options.hpp"

namespace {
using namespace softhand;

class StreamerTracker final : public TrackerSource {
 public:
  StreamerTracker(const HandModel& hand, const StreamerOptions& options) : decoder_(hand) {
    const unsigned udp = intake_.listen_udp(options.address, options.udp_port);
    const unsigned tcp = intake_.listen_tcp(options.address, options.tcp_port, '\n');
    std::printf("listening on %s, UDP port %u and TCP port %u\n", options.address.c_str(), udp, tcp);
    std::fflush(stdout);
    intake_.start();
  }
  void poll(Nanoseconds, TrackerSink& out) override {
    intake_.take([&](const Arrival& packet) { decoder_.take(packet, out); });
  }
  SourceState state() const override {
    const Intake::Counters counters = intake_.counters();
    return {intake_.connected(), decoder_.refusals().total() + counters.refused_size + counters.refused_cut};
  }
  void fill_status(LoopStatus& status) const override {
    const Intake::Counters counters = intake_.counters();
    add_counter(status, "connections", static_cast<double>(counters.connections));
    add_counter(status, "reconnects", static_cast<double>(counters.reconnects));
    add_counter(status, "passed_over", static_cast<double>(counters.passed_over));
    add_counter(status, "refused_cut", static_cast<double>(counters.refused_cut));
    decoder_.refusals().fill_status(status, counters.refused_size);
  }

 private:
  Intake intake_{kLargestStreamerPacket};
  StreamerDecoder decoder_;
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
