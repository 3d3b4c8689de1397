// softhand-tracker-webxr: both hands and the head of the wearer of a headset, whose browser shows the viewer's page.
#include <cstdio>

#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "scene_file.hpp"
#include "service/service.hpp"
#include "trackers/sockets/inbox.hpp"
#include "trackers/webxr/webxr_frames.hpp"

namespace {
using namespace softhand;

constexpr double kPollRate = 1000;  // Hz, polling of frames

void run(int argc, char** argv) {
  const TrackerArguments arguments =
      parse_tracker_arguments(argc, argv, "Tracker that receives hands and head from a headset's browser");
  const Scene scene = read_scene(arguments.config, arguments.overrides);
  const HandKey user = hand_key(scene);

  Service service(arguments, kPollRate, Pacing::real);
  bus::Writer hands(service.participant(), bus::topics::tracked_skeleton, arguments.strength);
  bus::Writer head(service.participant(), bus::topics::head_pose);
  Inbox inbox(scene.options.tracker_webxr.listening, Transport::websocket, kWebXrFrameSize);
  std::printf("listening at %s\n", inbox.url().c_str());
  std::fflush(stdout);

  std::vector<Arrival> arrivals;
  WebXrSample sample;
  WebXrClock clock;
  std::array<std::uint64_t, kWebXrRefusalNames.size()> refused{};
  std::uint64_t published = 0;
  Nanoseconds newest = 0;
  const auto step = [&](Nanoseconds) {
    inbox.take(arrivals);
    for (const Arrival& arrival : arrivals) {
      WebXrRefusal refusal = arrival.binary ? decode_webxr(arrival.bytes, sample) : WebXrRefusal::type;
      if (refusal == WebXrRefusal::none) refusal = clock.stamp(sample, arrival.connection, arrival.time);
      if (refusal != WebXrRefusal::none) {
        ++refused[static_cast<std::size_t>(refusal)];
        continue;
      }
      newest = sample.head.stamp.sample_time;
      sample.head.stamp.sample_time = service.clock().at(newest);
      if (sample.head.valid != 0) {
        sample.head.user = user.user;
        service.stamp(sample.head.stamp);
        head.write(sample.head);
      }
      for (Skeleton& hand : sample.hands) {
        // A hand that is not seen is not published, so that a weaker tracker can take over.
        if (hand.confidence == 0) continue;
        hand.hand.user = user.user;
        hand.source = arguments.source;
        service.stamp(hand.stamp);
        hand.stamp.sample_time = sample.head.stamp.sample_time;
        hand.stamp.chain.tracked_published = hand.stamp.publish_time;
        hands.write(hand);
        ++published;
      }
    }
  };
  const auto fill_status = [&](LoopStatus& status, Nanoseconds now) {
    status.input_age_ms = age_ms_of(newest, now);
    const Inbox::Counters counters = inbox.counters();
    add_counter(status, "published", static_cast<double>(published));
    add_counter(status, "connections", static_cast<double>(counters.connections));
    add_counter(status, "refused_origin", static_cast<double>(counters.refused_origin));
    add_counter(status, "passed_over", static_cast<double>(counters.passed_over));
    for (std::size_t i = 1; i < refused.size(); ++i) {
      // The inbox refuses a frame that is too large and closes its connection.
      const auto larger = static_cast<WebXrRefusal>(i) == WebXrRefusal::size ? counters.refused_size : 0;
      add_counter(status, "refused_" + std::string(kWebXrRefusalNames[i]), static_cast<double>(refused[i] + larger));
    }
  };
  service.run({.step = step, .fill_status = fill_status});
}
}  // namespace

int main(int argc, char** argv) {
  return softhand::guarded_main("softhand-tracker-webxr", [&] { run(argc, argv); });
}
