// A glove with the OpenGloves protocol. It tracks the fingers and brakes them.
#pragma once

#include <algorithm>
#include <array>
#include <cstdio>
#include <string>

#include "device/device_loop.hpp"
#include "device/intake.hpp"
#include "device/tracker_source.hpp"
#include "haptics/opengloves/alpha_line.hpp"
#include "haptics/opengloves/opengloves_options.hpp"

namespace softhand {

class OpenGloves final : public TrackerSource, public HapticDriver {
 public:
  using Options = OpenGlovesOptions;
  OpenGloves(const Options& options, const HandModel& hand)
      : options_(options), lifter_(hand, hand.side), decoder_(hand.side, options.maximum) {
    if (!options.serial.empty()) {
      intake_.open_serial(options.serial, options.baud, '\n');
      std::printf("opening %s\n", options.serial.c_str());
    } else {
      const unsigned port = intake_.listen_tcp(options.address, options.port, '\n');
      std::printf("listening on %s, TCP port %u\n", options.address.c_str(), port);
    }
    std::fflush(stdout);
    intake_.set_release(std::string(ForceLine(std::array<double, kFingerCount>{}, options.force_maximum).text()));
    intake_.start();
  }

  void poll(Nanoseconds, TrackerSink& out) override {
    intake_.take([&](const Arrival& packet) {
      const auto* fingers = decoder_.take(packet);
      // Others than the glove are not answered. Before its first good line it may be any of them.
      if (decoder_.connection() == 0 || packet.connection == decoder_.connection()) is_asked_ = true;
      if (fingers == nullptr) return;
      fingers_ = *fingers;
      for (FingerCurl& finger : fingers_) finger.splay *= options_.splay_angle;
      lifter_.lift(fingers_, hand_);
      hand_.confidence = 1;
      hand_.stamp.sample_time = packet.time;
      ++hand_.stamp.sequence;
      out.hand(hand_);
    });
  }
  SourceState state() const override {
    return {intake_.connected(), decoder_.refusals().total() + intake_.counters().refused()};
  }
  void fill_status(LoopStatus& status) const override {
    intake_.fill_status(status);
    decoder_.refusals().fill_status(status, intake_.counters().refused_size);
    add_counter(status, "ignored_lines", static_cast<double>(decoder_.ignored()));
  }

  DeviceLimits limits() const override { return {kFingerCount, 0, options_.blocking_force, options_.slew}; }
  void command(const BoneWrench& input, std::span<double> requested) override {
    add_closing_resistance(input, requested);
  }
  // Firmware with brakes waits for a line after each of its own, up to 1 s. So each one is answered, and nothing else
  // is sent except zero forces and, to a glove that is slow, new ones.
  void write(Nanoseconds now, std::span<const double> commands) override {
    let_go_of_earlier();
    const bool is_new = !std::equal(commands.begin(), commands.end(), sent_.begin());
    const bool is_zero = std::all_of(commands.begin(), commands.end(), [](double force) { return force == 0; });
    const bool is_late = now - sent_at_ >= kSlowGlove;
    if (!is_asked_ && !(is_new && (is_zero || is_late))) return;
    std::copy(commands.begin(), commands.end(), sent_.begin());
    std::array<double, kFingerCount> shares;
    for (std::size_t f = 0; f < shares.size(); ++f) shares[f] = commands[f] / options_.blocking_force;
    // A glove of an earlier connection must not stay blocked either.
    intake_.send(is_zero ? 0 : decoder_.connection(), ForceLine(shares, options_.force_maximum).text());
    sent_at_ = now;
    is_asked_ = false;
  }
  bool release() override {
    intake_.release();
    return true;
  }

 private:
  static constexpr Nanoseconds kSlowGlove = 20'000'000;

  // A glove that forces no longer reach must not stay blocked.
  void let_go_of_earlier() {
    const std::uint64_t connection = decoder_.connection();
    if (connection == connection_) return;
    const std::array<double, kFingerCount> zero{};
    if (connection_ != 0) intake_.send(connection_, ForceLine(zero, options_.force_maximum).text());
    connection_ = connection;
  }

  Options options_;
  Intake intake_{kLargestAlphaLine};
  CurlLifter lifter_;
  AlphaDecoder decoder_;
  std::array<FingerCurl, kFingerCount> fingers_;
  Skeleton hand_;
  std::array<double, kFingerCount> sent_{};
  Nanoseconds sent_at_ = 0;
  std::uint64_t connection_ = 0;  // that gets forces
  bool is_asked_ = false;         // the glove sent a line and waits for the answer
};
}  // namespace softhand
