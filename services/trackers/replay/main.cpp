// softhand-tracker-replay: plays a recorded or made hand as a tracker would.
#include <CLI/CLI.hpp>

#include "device/answer.hpp"
#include "service/service.hpp"
#include "trackers/replay/generator.hpp"
#include "trackers/replay/recording.hpp"
#include "trackers/replay/replay_tracker.hpp"

namespace {
using namespace softhand;

struct Configuration {
  GeneratorOptions motion;
  ReplayOptions tracker;
};
void describe(OptionVisitor& v, Configuration& o) {
  describe_section(v, "motion", "The motion that is made where no recording is played.", o.motion);
  describe_section(v, "tracker", "How the motion is sampled and spoiled.", o.tracker);
}

void run(int argc, char** argv) {
  std::string hand_file = "right_750.hand.json", recording;
  int strength = 0;
  std::uint32_t source = 0;
  double poll_hz = 1000;
  const ServiceArguments arguments =
      parse_arguments(argc, argv, "tracker", "Plays a recorded or made hand as a tracker", [&](CLI::App& app) {
        app.add_option("--hand", hand_file, "Hand file of a made motion: a path, or a name in config/hands");
        app.add_option("--motion", recording, "CSV recording to play instead of a made motion");
        app.add_option("--strength", strength, "Of several trackers of one hand the strongest owns it");
        app.add_option("--source", source, "Id of this source");
        app.add_option("--poll-hz", poll_hz, "How often due samples are looked for")->check(CLI::Range(10.0, 10000.0));
      });
  Configuration configuration;
  configure(configuration, arguments, other_sections({"motion", "tracker"}));
  std::shared_ptr<const Motion> motion;
  if (!recording.empty()) {
    motion = std::make_shared<Recording>(Recording::load(recording));
  } else {
    HandModel hand = load_hand(find_hand_file(hand_file));
    if (static_cast<std::uint32_t>(hand.side) != arguments.hand.side) hand = mirrored(hand);
    motion = make_motion(hand, configuration.motion);
  }

  Service service(arguments);
  bus::Writer writer(service.participant(), bus::topics::tracked_skeleton, strength);
  ReplayTracker tracker(motion, configuration.tracker, arguments.hand, source);
  Skeleton sample;
  std::uint64_t published = 0;
  Nanoseconds newest = 0;
  const auto step = [&](Nanoseconds now) {
    if (!tracker.sample(now, sample)) return;
    newest = sample.stamp.sample_time;
    ++published;
    service.stamp(sample.stamp);
    sample.stamp.chain.tracker_sample = sample.stamp.sample_time;
    sample.stamp.chain.tracked_published = sample.stamp.publish_time;
    writer.write(sample);
  };
  const auto answer = [&](const Message& message) {
    if (!is_addressed(message, arguments.module)) return reply_to(message, arguments.module, kReplyIgnored, "not for this module");
    if (get_text(message.key) == "restart") {
      tracker = ReplayTracker(motion, configuration.tracker, arguments.hand, source);
      return reply_to(message, arguments.module, kReplyApplied, "motion starts again");
    }
    return reply_to(message, arguments.module, kReplyIgnored, "unknown key; known: restart");
  };
  const auto fill_status = [&](LoopStatus& status, Nanoseconds now) {
    status.input_age_ms = newest == 0 ? -1 : static_cast<double>(now - newest) * 1e-6;
    NamedValue counter;
    set_text(counter.name, "published");
    counter.value = static_cast<double>(published);
    status.counters.push_back(counter);
  };
  service.run(poll_hz, {step, answer, fill_status});
}
}  // namespace

int main(int argc, char** argv) {
  return softhand::guarded_main("softhand-tracker-replay", [&] { run(argc, argv); });
}
