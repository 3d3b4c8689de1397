// Clocks of other hosts. Readers give the stamps of other hosts the times of this host's clock, so all code behind them
// has one clock. On one host there is nothing to do.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <limits>
#include <mutex>

#include "messages/messages.hpp"
#include "runtime/clock.hpp"
#include "runtime/clock_offset.hpp"

namespace softhand::bus {

class HostClocks {
 public:
  /// `own` is the id of this host's clock. If the wall clocks are `synchronised`, offsets come from them.
  HostClocks(std::uint32_t own, bool synchronised) : own_(own), synchronised_(synchronised) {}

  /// Gives the stamp the times of this host's clock. A clock id of 0 stands for this host. Returns false, and changes
  /// nothing, if the offset of its clock is not known. Any thread may call it. Does not wait or allocate.
  bool to_local(Stamp& stamp) const noexcept;

  /// A beacon arrived at our time `received`. `wall` is our wall clock. If all places are taken, a new host gets the
  /// place of one that was silent for a second. Otherwise the beacon is refused.
  void heard(const ClockBeacon& beacon, Nanoseconds received, const WallClock& wall);
  /// Computes the offsets at our time `now`, and what the next beacon says about other hosts.
  void update(Nanoseconds now, BoundedVector<HostClock, kMaxHosts>& out);
  /// The clocks as of the last update, without the newest beacons. Any thread may call it. Does not wait or allocate.
  BoundedVector<HostClock, kMaxHosts> hosts() const noexcept;
  /// Number of refused beacons. Any thread may call it.
  std::uint64_t refused() const noexcept { return refused_.load(std::memory_order_relaxed); }

 private:
  static constexpr Nanoseconds kUnknown = std::numeric_limits<Nanoseconds>::min();
  struct Host {
    std::atomic<std::uint32_t> id = 0;
    std::atomic<Nanoseconds> offset = kUnknown;
    std::atomic<double> uncertainty = -1;
    std::atomic<double> drift = 0;
    // The rest is behind the mutex.
    ClockOffset estimator;
    HostClock clock;
    Nanoseconds updated = 0;
    ClockOffset::Estimate from_wall{0, -1, 0};
  };

  const std::uint32_t own_;
  const bool synchronised_;
  std::mutex mutex_;
  std::array<Host, kMaxHosts> hosts_;
  std::atomic<std::uint64_t> refused_ = 0;
};

}  // namespace softhand::bus
