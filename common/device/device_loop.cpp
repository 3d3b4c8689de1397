#include "device/device_loop.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "device/answer.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"

namespace softhand {

void add_closing_resistance(const BoneWrench& input, std::span<double> forces) {
  for (std::size_t b = 2; b < kBodyCount; ++b) {  // after forearm and carpus
    const Finger finger = finger_of(static_cast<Body>(b));
    const BoneSample& distal = input.bones[static_cast<std::size_t>(index_of(distal_of(finger)))];
    const Vector3 back = to_quaternion(distal.intermediate_orientation) * Vector3::UnitY();
    forces[static_cast<std::size_t>(finger)] += to_vector(input.bones[b].coupling_force).dot(back);
  }
}

void describe(OptionVisitor& v, DeviceLoopOptions& o) {
  v.number("rate_hz", o.rate_hz, "Hz", {10, 10000}, "Rate at which commands are written to the device.");
  v.number("stale_after", o.stale_after, "s", {0.005, 0.045},
           "If the newest input, or the simulated hand in it, is older than this, all commands are zero. Commands fade "
           "over the last fifth of this time.");
  v.number("gain", o.gain, "1", {0, 1}, "Factor on every command.");
  v.flag("enabled", o.enabled, "If true, the motors are on at start. The message `motors` switches them on and off.");
}

DeviceGuard::DeviceGuard(const DeviceLoopOptions& options, const DeviceLimits& limits, std::uint32_t device,
                         std::uint32_t kind)
    : options_(options), limits_(limits), clock_id_(clock_id()), gain_(options.gain), enabled_(options.enabled) {
  if (limits.actuators < 1 || limits.actuators > kMaxActuators)
    throw std::invalid_argument("device: actuators: expected 1 to 32");
  if (!(limits.minimum_command <= 0) || !(limits.maximum_command > 0) || !std::isfinite(limits.maximum_command) ||
      !std::isfinite(limits.minimum_command)) {
    throw std::invalid_argument("device: expected finite minimum_command <= 0 < maximum_command");
  }
  if (!(limits.slew > 0)) throw std::invalid_argument("device: slew: expected a positive number");
  if (options.rate_hz < limits.lowest_rate)
    throw std::invalid_argument("rate_hz: this device needs at least " +
                                std::to_string(std::lround(limits.lowest_rate)) + " Hz");
  state_.device = device;
  state_.kind = kind;
  state_.commands.count = static_cast<std::uint32_t>(limits.actuators);
}

bool DeviceGuard::accept(Nanoseconds now, const HandKey& hand, const Stamp& stamp) {
  if (any_ && stamp.epoch == stamp_.epoch && stamp.sequence <= stamp_.sequence) {
    ++counters_.repeated;
    return false;
  }
  if (!is_usable(stamp, now, clock_id_)) {
    ++counters_.refused_stamp;
    return false;
  }
  if (!followed_.accept(stamp, now)) {
    ++counters_.second_writer;
    return false;
  }
  ++counters_.accepted;
  any_ = true;
  arrival_ = now;
  stamp_ = stamp;
  state_.hand = hand;
  return true;
}

double DeviceGuard::freshness(Nanoseconds now) const {
  if (!any_) return 0;
  double oldest = 0;
  // The age counts from the arrival. It also counts from the publisher's stamp, so that a backlog does not count as
  // fresh. It counts from the simulated hand in the input, so that a hung simulation does not. Both are in real time.
  for (const Nanoseconds time : {arrival_, stamp_.publish_time, stamp_.chain.simulated_published}) {
    const std::optional<double> age = time == 0 ? 0 : age_of(time, now);
    if (!age) return 0;
    oldest = std::max(oldest, *age);
  }
  return std::clamp((1 - oldest / options_.stale_after) / (1 - kFadeFrom), 0.0, 1.0);
}

const DeviceState& DeviceGuard::limit(Nanoseconds now, std::span<const double> requested, bool source_live) {
  const double share = source_live ? freshness(now) : 0;
  const bool live = share > 0;
  if (was_live_ && !live) ++state_.stale;
  was_live_ = live;
  if (!live || !enabled_) {
    zero(now);
    state_.live = live ? 1 : 0;
    return state_;
  }
  // After a stall the slew limit allows the change of one nominal period only: a late step must not jump.
  const double period = 1 / options_.rate_hz;
  const double elapsed = std::clamp(static_cast<double>(now - last_step_) * kSecondsPerNanosecond, 0.0, period);
  const double reach = limits_.slew * elapsed;
  bool clamped = false, slewed = false;
  for (std::size_t i = 0; i < limits_.actuators; ++i) {
    double command = gain_ * share * requested[i];
    if (!std::isfinite(command)) {
      ++counters_.nonfinite;
      state_.commands[i] = lowest_[i] = highest_[i] = 0;
      continue;
    }
    const double inside = std::clamp(command, limits_.minimum_command, limits_.maximum_command);
    clamped = clamped || inside != command;
    // A force that returns to zero late would push the user who lets go.
    const double last = state_.commands[i];
    lowest_[i] = std::max(limits_.minimum_command, std::min(last, 0.0) - reach);
    highest_[i] = std::min(limits_.maximum_command, std::max(last, 0.0) + reach);
    const double next = std::clamp(inside, lowest_[i], highest_[i]);
    slewed = slewed || next != inside;
    state_.commands[i] = next;
  }
  state_.clamped += clamped ? 1 : 0;
  state_.slewed += slewed ? 1 : 0;
  state_.live = 1;
  last_step_ = now;
  ++state_.stamp.sequence;
  state_.stamp.sample_time = state_.stamp.publish_time = now;
  state_.stamp.chain = stamp_.chain;
  return state_;
}

const DeviceState& DeviceGuard::zero(Nanoseconds now) {
  std::fill(state_.commands.begin(), state_.commands.end(), 0.0);
  lowest_.fill(0);
  highest_.fill(0);
  state_.live = 0;
  last_step_ = now;
  ++state_.stamp.sequence;
  state_.stamp.sample_time = state_.stamp.publish_time = now;
  state_.stamp.chain = stamp_.chain;
  return state_;
}

MessageReply DeviceGuard::answer(const Message& message, const std::string& module) {
  if (!is_addressed(message, module)) return reply_to(message, module, kReplyIgnored, "not for this module");
  const std::string_view key = get_text(message.key), value = get_text(message.value);
  if (key == "motors") {
    if (value != "on" && value != "off") return reply_to(message, module, kReplyRefused, "motors: expected on or off");
    enabled_ = value == "on";
    return reply_to(message, module, kReplyApplied, enabled_ ? "motors on" : "motors off, commands zero");
  }
  if (key == "gain") {
    const auto gain = parse_number(value);
    if (!gain || *gain < 0 || *gain > 1)
      return reply_to(message, module, kReplyRefused, "gain: expected a number from 0 to 1");
    gain_ = *gain;
    return reply_to(message, module, kReplyApplied, "gain set");
  }
  return reply_to(message, module, kReplyIgnored, "unknown key; known: motors, gain");
}

void DeviceGuard::fill_status(LoopStatus& status, Nanoseconds now) const {
  status.input_age_ms = age_ms_of(arrival_, now);
  const auto add = [&status](std::string_view name, double value) { add_counter(status, name, value); };
  add("accepted", static_cast<double>(counters_.accepted));
  add("repeated", static_cast<double>(counters_.repeated));
  add("refused_stamp", static_cast<double>(counters_.refused_stamp));
  add("second_writer", static_cast<double>(counters_.second_writer));
  add("nonfinite", static_cast<double>(counters_.nonfinite));
  add("clamped", state_.clamped);
  add("slewed", state_.slewed);
  add("stale", state_.stale);
  add("live", state_.live);
  add("motors", enabled_ ? 1 : 0);
}

void DeviceFeedback<BoneWrench>::measure(Nanoseconds now, HapticDriver& driver, std::span<const double> commands) {
  now_ = now;
  if (!driver.measure(now, {positions_.data(), actuators_})) {
    motion_.clear();
  } else {
    measures_ = true;
    const bool is_motion = motion_.add(now, positions_);
    const bool has_velocities = is_motion && driver.measure_velocities({velocities_.data(), actuators_});
    if (!is_motion || (has_velocities && !motion_.set_velocities(velocities_))) ++refused_motion_;
  }
  const bool knows = !motion_.empty() && driver.measure_commands({acted_.data(), actuators_});
  passivity_.observe(knows ? std::span<const double>{acted_.data(), actuators_} : commands, motion_);
}

std::span<const double> DeviceFeedback<BoneWrench>::requested() {
  model_.evaluate(now_, motion_, requested_);
  return {requested_.data(), actuators_};
}

void DeviceFeedback<BoneWrench>::fill_status(LoopStatus& status) const {
  status.passivity_energy = passivity_.energy();
  if (!measures_) return;
  add_counter(status, "planes", static_cast<double>(model_.planes()));
  add_counter(status, "refused_planes", static_cast<double>(model_.refused()));
  add_counter(status, "refused_motion", static_cast<double>(refused_motion_));
  add_counter(status, "passivity_control", static_cast<double>(passivity_.interventions()));
}

}  // namespace softhand
