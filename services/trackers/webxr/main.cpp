// softhand-tracker-webxr: both hands and the head of the wearer of a headset, whose browser shows the viewer's page.
#include <cstdio>

#include "device/refusals.hpp"
#include "service/tracker_service.hpp"
#include "trackers/sockets/inbox.hpp"
#include "trackers/webxr/webxr_frames.hpp"
#include "trackers/webxr/webxr_options.hpp"

namespace {
using namespace softhand;

class WebXrTracker final : public TrackerSource {
 public:
  explicit WebXrTracker(const WebXrOptions& options)
      : inbox_(options.listening, Transport::websocket, kWebXrFrameSize) {
    std::printf("listening at %s\n", inbox_.url().c_str());
    std::fflush(stdout);
  }
  void poll(Nanoseconds, TrackerSink& out) override {
    inbox_.take([&](const Arrival& arrival) {
      WebXrRefusal refusal = arrival.binary ? decode_webxr(arrival.bytes, sample_) : WebXrRefusal::type;
      if (refusal == WebXrRefusal::none) refusal = clock_.stamp(sample_, arrival.connection, arrival.time);
      if (!refusals_.accepted(refusal)) return;
      out.head(sample_.head);
      for (const Skeleton& hand : sample_.hands) out.hand(hand);
    });
  }
  SourceState state() const override {
    const Inbox::Counters counters = inbox_.counters();
    return {counters.connections > 0, refusals_.total() + counters.refused_size};
  }
  void fill_status(LoopStatus& status) const override {
    inbox_.fill_status(status);
    refusals_.fill_status(status, inbox_.counters().refused_size);
  }

 private:
  Inbox inbox_;
  WebXrClock clock_;
  WebXrSample sample_;
  Refusals<WebXrRefusal, kWebXrRefusalNames.size()> refusals_{kWebXrRefusalNames};
};
}  // namespace

int main(int argc, char** argv) {
  return run_tracker(argc, argv,
                     {.name = "webxr",
                      .about = "Tracker that receives hands and head from a headset's browser",
                      .make_source = [](const Scene& scene, const bus::Participant&) {
                        return std::make_unique<WebXrTracker>(driver_options<WebXrOptions>(scene.options));
                      }});
}
