// Cases with real processes that are killed, stopped or starved. Their figures are times on this machine.
#include <signal.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <string>
#include <thread>

#include "bus/bus.hpp"
#include "bus/topics.hpp"
#include "integration/rig_harness.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "stress/cases.hpp"
#include "support/own_domain.hpp"

namespace softhand::stress {
namespace {

using namespace std::chrono_literals;

constexpr const char* kTouch = "tests/integration/rig_touch.toml";  // two fingers on a fixed post, without end
constexpr double kFollows = 0.02;                                   // m, mean over the joints
constexpr double kPeriod = 1.0 / 90;                                // s, of the hand

double milliseconds(Nanoseconds from, Nanoseconds to) { return static_cast<double>(to - from) * 1e-6; }

/// Chooses the DDS domain before a reader or a process starts.
struct OwnDomain {
  OwnDomain() { testing::use_own_domain(); }
};

/// A running rig. Its hand touches something and follows its tracker.
class RunningRig : OwnDomain {
 public:
  explicit RunningRig(const char* file = kTouch, const std::vector<std::string>& arguments = {})
      : up_(file, arguments) {
    const bool runs = listener.wait(30s, [&] {
      return std::all_of(kModules.begin(), kModules.end(),
                         [&](const char* module) { return listener.process_id(module) > 0; }) &&
             follows(0) && listener.device_is_on(1);
    });
    if (!runs) throw std::runtime_error("the rig did not come up: " + up_.output());
  }
  bool follows(Nanoseconds since) const {
    constexpr std::ptrdiff_t kSteps = 10;
    return listener.simulated.size() >= kSteps &&
           std::all_of(listener.simulated.end() - kSteps, listener.simulated.end(),
                       [&](const rig::RigListener::HandSample& s) {
                         return s.tracker_sample > since && s.follow_error >= 0 && s.follow_error < kFollows;
                       });
  }
  void signal(const char* module, int number) const {
    if (kill(static_cast<pid_t>(listener.process_id(module)), number) != 0)
      throw std::runtime_error(std::string("cannot signal ") + module);
  }
  void judge(Findings& findings) const {
    std::uint64_t nonfinite = 0;
    for (const auto& [topic, count] : listener.nonfinite) nonfinite += count;
    findings.demand("G1", "messages published with numbers that are not finite", static_cast<double>(nonfinite), 0, "1",
                    Class::diverged);
  }

  static constexpr std::array<const char*, 6> kModules{"world", "hand", "tracking", "haptic", "tactile", "tracker"};
  rig::RigListener listener;

 private:
  rig::Up up_;
};

// Kills the module. The time from then to its first status with another epoch, ms; NaN: there was none within 10 s.
double kill_and_wait(RunningRig& rig, const char* module) {
  const auto status = [&]() -> const LoopStatus& { return rig.listener.modules.at(module); };
  const std::uint64_t epoch = status().stamp.epoch;
  const Nanoseconds when = now();
  rig.signal(module, SIGKILL);
  const bool lives = rig.listener.wait(10s, [&] { return status().stamp.epoch != epoch; });
  return lives ? milliseconds(when, status().stamp.publish_time) : std::nan("");
}
constexpr double kLive = 1000;  // ms
constexpr const char* kLiveText = "kill to the first status with another epoch";

Findings killed(const char* module) {
  RunningRig rig;
  const Nanoseconds when = now();
  const double after = kill_and_wait(rig, module);
  const bool follows = rig.listener.wait(10s, [&] { return rig.follows(when); });
  Findings findings;
  rig.judge(findings);
  findings.demand("follows", "runs in which the hand does not follow again", follows ? 0 : 1, 0, "1");
  findings.demand("live within 1 s, new epoch", kLiveText, after, kLive, "ms");
  return findings;
}

// The hand's process is killed while thumb and index finger squeeze a flexible ball. It simulates the ball, too.
// `soft`: of the options of the world.
Findings soft_object_dropped(const std::string& soft) {
  RunningRig rig("config/rigs/demo.toml", {"--scene", SOFTHAND_SOURCE_DIR "/config/scenes/sponge.toml", "--set",
                                           "hand.model=right_400.hand.json", "--set", "viewer.port=0", "--set",
                                           "hand.simulation.solver.work_budget=8", "--set", "world.soft=" + soft});
  bus::Participant participant("soft-stress");
  bus::Reader<SoftObjectState> reader(participant, bus::topics::soft_object_state);
  SoftObjectState ball;
  bool finite = true;
  const auto waits = [&](std::chrono::milliseconds time, auto&& done) {
    return rig.listener.wait(time, [&] {
      reader.take_all([&](const SoftObjectState& each) {
        ball = each;
        finite = finite && to_vector(each.centre).allFinite() &&
                 std::all_of(each.nodes.begin(), each.nodes.end(),
                             [](const auto& node) { return to_vector(node).allFinite(); });
      });
      return done();
    });
  };
  const auto squeezed = [&] { return ball.contact_count >= 10; };
  if (!waits(30s, squeezed)) throw std::runtime_error("the ball was not squeezed");
  const std::uint64_t epoch = ball.stamp.epoch;
  const double after = kill_and_wait(rig, "hand");
  const bool again = waits(30s, [&] { return ball.stamp.epoch != epoch && squeezed(); });
  Findings findings;
  rig.judge(findings);
  findings.demand("G1", "messages of the ball with numbers that are not finite", finite ? 0 : 1, 0, "1",
                  Class::diverged);
  findings.demand("squeezed again", "runs in which the hand does not squeeze it again", again ? 0 : 1, 0, "1");
  findings.demand("whole", "inverted tetrahedra in the second squeeze", ball.inverted_elements, 0, "1",
                  Class::inverted);
  findings.demand("live within 1 s, new epoch", kLiveText, after, kLive, "ms");
  return findings;
}

Findings stopped() {
  RunningRig rig;
  rig.signal("hand", SIGSTOP);
  rig.listener.listen(2s);
  const Nanoseconds when = now();
  rig.signal("hand", SIGCONT);
  const bool follows = rig.listener.wait(10s, [&] { return rig.follows(when); });
  // Counts the interrupted step, the step that is due and one catch-up step.
  const auto early = std::count_if(rig.listener.simulated.begin(), rig.listener.simulated.end(),
                                   [&](const rig::RigListener::HandSample& s) {
                                     return s.time > when && s.time < when + static_cast<Nanoseconds>(0.9e9 * kPeriod);
                                   });
  Findings findings;
  rig.judge(findings);
  findings.demand("follows", "runs in which the hand does not follow again", follows ? 0 : 1, 0, "1");
  findings.demand("at most one catch-up step", "steps published within 0.9 periods after SIGCONT",
                  static_cast<double>(early), 3, "1");
  return findings;
}

// Other threads occupy every core. The hand must make each step or count its deadline as missed.
Findings starved() {
  RunningRig rig;
  std::atomic<bool> stop{false};
  std::vector<std::thread> others;
  for (unsigned i = 0; i < 2 * std::max(1u, std::thread::hardware_concurrency()); ++i) {
    others.emplace_back([&stop] {
      while (!stop.load(std::memory_order_relaxed)) {
      }
    });
  }
  const auto counted = [&] {
    const LoopStatus& status = rig.listener.modules.at("hand");
    return std::pair(status.stamp.publish_time, static_cast<double>(status.steps + status.deadline_misses));
  };
  rig.listener.listen(1s);
  const auto [from, before] = counted();
  rig.listener.listen(5s);
  const auto [to, after] = counted();
  stop = true;
  for (std::thread& other : others) other.join();
  Findings findings;
  rig.judge(findings);
  findings.demand_at_least("G7", "steps made or counted as missed, over the steps due",
                           (after - before) * kPeriod / (static_cast<double>(to - from) * 1e-9), 0.95, "1",
                           Class::over_budget);
  return findings;
}

}  // namespace

std::vector<Case> process_cases() {
  CaseList cases("World");
  auto* rows = &cases.add(
      "killed", "kill -9 on a process of a running rig: live within 1 s under a new epoch, and the hand follows");
  for (const char* module : {"hand", "world", "tracking", "tracker"})
    rows->push_back({module, [module] { return killed(module); }, {}, false, true});
  rows = &cases.add(
      "soft_object_dropped",
      "kill -9 on the hand while it squeezes a flexible ball: live within 1 s, and the ball is squeezed again");
  rows->push_back({"hand", [] { return soft_object_dropped("hand"); }, {}, false, true});
  rows->push_back({"hand, world.soft = world", [] { return soft_object_dropped("world"); }, {}, false, true});
  cases.add("stopped", "SIGSTOP on the hand's process: after SIGCONT at most one catch-up step, and the hand follows")
      .push_back({"2 s", [] { return stopped(); }, {}, false, true});
  cases.add("starved", "two busy threads per core: each step is made or counted as missed")
      .push_back({"5 s", [] { return starved(); }, {}, false, true});
  return cases.take();
}

}  // namespace softhand::stress
