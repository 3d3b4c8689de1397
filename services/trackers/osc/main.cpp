// softhand-tracker-osc: hands and head from a VMC performer, head and wrists from OSC trackers.
#include <cstdio>

#include "device/intake.hpp"
#include "service/tracker_service.hpp"
#include "trackers/osc/performer.hpp"

namespace {
using namespace softhand;

class OscTracker final : public TrackerSource {
 public:
  OscTracker(const HandModel& hand, const OscOptions& options) : decoder_(hand, options) {
    std::printf("listening on UDP port %u\n", intake_.listen_udp(options.address, options.port));
    std::fflush(stdout);
    intake_.start();
  }
  void poll(Nanoseconds, TrackerSink& out) override {
    intake_.take([&](const Arrival& packet) { decoder_.take(packet, out); });
  }
  SourceState state() const override {
    return {intake_.connected(), decoder_.refusals().total() + intake_.counters().refused_size};
  }
  void fill_status(LoopStatus& status) const override {
    const Intake::Counters counters = intake_.counters();
    add_counter(status, "passed_over", static_cast<double>(counters.passed_over));
    decoder_.refusals().fill_status(status, counters.refused_size);
  }

 private:
  Intake intake_{kLargestOscPacket, kOscSlots};
  PerformerDecoder decoder_;
};
}  // namespace

int main(int argc, char** argv) {
  return run_tracker(argc, argv,
                     {.name = "osc",
                      .about = "Tracker that receives VMC and OSC trackers",
                      .make_source = [](const Scene& scene, const bus::Participant&) {
                        return std::make_unique<OscTracker>(load_scene_hand(scene),
                                                            driver_options<OscOptions>(scene.options));
                      }});
}
