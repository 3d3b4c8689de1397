// A tracker that plays a motion at its recorded times or at a given rate. It can add the imperfections of a real
// tracker and, for tests, faults.
#pragma once

#include <memory>

#include "device/tracker_source.hpp"
#include "runtime/options.hpp"
#include "trackers/replay/motion.hpp"

namespace softhand {

struct ReplayOptions {
  double rate_hz = 0;
  double start_time = 0;
  bool repeat = false;
  double latency = 0;
  double position_noise = 0;
  double rotation_noise = 0;
  std::int64_t seed = 1;
  double dropout_period = 0;
  double dropout_time = 0.5;
  // Faults. Each occurs once, at a time of the motion. Negative = never.
  double teleport_at = -1;
  std::array<double, 3> teleport_offset{10, 0, 0};
  double teleport_time = 1;
  double nan_at = -1;
  double nan_time = 0.5;
  std::string nan_joint = "index_intermediate";
  double freeze_at = -1;
  double freeze_time = 2;
  double doubt_at = -1;
  double doubt_time = 2;
  bool flip_signs = false;
  bool duplicate = false;
};

inline void describe(OptionVisitor& v, ReplayOptions& o) {
  v.number("rate_hz", o.rate_hz, "Hz", {0, 10000},
           "Rate of samples. 0 = the recorded times, or 90 Hz for a generated motion.");
  v.number("start_time", o.start_time, "s", {0, 86400}, "Start time in the motion.");
  v.flag("repeat", o.repeat,
         "Start the motion again at its end. Otherwise the last sample is repeated for ever. A restarted tracker "
         "begins at start_time.");
  v.number("latency", o.latency, "s", {0, 1}, "Delay from measurement to delivery.");
  v.number("position_noise", o.position_noise, "m", {0, 0.1}, "Standard deviation of each joint position, per axis.");
  v.number("rotation_noise", o.rotation_noise, "rad", {0, 1}, "Standard deviation of each joint rotation, per axis.");
  v.integer("seed", o.seed, "1", {0, 1e15}, "Seed of the noise. The same seed gives the same samples.");
  v.number("dropout_period", o.dropout_period, "s", {0, 3600},
           "Period of dropouts. Each dropout is at the end of a period. 0 = no dropouts.");
  v.number("dropout_time", o.dropout_time, "s", {0, 60}, "Duration of a dropout.");
  v.number("teleport_at", o.teleport_at, "s", {-1, 86400}, "Time at which the whole hand jumps. Negative = never.");
  v.numbers("teleport_offset", o.teleport_offset.data(), 3, "m", {-1000, 1000}, "Offset of the jump.");
  v.number("teleport_time", o.teleport_time, "s", {0, 3600}, "Duration of the stay at the offset.");
  v.number("nan_at", o.nan_at, "s", {-1, 86400}, "Time at which one joint becomes NaN. Negative = never.");
  v.number("nan_time", o.nan_time, "s", {0, 3600}, "Duration of the NaN.");
  v.string("nan_joint", o.nan_joint, "Joint that becomes NaN: an OpenXR name such as index_intermediate.");
  v.number("freeze_at", o.freeze_at, "s", {-1, 86400}, "Time at which the samples stop. Negative = never.");
  v.number("freeze_time", o.freeze_time, "s", {0, 3600}, "Duration without samples.");
  v.number("doubt_at", o.doubt_at, "s", {-1, 86400}, "Time at which the confidence falls to 0.1. Negative = never.");
  v.number("doubt_time", o.doubt_time, "s", {0, 3600}, "Duration of the low confidence.");
  v.flag("flip_signs", o.flip_signs, "Negate the quaternions of every second sample. The rotations stay the same.");
  v.flag("duplicate", o.duplicate, "Deliver every sample twice.");
}

class ReplayTracker : public TrackerSource {
 public:
  /// The first call of `sample` is at time `start_time` of the motion. Throws std::invalid_argument for an unknown
  /// joint name.
  ReplayTracker(std::shared_ptr<const Motion> motion, const ReplayOptions& options, HandKey hand,
                std::uint32_t source = 0);

  /// Samples that became due since the last call are skipped except for the newest, as if the tracker had overwritten
  /// them. The set of samples and their noise do not depend on the times of the calls.
  bool sample(Nanoseconds now, Skeleton& out);
  void poll(Nanoseconds now, TrackerSink& out) override;
  void restart(Nanoseconds begin) override;
  /// Adds the time at which the motion's time was 0. `softhand up` needs it to judge the run.
  void fill_status(LoopStatus& status) const override;
  /// True after the motion has ended. Never true if it repeats.
  bool finished(Nanoseconds now) const;

 private:
  double sample_time(std::int64_t index) const;   // seconds from start
  std::int64_t newest_due(double elapsed) const;  // index; negative = no sample due
  bool dropped(double time) const;
  void fill(std::int64_t index, Skeleton& out) const;

  std::shared_ptr<const Motion> motion_;
  ReplayOptions options_;
  HandKey hand_;
  std::uint32_t source_;
  std::size_t nan_joint_;
  double period_;          // s, of samples at a rate; 0 = recorded times
  std::size_t first_ = 0;  // index of the recorded sample to start at
  bool started_ = false;
  Nanoseconds start_ = 0;
  std::int64_t last_ = -1;
  std::uint64_t remaining_duplicates_ = 0;
  Skeleton last_sample_;
  Skeleton polled_;
};

}  // namespace softhand
