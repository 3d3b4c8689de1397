// A tracker made of a motion: plays it at its recorded times or at a rate, with a real tracker's imperfections and, for
// tests, its faults.
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
  // Faults, once, at a time of the motion; negative = never.
  double teleport_at = -1;
  std::array<double, 3> teleport_offset{10, 0, 0};
  double teleport_time = 1;
  double nan_at = -1;
  double nan_time = 0.5;
  std::string nan_joint = "index_intermediate";
  double freeze_at = -1;
  double freeze_time = 2;
  bool flip_signs = false;
  bool duplicate = false;
};

inline void describe(OptionVisitor& v, ReplayOptions& o) {
  v.number("rate_hz", o.rate_hz, "Hz", {0, 10000},
           "Rate of samples; 0 = at the recorded times, or 90 Hz for a made motion.");
  v.number("start_time", o.start_time, "s", {0, 86400}, "Where in the motion to start.");
  v.flag("repeat", o.repeat,
         "Start again at the end; otherwise the last sample is repeated for ever. A tracker that is restarted begins "
         "anew at start_time.");
  v.number("latency", o.latency, "s", {0, 1}, "From measurement to delivery.");
  v.number("position_noise", o.position_noise, "m", {0, 0.1}, "Standard deviation of each joint's position, per axis.");
  v.number("rotation_noise", o.rotation_noise, "rad", {0, 1}, "Standard deviation of each joint's rotation, per axis.");
  v.integer("seed", o.seed, "1", {0, 1e15}, "Seed of the noise; the same seed gives the same samples.");
  v.number("dropout_period", o.dropout_period, "s", {0, 3600}, "A dropout ends each such period; 0 = none.");
  v.number("dropout_time", o.dropout_time, "s", {0, 60}, "Duration of a dropout.");
  v.number("teleport_at", o.teleport_at, "s", {-1, 86400}, "When the whole hand jumps; negative = never.");
  v.numbers("teleport_offset", o.teleport_offset.data(), 3, "m", {-1000, 1000}, "How far it jumps.");
  v.number("teleport_time", o.teleport_time, "s", {0, 3600}, "How long it stays there.");
  v.number("nan_at", o.nan_at, "s", {-1, 86400}, "When one joint turns not-a-number; negative = never.");
  v.number("nan_time", o.nan_time, "s", {0, 3600}, "For how long.");
  v.string("nan_joint", o.nan_joint, "Which joint: an OpenXR name such as index_intermediate.");
  v.number("freeze_at", o.freeze_at, "s", {-1, 86400}, "When no samples come; negative = never.");
  v.number("freeze_time", o.freeze_time, "s", {0, 3600}, "For how long.");
  v.flag("flip_signs", o.flip_signs, "Every other sample has its quaternions negated: the same rotations.");
  v.flag("duplicate", o.duplicate, "Every sample is delivered twice.");
}

class ReplayTracker : public TrackerSource {
 public:
  /// Time 0 of the motion is the first call of `sample`, less `start_time`. Throws std::invalid_argument for a joint
  /// name that does not exist.
  ReplayTracker(std::shared_ptr<const Motion> motion, const ReplayOptions& options, HandKey hand,
                std::uint32_t source = 0);

  /// Samples that became due since the last call and are not the newest are skipped, as a tracker would overwrite them.
  /// Which samples exist, and their noise, does not depend on when this is called.
  bool sample(Nanoseconds now, Skeleton& out) override;
  /// True once the motion has been played to its end (never when it repeats).
  bool finished(Nanoseconds now) const;

 private:
  double sample_time(std::int64_t index) const;   // seconds from start
  std::int64_t newest_due(double elapsed) const;  // index; negative = none
  bool dropped(double time) const;
  void fill(std::int64_t index, Skeleton& out) const;

  std::shared_ptr<const Motion> motion_;
  ReplayOptions options_;
  HandKey hand_;
  std::uint32_t source_;
  std::size_t nan_joint_;
  double period_;          // of samples at a rate; 0 = recorded times
  std::size_t first_ = 0;  // recorded sample to start at
  bool started_ = false;
  Nanoseconds start_ = 0;
  std::int64_t last_ = -1;
  std::uint64_t duplicates_left_ = 0;
  Skeleton last_sample_;
};

}  // namespace softhand
