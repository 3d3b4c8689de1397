// A bHaptics TactGlove behind the bHaptics Player. It vibrates where fingers touch.
#pragma once

#include <algorithm>
#include <array>
#include <cstdio>

#include "device/device_loop.hpp"
#include "device/taxel_map.hpp"
#include "device/websocket_client.hpp"
#include "model/hand_model.hpp"
#include "tactile/bhaptics/bhaptics_options.hpp"
#include "tactile/bhaptics/player_messages.hpp"

namespace softhand {

class Bhaptics final : public TactileDriver {
 public:
  using Options = BhapticsOptions;
  Bhaptics(const Options& options, const HandModel& hand)
      : options_(options),
        side_(hand.side),
        taxels_(hand, digit_taxels(hand, kGloveMotors)),
        player_({options.address, options.port, player_target("softhand")}, kLargestPlayerMessage, kSlots) {
    // JSON is decoded in the thread that receives, because its decoder allocates.
    player_.translate([this](const Arrival& message) {
      report_ = decode_player_report(message.bytes, side_);
      return packet_of(report_);
    });
    std::printf("connecting to %s, port %u\n", options.address.c_str(), static_cast<unsigned>(options.port));
    std::fflush(stdout);
    player_.start();
  }
  /// Nothing vibrates after the end of the process, whatever was lost on the way.
  ~Bhaptics() override { player_.send(kPlayerTurnOffAll); }

  DeviceLimits limits() const override {
    DeviceLimits out{kGloveMotors, 0, 1, options_.slew};
    out.lowest_rate = kLowestRate;
    return out;
  }
  /// The motor at the wrist vibrates if the palm touches.
  void command(const SkinTraction& input, std::span<double> requested) override {
    const auto touches = taxels_.feel(input);
    for (std::size_t f = 0; f < kGloveMotors; ++f) requested[f] = touches[f].press / options_.full_scale_force;
  }
  // A frame outlives a dead client by its duration. So frames are short, and sent again while something vibrates.
  void write(Nanoseconds now, std::span<const double> commands) override {
    player_.take([this](const Arrival& message) { take(value_in<PlayerReport>(message)); });
    const bool is_zero = std::all_of(commands.begin(), commands.end(), [](double command) { return command == 0; });
    const bool lets_go = is_zero && !is_off_;
    if (!lets_go && (is_zero || now - sent_at_ < kFramePeriod)) return;
    player_.send(is_zero ? player_turn_off(side_) : PlayerFrame(side_, commands, kFrameMilliseconds).text());
    is_off_ = is_zero;
    sent_at_ = now;
  }
  // The last frame ends by itself.
  bool release() override { return true; }
  bool connected() const override { return player_.connected() && is_connected_; }
  void fill_status(LoopStatus& status) const override {
    player_.fill_status(status);
    refusals_.fill_status(status, player_.counters().refused_size);
    add_counter(status, "refused_regions", static_cast<double>(taxels_.refused()));
    add_counter(status, "glove_connected", is_connected_ ? 1 : 0);
    add_counter(status, "glove_intensity", intensity_);
  }

 private:
  static constexpr std::size_t kSlots = 16;
  static constexpr Nanoseconds kFramePeriod = 20'000'000;
  static constexpr int kFrameMilliseconds = 40;  // less than the 50 ms that "off" may take: `release`
  static constexpr double kLowestRate = 100;     // a frame is sent again before it ends, even if a step is late

  void take(const PlayerReport& report) {
    if (!refusals_.accepted(report.refusal)) return;
    if (report.has_positions) is_connected_ = report.is_connected;
    if (report.has_motors) intensity_ = *std::max_element(report.motors.begin(), report.motors.end());
  }

  Options options_;
  Side side_;
  TaxelMap taxels_;
  PlayerReport report_;  // used by the thread of player_
  bool is_off_ = true, is_connected_ = false;
  int intensity_ = 0;  // largest of the motors, as the Player reports it
  Nanoseconds sent_at_ = 0;
  Refusals<PlayerRefusal, kPlayerRefusalNames.size()> refusals_{kPlayerRefusalNames};
  WebSocketClient player_;  // last: its thread uses report_
};

}  // namespace softhand
