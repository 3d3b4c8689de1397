// softhand-tracker-leap: both hands from an Ultraleap camera, by its WebSocket protocol or by its library LeapC.
#include <cstdio>

#include "device/device_thread.hpp"
#include "device/packet_tracker.hpp"
#include "device/websocket_client.hpp"
#include "service/tracker_service.hpp"
#include "trackers/leap/leap_hands.hpp"
#include "trackers/leap/leap_message.hpp"
#include "trackers/leap/leap_options.hpp"
#include "trackers/leap/leapc_service.hpp"

namespace {
using namespace softhand;

bool is_on_headset(const LeapOptions& options) { return options.mounting == "headset"; }

class LeapSocketTracker final : public PacketTracker<LeapDecoder, WebSocketClient> {
 public:
  LeapSocketTracker(const HandModel& hand, const LeapOptions& options)
      : PacketTracker(
            LeapDecoder(hand, is_on_headset(options)),
            WebSocketClient::Server{options.server, options.port, "/v6.json", leap_greeting(is_on_headset(options))},
            kLargestLeapMessage) {
    std::printf("connecting to ws://%s:%d/v6.json\n", options.server.c_str(), static_cast<int>(options.port));
    std::fflush(stdout);
    receiver_.translate(translate_leap_messages());
    receiver_.start();
  }
};

class LeapCTracker final : public PacketTracker<LeapDecoder, DeviceThread> {
 public:
  LeapCTracker(const HandModel& hand, const LeapOptions& options)
      : PacketTracker(LeapDecoder(hand, is_on_headset(options)), sizeof(LeapFrame)) {
    std::printf("opening %s\n", options.library.c_str());
    std::fflush(stdout);
    receiver_.start(leapc_session(options.library, options.mounting));
  }
};

}  // namespace

int main(int argc, char** argv) {
  return run_tracker(argc, argv,
                     {.name = "leap",
                      .about = "Tracker that receives both hands from an Ultraleap camera",
                      .make_source = [](const Scene& scene, const bus::Participant&) -> std::unique_ptr<TrackerSource> {
                        const HandModel hand = load_scene_hand(scene);
                        const auto& options = driver_options<LeapOptions>(scene.options);
                        if (options.source == "leapc") return std::make_unique<LeapCTracker>(hand, options);
                        return std::make_unique<LeapSocketTracker>(hand, options);
                      }});
}
