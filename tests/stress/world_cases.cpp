// World cases: rates, stalls, stops and losses of the world and of the messages between loops, and couplings from soft
// to stiff.
#include <cmath>
#include <cstdio>
#include <string>

#include "messages/convert.hpp"
#include "stress/cases.hpp"
#include "stress/grasp.hpp"

namespace softhand::stress {
namespace {

// A pseudo-random number in [0, 1). It is always the same for the same loop, time and salt.
double chance(RigLoop loop, double time, std::uint64_t salt) {
  std::uint64_t x = static_cast<std::uint64_t>(std::llround(time * 1e9)) * 8 + static_cast<std::uint64_t>(loop) +
                    salt * 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return static_cast<double>((x ^ (x >> 31)) >> 11) * 0x1p-53;
}

std::function<bool(RigLoop, double)> stopped(RigLoop which, double from, double seconds) {
  return [which, from, seconds](RigLoop loop, double time) {
    return loop != which || time < from || time >= from + seconds;
  };
}

Findings world_stops_and_jumps() {
  Grasp setting;
  setting.seconds = 5;
  setting.held = false;
  setting.runs = stopped(RigLoop::world, kEvent, 2);
  bool jumped = false;
  setting.at_step = [&jumped](VirtualRig& rig, double time) {
    if (time < kEvent + 2 || jumped) return;
    jumped = true;
    tell_world(rig, "object.teleport", "cube 0.35 0.09 0.35");  // still on the table
  };
  Grasped result = grasp(setting);
  result.demand_slow_cube();
  return result.findings;
}

Findings stop(RigLoop which, double seconds, bool held) {
  Grasp setting;
  setting.seconds = kEvent + seconds + 1;
  setting.held = held;
  setting.runs = stopped(which, kEvent, seconds);
  Grasped result = grasp(setting);
  result.demand_slow_cube();
  return result.findings;
}

Findings world_rate(double rate) {
  Grasp setting;
  setting.overrides = {fmt::format("world.rate_hz={}", rate)};
  return grasp_findings(setting);
}

// The world's process runs only after pauses, whatever its rate is.
Findings world_scheduled(double rate, const std::function<double(double)>& pause) {
  Grasp setting;
  setting.seconds = 3;
  setting.overrides = {fmt::format("world.rate_hz={}", rate)};
  setting.held = false;
  double next = 0;
  setting.runs = [&next, &pause](RigLoop loop, double time) {
    if (loop != RigLoop::world) return true;
    if (time < next) return false;
    next = time + pause(time);
    return true;
  };
  Grasped result = grasp(setting);
  result.demand_slow_cube();
  return result.findings;
}

Findings loss_and_jitter(double loss, double jitter) {
  Grasp setting;
  setting.seconds = 3;
  setting.delay = [loss, jitter](RigLoop from, double time) {
    return chance(from, time, 1) < loss ? -1.0 : jitter * chance(from, time, 2);
  };
  Grasped result = grasp(setting);
  result.demand_slow_cube();
  return result.findings;
}

// Reads the number that follows `word` in `text`.
bool number_after(const std::string& text, const std::string& word, double& value) {
  const std::size_t at = text.find(word);
  return at != std::string::npos && std::sscanf(text.c_str() + at + word.size(), "%lf", &value) == 1;
}

/// A coupling either runs with the cube at rest at the end, or it is refused. A refusal must name the growth and offer
/// values that then run.
Findings stable_or_refused(Grasp setting, const std::function<bool(const std::string&, Grasp&)>& take_offer) {
  constexpr double kSlowObject = 0.2;  // m/s
  const auto judged = [](const Grasp& which) {
    Grasped result = grasp(which);
    result.findings.demand("stable", "speed of the cube over the last 0.3 s", result.fastest(which.seconds - 0.3),
                           kSlowObject, "m/s");
    return result.findings;
  };
  setting.held = false;
  Findings first = judged(setting);
  if (first.refusal.empty()) return first;
  // An option out of its range is refused first, so one refusal may follow another.
  Findings offered = first;
  for (int refusals = 0; refusals < 3 && !offered.refusal.empty() && take_offer(offered.refusal, setting); ++refusals)
    offered = judged(setting);
  offered.demand("offer", "refusals whose offered values are not accepted", offered.refusal.empty() ? 0 : 1, 0, "1");
  offered.refusal = first.refusal;
  offered.refusal_is_right = true;
  return offered;
}

// Mode symmetric: the spring of the patent text between an object and its copy.
Findings symmetric(double factor, double world_rate) {
  Grasp setting;
  setting.overrides = {"world.mode=symmetric", fmt::format("world.rate_hz={}", world_rate),
                       fmt::format("world.stiffness={}", 500 * factor),
                       fmt::format("world.angular_stiffness={}", 0.1 * factor)};
  return stable_or_refused(setting, [](const std::string& reason, Grasp& offered) {
    bool any = false;
    for (const char* key : {"world.stiffness", "world.angular_stiffness"}) {
      const std::size_t line = reason.find(std::string(key) + " = ");
      if (line == std::string::npos) continue;
      const std::string text = reason.substr(line, reason.find('\n', line) - line);
      double value = 0;
      if (number_after(text, "nearest value that works: ", value)) {
        offered.overrides.push_back(fmt::format("{}={}", key, value));
        any = true;
      } else if (text.find("use mode owner") != std::string::npos) {
        offered.overrides.push_back("world.mode=owner");
        any = true;
      }
    }
    return any;
  });
}

// Mode owner: the world's copy follows the hand's copy.
Findings owner(double factor, double world_rate) {
  Grasp setting;
  setting.overrides = {fmt::format("world.rate_hz={}", world_rate),
                       fmt::format("world.follow_stiffness={}", 0.25 * factor)};
  return stable_or_refused(setting, [](const std::string& reason, Grasp& offered) {
    double value = 0;
    if (!number_after(reason, "nearest value that works: ", value) &&
        !number_after(reason, "expected number in [0.001, ", value))
      return false;
    // Replaces the refused override: an override out of range is refused before later overrides are read.
    offered.overrides.back() = fmt::format("world.follow_stiffness={}", value);
    return true;
  });
}

// The hand's couplings to the intermediate skeleton.
Findings tracking(double factor, double hand_rate, double tracking_rate) {
  static constexpr double kStiffest = 1e6, kStiffestTurn = 1e4;  // largest values in a hand file, N/m and N m/rad
  const auto scaled = [factor](bool clamp) {
    return [factor, clamp](HandModel& hand) {
      for (BodyModel& body : hand.bodies) {
        body.coupling_linear_stiffness *= factor;
        body.coupling_angular_stiffness *= factor;
        if (!clamp) continue;
        body.coupling_linear_stiffness = std::min(body.coupling_linear_stiffness, kStiffest);
        body.coupling_angular_stiffness = std::min(body.coupling_angular_stiffness, kStiffestTurn);
      }
    };
  };
  Grasp setting;
  setting.overrides = {fmt::format("hand.rate_hz={}", hand_rate), fmt::format("tracking.rate_hz={}", tracking_rate)};
  setting.hand = scaled(false);
  return stable_or_refused(setting, [&scaled](const std::string& reason, Grasp& offered) {
    if (reason.find("linear_stiffness") != std::string::npos || reason.find("angular_stiffness") != std::string::npos) {
      offered.hand = scaled(true);  // the end of the file's range is the nearest value
      return true;
    }
    double stiffness = 0, feedback = 0, mass = 0;
    const std::size_t at = reason.find("e.g. ");
    if (at == std::string::npos ||
        std::sscanf(reason.c_str() + at, "e.g. stiffness_ratio %lf, feedback_ratio %lf, mass_fraction %lf", &stiffness,
                    &feedback, &mass) != 3)
      return false;
    for (const auto& [key, value] :
         {std::pair{"stiffness_ratio", stiffness}, {"feedback_ratio", feedback}, {"mass_fraction", mass}}) {
      offered.overrides.push_back(fmt::format("tracking.{}={}", key, value));
    }
    return true;
  });
}

}  // namespace

std::vector<Case> world_cases() {
  CaseList cases("World");
  cases.add("world_stops", "the world stops for 2 s and the cube jumps by 0.5 m, and its speed stays below 5 m/s")
      .push_back({"2 s, 0.5 m", [] { return world_stops_and_jumps(); }, {}, true});
  auto* rows = &cases.add("world_rate", "the cube is lifted and held, or stays below 5 m/s if the world hardly runs");
  for (const double rate : {30.0, 60.0, 1000.0})
    rows->push_back({named("rate", rate, "Hz"), [rate] { return world_rate(rate); }, {}, rate == 30});
  rows->push_back({"a step every 200 ms", [] { return world_scheduled(30, [](double) { return 0.2; }); }, {}, true});
  rows->push_back({"a step every 5 to 200 ms", [] {
                     return world_scheduled(
                         250, [](double time) { return 0.005 + 0.195 * chance(RigLoop::world, time, 3); });
                   }});
  rows = &cases.add("loop_stops", "a loop stops: the cube is still held after 50 ms, and stays below 5 m/s after 2 s");
  const std::array<std::pair<const char*, RigLoop>, 3> loops{
      {{"tracking", RigLoop::tracking}, {"hand", RigLoop::hand}, {"world", RigLoop::world}}};
  for (const auto& [name, loop] : loops) {
    rows->push_back(
        {fmt::format("{}, 50 ms", name), [loop] { return stop(loop, 0.05, true); }, {}, loop == RigLoop::hand});
    if (loop != RigLoop::world)
      rows->push_back({fmt::format("{}, 2 s", name), [loop] { return stop(loop, 2, false); }});
  }
  rows = &cases.add("loss_and_jitter", "the cube is lifted and held");
  rows->push_back({"5 % lost", [] { return loss_and_jitter(0.05, 0); }});
  rows->push_back({"jitter of 50 ms", [] { return loss_and_jitter(0, 0.05); }});
  rows->push_back({"5 % lost, jitter of 50 ms", [] { return loss_and_jitter(0.05, 0.05); }, {}, true});

  constexpr std::array<double, 7> factors{1e-2, 1e-1, 1, 10, 1e2, 1e3, 1e4};
  rows = &cases.add("symmetric_coupling", "stable, or refused with a value that is stable");
  for (const double rate : {30.0, 90.0, 250.0, 1000.0}) {
    for (const double factor : factors) {
      rows->push_back({fmt::format("k x {:g}, {:g} : 90 Hz", factor, rate),
                       [factor, rate] { return symmetric(factor, rate); },
                       {},
                       rate == 30 && (factor == 1 || factor == 1e4)});
    }
  }
  rows = &cases.add("owner_coupling", "stable, or refused with a value that is stable");
  for (const double rate : {30.0, 250.0, 1000.0}) {
    for (const double factor : factors) {
      rows->push_back({fmt::format("k x {:g}, {:g} : 90 Hz", factor, rate),
                       [factor, rate] { return owner(factor, rate); },
                       {},
                       rate == 250 && (factor == 1 || factor == 100)});
    }
  }
  rows = &cases.add("tracking_coupling", "stable, or refused with values that are stable");
  const std::array<std::pair<double, double>, 3> rates{{{90, 1000}, {90, 90}, {240, 1000}}};
  for (const auto& [hand_rate, tracking_rate] : rates) {
    for (const double factor : factors) {
      rows->push_back({fmt::format("k x {:g}, {:g} : {:g} Hz", factor, tracking_rate, hand_rate),
                       [factor, hand = hand_rate, track = tracking_rate] { return tracking(factor, hand, track); },
                       {},
                       factor == 100 && tracking_rate == 90});
    }
  }
  return cases.take();
}

}  // namespace softhand::stress
