// Clean stop on SIGINT, SIGTERM and SIGHUP.
#pragma once

#include <atomic>
#include <csignal>

namespace softhand {

/// While one lives, SIGINT, SIGTERM and SIGHUP (unless that is ignored) set a flag instead of ending the process; the
/// destructor puts the former handlers back. One at a time in a process. Signals that came before construction are
/// forgotten.
class StopSignal {
 public:
  StopSignal();
  ~StopSignal();
  StopSignal(const StopSignal&) = delete;
  StopSignal& operator=(const StopSignal&) = delete;

  bool requested() const { return flag().load(std::memory_order_relaxed); }
  /// The flag itself, e.g. for PeriodicLoop. Lock-free.
  const std::atomic<bool>& flag() const;

 private:
  struct sigaction former_interrupt_ {};
  struct sigaction former_terminate_ {};
  struct sigaction former_hang_up_ {};
};

/// Sends this process SIGTERM when its parent ends, so that a killed supervisor leaves no orphans. False when refused,
/// or when the parent is gone already.
bool stop_with_parent();

}  // namespace softhand
