#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <optional>
#include <thread>

#include "bus/bus.hpp"
#include "cli/commands.hpp"
#include "cli/terminal_text.hpp"
#include "cli/tracker_table.hpp"
#include "device/health.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"

namespace softhand {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;
constexpr milliseconds kListening{2000};  // all modules are found, and rates are known
constexpr milliseconds kSwitching{3000};  // longest time until readers hear the chosen tracker

class Watcher {
 public:
  void listen(milliseconds time) {
    for (const auto end = Clock::now() + time; Clock::now() < end;) {
      std::this_thread::sleep_for(milliseconds(5));
      statuses_.take_all([this](const LoopStatus& status) { table_.add(status, now()); });
      hands_.take_all([this](const Skeleton& hand) { table_.add(hand); });
    }
  }
  const TrackerTable& table() const { return table_; }
  const bus::Participant& participant() const { return participant_; }

 private:
  bus::Participant participant_{"softhand trackers"};
  bus::Reader<LoopStatus> statuses_{participant_, bus::topics::loop_status};
  bus::Reader<Skeleton> hands_{participant_, bus::topics::tracked_skeleton};
  TrackerTable table_;
};

bool set_strength(const bus::Participant& participant, const std::string& module, int strength) {
  bus::Reader replies(participant, bus::topics::message_reply);
  bus::Writer writer(participant, bus::topics::message);
  Message message;
  set_text(message.module, module);
  set_text(message.key, "strength");
  set_text(message.value, std::to_string(strength));
  message.id = make_epoch();
  message.stamp.sequence = 1;
  message.stamp.epoch = participant.epoch();
  message.stamp.clock_id = clock_id();
  message.stamp.publish_time = message.stamp.sample_time = now();
  writer.write(message);
  bool applied = false;
  for (const auto end = Clock::now() + kSwitching; !applied && Clock::now() < end;) {
    std::this_thread::sleep_for(milliseconds(5));
    replies.take_all([&](const MessageReply& reply) {
      applied =
          applied || (reply.id == message.id && get_text(reply.module) == module && reply.result == kReplyApplied);
    });
  }
  return applied;
}

}  // namespace

int run_trackers(const TrackersArguments& arguments) {
  Watcher watcher;
  watcher.listen(kListening);
  const TrackerTable& table = watcher.table();
  if (arguments.use.empty()) {
    fmt::print("{}", terminal_text(table.text(now())));
    return table.trackers().empty() ? 1 : 0;
  }
  const std::optional<int> strength = table.strength_to_own(arguments.use, now());
  if (!strength) {
    fmt::print(stderr, "softhand trackers: no live tracker '{}'; `softhand trackers` lists them\n", arguments.use);
    return 1;
  }
  if (*strength > kMostStrength) {
    fmt::print(stderr,
               "softhand trackers: another tracker has strength {}; lower it first: `softhand send MODULE "
               "strength 0`\n",
               kMostStrength);
    return 1;
  }
  if (!set_strength(watcher.participant(), arguments.use, *strength)) {
    fmt::print(stderr, "softhand trackers: {} does not answer\n", arguments.use);
    return 1;
  }
  for (const auto end = Clock::now() + kSwitching; Clock::now() < end;) {
    watcher.listen(milliseconds(50));
    if (!table.owns(arguments.use)) continue;
    fmt::print("{} owns {} (strength {})\n", arguments.use, table.hands_of(arguments.use), *strength);
    return 0;
  }
  fmt::print(stderr,
             "softhand trackers: {} has strength {} now, but does not own a hand: it is not healthy, or sees none\n",
             arguments.use, *strength);
  return 1;
}

}  // namespace softhand
