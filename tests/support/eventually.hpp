// Waits for what another thread or process does.
#pragma once

#include <chrono>
#include <thread>

namespace softhand::testing {

/// Polls until `f` is true. Returns false after ten seconds.
template <typename F>
bool eventually(F&& f) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  while (!f()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

}  // namespace softhand::testing
