// Devices of Force Dimension and the Novint Falcon, by the DHD library of Force Dimension.
#pragma once

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <thread>

#include "device/grounded_device.hpp"
#include "device/health.hpp"
#include "haptics/dhd/dhd_library.hpp"
#include "haptics/dhd/dhd_options.hpp"
#include "runtime/clock.hpp"
#include "runtime/scheduling.hpp"

namespace softhand {

class Dhd final : public GroundedDevice {
 public:
  using Options = DhdOptions;
  /// Throws ConfigError if the library cannot be loaded.
  Dhd(const Options& options, const HandModel& hand)
      : GroundedDevice(options.point, hand),
        options_(options),
        library_(options.library),
        wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    if (wake_ < 0) throw std::runtime_error("eventfd: no file descriptor is free");
    std::printf("loaded %s\n", options.library.c_str());
    std::fflush(stdout);
    thread_ = std::thread([this] {
      become_ordinary();
      run();
    });
  }
  /// Sets the force of the device to zero and closes it.
  ~Dhd() override {
    stop_ = true;
    thread_.join();
    close(wake_);
  }

  // Each step of the loop wakes the thread, so that it measures once between two steps.
  void write(Nanoseconds now, std::span<const double> commands) override {
    GroundedDevice::write(now, commands);
    const std::uint64_t one = 1;
    [[maybe_unused]] const ssize_t ignored = ::write(wake_, &one, sizeof one);
  }

 private:
  static constexpr std::chrono::milliseconds kPeriod{1};
  static constexpr int kLongestWait = 5;  // ms, for the loop

  void run() {
    Backoff backoff;
    bool is_told = false;
    while (!stop_) {
      const int id = options_.index < 0 ? library_.open() : library_.open_id(static_cast<char>(options_.index));
      if (id >= 0) {
        serve(static_cast<char>(id));
        backoff.reset();
        is_told = false;
      } else if (!is_told) {
        std::fprintf(stderr, "no device: %s\n", library_.last_error());
        is_told = true;
      }
      const Nanoseconds end = now() + backoff.next();
      while (!stop_ && now() < end) std::this_thread::sleep_for(kPeriod);
    }
  }
  void serve(char id) {
    library_.set_gravity_compensation(1, id);
    bool works = library_.enable_force(1, id) >= 0;
    set_open(works);
    while (works && !stop_) {
      works = step(id);
      pollfd wake{wake_, POLLIN, 0};
      ::poll(&wake, 1, kLongestWait);
      std::uint64_t wakes = 0;
      [[maybe_unused]] const ssize_t ignored = read(wake_, &wakes, sizeof wakes);
    }
    set_open(false);
    if (!works) {
      count_error();
      std::fprintf(stderr, "device lost: %s\n", library_.last_error());
    }
    // The device may keep the last force: it has no watchdog that we know of.
    library_.set_force(0, 0, 0, id);
    library_.close(id);
  }
  // The device has x to the user, y to the right and z up.
  bool step(char id) {
    double x = 0, y = 0, z = 0;
    if (library_.get_position(&x, &y, &z, id) < 0) return false;
    const Nanoseconds time = now();
    moved(time, {y, z, x});
    const Vec3 newton = force(time);
    return library_.set_force(newton[2], newton[0], newton[1], id) >= 0;
  }

  Options options_;
  DhdLibrary library_;
  const int wake_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace softhand
