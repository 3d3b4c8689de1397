// A WEART TouchDIVER behind the WEART middleware. It tracks the curls of fingers, and acts on their skin.
#pragma once

#include <algorithm>
#include <array>
#include <cstdio>
#include <string>

#include "device/device_loop.hpp"
#include "device/intake.hpp"
#include "device/taxel_map.hpp"
#include "device/tracker_source.hpp"
#include "tactile/weart/weart_messages.hpp"
#include "tactile/weart/weart_options.hpp"

namespace softhand {

class Weart final : public TrackerSource, public TactileDriver {
 public:
  using Options = WeartOptions;
  Weart(const Options& options, const HandModel& hand)
      : options_(options),
        side_(hand.side),
        points_(options.pro ? 6 : 3),
        taxels_(hand, digit_taxels(hand, points_)),
        lifter_(hand, hand.side) {
    // JSON is decoded in the thread that receives, because its decoder allocates.
    intake_.translate([this](const Arrival& message) {
      report_ = decode_weart(message.bytes, side_);
      return packet_of(report_);
    });
    intake_.connect_tcp(options.address, options.port, kWeartEnd, greeting());
    std::printf("connecting to %s, TCP port %u\n", options.address.c_str(), static_cast<unsigned>(options.port));
    std::fflush(stdout);
    intake_.set_release(no_effect());
    intake_.start();
  }
  ~Weart() override { intake_.send(0, no_effect() + "StopFromClient~"); }

  void poll(Nanoseconds, TrackerSink& out) override {
    intake_.take([&](const Arrival& message) {
      const auto report = value_in<WeartReport>(message);
      // A middleware that was started again knows nothing of the calibration before.
      if (message.connection != heard_connection_) calibration_ = 0;
      heard_connection_ = message.connection;
      if (refusals_.accepted(report.refusal)) take(report, message.time, out);
    });
  }
  SourceState state() const override { return {intake_.connected(), refusals_.total() + intake_.counters().refused()}; }
  void fill_status(LoopStatus& status) const override {
    intake_.fill_status(status);
    refusals_.fill_status(status, intake_.counters().refused_size);
    add_counter(status, "refused_regions", static_cast<double>(taxels_.refused()));
    add_counter(status, "calibration", calibration_);
    add_counter(status, "status_code", status_code_);
    add_counter(status, "gloves", gloves_);
  }

  // Each point has a force, a temperature and a texture.
  DeviceLimits limits() const override { return {3 * points_, -1, 1, options_.slew}; }
  void command(const SkinTraction& input, std::span<double> requested) override {
    const auto touches = taxels_.feel(input);
    for (std::size_t p = 0; p < points_; ++p) {
      if (!(touches[p].press > 0)) continue;
      requested[3 * p] = touches[p].press / options_.full_scale_force;
      requested[3 * p + 1] = 2 * options_.temperature - 1;
      requested[3 * p + 2] = options_.texture_volume > 0 ? touches[p].slip_speed() / options_.full_scale_slip : 0;
    }
  }
  // An effect lasts until the next message about it. So effects are sent when they change, zero at once, and all of
  // them to each new connection.
  void write(Nanoseconds now, std::span<const double> commands) override {
    const Intake::Counters counters = intake_.counters();
    const std::uint64_t connection = counters.connections + counters.reconnects;  // changes with each connection
    const bool is_new = !std::equal(commands.begin(), commands.end(), sent_.begin()) || connection != connection_;
    const bool is_zero = std::all_of(commands.begin(), commands.end(), [](double command) { return command == 0; });
    if (!is_new || (!is_zero && now - sent_at_ < kPeriod)) return;
    std::copy(commands.begin(), commands.end(), sent_.begin());
    for (std::size_t p = 0; p < points_; ++p) effects_[p] = {sent_[3 * p], sent_[3 * p + 1], sent_[3 * p + 2]};
    const WeartCommand command(side_, std::span(effects_.data(), points_), static_cast<int>(options_.texture),
                               options_.texture_volume);
    intake_.send(0, command.text());
    connection_ = connection;
    sent_at_ = now;
  }
  bool release() override {
    intake_.release();
    return true;
  }

 private:
  static constexpr Nanoseconds kPeriod = 10'000'000;
  static constexpr int kCalibrating = 1;

  std::string no_effect() const {
    const std::array<WeartEffects, kWeartPoints.size()> none{};
    return std::string(WeartCommand(side_, std::span(none.data(), points_), 0, 0).text());
  }
  std::string greeting() const {
    std::string text = "StartFromClient:SdkLLCPP:2.0.0:TrackType1~" + weart_questions();
    if (options_.calibrate) text += "StartCalibration~";
    return text;
  }
  void take(const WeartReport& report, Nanoseconds time, TrackerSink& out) {
    switch (report.kind) {
      case WeartKind::other:
        break;
      case WeartKind::calibration_result:
        break;
      case WeartKind::calibration:
        calibration_ = report.value;
        break;
      case WeartKind::middleware:
        status_code_ = report.value;
        break;
      case WeartKind::devices:
        gloves_ = report.value;
        break;
      case WeartKind::tracking:
        if (calibration_ == kCalibrating) break;
        fingers_ = report.fingers;
        fingers_[0].splay *= options_.thumb_abduction;
        lifter_.lift(fingers_, hand_);
        hand_.confidence = 1;
        hand_.stamp.sample_time = time;
        ++hand_.stamp.sequence;
        out.hand(hand_);
    }
  }

  Options options_;
  Side side_;
  std::size_t points_;
  TaxelMap taxels_;
  CurlLifter lifter_;
  WeartReport report_;  // used by the thread of intake_
  std::array<FingerCurl, kFingerCount> fingers_;
  Skeleton hand_;
  std::array<double, 3 * kWeartPoints.size()> sent_{};
  std::array<WeartEffects, kWeartPoints.size()> effects_{};
  Nanoseconds sent_at_ = 0;
  std::uint64_t connection_ = 0, heard_connection_ = 0;
  int calibration_ = 0, status_code_ = 0, gloves_ = 0;
  Refusals<WeartRefusal, kWeartRefusalNames.size()> refusals_{kWeartRefusalNames};
  Intake intake_{kLargestWeartMessage};  // last: its thread uses report_
};

}  // namespace softhand
