// softhand-hand: the simulation of one hand, or with `one_process` of both hands of a person. For other hands run
// further processes. The key (user, side) of every topic distinguishes the hands.
#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <optional>
#include <string_view>
#include <type_traits>
#include <vector>

#include "flight/hand_flight.hpp"
#include "hand/hand_loop.hpp"
#include "hand/hand_size.hpp"
#include "hand/object_shapes.hpp"
#include "hand/work_price.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "messages/newest_couplings.hpp"
#include "messages/newest_soft_states.hpp"
#include "runtime/phase_lock.hpp"
#include "scene_file.hpp"
#include "service/loop_log.hpp"
#include "service/service.hpp"
#include "world/solid.hpp"

namespace {
using namespace softhand;

constexpr double kBudgetFraction =
    0.6;  // of the period; the rest is for work beyond the budget, for the topics and for other processes

double seconds_now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

template <typename... Parts>
void log_line(fmt::format_string<Parts...> text, Parts&&... parts) {
  // fmt::print would throw if nobody reads stderr any more.
  std::fputs(("softhand-hand: " + fmt::format(text, std::forward<Parts>(parts)...) + "\n").c_str(), stderr);
}

std::vector<HandModel> load_hands(const std::vector<Scene>& scenes, const std::string& file) {
  std::vector<HandModel> hands;
  for (const Scene& scene : scenes) hands.push_back(load_scene_hand(scene, file));
  return hands;
}

HandSizeChoice choose_size(const std::vector<Scene>& scenes, const HandOptions& options, double budget) {
  std::vector<int> nodes;
  const double start = seconds_now();
  const double least = least_fast_steps(!scenes.front().soft_objects.empty());
  const HandSizeChoice choice = choose_hand_size(kHandSizes.size(), budget, least, [&](std::size_t size) {
    const std::vector<HandModel> hands = load_hands(scenes, kHandSizes[size]);
    nodes.push_back(hands.front().node_count());
    return measure_fast_step(hands, options, scenes.front().soft_objects, budget, seconds_now);
  });
  std::string measured;
  for (std::size_t size = 0; size < nodes.size(); ++size) {
    measured += fmt::format("{}{} nodes {:.2f} ms", size == 0 ? "" : ", ", nodes[size], 1e3 * choice.fast_steps[size]);
  }
  log_line(
      "hand.model = auto: a fast step takes {}; chose {}: its budget of {:.1f} ms is {:.1f} fast steps; measured in "
      "{:.2f} s",
      measured, kHandSizes[choice.size], 1e3 * budget, choice.budget_fast_steps, seconds_now() - start);
  if (choice.budget_fast_steps < least)
    log_line("this machine is too slow or too busy for the coarsest hand: steps will end before convergence");
  return choice;
}

// Of objects and of joints, taken in one step. A new one may arrive while another is taken, so a flood would not end.
constexpr int kMostDescriptions = 32;

void run(int argc, char** argv) {
  const ServiceArguments arguments = parse_arguments(argc, argv, "hand", "Simulation of a soft hand, or of two");
  const std::vector<Scene> scenes = read_process_scenes(arguments.config, arguments.overrides);
  const Scene& scene = scenes.front();
  HandOptions options = scene.options.hand;
  const std::uint32_t user = hand_key(scene).user;

  Service service(arguments, options.rate_hz, Pacing::simulated);
  const auto& p = service.participant();
  std::vector<bus::Reader<Skeleton>> skeletons;  // by hand
  for (const Scene& each : scenes)
    skeletons.emplace_back(p, options.direct ? bus::topics::tracked_skeleton : bus::topics::intermediate_skeleton,
                           hand_key(each));
  bus::Reader heads(p, bus::topics::head_pose);
  bus::Reader worlds(p, bus::topics::objects);
  std::optional<bus::Reader<ObjectCoupling>> couplings;  // of other hands
  if (options.simulation.other_hands) couplings.emplace(p, bus::topics::object_coupling);
  bus::Reader descriptions(p, bus::topics::object_description);
  bus::Reader joints(p, bus::topics::object_joint);
  bus::Writer simulated_writer(p, bus::topics::simulated_skeleton);
  bus::Writer coupling_writer(p, bus::topics::object_coupling);
  bus::Writer contacts_writer(p, bus::topics::contacts);
  bus::Writer traction_writer(p, bus::topics::skin_traction);
  bus::Writer surface_writer(p, bus::topics::tissue_surface);
  bus::Writer wrench_writer(p, bus::topics::bone_wrench);
  bus::Writer description_writer(p, bus::topics::hand_description);
  std::optional<bus::Writer<SoftObjectState>> soft_writer;
  std::optional<bus::Writer<SoftObjectDescription>> soft_description_writer;
  std::optional<bus::Reader<SoftObjectState>> soft_copies;
  if (!scene.soft_objects.empty()) {
    soft_writer.emplace(p, bus::topics::soft_object_state);
    soft_description_writer.emplace(p, bus::topics::soft_object_description);
    if (scene.options.world.soft == "world") soft_copies.emplace(p, bus::topics::soft_object_copy);
  }

  // Measure with the urgency of the service, because the loop will run with it. A late step is worse than a slightly
  // less exact step. Therefore the period is converted into an amount of work. Live steps correct the price of work.
  const double budget_seconds = kBudgetFraction / options.rate_hz;
  HandSizeChoice choice;
  if (chooses_hand_size(scene)) choice = choose_size(scenes, options, budget_seconds);
  const std::string model = chooses_hand_size(scene) ? kHandSizes[choice.size] : scene.options.hand.model;
  const std::vector<HandModel> models = load_hands(scenes, model);
  const double fast_step = chooses_hand_size(scene)
                               ? choice.fast_steps[choice.size]
                               : measure_fast_step(models, options, scene.soft_objects, budget_seconds, seconds_now);
  double& work_budget = options.simulation.solver.work_budget;
  const bool learns_budget = work_budget == 0;
  WorkPrice price(fast_step, budget_seconds, WorkPrice::least_budget(!scene.soft_objects.empty()));
  if (learns_budget) work_budget = price.budget();
  const int nodes = models.front().node_count();
  log_line("a fast step of {}{} nodes takes {:.2f} ms here; the budget of a step is {:.1f} fast steps at first",
           models.size() > 1 ? "two hands of " : "", nodes, 1e3 * fast_step, work_budget);

  // The shapes of the scene are ready before the loop starts. Others are built beside the loop.
  ObjectShapes shapes(object_folders(scene));
  for (const ObjectOptions& object : scene.options.objects) {
    shapes.prepare(make_solid(object).shape);
  }

  // A repeated run takes what was measured here. The input of each step has the budget of that step.
  auto chosen = arguments.overrides;
  chosen.push_back("hand.model=" + model);
  chosen.push_back(fmt::format("hand.simulation.solver.work_budget={:.17g}", work_budget));
  const auto recorder = make_flight_recorder(
      scene.options.flight, flight_header("hand", arguments.module, scenes, chosen, models), arguments.flight);
  HandInvariants invariants(scene.options.flight);

  // Create the loop after the DDS threads, because its helper thread pins this thread to a core. Create it after the
  // service has set its urgency, because the helper inherits that urgency.
  std::vector<KeyedHand> hands;
  for (std::size_t h = 0; h < scenes.size(); ++h) hands.push_back({models[h], hand_key(scenes[h])});
  HandLoop loop(hands, options, object_spring(scene.options.world), scene.soft_objects);
  Flight flight(loop, recorder.get());
  for (int h = 0; h < loop.hand_count(); ++h) {
    const auto description = std::make_unique<HandDescription>(loop.description(h));
    service.stamp(description->stamp);
    description_writer.write(*description);
  }
  for (SoftObjectDescription& each : loop.soft_object_descriptions()) {
    service.stamp(each.stamp);
    soft_description_writer->write(each);
  }

  std::vector<Skeleton> newest(scenes.size());
  auto world = std::make_unique<WorldObjects>();
  HeadPose head;
  NewestSoftStates soft_states(scene.soft_objects.size());
  NewestCouplings other_hands(couplings ? 2 * bus::topics::kHands : 0);  // as many as a reader follows
  std::uint64_t refused_objects = 0, other_worlds = 0;
  LoopLog log("softhand-hand");
  // The tracking loop passes a tracker's sample on within one of its own periods and the time of its step.
  constexpr Nanoseconds kWayOfSample = 500'000;
  const Nanoseconds way =
      kWayOfSample + (options.direct ? 0 : static_cast<Nanoseconds>(1e9 / scene.options.tracking.rate_hz));
  PhaseLock phase_lock(static_cast<Nanoseconds>(1e9 / options.rate_hz), way);
  const auto publish = [&service](auto& writer, auto& message) {
    if (!writer.has_readers()) return;
    service.stamp(message.stamp);
    message.stamp.chain.simulated_published = message.stamp.publish_time;
    if constexpr (std::is_same_v<decltype(message), BoneWrench&>)
      message.stamp.chain.wrench_published = message.stamp.publish_time;
    writer.write(message);
  };
  const auto step = [&](Nanoseconds now) {
    // Other worlds in the domain do not belong to this rig.
    const auto is_of_rig = [&](const auto& of_a_world) {
      if (of_a_world.world != kRigWorld) ++other_worlds;
      return of_a_world.world == kRigWorld;
    };
    const auto refuse = [&](const ObjectDescription& d, std::string_view problem) {
      ++refused_objects;
      if (!problem.empty()) log.line("object {} ('{}') refused: {}", d.object, get_text(d.name), problem);
    };
    descriptions.take_some(kMostDescriptions, [&](const ObjectDescription& d) {
      if (!is_of_rig(d)) return;
      // The hand would ignore all samples of the object until that time. It comes only once, so a stall of the loop
      // must not make it one of the future.
      if (age_of(d.stamp.sample_time, service.clock().at(softhand::now()))) {
        shapes.request(d);
      } else {
        refuse(d, "its sample time is in the future");
      }
    });
    shapes.deliver(
        [&](const ObjectDescription& d, std::shared_ptr<const ShapeGeometry> shape) {
          try {
            flight.describe(kFlightObject, d, [&] { loop.describe_object(d, std::move(shape)); });
          } catch (const std::exception& error) {
            refuse(d, error.what());
          }
        },
        refuse);
    joints.take_some(kMostDescriptions, [&](const ObjectJointDescription& d) {
      if (!is_of_rig(d)) return;
      try {
        flight.describe(kFlightJoint, d, [&] { loop.describe_joint(d); });
      } catch (const std::exception& error) {
        ++refused_objects;
        log.line("joint {} ('{}') refused: {}", d.joint, get_text(d.name), error.what());
      }
    });
    HandInput input;
    if (skeletons[0].take_latest(newest[0])) input.skeleton = &newest[0];
    if (skeletons.size() > 1 && skeletons[1].take_latest(newest[1])) input.second_skeleton = &newest[1];
    worlds.take_all([&](const WorldObjects& each) {
      if (!is_of_rig(each)) return;
      *world = each;
      input.world = world.get();
    });
    heads.take_all([&](const HeadPose& each) {
      if (each.user != user) return;
      head = each;
      input.head = &head;
    });
    if (couplings) {
      couplings->take_all([&](const ObjectCoupling& each) {
        if (!(each.hand == loop.key())) other_hands.put(each, now);
      });
      input.other_hands = other_hands.all();
    }
    soft_states.clear();
    if (soft_copies) {
      soft_copies->take_all([&](const SoftObjectState& each) { soft_states.put(each); });
      input.soft_objects = soft_states.all();
    }
    const RequestedOutputs requested{.surface = surface_writer.has_readers(),
                                     .contacts = contacts_writer.has_readers(),
                                     .traction = traction_writer.has_readers(),
                                     .bone_wrench = options.direct && wrench_writer.has_readers(),
                                     .soft_objects = soft_writer && soft_writer->has_readers(),
                                     .ledger = service.status_requested()};
    if (learns_budget) input.work_budget = work_budget = price.budget();
    const double started = seconds_now();
    flight.step(now, {input, requested}, [&]() -> HandOutput& { return loop.step(now, input, requested); });
    if (learns_budget && loop.plays()) price.learn(seconds_now() - started, loop.report().work);
    if (const char* wrong = recorder ? invariants.check(loop) : nullptr) flight.report(wrong);
    if (!loop.plays()) return;
    publish(coupling_writer, loop.output().coupling);
    for (int h = 0; h < loop.hand_count(); ++h) {
      HandOutput& output = loop.output(h);
      if (!output.valid) continue;
      publish(simulated_writer, output.simulated);
      publish(contacts_writer, output.contacts);
      publish(traction_writer, output.traction);
      publish(surface_writer, output.surface);
      if (options.direct) publish(wrench_writer, output.bone_wrench);
    }
    for (SoftObjectState& each : loop.output().soft_objects) publish(*soft_writer, each);
  };
  const auto fill_status = [&](LoopStatus& status, Nanoseconds now) {
    loop.fill_status(status, now);
    for (const auto& reader : skeletons) count_inputs(status, p, reader);
    count_inputs(status, p, heads, worlds, descriptions, joints);
    if (soft_copies) count_inputs(status, p, *soft_copies);
    add_counter(status, "other_worlds", static_cast<double>(other_worlds));
    if (couplings) {
      count_inputs(status, p, *couplings);
      add_counter(status, "couplings_from_future", static_cast<double>(other_hands.refused_future()));
      add_counter(status, "patches_used", static_cast<double>(loop.simulation().work().patches_used));
    }
    add_counter(status, "hand_nodes", nodes);
    add_counter(status, "phase_locked", phase_lock.locked() ? 1 : 0);
    add_counter(status, "sample_wait_ms", static_cast<double>(phase_lock.wait()) * 1e-6);
    add_counter(status, "fast_step_ms", 1e3 * price.fast_step());
    add_counter(status, "work_budget", work_budget);
    add_counter(status, "refused_objects", static_cast<double>(refused_objects));
    add_counter(status, "surfaces_sent",
                static_cast<double>(surface_writer.counters().written));  // does not grow without subscribers
  };
  // Otherwise two hands of two processes that hold one object would step at the same moment. Each would have data of
  // the other that are a period old.
  const bool locks = options.phase_lock && !options.simulation.other_hands;
  const auto shift = [&](Nanoseconds due) {
    return phase_lock.follow(due, service.clock().at(loop.tracked_published()));
  };
  service.run({.step = step,
               .answer = [&](const Message& message) { return flight.answer(message, arguments.module); },
               .fill_status = fill_status,
               .reset = [&](Nanoseconds time) { flight.reset(time); },
               .shift = locks ? std::function<Nanoseconds(Nanoseconds)>(shift) : nullptr});
  for (SoftObjectDescription& each : loop.soft_object_descriptions()) {
    each.removed = 1;
    service.stamp(each.stamp);
    soft_description_writer->write(each);
  }
  if (recorder && !arguments.flight.empty()) recorder->finish("the process was stopped");
}
}  // namespace

int main(int argc, char** argv) {
  return softhand::guarded_main("softhand-hand", [&] { run(argc, argv); });
}
