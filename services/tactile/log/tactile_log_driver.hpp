// A simulated tactile glove that logs its contact events. It has one actuator per finger, with commands from 0 to 1.
#pragma once

#include <memory>
#include <string>

#include "device/device_loop.hpp"
#include "device/record_log.hpp"
#include "device/taxel_map.hpp"

namespace softhand {

struct TactileLogOptions {
  double full_scale_force = 5;
  double threshold_force = 0.01;
  double slew = 200;
  std::string file;
  double log_rate_hz = 50;
};
inline void describe(OptionVisitor& v, TactileLogOptions& o) {
  v.number("full_scale_force", o.full_scale_force, "N", {0.1, 100},
           "Contact force on a finger at which the command of its actuator is 1.");
  v.number("threshold_force", o.threshold_force, "N", {0, 10},
           "A contact event begins above this force and ends below half of it.");
  v.number("slew", o.slew, "1/s", {1, 100000}, "Largest rate of change of a command.");
  v.string("file", o.file, "Log file (CSV) of contact events; empty = no log.");
  v.number("log_rate_hz", o.log_rate_hz, "Hz", {0.1, 1000},
           "Log lines per second during a contact, in addition to its begin and end.");
}

class TactileLogDriver : public TactileDriver {
 public:
  using Options = TactileLogOptions;
  /// Throws std::runtime_error if the file cannot be written.
  TactileLogDriver(const Options& options, const HandModel& hand);

  DeviceLimits limits() const override { return {kFingerCount, 0, 1, options_.slew}; }
  /// Commands the normal forces on each digit divided by the full-scale force.
  void command(const SkinTraction& input, std::span<double> requested) override;
  void write(Nanoseconds now, std::span<const double> commands) override;
  bool release() override { return true; }  // nobody wears it
  void fill_status(LoopStatus& status) const override;

 private:
  enum class Event : std::uint32_t { begin, update, end };
  struct Record {
    Nanoseconds time = 0;  // time of the simulation's sample
    std::uint32_t finger = 0;
    Event event = Event::begin;
    TaxelTouch touch;
    double command = 0;  // the last command that was written to the device
  };
  static void format(const Record& record, std::string& text);

  Options options_;
  TaxelMap taxels_;  // of the digits
  std::array<bool, kFingerCount> touching_{};
  std::array<Nanoseconds, kFingerCount> last_logged_{};
  std::array<double, kFingerCount> commands_{};
  std::unique_ptr<RecordLog<Record>> log_;
};

}  // namespace softhand
