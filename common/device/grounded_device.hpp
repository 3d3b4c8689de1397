// A grounded device whose vendor's library must be called in a thread of its own: USB calls that block, or a callback
// of the vendor's scheduler. The thread and the loop exchange the newest position and the newest force.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <optional>

#include "device/grounded_point.hpp"
#include "device/latest_value.hpp"
#include "device/tracker_source.hpp"
#include "messages/convert.hpp"

namespace softhand {

/// Vectors are in the frame of the device of GroundedPoint: x right, y up, z to the user.
class GroundedDevice : public TrackerSource, public HapticDriver {
 public:
  void poll(Nanoseconds now, TrackerSink& out) override {
    if (cursors_.load(newest_) && newest_.time - tracked_at_ >= kTrackPeriod) {
      tracked_at_ = newest_.time;
      point_.lift(to_vector(newest_.position), hand_);
      hand_.stamp.sample_time = newest_.time;
      ++hand_.stamp.sequence;
      out.hand(hand_);
    }
    is_fresh_ = is_open_ && now - newest_.time < kOld;
  }
  SourceState state() const override { return {is_open_, refused_}; }
  void fill_status(LoopStatus& status) const override {
    add_counter(status, "openings", static_cast<double>(openings_));
    add_counter(status, "refused_range", static_cast<double>(refused_));
    add_counter(status, "device_errors", static_cast<double>(errors_));
  }

  DeviceLimits limits() const override {
    DeviceLimits out = point_.limits();
    out.lowest_rate = kLowestRate;
    return out;
  }
  void command(const BoneWrench& input, std::span<double> requested) override { point_.command(input, requested); }
  bool measure(Nanoseconds, std::span<double> positions) override {
    if (is_fresh_) std::copy(newest_.position.begin(), newest_.position.end(), positions.begin());
    return is_fresh_;
  }
  /// What the thread applied until it measured the newest position.
  bool measure_commands(std::span<double> commands) override {
    std::copy(newest_.acted.begin(), newest_.acted.end(), commands.begin());
    return true;
  }
  void write(Nanoseconds now, std::span<const double> commands) override {
    forces_.store({now, {commands[0], commands[1], commands[2]}});
  }
  /// The thread of the device sees that the loop stands still: `force`.
  bool release() override { return true; }

 protected:
  GroundedDevice(const GroundedPointOptions& options, const HandModel& hand) : point_(options, hand) {}

  // All that follows is for the thread of the device.

  /// A position farther than this from the device's origin is a fault, m.
  static constexpr double kFarthest = 1;
  void set_open(bool is_open) {
    if (is_open) ++openings_;
    is_open_ = is_open;
    pushes_since_.reset();
  }
  void count_error() { ++errors_; }
  /// Refuses a position that is not finite or absurd.
  void moved(Nanoseconds time, const Vec3& position) {
    const bool is_plausible =
        std::all_of(position.begin(), position.end(), [](double x) { return std::abs(x) <= kFarthest; });
    if (is_plausible) {
      located_at_ = time;
      cursors_.store({time, position, applied_});
    } else {
      ++refused_;
    }
  }
  /// The force to apply now, N. Zero if the loop stands still, and without a plausible position. Forces begin softly
  /// after that, and after each opening.
  Vec3 force(Nanoseconds now) {
    forces_.load(force_);
    applied_ = {};
    if (now - force_.time >= kSilentLoop || now - located_at_ >= kOld) {
      pushes_since_.reset();
      return applied_;
    }
    if (!pushes_since_) pushes_since_ = now;
    const double share = std::min(1.0, static_cast<double>(now - *pushes_since_) / static_cast<double>(kRamp));
    for (std::size_t i = 0; i < applied_.size(); ++i) applied_[i] = share * force_.newton[i];
    return applied_;
  }

 private:
  static constexpr Nanoseconds kTrackPeriod = 4'000'000, kOld = 50'000'000, kSilentLoop = 20'000'000;
  static constexpr Nanoseconds kRamp = 500'000'000;
  static constexpr double kLowestRate = 3e9 / kSilentLoop;  // two steps may be late
  struct Cursor {
    Nanoseconds time = 0;
    Vec3 position{};
    Vec3 acted{};  // force before that time, N
  };
  struct Force {
    Nanoseconds time = 0;
    Vec3 newton{};
  };
  GroundedPoint point_;
  Cursor newest_;
  Nanoseconds tracked_at_ = 0;
  bool is_fresh_ = false;
  Skeleton hand_;
  // Of the thread of the device.
  Force force_;
  Vec3 applied_{};
  Nanoseconds located_at_ = 0;                 // time of the last plausible position
  std::optional<Nanoseconds> pushes_since_{};  // none: the force is zero
  LatestValue<Cursor> cursors_;
  LatestValue<Force> forces_;
  std::atomic<bool> is_open_{false};
  std::atomic<std::uint64_t> openings_{0}, refused_{0}, errors_{0};
};

}  // namespace softhand
