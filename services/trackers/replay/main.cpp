// softhand-tracker-replay: plays a recorded or generated hand like a tracker.
#include "device/answer.hpp"
#include "messages/age.hpp"
#include "scene_file.hpp"
#include "service/service.hpp"
#include "trackers/replay/replay_tracker.hpp"

namespace {
using namespace softhand;

constexpr double kPollRate = 1000;  // Hz, polling for due samples

void run(int argc, char** argv) {
  const TrackerArguments arguments =
      parse_tracker_arguments(argc, argv, "Tracker that plays a recorded or generated hand");
  const Scene scene = read_scene(arguments.config, arguments.overrides);
  const ReplayOptions& options = scene.options.tracker;
  const HandModel hand = load_scene_hand(scene);
  const auto motion = make_scene_motion(scene, hand);

  Service service(arguments, kPollRate, Pacing::simulated);
  bus::Writer writer(service.participant(), bus::topics::tracked_skeleton, arguments.strength);
  ReplayTracker tracker(motion, options, hand_key(scene), arguments.source);
  Skeleton sample;
  std::uint64_t published = 0;
  Nanoseconds newest = 0;
  Nanoseconds motion_start = 0;  // time at which the motion's time was 0
  std::uint64_t restarts = 0;
  const auto step = [&](Nanoseconds now) {
    const bool starts = motion_start == 0;
    if (starts) motion_start = now - static_cast<Nanoseconds>(options.start_time * 1e9);
    // The motion continues without subscribers. Samples are made only for subscribers.
    const bool is_read = writer.has_readers();
    if (!is_read && !starts) return;
    if (!tracker.sample(now, sample) || !is_read) return;
    newest = sample.stamp.sample_time;
    ++published;
    service.stamp(sample.stamp);
    // The sequence starts again after a restart. Subscribers must see a new epoch, as after a restart of the process.
    sample.stamp.epoch += restarts;
    sample.stamp.chain.tracker_sample = service.clock().when(sample.stamp.sample_time);
    sample.stamp.chain.tracked_published = sample.stamp.publish_time;
    writer.write(sample);
  };
  const auto restart = [&] {
    tracker = ReplayTracker(motion, options, hand_key(scene), arguments.source);
    motion_start = 0;
    ++restarts;
  };
  const auto answer = [&](const Message& message) {
    if (!is_addressed(message, arguments.module))
      return reply_to(message, arguments.module, kReplyIgnored, "not for this module");
    if (get_text(message.key) == "restart") {
      restart();
      return reply_to(message, arguments.module, kReplyApplied, "the motion starts again");
    }
    return reply_to(message, arguments.module, kReplyIgnored, "unknown key; known: restart");
  };
  const auto fill_status = [&](LoopStatus& status, Nanoseconds now) {
    status.input_age_ms = age_ms_of(newest, now);
    add_counter(status, "published", static_cast<double>(published));
    // `softhand up` reads this counter to judge the run.
    add_counter(status, "motion_start_s", static_cast<double>(motion_start) * 1e-9);
  };
  service.run({step, answer, fill_status, [&](Nanoseconds) { restart(); }});
}
}  // namespace

int main(int argc, char** argv) {
  return softhand::guarded_main("softhand-tracker-replay", [&] { run(argc, argv); });
}
