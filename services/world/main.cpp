// softhand-world: the bridge to a physics engine.
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "flight/world_flight.hpp"
#include "messages/newest_couplings.hpp"
#include "messages/newest_soft_states.hpp"
#include "scene_file.hpp"
#include "service/service.hpp"
#include "world/description_changes.hpp"
#include "world/world_loop.hpp"

namespace {
using namespace softhand;

void run(int argc, char** argv) {
  const ServiceArguments arguments = parse_arguments(argc, argv, "world", "The physics world of a scene");
  const Scene scene = read_scene(arguments.config, arguments.overrides);
  const WorldOptions& options = scene.options.world;
  WorldLoop loop(options, scene.options.objects, 1 / scene.options.hand.rate_hz, scene.options.joints,
                 scene.soft_objects);

  Service service(arguments, options.rate_hz, Pacing::simulated);
  const auto recorder = make_flight_recorder(
      scene.options.flight, flight_header("world", arguments.module, {&scene, 1}, arguments.overrides, {}),
      arguments.flight);
  Flight flight(loop, recorder.get());
  WorldCounters counters;
  bus::Reader couplings(service.participant(), bus::topics::object_coupling);
  bus::Writer objects(service.participant(), bus::topics::objects);
  bus::Writer descriptions(service.participant(), bus::topics::object_description);
  bus::Writer joints(service.participant(), bus::topics::object_joint);
  std::optional<bus::Reader<SoftObjectState>> soft_states;
  std::optional<bus::Reader<SoftObjectDescription>> soft_descriptions;
  if (!scene.soft_objects.empty()) {
    soft_states.emplace(service.participant(), bus::topics::soft_object_state);
    soft_descriptions.emplace(service.participant(), bus::topics::soft_object_description);
  }

  const auto stamped_to = [&service](auto& writer) {
    return [&service, &writer](auto& description) {
      service.stamp(description.stamp);
      writer.write(description);
    };
  };
  DescriptionChanges changes(loop, stamped_to(descriptions), stamped_to(joints));

  NewestCouplings newest(2 * bus::topics::kHands);  // as many as a reader follows
  std::optional<bus::Writer<SoftObjectState>> soft_copies;
  if (options.soft == "world" && !scene.soft_objects.empty())
    soft_copies.emplace(service.participant(), bus::topics::soft_object_copy);
  NewestSoftStates soft_objects(scene.soft_objects.size());
  auto out = std::make_unique<WorldObjects>();
  auto copy_out = std::make_unique<SoftObjectState>();
  const auto step = [&](Nanoseconds now) {
    changes.pass_on(loop, now);
    bool is_new = false;
    couplings.take_all([&](const ObjectCoupling& each) {
      is_new = true;
      newest.put(each, now);
    });
    soft_objects.clear();
    if (soft_descriptions) {
      soft_descriptions->take_some(kMaxSoftObjects, [&](const SoftObjectDescription& each) {
        flight.describe(kFlightSoftObject, each, [&] { loop.describe_soft_object(each); });
      });
      soft_states->take_all([&](const SoftObjectState& each) { soft_objects.put(each); });
    }
    const WorldInput input{newest.all(), soft_objects.all()};
    const WorldOutput& result =
        flight.step(now, {input, is_new}, [&]() -> const WorldOutput& { return loop.step(now, input); });
    const WorldCounters before = std::exchange(counters, loop.counters());
    if (counters.repaired > before.repaired) flight.report("an object was not finite in the engine");
    if (counters.refused_nonfinite > before.refused_nonfinite) flight.report("an input was not finite");
    for (std::size_t i = 0; soft_copies && i < result.soft_count && soft_copies->has_readers(); ++i) {
      *copy_out = result.soft_objects[i];
      service.stamp(copy_out->stamp);
      soft_copies->write(*copy_out);
    }
    if (!objects.has_readers()) return;
    *out = result.objects;
    service.stamp(out->stamp);
    objects.write(*out);
  };
  service.run({step, [&](const Message& message) { return flight.answer(message, arguments.module); },
               [&](LoopStatus& status, Nanoseconds now) {
                 loop.fill_status(status, now);
                 count_inputs(status, service.participant(), couplings);
                 if (soft_states) count_inputs(status, service.participant(), *soft_states, *soft_descriptions);
                 add_counter(status, "couplings_from_future", static_cast<double>(newest.refused_future()));
               },
               [&](Nanoseconds time) { flight.reset(time); }});
  if (recorder && !arguments.flight.empty()) recorder->finish("the process was stopped");
}
}  // namespace

int main(int argc, char** argv) {
  return softhand::guarded_main("softhand-world", [&] { run(argc, argv); });
}
