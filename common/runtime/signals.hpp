// Clean stop on SIGINT, SIGTERM and SIGHUP.
#pragma once

#include <atomic>
#include <csignal>

namespace softhand {

/// While an object of this class lives, SIGINT, SIGTERM and SIGHUP set a flag and do not end the process. An ignored
/// SIGHUP stays ignored. SIGPIPE is ignored, so that a write without a reader is an error. The destructor restores the
/// previous handlers. Only one object may exist in a process at a time. Signals from before the construction are
/// forgotten.
class StopSignal {
 public:
  StopSignal();
  ~StopSignal();
  StopSignal(const StopSignal&) = delete;
  StopSignal& operator=(const StopSignal&) = delete;

  bool requested() const { return flag().load(std::memory_order_relaxed); }
  /// The flag itself, for example for PeriodicLoop. Lock-free.
  const std::atomic<bool>& flag() const;

 private:
  struct sigaction former_interrupt_ {};
  struct sigaction former_terminate_ {};
  struct sigaction former_hang_up_ {};
  struct sigaction former_pipe_ {};
};

}  // namespace softhand
