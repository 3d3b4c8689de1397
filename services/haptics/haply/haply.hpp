// A Haply Inverse3: a grounded device that measures its cursor and pushes it.
#pragma once

#include <algorithm>
#include <array>
#include <cstdio>
#include <string_view>

#include "device/device_loop.hpp"
#include "device/grounded_point.hpp"
#include "device/tracker_source.hpp"
#include "device/websocket_client.hpp"
#include "haptics/haply/haply_messages.hpp"
#include "haptics/haply/haply_options.hpp"

namespace softhand {

class Haply final : public TrackerSource, public HapticDriver {
 public:
  using Options = HaplyOptions;
  Haply(const Options& options, const HandModel& hand)
      : options_(options),
        point_(options.point, hand),
        service_({options.address, options.port}, kLargestHaplyMessage, kSlots),
        events_({options.address, options.event_port}, kLargestHaplyMessage, kSlots) {
    // JSON is decoded in the threads that receive, because its decoder allocates.
    service_.translate([this](const Arrival& message) {
      report_ = decode_haply_report(message.bytes, options_.device_id);
      return packet_of(report_);
    });
    events_.translate([this](const Arrival& message) {
      event_ = decode_haply_event(message.bytes);
      return packet_of(event_);
    });
    std::printf("connecting to %s, port %u\n", options.address.c_str(), static_cast<unsigned>(options.port));
    std::fflush(stdout);
    service_.start();
    if (options.event_port != 0) events_.start();
  }

  void poll(Nanoseconds now, TrackerSink& out) override {
    service_.take([&](const Arrival& message) { take(value_in<HaplyReport>(message), message, out); });
    events_.take([&](const Arrival& message) { take(value_in<HaplyEvent>(message), message.time); });
    if (!service_.connected() || now - newest_time_ > kOld) newest_.has_device = false;
    if (is_halted(now)) ramp_from_ = now;
  }
  SourceState state() const override {
    return {service_.connected() && newest_.has_device, refusals_.total() + service_.counters().refused()};
  }
  void fill_status(LoopStatus& status) const override {
    service_.fill_status(status);
    refusals_.fill_status(status, service_.counters().refused_size);
    add_counter(status, "reports", static_cast<double>(reports_));
    add_counter(status, "safety_events", static_cast<double>(safety_events_));
    add_counter(status, "braked", is_braked_ ? 1 : 0);
    add_counter(status, "force_key_changes", static_cast<double>(key_changes_));
  }

  DeviceLimits limits() const override { return point_.limits(); }
  void command(const BoneWrench& input, std::span<double> requested) override { point_.command(input, requested); }
  bool measure(Nanoseconds, std::span<double> positions) override {
    if (!newest_.has_device) return false;
    std::copy(newest_.position.begin(), newest_.position.end(), positions.begin());
    return true;
  }
  bool measure_velocities(std::span<double> velocities) override {
    if (newest_.has_velocity) std::copy(newest_.velocity.begin(), newest_.velocity.end(), velocities.begin());
    return newest_.has_velocity;
  }
  /// The service says which force it applies. A report follows the force of the report before.
  bool measure_commands(std::span<double> commands) override {
    if (acted_count_ == 0) return newest_.has_force;
    for (std::size_t i = 0; i < 3; ++i) commands[i] = acted_[i] / acted_count_;
    acted_ = {};
    acted_count_ = 0;
    return newest_.has_force;
  }
  // The service answers each message with one report, and a force lasts for one tick. So a message is sent in each
  // step, but not more than two before their reports, or they would queue up. Zero does not wait.
  void write(Nanoseconds now, std::span<const double> commands) override {
    const Vector3 wanted(commands[0], commands[1], commands[2]);
    const Vector3 force = wanted * share(now);
    const bool lets_go = force.isZero(0) && !sent_.isZero(0), is_slow = now - sent_at_ >= kSlowService;
    forget_unanswered(now, is_slow);
    if (unanswered_ >= kMostUnanswered && !lets_go && !is_slow) return;
    if (newest_.has_device) {
      service_.send(HaplyCommand(newest_.device_id, key_, force).text());
    } else if (is_slow) {
      service_.send(kHaplyProbe);
    } else {
      return;
    }
    sent_ = force;
    sent_at_ = now;
    ++unanswered_;
  }
  // A force lasts for one tick of the service.
  bool release() override { return true; }

 private:
  static constexpr std::size_t kSlots = 16;
  static constexpr int kMostUnanswered = 2;
  static constexpr Nanoseconds kSlowService = 20'000'000, kOld = 50'000'000;
  static constexpr Nanoseconds kTrackPeriod = 4'000'000;
  static constexpr Nanoseconds kHalt = 1'000'000'000, kRamp = 500'000'000;
  // A force without effect: at least kFelt is commanded, and the service reports less than kNothing.
  static constexpr double kFelt = 0.3, kNothing = 1e-3;
  static constexpr int kReportsWithoutEffect = 100;

  void take(const HaplyReport& report, const Arrival& message, TrackerSink& out) {
    if (message.connection != connection_) {
      connection_ = message.connection;
      unanswered_ = 1;  // the first report is not an answer
      begin(message.time, options_.force_key == "values" || (options_.force_key == "auto" && !report.has_session)
                              ? HaplyForceKey::values
                              : HaplyForceKey::vector);
    }
    unanswered_ = std::max(0, unanswered_ - 1);
    answered_at_ = message.time;
    if (!refusals_.accepted(report.refusal)) return;
    ++reports_;
    if (report.has_device && !newest_.has_device) begin(message.time, key_);
    for (std::size_t i = 0; i < 3; ++i) acted_[i] += newest_.force[i];
    ++acted_count_;
    newest_ = report;
    newest_time_ = message.time;
    if (!report.has_device) return;
    known_id_ = report.device_id;
    check_effect(message.time);
    if (message.time - tracked_at_ < kTrackPeriod) return;
    tracked_at_ = message.time;
    point_.lift(to_vector(report.position), hand_);
    hand_.stamp.sample_time = message.time;
    ++hand_.stamp.sequence;
    out.hand(hand_);
  }
  void take(const HaplyEvent& event, Nanoseconds time) {
    if (!refusals_.accepted(event.refusal) || event.kind == HaplyEventKind::other) return;
    // Before the first report any device may be ours.
    const std::string_view ours = known_id_[0] != '\0' ? known_id_.data() : options_.device_id;
    const std::string_view id = event.device_id.data();
    if (!id.empty() && !ours.empty() && id != ours) return;
    ++safety_events_;
    // A brake outlives a connection: a service that is back does not say whether the brake is still on.
    is_braked_ = event.kind == HaplyEventKind::brake || (is_braked_ && event.kind != HaplyEventKind::release);
    halted_until_ = time + kHalt;
  }

  void forget_unanswered(Nanoseconds now, bool is_slow) {
    // A message that a newer one replaced never reached the service.
    const std::uint64_t superseded = service_.counters().superseded;
    unanswered_ = std::max(0, unanswered_ - static_cast<int>(superseded - superseded_));
    superseded_ = superseded;
    // The service has worked off all it got, and is quiet since: other reports will not come. One that stands still, or
    // still catches up, gets no more messages than before.
    if (is_slow && answered_at_ > sent_at_ && now - answered_at_ >= kSlowService / 2) unanswered_ = 0;
  }
  // A version of the service that does not know our key ignores it.
  void check_effect(Nanoseconds now) {
    const bool has_no_effect =
        newest_.has_force && !is_halted(now) && sent_.norm() > kFelt && to_vector(newest_.force).norm() < kNothing;
    without_effect_ = has_no_effect ? without_effect_ + 1 : 0;
    if (without_effect_ < kReportsWithoutEffect || options_.force_key != "auto") return;
    ++key_changes_;
    begin(now, key_ == HaplyForceKey::vector ? HaplyForceKey::values : HaplyForceKey::vector);
  }
  // Forces begin softly.
  void begin(Nanoseconds now, HaplyForceKey key) {
    key_ = key;
    without_effect_ = 0;
    ramp_from_ = now;
  }
  bool is_halted(Nanoseconds now) const { return is_braked_ || now < halted_until_; }
  double share(Nanoseconds now) const {
    if (is_halted(now)) return 0;
    return std::clamp(static_cast<double>(now - ramp_from_) / static_cast<double>(kRamp), 0.0, 1.0);
  }

  Options options_;
  GroundedPoint point_;
  HaplyReport report_;  // used by the thread of service_
  HaplyEvent event_;    // used by the thread of events_
  HaplyReport newest_;
  Nanoseconds newest_time_ = 0, tracked_at_ = 0, sent_at_ = 0, ramp_from_ = 0, halted_until_ = 0;
  HaplyId known_id_{};  // of the newest report with a device
  std::uint64_t connection_ = 0, superseded_ = 0;
  Nanoseconds answered_at_ = 0;
  int unanswered_ = 0;
  Vector3 sent_ = Vector3::Zero();
  HaplyForceKey key_ = HaplyForceKey::vector;
  int without_effect_ = 0;
  Vec3 acted_{};  // sum of the forces before the reports of this step
  int acted_count_ = 0;
  bool is_braked_ = false;
  std::uint64_t reports_ = 0, safety_events_ = 0, key_changes_ = 0;
  Skeleton hand_;
  Refusals<HaplyRefusal, kHaplyRefusalNames.size()> refusals_{kHaplyRefusalNames};
  WebSocketClient service_, events_;  // last: their threads use report_ and event_
};

}  // namespace softhand
