// softhand-tracking: owns the intermediate skeleton.
#include "scene_file.hpp"
#include "service/service.hpp"
#include "tracking/tracking_loop.hpp"

namespace {
using namespace softhand;

void run(int argc, char** argv) {
  const ServiceArguments arguments =
      parse_arguments(argc, argv, "tracking", "Tracking loop; owns the intermediate skeleton");
  const Scene scene = read_scene(arguments.config, arguments.overrides);
  const HandKey hand = hand_key(scene);
  TrackingLoop loop(scene.options.tracking, scene.options.hand.rate_hz, load_scene_hand(scene), hand);

  Service service(arguments, scene.options.tracking.rate_hz, Pacing::simulated);
  bus::Reader tracked_reader(service.participant(), bus::topics::tracked_skeleton, hand);
  bus::Reader simulated_reader(service.participant(), bus::topics::simulated_skeleton, hand);
  bus::Reader contacts_reader(service.participant(), bus::topics::contacts, hand);
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
    input.wrench_requested = wrench_writer.has_readers();
    input.ledger_requested = service.status_requested();
    if (input.wrench_requested && contacts_reader.take_latest(contacts)) input.contacts = &contacts;
    head_reader.take_all([&](const HeadPose& each) {
      if (each.user != hand.user) return;
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
    if (input.wrench_requested) {
      wrench = output.wrench;
      service.stamp(wrench.stamp);
      wrench.stamp.chain.wrench_published = wrench.stamp.publish_time;
      wrench_writer.write(wrench);
    }
  };
  service.run({step, [&](const Message& message) { return loop.answer(message, arguments.module); },
               [&](LoopStatus& status, Nanoseconds now) {
                 loop.fill_status(status, now);
                 status.input_drops = dropped_before(tracked_reader, simulated_reader, contacts_reader, head_reader);
               },
               [&](Nanoseconds time) { loop.reset(time); }});
}
}  // namespace

int main(int argc, char** argv) {
  return softhand::guarded_main("softhand-tracking", [&] { run(argc, argv); });
}
