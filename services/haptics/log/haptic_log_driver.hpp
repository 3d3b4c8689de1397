// A simulated force-feedback glove that writes down what it receives: one force a finger, against closing.
#pragma once

#include <memory>
#include <string>

#include "device/device_loop.hpp"
#include "device/record_log.hpp"

namespace softhand {

struct HapticLogOptions {
  double maximum_force = 8;
  double slew = 400;
  std::string file;
  double log_rate_hz = 100;
};
inline void describe(OptionVisitor& v, HapticLogOptions& o) {
  v.number("maximum_force", o.maximum_force, "N", {0.1, 20}, "Force that one actuator can make.");
  v.number("slew", o.slew, "N/s", {1, 100000}, "Fastest change of a force.");
  v.string("file", o.file, "JSON lines of all that was received and commanded; empty = none.");
  v.number("log_rate_hz", o.log_rate_hz, "Hz", {0.1, 1000}, "Lines a second.");
}

class HapticLogDriver : public HapticDriver {
 public:
  using Options = HapticLogOptions;
  /// Throws std::runtime_error where the file cannot be written.
  explicit HapticLogDriver(const Options& options);

  DeviceLimits limits() const override { return {kFingerCount, 0, options_.maximum_force, options_.slew}; }
  /// Coupling force on the finger's bones along the back of its distal bone: what holds the finger off closing. Pulls
  /// are not rendered.
  void command(const BoneWrench& input, std::span<double> wanted) override;
  void write(Nanoseconds now, std::span<const double> commands) override;

 private:
  struct Record {
    Nanoseconds time = 0;
    BoneWrench input;
    std::array<double, kFingerCount> commands{};
  };
  static void format(const Record& record, std::string& text);

  Options options_;
  Record record_;
  Nanoseconds last_logged_ = 0;
  std::unique_ptr<RecordLog<Record>> log_;
};

}  // namespace softhand
