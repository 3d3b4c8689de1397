// The HD library of OpenHaptics, loaded at run time.
#pragma once

#include <string>

#include "device/shared_library.hpp"

namespace softhand {

/// The functions that the driver and its checks call, and their constants (README.md says how sure they are).
class HdLibrary {
 public:
  struct Error {
    unsigned code;
    int internal_code;
    unsigned device;
  };
  using Callback = unsigned (*)(void* data);
  static constexpr unsigned kNoDevice = 0xffffffff;
  static constexpr unsigned kPosition = 0x2050, kForce = 0x2700;  // parameters: mm, N
  static constexpr unsigned kForceOutput = 0x4000;                // capability
  static constexpr unsigned kDone = 0, kContinue = 1;             // results of a callback
  static constexpr unsigned short kPriority = 0x7fff;
  /// Errors of the class "force": motors too warm, too much force, too fast. The device goes on without force.
  static constexpr bool is_force_error(unsigned code) { return code >> 8 == 2; }

  explicit HdLibrary(const std::string& path) : library_(path) {
    library_.find("hdInitDevice", init_device);
    library_.find("hdDisableDevice", disable_device);
    library_.find("hdMakeCurrentDevice", make_current_device);
    library_.find("hdEnable", enable);
    library_.find("hdGetError", get_error);
    library_.find("hdScheduleAsynchronous", schedule_asynchronous);
    library_.find("hdStartScheduler", start_scheduler);
    library_.find("hdStopScheduler", stop_scheduler);
    library_.find("hdBeginFrame", begin_frame);
    library_.find("hdEndFrame", end_frame);
    library_.find("hdGetDoublev", get_doubles);
    library_.find("hdSetDoublev", set_doubles);
  }

  /// The device of this name, empty = the default device. kNoDevice, and the code in `error`, if it cannot be opened.
  unsigned open(const std::string& name, unsigned& error) const {
    for_each_error([](unsigned) {});  // of earlier calls
    const unsigned device = init_device(name.empty() ? nullptr : name.c_str());
    error = get_error().code;
    if (error == 0 || device == kNoDevice) return device;
    disable_device(device);
    return kNoDevice;
  }
  /// Calls f(code) for each error that waits in the library, newest first. A library that always has one is asked some
  /// times only.
  template <typename F>
  void for_each_error(F&& f) const {
    constexpr int kMost = 32;
    for (int i = 0; i < kMost; ++i) {
      const unsigned code = get_error().code;
      if (code == 0) return;
      f(code);
    }
  }

  unsigned (*init_device)(const char* name);
  void (*disable_device)(unsigned device);
  void (*make_current_device)(unsigned device);
  void (*enable)(unsigned capability);
  Error (*get_error)();
  unsigned long (*schedule_asynchronous)(Callback callback, void* data, unsigned short priority);
  void (*start_scheduler)();
  void (*stop_scheduler)();
  void (*begin_frame)(unsigned device);
  void (*end_frame)(unsigned device);
  void (*get_doubles)(unsigned parameter, double* values);
  void (*set_doubles)(unsigned parameter, const double* values);

 private:
  SharedLibrary library_;
};

}  // namespace softhand
