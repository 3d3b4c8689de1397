#include "bus/host_clocks.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "messages/age.hpp"

namespace softhand::bus {
namespace {

constexpr double kSlew = 5e-3;                      // largest change of an offset, s/s
constexpr Nanoseconds kRest = 1'000'000'000;        // a host that is silent for this time makes room for another
constexpr Nanoseconds kForgotten = 10'000'000'000;  // a host that is silent for this time has left

}  // namespace

bool HostClocks::to_local(Stamp& stamp) const noexcept {
  if (stamp.clock_id == 0 || stamp.clock_id == own_) return true;
  for (const Host& host : hosts_) {
    if (host.id.load(std::memory_order_acquire) != stamp.clock_id) continue;
    const Nanoseconds offset = host.offset.load(std::memory_order_relaxed);
    if (offset == kUnknown) return false;
    for (Nanoseconds* time :
         {&stamp.sample_time, &stamp.publish_time, &stamp.chain.tracker_sample, &stamp.chain.tracked_published,
          &stamp.chain.intermediate_published, &stamp.chain.simulated_published, &stamp.chain.wrench_published}) {
      // 0 means unknown. Anybody can write a stamp, and the sum must not overflow.
      if (*time > 0 && *time <= ClockOffset::kLatest) *time += offset;
    }
    stamp.clock_id = own_;
    return true;
  }
  return false;
}

void HostClocks::heard(const ClockBeacon& beacon, Nanoseconds received, const WallClock& wall) {
  const std::uint32_t id = beacon.stamp.clock_id;
  if (id == 0 || id == own_) return;
  const std::lock_guard lock(mutex_);
  const auto known = std::find_if(hosts_.begin(), hosts_.end(), [id](const Host& each) { return each.id == id; });
  // A host that was started again has a new clock. It takes a free place, or that of the host that is silent for
  // longest. Anybody on the domain can invent clocks, so a host that is heard keeps its place.
  Host& host = known != hosts_.end() ? *known : *std::min_element(hosts_.begin(), hosts_.end(), [](auto& a, auto& b) {
    return a.clock.received < b.clock.received;
  });
  if (known == hosts_.end()) {
    if (host.id != 0 && received - host.clock.received <= kRest) {
      refused_.fetch_add(1, std::memory_order_relaxed);
      return;
    }
    host.offset = kUnknown;
    host.uncertainty = -1;
    host.estimator = {};
    host.from_wall = {0, -1, 0};
    host.clock = {};
    host.clock.clock_id = id;
    host.id.store(id, std::memory_order_release);
  }
  host.clock.sent = beacon.stamp.publish_time;
  host.clock.received = received;
  host.estimator.heard(beacon.stamp.publish_time, received);
  for (const HostClock& each : beacon.hosts) {
    if (each.clock_id == own_ && each.received != 0) host.estimator.answered(each.sent, each.received);
  }
  const bool both = beacon.wall_uncertainty >= 0 && wall.uncertainty >= 0 && beacon.wall_offset >= 0 &&
                    beacon.wall_offset <= ClockOffset::kLatest;
  if (!both) {
    host.from_wall = {0, -1, 0};
    return;
  }
  host.from_wall = {beacon.wall_offset - wall.offset, beacon.wall_uncertainty + wall.uncertainty, 0};
}

void HostClocks::update(Nanoseconds now, BoundedVector<HostClock, kMaxHosts>& out) {
  const std::lock_guard lock(mutex_);
  out.clear();
  for (Host& host : hosts_) {
    if (host.id == 0) continue;
    if (now - host.clock.received > kForgotten) {
      host.id = 0;
      host.clock.received = 0;
      continue;
    }
    const auto estimate =
        synchronised_ ? host.from_wall : host.estimator.at(now).value_or(ClockOffset::Estimate{0, -1, 0});
    host.clock.offset = estimate.offset;
    host.clock.uncertainty = estimate.uncertainty;
    host.clock.drift = estimate.drift;
    if (is_known(host.clock)) {
      // Velocities are differences of samples by differences of stamps. So a better estimate is approached slowly. The
      // rest of the way counts as uncertainty.
      const double most = 1e9 * (kMostClockUncertainty - estimate.uncertainty);
      const auto slew = static_cast<double>(now - host.updated) * kSlew;
      if (host.offset != kUnknown) {
        const double ahead = static_cast<double>(host.offset - estimate.offset);
        const double left = std::clamp(ahead, -most, most);
        host.clock.offset += std::llround(left - std::clamp(left, -slew, slew));
        host.clock.uncertainty += 1e-9 * static_cast<double>(std::abs(host.clock.offset - estimate.offset));
      }
      host.offset = host.clock.offset;
    } else {
      host.offset = kUnknown;
    }
    host.updated = now;
    host.uncertainty = host.clock.uncertainty;
    host.drift = estimate.drift;
    out.push_back(host.clock);
  }
}

BoundedVector<HostClock, kMaxHosts> HostClocks::hosts() const noexcept {
  BoundedVector<HostClock, kMaxHosts> hosts;
  for (const Host& host : hosts_) {
    const std::uint32_t id = host.id.load(std::memory_order_acquire);
    if (id != 0) hosts.push_back({id, 0, 0, host.offset, host.uncertainty, host.drift});
  }
  return hosts;
}

}  // namespace softhand::bus
