// softhand-tracking: owns the intermediate skeleton.
#include "flight/tracking_flight.hpp"
#include "scene_file.hpp"
#include "service/service.hpp"
#include "tracking/tracking_loop.hpp"

namespace {
using namespace softhand;

void run(int argc, char** argv) {
  const ServiceArguments arguments =
      parse_arguments(argc, argv, "tracking", "Tracking loop; owns the intermediate skeleton");
  const Scene scene = read_own_scene(arguments.config, arguments.overrides);
  const HandKey hand = hand_key(scene);
  const HandModel model = load_scene_hand(scene);
  TrackingLoop loop(scene.options.tracking, scene.options.hand.rate_hz, model, hand);

  Service service(arguments, scene.options.tracking.rate_hz, Pacing::simulated);
  const auto recorder = make_flight_recorder(
      scene.options.flight, flight_header("tracking", arguments.module, {&scene, 1}, arguments.overrides, {&model, 1}),
      arguments.flight);
  Flight flight(loop, recorder.get());
  std::uint64_t refused_nonfinite = 0;
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
    const TrackingOutput& output =
        flight.step(now, input, [&]() -> const TrackingOutput& { return loop.step(now, input); });
    const std::uint64_t refused = loop.input().counters().refused_nonfinite;
    if (std::exchange(refused_nonfinite, refused) < refused) flight.report("an input was not finite");
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
  service.run({step, [&](const Message& message) { return flight.answer(message, arguments.module); },
               [&](LoopStatus& status, Nanoseconds now) {
                 loop.fill_status(status, now);
                 count_inputs(status, service.participant(), tracked_reader, simulated_reader, contacts_reader,
                              head_reader);
               },
               [&](Nanoseconds time) { flight.reset(time); }});
  if (recorder && !arguments.flight.empty()) recorder->finish("the process was stopped");
}
}  // namespace

int main(int argc, char** argv) {
  return softhand::guarded_main("softhand-tracking", [&] { run(argc, argv); });
}
