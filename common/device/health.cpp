#include "device/health.hpp"

namespace softhand {

void HealthMonitor::sample(Nanoseconds now, double confidence) {
  const bool is_in_doubt = confidence > 0 && confidence < kDoubt;
  if (is_in_doubt || (newest_ != 0 && now - newest_ > kLate)) degraded_until_ = now + kMemory;
  newest_ = now;
  ++samples_;
}

Health HealthMonitor::update(Nanoseconds now, const SourceState& state) {
  if (now - window_start_ >= kMemory) {
    const auto refused = static_cast<double>(state.refused - refused_before_);
    if (refused > kRefusedShare * (refused + static_cast<double>(samples_))) degraded_until_ = now + kMemory;
    window_start_ = now;
    samples_ = 0;
    refused_before_ = state.refused;
  }
  if (newest_ == 0) return Health::opening;
  if (!state.connected || now - newest_ > kSilent) return Health::lost;
  return now < degraded_until_ || now - newest_ > kLate ? Health::degraded : Health::live;
}

}  // namespace softhand
