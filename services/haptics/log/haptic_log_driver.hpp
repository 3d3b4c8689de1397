// A simulated force-feedback glove that logs its input. It has one motor per finger, which pushes against closing. No
// user wears it: its encoders measure fingers that follow the tracked hand of its input.
#pragma once

#include <memory>
#include <string>

#include "device/device_loop.hpp"
#include "device/record_log.hpp"
#include "haptics/log/glove_encoders.hpp"

namespace softhand {

struct HapticLogOptions {
  double maximum_force = 8;
  double slew = 400;
  std::string file;
  double log_rate_hz = 100;
};
inline void describe(OptionVisitor& v, HapticLogOptions& o) {
  v.number("maximum_force", o.maximum_force, "N", {0.1, 20}, "Largest force of one actuator.");
  v.number("slew", o.slew, "N/s", {1, 100000}, "Largest rate of change of a force.");
  v.string("file", o.file, "Log file (JSON lines) of received messages and commands; empty = no log.");
  v.number("log_rate_hz", o.log_rate_hz, "Hz", {0.1, 1000}, "Log lines per second.");
}

class HapticLogDriver : public HapticDriver {
 public:
  using Options = HapticLogOptions;
  /// Throws std::runtime_error if the file cannot be written.
  explicit HapticLogDriver(const Options& options);

  DeviceLimits limits() const override {
    return {kFingerCount, 0, options_.maximum_force, options_.slew, kStiffness, kDamping, true};
  }
  /// Commands the force against closing of each finger. A negative force (a pull) is not rendered.
  void command(const BoneWrench& input, std::span<double> requested) override;
  bool measure(Nanoseconds now, std::span<double> positions) override {
    std::array<double, kFingerCount> tracked;
    if (!encoders_.read(tracked)) return false;
    fingers_.follow(now, tracked, positions);
    return true;
  }
  void write(Nanoseconds now, std::span<const double> commands) override;
  bool release() override { return true; }  // nobody wears it

 private:
  static constexpr double kStiffness = 3000, kDamping = 20;  // N/m, N s/m: as a Novint Falcon at 1 kHz
  struct Record {
    Nanoseconds time = 0;
    BoneWrench input;
    std::array<double, kFingerCount> commands{};
  };
  static void format(const Record& record, std::string& text);

  Options options_;
  Record record_;
  GloveEncoders encoders_;
  SmoothFingers fingers_;
  Nanoseconds last_logged_ = 0;
  std::unique_ptr<RecordLog<Record>> log_;
};

}  // namespace softhand
