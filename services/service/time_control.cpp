#include "service/time_control.hpp"

#include <algorithm>
#include <cstdlib>

#include "device/answer.hpp"

namespace softhand {
namespace {

constexpr double kSlowest = 0.01;       // other than standing
constexpr double kLongestAdvance = 60;  // s
constexpr Nanoseconds kOldestCommand =
    2'000'000'000;  // the sender's clock is another one, or the message waited too long to be acted on
constexpr Nanoseconds kNewestCommand = 1'000'000;

}  // namespace

TimeControl::TimeControl() {
  if (const char* text = std::getenv(kVariable)) clock_ = SimulatedClock::from_text(text);
}

std::optional<MessageReply> TimeControl::answer(const Message& message, std::string_view module, Nanoseconds now) {
  const std::string_view key = get_text(message.key);
  if (key != "pace" && key != "advance" && key != "reset") return std::nullopt;
  if (get_text(message.module) != "*")
    return reply_to(message, module, kReplyRefused, "one clock for all: send it to *");
  const Nanoseconds sent = message.stamp.publish_time;
  if (sent < now - kOldestCommand || sent > now + kNewestCommand)
    return reply_to(message, module, kReplyRefused, "sent by another clock than this host's");
  const Nanoseconds from = sent + kNotice;
  if (key == "reset") {
    reset_ = std::max(reset_.value_or(from), from);
    return reply_to(message, module, kReplyApplied, "starts over");
  }
  const std::optional<double> value = parse_number(get_text(message.value));
  if (key == "pace") {
    if (!value || (*value != 0 && !(*value >= kSlowest && *value <= 1)))
      return reply_to(message, module, kReplyRefused, "pace: expected 0 to stand, or 0.01 to 1");
    clock_.command(from, *value);
    return reply_to(message, module, kReplyApplied,
                    *value == 0   ? "stands"
                    : *value == 1 ? "goes on in real time"
                                  : "goes on, slowed down");
  }
  if (!value || !(*value > 0 && *value <= kLongestAdvance))
    return reply_to(message, module, kReplyRefused, "advance: expected seconds, up to 60");
  clock_.command(from, 1, from + static_cast<Nanoseconds>(*value * 1e9));
  return reply_to(message, module, kReplyApplied, "goes on for so long, then stands");
}

std::optional<Nanoseconds> TimeControl::take_reset(Nanoseconds now) {
  if (!reset_ || now < *reset_) return std::nullopt;
  const Nanoseconds simulated = clock_.at(*reset_);
  reset_.reset();
  return simulated;
}

}  // namespace softhand
