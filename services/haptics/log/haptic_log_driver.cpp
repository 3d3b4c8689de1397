#include "haptics/log/haptic_log_driver.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "messages/convert.hpp"

namespace softhand {
namespace {

void append(std::string& text, double value) {
  char buffer[32];
  const int length = std::snprintf(buffer, sizeof buffer, "%.9g", value);
  text.append(buffer, static_cast<std::size_t>(length));
}

template <std::size_t n>
void append(std::string& text, const char* key, const std::array<double, n>& values) {
  text += '"';
  text += key;
  text += "\":[";
  for (std::size_t i = 0; i < n; ++i) {
    if (i > 0) text += ',';
    // JSON has no NaN and no infinity.
    if (std::isfinite(values[i])) {
      append(text, values[i]);
    } else {
      text += "null";
    }
  }
  text += ']';
}

}  // namespace

HapticLogDriver::HapticLogDriver(const Options& options) : options_(options) {
  if (!options.file.empty())
    log_ = std::make_unique<RecordLog<Record>>(options.file, 256, "", &HapticLogDriver::format);
}

void HapticLogDriver::command(const BoneWrench& input, std::span<double> requested) {
  record_.input = input;
  std::array<Pose, kFingerCount> distal;
  const auto tracked = [&input](Body body) {
    const BoneSample& bone = input.bones[static_cast<std::size_t>(index_of(body))];
    return to_pose(bone.tracked_position, bone.tracked_orientation);
  };
  for (std::size_t f = 0; f < kFingerCount; ++f) distal[f] = tracked(distal_of(static_cast<Finger>(f)));
  encoders_.move(tracked(Body::carpus), distal);
  add_closing_resistance(input, requested);
}

void HapticLogDriver::write(Nanoseconds now, std::span<const double> commands) {
  if (log_ == nullptr) return;
  // Log the release of all forces at once: it may be the last record, for example at exit.
  const auto pulls = [](double command) { return command != 0; };
  const bool lets_go = std::any_of(record_.commands.begin(), record_.commands.end(), pulls) &&
                       std::none_of(commands.begin(), commands.end(), pulls);
  if (!lets_go && static_cast<double>(now - last_logged_) * 1e-9 * options_.log_rate_hz < 1 - 1e-6) return;
  last_logged_ = now;
  record_.time = now;
  std::copy(commands.begin(), commands.end(), record_.commands.begin());
  log_->push(record_);
}

void HapticLogDriver::format(const Record& record, std::string& text) {
  const BoneWrench& input = record.input;
  text += "{\"time_ns\":" + std::to_string(record.time) + ",\"user\":" + std::to_string(input.hand.user) +
          ",\"side\":" + std::to_string(input.hand.side) +
          ",\"sample_time_ns\":" + std::to_string(input.stamp.sample_time) +
          ",\"tracker_sample_ns\":" + std::to_string(input.stamp.chain.tracker_sample) +
          ",\"simulated_valid\":" + std::to_string(input.simulated_valid) + ",";
  append(text, "commands_N", record.commands);
  text += ",\"bones\":{";
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const BoneSample& bone = input.bones[b];
    if (b > 0) text += ',';
    text += '"';
    text += kBodyNames[b];
    text += "\":{";
    append(text, "tracked_m", bone.tracked_position);
    text += ',';
    append(text, "tracked_xyzw", bone.tracked_orientation);
    text += ',';
    append(text, "intermediate_m", bone.intermediate_position);
    text += ',';
    append(text, "intermediate_xyzw", bone.intermediate_orientation);
    text += ',';
    append(text, "simulated_m", bone.simulated_position);
    text += ',';
    append(text, "simulated_xyzw", bone.simulated_orientation);
    text += ',';
    append(text, "coupling_force_N", bone.coupling_force);
    text += ',';
    append(text, "coupling_torque_Nm", bone.coupling_torque);
    text += ',';
    append(text, "contact_force_N", bone.contact_force);
    text += '}';
  }
  text += "}}\n";
}

}  // namespace softhand
