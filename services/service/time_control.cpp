#include "service/time_control.hpp"

#include <algorithm>

#include "device/answer.hpp"
#include "messages/age.hpp"
#include "runtime/clock.hpp"

namespace softhand {
namespace {

constexpr double kSlowest = 0.01;  // smallest pace except 0
// An older command comes from another clock, or it waited too long for its execution.
constexpr double kOldestCommand = 2;  // s

}  // namespace

TimeControl::TimeControl(const SimulatedClock& clock) : clock_id_(clock_id()), clock_(clock) {}

std::optional<MessageReply> TimeControl::answer(const Message& message, std::string_view module, Nanoseconds now) {
  const std::string_view key = get_text(message.key);
  if (key != "pace" && key != "advance" && key != "reset") return std::nullopt;
  if (get_text(message.module) != "*")
    return reply_to(message, module, kReplyRefused, "this concerns all modules: send it to *");
  const Nanoseconds sent = message.stamp.publish_time;
  if (!is_usable(message.stamp, now, clock_id_) || age_of(sent, now).value_or(0) > kOldestCommand)
    return reply_to(message, module, kReplyRefused, "the stamp is too old, or from a clock that is not known");
  const Nanoseconds from = sent + kNotice;
  if (key == "reset") {
    reset_ = std::max(reset_.value_or(from), from);
    return reply_to(message, module, kReplyApplied, "starting over");
  }
  const std::optional<double> value = parse_number(get_text(message.value));
  if (key == "pace") {
    if (!value || (*value != 0 && !(*value >= kSlowest && *value <= 1)))
      return reply_to(message, module, kReplyRefused, "pace: expected 0 to halt, or 0.01 to 1");
    clock_.command(from, *value);
    return reply_to(message, module, kReplyApplied,
                    *value == 0   ? "halted"
                    : *value == 1 ? "running in real time"
                                  : "running slowed down");
  }
  if (!value || !(*value > 0 && *value <= kLongestAdvance))
    return reply_to(message, module, kReplyRefused, "advance: expected seconds above 0, up to 60");
  clock_.command(from, 1, from + static_cast<Nanoseconds>(*value * 1e9));
  return reply_to(message, module, kReplyApplied, "running for this time, then halted");
}

std::optional<Nanoseconds> TimeControl::take_reset(Nanoseconds now) {
  if (!reset_ || now < *reset_) return std::nullopt;
  const Nanoseconds simulated = clock_.at(*reset_);
  reset_.reset();
  return simulated;
}

}  // namespace softhand
