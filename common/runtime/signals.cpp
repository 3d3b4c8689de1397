#include "runtime/signals.hpp"

namespace softhand {
namespace {

std::atomic<bool> stop_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free);  // a signal handler may only touch lock-free atomics

void request_stop(int) { stop_requested.store(true, std::memory_order_relaxed); }

}  // namespace

StopSignal::StopSignal() {
  stop_requested.store(false, std::memory_order_relaxed);
  struct sigaction action {};
  action.sa_handler = request_stop;
  sigemptyset(&action.sa_mask);
  sigaction(SIGINT, &action, &former_interrupt_);
  sigaction(SIGTERM, &action, &former_terminate_);
  // When a terminal closes, it sends SIGHUP to its processes. A device must not keep its last command then. `nohup`
  // makes the process ignore SIGHUP.
  sigaction(SIGHUP, nullptr, &former_hang_up_);
  if (former_hang_up_.sa_handler != SIG_IGN) sigaction(SIGHUP, &action, nullptr);
  // Whoever reads the output may end first, for example the supervisor, or `tee` after Ctrl-C.
  action.sa_handler = SIG_IGN;
  sigaction(SIGPIPE, &action, &former_pipe_);
}

StopSignal::~StopSignal() {
  sigaction(SIGINT, &former_interrupt_, nullptr);
  sigaction(SIGTERM, &former_terminate_, nullptr);
  sigaction(SIGHUP, &former_hang_up_, nullptr);
  sigaction(SIGPIPE, &former_pipe_, nullptr);
}

const std::atomic<bool>& StopSignal::flag() const { return stop_requested; }

}  // namespace softhand
