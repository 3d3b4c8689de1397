// softhand-tracking: owner of the intermediate skeleton.
#include <CLI/CLI.hpp>

#include "service/service.hpp"
#include "tracking/tracking_loop.hpp"

namespace {
using namespace softhand;

struct Configuration {
  TrackingOptions tracking;
};
void describe(OptionVisitor& v, Configuration& o) { describe_section(v, "tracking", "The tracking loop.", o.tracking); }

void run(int argc, char** argv) {
  std::string hand_file = "right_750.hand.json";
  const ServiceArguments arguments = parse_arguments(argc, argv, "tracking", "Owner of the intermediate skeleton", [&](CLI::App& app) {
    app.add_option("--hand", hand_file, "Hand file: a path, or a name in config/hands");
  });
  Configuration configuration;
  configure(configuration, arguments, other_sections({"tracking"}));
  HandModel hand = load_hand(find_hand_file(hand_file));
  if (static_cast<std::uint32_t>(hand.side) != arguments.hand.side) hand = mirrored(hand);
  TrackingLoop loop(configuration.tracking, hand, arguments.hand);

  Service service(arguments);
  bus::Reader tracked_reader(service.participant(), bus::topics::tracked_skeleton, arguments.hand);
  bus::Reader simulated_reader(service.participant(), bus::topics::simulated_skeleton, arguments.hand);
  bus::Reader contacts_reader(service.participant(), bus::topics::contacts, arguments.hand);
  bus::Reader head_reader(service.participant(), bus::topics::head_pose);
  bus::Writer intermediate_writer(service.participant(), bus::topics::intermediate_skeleton);
  bus::Writer wrench_writer(service.participant(), bus::topics::bone_wrench);

  Skeleton tracked, simulated, intermediate;
  Contacts contacts;
  BoneWrench wrench;
  HeadPose own_head;
  const auto step = [&](Nanoseconds now) {
    TrackingInput input;
    if (tracked_reader.take_latest(tracked)) input.tracked = &tracked;
    if (simulated_reader.take_latest(simulated)) input.simulated = &simulated;
    input.wrench_wanted = wrench_writer.has_readers();
    if (input.wrench_wanted && contacts_reader.take_latest(contacts)) input.contacts = &contacts;
    head_reader.take_all([&](const HeadPose& each) {
      if (each.user != arguments.hand.user) return;
      own_head = each;
      input.head = &own_head;
    });
    const TrackingOutput& output = loop.step(now, input);
    if (!output.valid) return;
    if (intermediate_writer.has_readers()) {
      intermediate = output.intermediate;
      service.stamp(intermediate.stamp);
      intermediate.stamp.chain.intermediate_published = intermediate.stamp.publish_time;
      intermediate_writer.write(intermediate);
    }
    if (input.wrench_wanted) {
      wrench = output.wrench;
      service.stamp(wrench.stamp);
      wrench.stamp.chain.wrench_published = wrench.stamp.publish_time;
      wrench_writer.write(wrench);
    }
  };
  service.run(configuration.tracking.rate_hz, {step, [&](const Message& message) { return loop.answer(message, arguments.module); },
                                               [&](LoopStatus& status, Nanoseconds now) { loop.fill_status(status, now); }});
}
}  // namespace

int main(int argc, char** argv) {
  return softhand::guarded_main("softhand-tracking", [&] { run(argc, argv); });
}
