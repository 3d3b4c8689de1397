#include "tactile/log/tactile_log_driver.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "messages/convert.hpp"

namespace softhand {
namespace {
constexpr const char* kHeader =
    "time_ns,finger,event,force_x_N,force_y_N,force_z_N,normal_x,normal_y,normal_z,point_x_m,point_y_m,point_z_m,area_"
    "m2,object,slip_m_s,"
    "contacts,command\n";
}

TactileLogDriver::TactileLogDriver(const Options& options) : options_(options) {
  if (!options.file.empty())
    log_ = std::make_unique<RecordLog<Record>>(options.file, 1024, kHeader, &TactileLogDriver::format);
}

void TactileLogDriver::command(const Contacts& input, std::span<double> requested) {
  for (std::size_t f = 0; f < kFingerCount; ++f) {
    const FingerContact& contact = input.fingers[f];
    const double force = to_vector(contact.force).norm();
    requested[f] = force / options_.full_scale_force;
    // Begin and end have different thresholds (hysteresis), so that noise near the threshold makes no events.
    const bool touches = touching_[f] ? force > 0.5 * options_.threshold_force : force > options_.threshold_force;
    const bool due =
        touches && static_cast<double>(input.stamp.sample_time - last_logged_[f]) * 1e-9 * options_.log_rate_hz >= 1;
    if (log_ != nullptr && (touches != touching_[f] || due)) {
      const Event event = touches == touching_[f] ? Event::update : touches ? Event::begin : Event::end;
      log_->push({input.stamp.sample_time, static_cast<std::uint32_t>(f), event, contact, commands_[f]});
      last_logged_[f] = input.stamp.sample_time;
    }
    touching_[f] = touches;
  }
}

void TactileLogDriver::write(Nanoseconds, std::span<const double> commands) {
  std::copy(commands.begin(), commands.end(), commands_.begin());
}

void TactileLogDriver::format(const Record& record, std::string& text) {
  constexpr const char* kEvents[] = {"begin", "update", "end"};
  const FingerContact& c = record.contact;
  char line[512];
  const int length =
      std::snprintf(line, sizeof line, "%lld,%s,%s,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%u,%.6g,%u,%.6g\n",
                    static_cast<long long>(record.time), kFingerNames[record.finger].data(),
                    kEvents[static_cast<std::size_t>(record.event)], c.force[0], c.force[1], c.force[2], c.normal[0],
                    c.normal[1], c.normal[2], c.centre[0], c.centre[1], c.centre[2], c.area, c.object, c.slip_speed,
                    c.contact_count, record.command);
  text.append(line, static_cast<std::size_t>(std::min<int>(length, sizeof line - 1)));
}

}  // namespace softhand
