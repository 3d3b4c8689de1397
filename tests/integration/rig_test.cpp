// The demo with real processes: start, death of each process, faults of a tracker, and messages. The time limits leave
// room for a busy machine. Measured times are printed.
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "integration/rig_fixture.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"

namespace softhand::rig::rig_test {
namespace {

constexpr const char* kTouch = "tests/integration/rig_touch.toml";  // two fingers stay on a fixed post
constexpr std::uint32_t kHaptic = 1;                                // device ids of the demo
constexpr std::uint32_t kTactile = 2;
constexpr std::uint32_t kCube = 2;  // of the demo's objects
constexpr double kHeld = 0.1;       // m; the cube is this high only in the hand

// Limits for the time from a kill, ms. The promised value is 1000. These limits are for a machine that is six to nine
// times oversubscribed (load 12 to 19 on two cores). Seven runs on such a machine gave up to 980 for the other
// processes. They gave 520 to 2220 for the tracker, which solves its grip again and starts its motion again.
constexpr double kFollowsWithin = 2000;
constexpr double kFollowsTrackerWithin = 3000;

TEST_F(Rig, DemoStartsFollowsAndStops) {
  RigListener listener;
  std::set<std::uint32_t> processes;
  {
    Up up(kDemo, {});
    ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
    EXPECT_TRUE(listener.wait(10s, [&] { return follows(listener, 0); }));
    EXPECT_TRUE(listener.wait(10s, [&] { return listener.device_is_on(kHaptic); }));
    EXPECT_TRUE(listener.wait(10s, [&] { return listener.device_is_on(kTactile); }));
    EXPECT_TRUE(listener.wait(20s, [&] { return listener.counter("hand", "phase_locked") == 1; }))
        << "tracker and hand have the same rate";
    EXPECT_GT(listener.counter("hand", "sample_wait_ms"), 0);
    listener.listen(2s);  // rates are of the last second
    for (const std::string& module : kModules) {
      const LoopStatus& status = listener.modules.at(module);
      processes.insert(status.process_id);
      std::printf("%-9s %7.1f of %6.1f Hz, step p99 %6.3f ms\n", module.c_str(), status.rate_hz, status.nominal_rate_hz,
                  status.step_ms_p99);
      EXPECT_GT(status.rate_hz, 0.6 * status.nominal_rate_hz) << module;
      EXPECT_LT(status.rate_hz, 1.1 * status.nominal_rate_hz) << module;
      EXPECT_GE(status.step_ms_p999, status.step_ms_p99) << module;
    }
    // A physics loop publishes these values. Whether its ledger closes is tested on the virtual clock, where every step
    // has enough time.
    const LoopStatus& hand = listener.modules.at("hand");
    EXPECT_GT(hand.iterations, 0u);
    EXPECT_GT(hand.coupling_stretch, 0);
    EXPECT_GT(hand.energies.size(), 5u);
    EXPECT_GT(hand.ledger.size(), 5u);
    EXPECT_GT(listener.modules.at("tracking").ledger.size(), 5u);
    const double energy = listener.modules.at("haptic").passivity_energy;
    std::printf("energy that the user put into the glove: %.1f mJ\n", 1e3 * energy);
    EXPECT_NE(energy, 0) << "the glove measures its motion";
    EXPECT_GE(energy, -1e-3) << "the glove gave energy to its user";
    EXPECT_EQ(processes.size(), kModules.size());
    for (const std::uint32_t process : processes) EXPECT_TRUE(is_alive(process));
    expect_all_finite(listener);
    up.send_signal(SIGINT);
    EXPECT_EQ(up.wait(8s), 0) << "not a clean stop:\n" << up.output();
  }
  for (const std::uint32_t process : processes) EXPECT_FALSE(is_alive(process)) << "orphan " << process;
  // On exit, devices are left at zero.
  for (const std::uint32_t device : {kHaptic, kTactile}) {
    EXPECT_TRUE(listener.wait(1s, [&] { return !listener.devices[device].back().live; })) << device;
    EXPECT_EQ(listener.devices[device].back().largest_command, 0) << device;
  }
}

TEST_F(Rig, SummaryHasLoopsAndMotionToForce) {
  const std::string path = "/tmp/softhand_rig_summary_" + std::to_string(getpid()) + ".json";
  const Finished up = run_program({SOFTHAND_PROGRAMS "/softhand", "up", std::string(SOFTHAND_SOURCE_DIR "/") + kDemo,
                                   "--seconds", "8", "--json", path});
  EXPECT_EQ(up.exit_code, 0) << up.output;
  std::ifstream in(path);
  const nlohmann::json summary = nlohmann::json::parse(in, nullptr, false);
  unlink(path.c_str());
  ASSERT_TRUE(summary.is_object()) << up.output;
  for (const std::string& module : kModules) {
    ASSERT_TRUE(summary["loops"].contains(module)) << module;
    EXPECT_GT(summary["loops"][module]["steps"].get<double>(), 100) << module;
    EXPECT_EQ(summary["restarts"][module].get<int>(), 0) << module << "\n" << up.output;
  }
  for (const char* key : {"motion_to_force_ms_p50", "motion_to_force_ms_p99"}) {
    ASSERT_TRUE(summary.contains(key) && summary[key].is_object()) << key;
    EXPECT_GT(summary[key]["total"].get<double>(), 1) << key;
    EXPECT_LT(summary[key]["total"].get<double>(), 500) << key;
    for (const char* hop : {"tracker", "tracking", "hand", "wrench", "device"})
      EXPECT_TRUE(summary[key]["hops"].contains(hop)) << hop;
    std::printf("%s %.1f\n", key, summary[key]["total"].get<double>());
  }
  const double first = summary["first_effect_ms_p50"].get<double>(),
               total = summary["motion_to_force_ms_p50"]["total"].get<double>();
  EXPECT_GT(first, 0.5);
  EXPECT_LT(first, total) << "the first answer is newer than the commands that repeat it";
  EXPECT_EQ(summary["nonfinite_published"].get<int>(), 0);
  EXPECT_TRUE(summary["clean_stop"].get<bool>());
}

// The effect of each death on the devices. If the input of a device dies, the device's own stale timer zeroes it.
struct Death {
  const char* module;
  std::vector<std::uint32_t> zeroed;  // devices
};
void PrintTo(const Death& death, std::ostream* out) { *out << death.module; }

class RigDeath : public Rig, public ::testing::WithParamInterface<Death> {};

TEST_P(RigDeath, OthersLiveDevicesAreZeroedAndTheHandFollowsAfterARestart) {
  const std::string victim = GetParam().module;
  RigListener listener;
  Up up(kTouch, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  listener.listen(2s);  // until the fingers have closed
  ASSERT_TRUE(listener.wait(
      10s, [&] { return follows(listener, 0) && listener.device_is_on(kHaptic) && listener.device_is_on(kTactile); }))
      << "follow error " << listener.simulated.back().follow_error;
  std::map<std::string, std::int64_t> before;
  for (const std::string& module : kModules) before[module] = listener.process_id(module);
  const std::uint64_t hand_epoch = listener.simulated.back().epoch;

  const Nanoseconds killed = now();
  ASSERT_EQ(kill(static_cast<pid_t>(before[victim]), SIGKILL), 0);

  // A device whose input lives is not disturbed. A device whose input died goes to zero and stays there until its input
  // is back.
  listener.listen(60ms);
  for (const std::uint32_t device : {kHaptic, kTactile}) {
    const bool itself = (victim == "haptic" && device == kHaptic) || (victim == "tactile" && device == kTactile);
    if (itself) continue;
    const bool should_zero = std::count(GetParam().zeroed.begin(), GetParam().zeroed.end(), device) != 0;
    const auto first_zero = [&]() -> const RigListener::DeviceSample* {
      for (const auto& sample : listener.devices[device]) {
        if (sample.time > killed && !sample.live) return &sample;
      }
      return nullptr;
    };
    if (should_zero) {
      ASSERT_TRUE(listener.wait(2s, [&] { return first_zero() != nullptr; }))
          << "device " << device << " was never zeroed";
      const double milliseconds = milliseconds_between(killed, first_zero()->time);
      EXPECT_EQ(first_zero()->largest_command, 0);
      EXPECT_LT(milliseconds, 150) << "device " << device;
      std::printf("%s killed: device %u zero after %.1f ms\n", victim.c_str(), device, milliseconds);
    } else {
      EXPECT_EQ(first_zero(), nullptr) << "device " << device << " was zeroed although its input lives";
    }
  }

  ASSERT_TRUE(listener.wait(5s, [&] { return listener.process_id(victim) != before[victim]; })) << "not restarted\n"
                                                                                                << up.output();
  const Nanoseconds restarted = now();
  const auto works_again = [&] {
    if (!follows(listener, killed)) return false;
    if (victim == "hand" && listener.simulated.back().epoch == hand_epoch) return false;
    return true;
  };
  EXPECT_TRUE(listener.wait(10s, works_again)) << "follow error " << listener.simulated.back().follow_error;
  const double followed =
      milliseconds_between(killed, (listener.simulated.end() - 10)->time);  // the first of those that `follows` saw
  EXPECT_LT(followed, victim == "tracker" ? kFollowsTrackerWithin : kFollowsWithin);
  std::printf("%s killed: the hand follows again within %.0f ms\n", victim.c_str(), followed);
  for (const std::uint32_t device : {kHaptic, kTactile}) {
    ASSERT_TRUE(listener.wait(
        10s, [&] { return listener.device_is_on(device) && listener.devices[device].back().time > restarted; }))
        << "device " << device;
    // From this sample on the device stays live. It follows the last sample that was not live, or it is the first
    // sample of a new process.
    const auto& samples = listener.devices[device];
    auto on = samples.end() - 1;
    while (on != samples.begin() && (on - 1)->live && (on - 1)->epoch == on->epoch && (on - 1)->time > killed) --on;
    const double back = milliseconds_between(killed, on->time);
    EXPECT_LT(back, 3000) << "device " << device;
    std::printf("%s killed: device %u commands on or again after %.0f ms\n", victim.c_str(), device, back);
  }
  const Nanoseconds status_after = now();
  EXPECT_TRUE(listener.wait(5s, [&] {
    return std::all_of(kModules.begin(), kModules.end(),
                       [&](const std::string& m) { return listener.modules.at(m).stamp.publish_time > status_after; });
  }));
  for (const std::string& module : kModules) {
    if (module == victim) continue;
    EXPECT_EQ(listener.process_id(module), before[module]) << module << " died too\n" << up.output();
  }
  expect_all_finite(listener);
}

INSTANTIATE_TEST_SUITE_P(Of, RigDeath,
                         ::testing::Values(Death{"world", {}}, Death{"hand", {kHaptic, kTactile}},
                                           Death{"tracking", {kHaptic}}, Death{"tracker", {}}, Death{"haptic", {}},
                                           Death{"tactile", {}}),
                         [](const auto& death) { return std::string(death.param.module); });

TEST_F(Rig, FaultsOfATrackerAreRefusedOrAbsorbedAndCounted) {
  RigListener listener;
  // One motion has all three faults. The hand is 10 m away from 2 s to 3 s. One bone is NaN from 4 s to 4.5 s. No
  // samples come from 5.5 s to 7.5 s.
  Up up(kDemo, {"--set", "generator.motion=free_motion", "--set", "generator.object_position=[0,0.5,0]", "--set",
                "generator.free_time=3600", "--set", "tracker.teleport_at=2", "--set", "tracker.teleport_time=1",
                "--set", "tracker.nan_at=4", "--set", "tracker.nan_time=0.5", "--set", "tracker.freeze_at=5.5", "--set",
                "tracker.freeze_time=2"});
  ASSERT_TRUE(listener.wait(20s, [&] {
    return all_present(listener) && listener.counter("tracker", "motion_start_s") > 0;
  })) << up.output();
  const Nanoseconds start = static_cast<Nanoseconds>(listener.counter("tracker", "motion_start_s") * 1e9);
  const auto motion_time = [&](Nanoseconds time) { return static_cast<double>(time - start) * 1e-9; };
  double largest_step_age = 0;
  ASSERT_TRUE(listener.wait(20s, [&] {
    if (const auto found = listener.modules.find("tracking"); found != listener.modules.end())
      largest_step_age = std::max(largest_step_age, found->second.input_age_ms);
    return motion_time(now()) > 9;
  }));

  // The teleport is counted twice, there and back. The simulated hand jumps along and comes back.
  EXPECT_EQ(listener.counter("tracking", "repositioned"), 2);
  EXPECT_GE(listener.counter("hand", "repositioned"), 2);
  double farthest = 0;
  for (const auto& sample : listener.simulated) farthest = std::max(farthest, std::abs(sample.wrist[0]));
  EXPECT_NEAR(farthest, 10, 1);
  // The bone with NaN is refused for half a second at 90 Hz, and its place is inferred. The rest of the hand goes on.
  EXPECT_NEAR(listener.counter("tracking", "refused_nonfinite"), 45, 15);
  EXPECT_GT(listener.counter("tracking", "inferred"), 0);
  // The freeze is reported as stale, and then as over.
  EXPECT_EQ(listener.peaks["tracking"]["stale"], 1);
  EXPECT_EQ(listener.counter("tracking", "stale"), 0);
  EXPECT_GT(largest_step_age, 1500);
  // During the freeze the simulated hand stays where it is: no drift, no drop.
  Vec3 frozen{};
  double drift = 0;
  bool any = false;
  for (const auto& sample : listener.simulated) {
    if (motion_time(sample.time) < 6.2 || motion_time(sample.time) > 7.4) continue;
    if (!any) frozen = sample.wrist;
    any = true;
    drift = std::max(drift, (to_vector(sample.wrist) - to_vector(frozen)).norm());
  }
  EXPECT_TRUE(any);
  EXPECT_LT(drift, 0.002);
  EXPECT_TRUE(listener.wait(5s, [&] { return follows(listener, start + 8'000'000'000); }))
      << listener.simulated.back().follow_error;
  std::printf("drift while frozen %.3f mm, follow error at the end %.1f mm\n", drift * 1e3,
              listener.simulated.back().follow_error * 1e3);
  expect_all_finite(listener);
  for (const std::string& module : kModules) EXPECT_TRUE(is_alive(listener.modules.at(module).process_id)) << module;
}

// The module has a name that would clear the terminal.
TEST_F(Rig, SendNamesAModuleThatDoesNotAnswer) {
  const bus::Participant participant("world");
  const bus::Reader messages(participant, bus::topics::message);
  bus::Writer statuses(participant, bus::topics::loop_status);
  const std::jthread module([&](const std::stop_token& stop) {
    LoopStatus status;
    set_text(status.module, "deaf\x1b[2J");
    status.stamp.epoch = participant.epoch();
    while (!stop.stop_requested()) {
      ++status.stamp.sequence;
      status.stamp.sample_time = status.stamp.publish_time = now();
      statuses.write(status);
      std::this_thread::sleep_for(50ms);
    }
  });
  const Finished sent = run_program({SOFTHAND_PROGRAMS "/softhand", "send", "*", "pace", "1"});
  EXPECT_EQ(sent.exit_code, 1);
  EXPECT_NE(sent.output.find("softhand send: module deaf?[2J did not answer\n"), std::string::npos) << sent.output;
}

TEST_F(Rig, EveryModuleAnswersEveryMessage) {
  RigListener listener;
  Up up(kTouch, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  ASSERT_TRUE(listener.wait(15s, [&] { return listener.device_is_on(kHaptic) && listener.device_is_on(kTactile); }));
  const auto send = [](const std::string& module, const std::string& key, const std::string& value) {
    return run_program({SOFTHAND_PROGRAMS "/softhand", "send", module, key, value});
  };
  /// Module -> result, from the output of `softhand send`.
  const auto answers = [](const Finished& sent) {
    std::map<std::string, std::string> results;
    std::istringstream lines(sent.output);
    for (std::string line; std::getline(lines, line);) {
      std::istringstream words(line);
      std::string module, result;
      if (words >> module >> result && kModules.count(module) != 0) results[module] = result;
    }
    return results;
  };
  const auto expect_from_all = [&](const Finished& sent) {
    const auto results = answers(sent);
    for (const std::string& module : kModules)
      EXPECT_EQ(results.count(module), 1u) << module << " did not answer:\n" << sent.output;
    return results;
  };

  const Finished off = send("*", "motors", "off");
  auto results = expect_from_all(off);
  EXPECT_EQ(off.exit_code, 0);
  for (const std::string& module : kModules)
    EXPECT_EQ(results[module], module == "haptic" || module == "tactile" ? "applied" : "not") << module;
  listener.listen(100ms);
  const Nanoseconds switched_off = now();
  listener.listen(1s);
  for (const std::uint32_t device : {kHaptic, kTactile}) {
    int samples = 0;
    for (const auto& sample : listener.devices[device]) {
      if (sample.time < switched_off) continue;
      ++samples;
      ASSERT_EQ(sample.largest_command, 0) << "device " << device << " commands with its motors off";
    }
    EXPECT_GT(samples, 100);
  }

  results = expect_from_all(send("haptic", "motors", "on"));
  EXPECT_EQ(results["haptic"], "applied");
  EXPECT_EQ(results["tactile"], "not");
  EXPECT_TRUE(listener.wait(15s, [&] { return listener.device_is_on(kHaptic); }));

  const Finished refused = send("haptic", "gain", "2");
  EXPECT_EQ(answers(refused)["haptic"], "REFUSED") << refused.output;
  EXPECT_EQ(refused.exit_code, 1);
}

// An outsider writes another world, in which the held cube's id is a sphere. It describes the cube as of tomorrow, and
// is a hand of tomorrow.
TEST_F(Rig, TheHandHoldsItsCubeBesideAnotherWorld) {
  RigListener listener;
  Up up(kDemo, {"--set", "hand.simulation.other_hands=true"});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  const bus::Participant outsider("outsider");
  bus::Writer worlds(outsider, bus::topics::objects);
  bus::Writer descriptions(outsider, bus::topics::object_description);
  bus::Writer couplings(outsider, bus::topics::object_coupling);
  const auto height = [&] { return listener.objects.count(kCube) != 0 ? listener.objects.at(kCube)[1] : 0.0; };
  ASSERT_TRUE(listener.wait(20s, [&] { return height() > kHeld; })) << "the cube was never lifted";

  constexpr Nanoseconds kDay = 86'400'000'000'000;
  const auto stamp = [&](Stamp& out, Nanoseconds later) {
    ++out.sequence;
    out.epoch = outsider.epoch();
    out.publish_time = now();
    out.sample_time = out.publish_time + later;
  };
  ObjectDescription cube;
  cube.object = kCube;
  cube.mass = 0.05;
  cube.inertia = {1e-5, 1e-5, 1e-5};
  cube.shape.size = {0.02, 0, 0};
  stamp(cube.stamp, kDay);
  descriptions.write(cube);
  auto world = std::make_unique<WorldObjects>();
  world->world = cube.world = 1;
  stamp(cube.stamp, 0);
  descriptions.write(cube);
  auto coupling = std::make_unique<ObjectCoupling>();
  coupling->hand = {3, 0};
  double lowest = 1;
  const Nanoseconds end = now() + 600'000'000;
  while (now() < end) {
    stamp(world->stamp, 0);
    worlds.write(*world);
    stamp(coupling->stamp, kDay);
    couplings.write(*coupling);
    listener.listen(2ms);
    lowest = std::min(lowest, height());
  }
  EXPECT_GT(lowest, kHeld - 0.01) << "the hand let the cube fall";
  EXPECT_TRUE(listener.wait(2s, [&] { return listener.counter("hand", "other_worlds") > 0; }));
  EXPECT_EQ(listener.counter("hand", "refused_objects"), 1);
  EXPECT_GT(listener.counter("hand", "refused_stamp"), 0) << "of the outsider's couplings";
  EXPECT_EQ(listener.counter("hand", "couplings_from_future"), 0) << "their reader has refused them";
}

TEST_F(Rig, FollowsATrackerThatRestartsItsMotionAtOnce) {
  RigListener listener;
  Up up(kDemo, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener) && follows(listener, 0); })) << up.output();
  listener.listen(3s);  // earlier, samples of the new motion were refused for as long as the old motion had run
  const double refused = listener.counter("tracking", "refused_order");
  ASSERT_EQ(run_program({SOFTHAND_PROGRAMS "/softhand", "send", "tracker", "restart", "now"}).exit_code, 0);
  const Nanoseconds sent = now();
  EXPECT_TRUE(listener.wait(1500ms, [&] { return follows(listener, sent); }));
  listener.listen(300ms);
  EXPECT_LE(listener.counter("tracking", "refused_order"), refused + 2);
}

TEST_F(Rig, SendsSurfacesOnlyWhileSomebodyReadsThem) {
  RigListener listener;
  Up up(kDemo, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  ASSERT_TRUE(listener.wait(10s, [&] { return follows(listener, 0); }));
  listener.listen(500ms);
  EXPECT_EQ(listener.counter("hand", "surfaces_sent"), 0) << "nobody reads tissue_surface";
  {
    const bus::Participant participant("viewer");
    bus::Reader<TissueSurface> surfaces(participant, bus::topics::tissue_surface);
    std::size_t heard = 0;
    auto surface = std::make_unique<TissueSurface>();
    ASSERT_TRUE(listener.wait(10s, [&] { return (heard += surfaces.take_latest(*surface) ? 1 : 0) > 20; }));
    EXPECT_GT(surface->nodes.size(), 100u);
    listener.listen(300ms);
    EXPECT_GT(listener.counter("hand", "surfaces_sent"), 20);
  }
  listener.listen(1s);  // until the writer knows that the reader has gone
  const double sent = listener.counter("hand", "surfaces_sent");
  listener.listen(1s);
  EXPECT_EQ(listener.counter("hand", "surfaces_sent"), sent) << "surfaces were sent after the reader had gone";
}

}  // namespace
}  // namespace softhand::rig::rig_test
