// Devices of 3D Systems (Touch, Phantom), by the HD library of OpenHaptics.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <thread>

#include "device/grounded_device.hpp"
#include "device/health.hpp"
#include "haptics/openhaptics/hd_library.hpp"
#include "haptics/openhaptics/openhaptics_options.hpp"
#include "runtime/clock.hpp"
#include "runtime/scheduling.hpp"

namespace softhand {

class OpenHaptics final : public GroundedDevice {
 public:
  using Options = OpenHapticsOptions;
  /// Throws ConfigError if the library cannot be loaded.
  OpenHaptics(const Options& options, const HandModel& hand)
      : GroundedDevice(options.point, hand), options_(options), library_(options.library) {
    std::printf("loaded %s\n", options.library.c_str());
    std::fflush(stdout);
    thread_ = std::thread([this] {
      become_ordinary();
      run();
    });
  }
  /// Sets the force of the device to zero and closes it.
  ~OpenHaptics() override {
    stop_ = true;
    thread_.join();
  }

 private:
  static constexpr std::chrono::milliseconds kPeriod{1};
  static constexpr Nanoseconds kLastCallback = 50'000'000;

  // Opens and closes the device. Forces are set only in the callback of the vendor's scheduler.
  void run() {
    Backoff backoff;
    bool is_told = false;
    while (!stop_) {
      unsigned error = 0;
      device_ = library_.open(options_.device, error);
      if (device_ != HdLibrary::kNoDevice) {
        serve();
        backoff.reset();
        is_told = false;
      } else if (!is_told) {
        std::fprintf(stderr, "no device: HD error 0x%04x\n", error);
        is_told = true;
      }
      const Nanoseconds end = now() + backoff.next();
      while (!stop_ && now() < end) std::this_thread::sleep_for(kPeriod);
    }
  }
  void serve() {
    library_.make_current_device(device_);
    library_.enable(HdLibrary::kForceOutput);
    is_lost_ = is_done_ = false;
    set_open(true);
    library_.schedule_asynchronous(&OpenHaptics::call, this, HdLibrary::kPriority);
    library_.start_scheduler();
    while (!stop_ && !is_lost_) std::this_thread::sleep_for(kPeriod);
    // The last callback sets the force to zero.
    const Nanoseconds end = now() + kLastCallback;
    while (!is_done_ && now() < end) std::this_thread::sleep_for(kPeriod);
    set_open(false);
    library_.stop_scheduler();
    library_.disable_device(device_);
    if (is_lost_) {
      count_error();
      std::fprintf(stderr, "device lost: HD error 0x%04x\n", error_.load());
    }
  }
  static unsigned call(void* self) { return static_cast<OpenHaptics*>(self)->step(); }
  // In the thread of the scheduler, 1,000 times a second.
  unsigned step() {
    const bool is_last = stop_ || is_lost_;
    std::array<double, 3> millimetres{};
    library_.begin_frame(device_);
    library_.get_doubles(HdLibrary::kPosition, millimetres.data());
    const Nanoseconds time = now();
    moved(time, {1e-3 * millimetres[0], 1e-3 * millimetres[1], 1e-3 * millimetres[2]});
    const Vec3 newton = is_last ? Vec3{} : force(time);
    library_.set_doubles(HdLibrary::kForce, newton.data());
    library_.end_frame(device_);
    library_.for_each_error([this](unsigned code) {
      if (HdLibrary::is_force_error(code)) return count_error();
      error_ = code;
      is_lost_ = true;
    });
    is_done_ = is_last;
    return is_last ? HdLibrary::kDone : HdLibrary::kContinue;
  }

  Options options_;
  HdLibrary library_;
  unsigned device_ = HdLibrary::kNoDevice;
  std::atomic<unsigned> error_{0};
  std::atomic<bool> stop_{false}, is_lost_{false}, is_done_{false};
  std::thread thread_;
};

}  // namespace softhand
