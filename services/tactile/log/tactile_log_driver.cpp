#include "tactile/log/tactile_log_driver.hpp"

#include <algorithm>
#include <cstdio>

#include "messages/convert.hpp"

namespace softhand {
namespace {
constexpr const char* kHeader =
    "time_ns,finger,event,press_N,force_tip_N,force_x_N,force_out_N,slip_tip_m_s,slip_x_m_s,area_m2,area_rate_m2_s,"
    "object,"
    "command\n";
}

TactileLogDriver::TactileLogDriver(const Options& options, const HandModel& hand)
    : options_(options), taxels_(hand, digit_taxels(hand, kFingerCount)) {
  if (!options.file.empty())
    log_ = std::make_unique<RecordLog<Record>>(options.file, 1024, kHeader, &TactileLogDriver::format);
}

void TactileLogDriver::command(const SkinTraction& input, std::span<double> requested) {
  const auto all = taxels_.feel(input);
  for (std::size_t f = 0; f < kFingerCount; ++f) {
    const TaxelTouch& touch = all[f];
    requested[f] = touch.press / options_.full_scale_force;
    // Begin and end have different thresholds (hysteresis), so that noise near the threshold makes no events.
    const bool touches = touch.press > (touching_[f] ? 0.5 : 1) * options_.threshold_force;
    const bool due =
        touches && static_cast<double>(input.stamp.sample_time - last_logged_[f]) * 1e-9 * options_.log_rate_hz >= 1;
    if (log_ != nullptr && (touches != touching_[f] || due)) {
      const Event event = touches == touching_[f] ? Event::update : touches ? Event::begin : Event::end;
      log_->push({input.stamp.sample_time, static_cast<std::uint32_t>(f), event, touch, commands_[f]});
      last_logged_[f] = input.stamp.sample_time;
    }
    touching_[f] = touches;
  }
}

void TactileLogDriver::write(Nanoseconds, std::span<const double> commands) {
  std::copy(commands.begin(), commands.end(), commands_.begin());
}

void TactileLogDriver::fill_status(LoopStatus& status) const {
  add_counter(status, "refused_regions", static_cast<double>(taxels_.refused()));
}

void TactileLogDriver::format(const Record& record, std::string& text) {
  constexpr const char* kEvents[] = {"begin", "update", "end"};
  const TaxelTouch& t = record.touch;
  char line[512];
  const int length = std::snprintf(line, sizeof line, "%lld,%s,%s,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%u,%.6g\n",
                                   static_cast<long long>(record.time), kFingerNames[record.finger].data(),
                                   kEvents[static_cast<std::size_t>(record.event)], t.press, t.force[0], t.force[1],
                                   t.force[2], t.slip[0], t.slip[1], t.area, t.area_rate, t.object, record.command);
  text.append(line, static_cast<std::size_t>(std::min<int>(length, sizeof line - 1)));
}

}  // namespace softhand
