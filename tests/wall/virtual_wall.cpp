#include "wall/virtual_wall.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "device/device_loop.hpp"
#include "trackers/replay/motion.hpp"

namespace softhand::wall {
namespace {

constexpr Nanoseconds kStart = 1'000'000'000, kMillisecond = 1'000'000;
constexpr int kSubsteps = 50;
constexpr double kSlew = 1000;   // N/s
constexpr double kNear = 0.015;  // m, as ContactSet::near_gap
constexpr double kStep = 1e-3, kSubstep = kStep / kSubsteps;

// The wall is at 0, and its inside is negative. A press, three taps, and a second press from which the user lets go.
constexpr double kOutside = 0.01, kDepth = -0.01;
struct Part {
  double end, from, to, duration;  // a motion from `from` to `to` that begins `duration` before or at the last end
};
constexpr std::array kParts{
    Part{0.3, kOutside, kDepth, 0.2}, Part{3.0, kDepth, kDepth, 1},     Part{3.3, kDepth, kOutside, 0.2},
    Part{3.4, kOutside, kDepth, 0.1}, Part{3.5, kDepth, kOutside, 0.1}, Part{3.6, kOutside, kDepth, 0.1},
    Part{3.7, kDepth, kOutside, 0.1}, Part{3.8, kOutside, kDepth, 0.1}, Part{3.9, kDepth, kOutside, 0.1},
    Part{4.4, kOutside, kDepth, 0.5}, Part{7.0, kDepth, kDepth, 1},     Part{7.6, kDepth, kOutside, 0.6}};
constexpr double kEnd = 8;
constexpr std::array<std::array<double, 2>, 2> kHolds{{{2.5, 3.0}, {6.5, 7.0}}};
constexpr std::array<double, 2> kPressed{0.5, 3.0};

double wanted(double time) {
  double begin = 0;
  for (const Part& part : kParts) {
    if (time < part.end) return part.from + (part.to - part.from) * minimum_jerk((time - begin) / part.duration);
    begin = part.end;
  }
  return kParts.back().to;
}

// Where the wall is, and its velocity.
std::array<double, 2> wall_at(const Swing& swing, double time) {
  const double rate = 2 * M_PI * swing.frequency;
  return {swing.amplitude * std::sin(rate * time), swing.amplitude * rate * std::cos(rate * time)};
}

// One actuator. A positive command pushes out of the wall.
class WallDriver final : public HapticDriver {
 public:
  WallDriver(const Trial& trial, const double& position, const double& velocity)
      : device_(trial.device),
        measures_(trial.mode != Mode::held),
        path_(trial.path),
        random_(trial.seed + 1000),
        position_(position),
        velocity_(velocity) {}
  DeviceLimits limits() const override {
    return {1, -device_.force, device_.force, kSlew, device_.stiffness, device_.damping};
  }
  void command(const BoneWrench& input, std::span<double> requested) override {
    requested[0] = input.bones[0].coupling_force[0];
  }
  bool measure(Nanoseconds, std::span<double> positions) override {
    reports_.push_back({device_.resolution * std::floor(position_ / device_.resolution), velocity_, force});
    if (reports_.size() > static_cast<std::size_t>(path_.delay) + 1) reports_.pop_front();
    if (static_cast<double>(random_() >> 11) * 0x1.0p-53 >= path_.missing) report_ = reports_.front();
    positions[0] = report_[0];
    return measures_;
  }
  bool measure_velocities(std::span<double> velocities) override {
    velocities[0] = report_[1];
    return path_.measures_velocity;
  }
  bool measure_commands(std::span<double> commands) override {
    commands[0] = report_[2];
    return path_.knows_commands;
  }
  void write(Nanoseconds, std::span<const double> commands) override {
    commands_.push_back(commands[0]);
    if (commands_.size() <= static_cast<std::size_t>(path_.delay)) return;
    force = commands_.front();
    commands_.pop_front();
  }

  double force = 0;

 private:
  Device device_;
  bool measures_;
  Path path_;
  std::mt19937_64 random_;
  const double& position_;
  const double& velocity_;
  std::deque<std::array<double, 3>> reports_;  // on their way: position, velocity, force that acted
  std::array<double, 3> report_{};
  std::deque<double> commands_;  // on their way
};

}  // namespace

Result run(const Trial& trial) {
  double x = kOutside, v = 0;
  const auto driver = std::make_shared<WallDriver>(trial, x, v);
  DeviceLoop<BoneWrench> loop({}, driver, 1, 0);
  struct Message {
    Nanoseconds arrives = 0;
    BoneWrench wrench;
  };
  std::vector<Message> under_way;
  std::mt19937_64 random(trial.seed);
  const auto uniform = [&random] { return static_cast<double>(random() >> 11) * 0x1.0p-53; };
  const double mass = trial.device.mass + trial.hand.mass;

  Result result;
  const double damping = 2 * std::sqrt(trial.stiffness * mass);
  double energy = 0, next_sample = 0, squares = 0;
  int pressed = 0;
  std::uint64_t sequence = 0;
  struct Hold {
    double lowest = 1, highest = -1, force = 0, depth = 0;
    int count = 0;
  };
  std::array<Hold, kHolds.size()> holds;
  for (int i = 0; i * kStep < kEnd; ++i) {
    const double time = i * kStep;
    const Nanoseconds now = kStart + i * kMillisecond;
    if (time >= next_sample) {  // the simulation's tracker samples the hand
      next_sample += 1 / trial.link.rate;
      const double age = trial.link.age + trial.link.jitter * (2 * uniform() - 1);
      const bool is_lost = uniform() < trial.link.loss;
      Message message;
      message.arrives = now + static_cast<Nanoseconds>(1e9 * age);
      BoneWrench& wrench = message.wrench;
      wrench.simulated_valid = 1;
      wrench.stamp.sequence = ++sequence;
      wrench.stamp.epoch = 1;
      wrench.stamp.sample_time = now;
      wrench.stamp.publish_time = message.arrives;
      BoneSample& bone = wrench.bones[0];
      bone.tracked_position[0] = x;
      const auto [wall, wall_speed] = wall_at(trial.swing, time);
      if (x - wall < (trial.mode == Mode::near ? kNear : 0)) {
        bone.coupling_force[0] = std::max(0.0, trial.stiffness * (wall - x));
        bone.contact_gap = std::max(0.0, x - wall);
        bone.contact_normal = {1, 0, 0};
        bone.contact_stiffness = trial.stiffness;
        bone.contact_damping = damping;
        if (trial.swing.tells_speed) bone.contact_velocity[0] = wall_speed;
      }
      if (!is_lost) under_way.push_back(message);
    }
    const BoneWrench* newest = nullptr;
    for (const Message& message : under_way) {
      if (message.arrives > now) continue;
      if (newest == nullptr || message.wrench.stamp.sequence > newest->stamp.sequence) newest = &message.wrench;
    }
    loop.step(now, newest);
    std::erase_if(under_way, [now](const Message& message) { return message.arrives <= now; });

    for (int s = 0; s < kSubsteps; ++s) {
      const double t = time + s * kSubstep, before = x;
      const auto [wall, wall_speed] = wall_at(trial.swing, t);
      double wanted_now = wanted(t), wanted_speed = (wanted(t + kSubstep) - wanted_now) / kSubstep;
      if (trial.swing.is_carried) {
        wanted_now += wall;
        wanted_speed += wall_speed;
      }
      const double hand = trial.hand.stiffness * (wanted_now - x) + trial.hand.damping * (wanted_speed - v);
      v += kSubstep / mass * (hand + driver->force - trial.device.friction * v);
      x += kSubstep * v;
      energy -= driver->force * (x - before - kSubstep * wall_speed);
      if (t >= kPressed[0] && t < kPressed[1]) {
        const double ideal = trial.stiffness * (wall - x) - damping * (v - wall_speed);
        const double error = driver->force - (wall > x ? std::clamp(ideal, 0.0, trial.device.force) : 0);
        squares += error * error;
        ++pressed;
      }
      result.lowest_energy = std::min(result.lowest_energy, energy);
    }
    for (std::size_t h = 0; h < kHolds.size(); ++h) {
      if (time < kHolds[h][0] || time >= kHolds[h][1]) continue;
      Hold& hold = holds[h];
      hold.lowest = std::min(hold.lowest, x);
      hold.highest = std::max(hold.highest, x);
      hold.force += driver->force;
      hold.depth -= x;
      ++hold.count;
    }
  }
  for (const Hold& hold : holds) result.ripple = std::max(result.ripple, hold.highest - hold.lowest);
  result.rendered = holds[0].force / holds[0].depth;
  result.force_error = std::sqrt(squares / pressed);
  return result;
}

Result worst(Trial trial) {
  constexpr std::uint64_t kSeeds = 5;
  Result out;
  out.rendered = std::numeric_limits<double>::infinity();
  for (const Hand& hand : kHands) {
    trial.hand = hand;
    for (trial.seed = 1; trial.seed <= kSeeds; ++trial.seed) {
      const Result result = run(trial);
      out.lowest_energy = std::min(out.lowest_energy, result.lowest_energy);
      out.ripple = std::max(out.ripple, result.ripple);
      out.rendered = std::min(out.rendered, result.rendered);
      out.force_error = std::max(out.force_error, result.force_error);
    }
  }
  return out;
}

double largest_stiffness(const Device& device, const Link& link, Mode mode, bool passive, const Path& path) {
  double largest = 0;
  for (int step = 0; step <= 30; ++step) {
    const double stiffness = std::pow(10, 1 + 0.1 * step);
    const Result result = worst({device, {}, link, stiffness, mode, 0, path});
    if (!result.stable() || (passive && !result.passive())) break;
    largest = stiffness;
  }
  return largest;
}

}  // namespace softhand::wall
