#include <fmt/format.h>

#include <chrono>
#include <thread>

#include "bus/bus.hpp"
#include "cli/commands.hpp"
#include "cli/module_table.hpp"
#include "cli/terminal_text.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"

namespace softhand {
namespace {

// Modules find a new process one after another, within half a second, and within seconds while a rig starts. A command
// for all of them takes effect 0.1 s after it was sent (TimeControl), so all must have found this process before. DDS
// keeps the message for those that come still later.
void wait_for_readers(const bus::Writer<Message>& writer) {
  using Clock = std::chrono::steady_clock;
  constexpr std::chrono::milliseconds kQuiet{500}, kMost{5000};
  const Clock::time_point start = Clock::now();
  Clock::time_point changed = start;
  int readers = 0;
  while (Clock::now() < start + kMost && (readers == 0 || Clock::now() < changed + kQuiet)) {
    if (const int count = writer.reader_count(); count != readers) {
      readers = count;
      changed = Clock::now();
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}

}  // namespace

int run_send(const SendArguments& arguments) {
  Message message;
  if (arguments.module.size() >= message.module.size() || arguments.key.size() >= message.key.size() ||
      arguments.value.size() >= message.value.size()) {
    fmt::print(stderr, "softhand send: module, key and value may have at most {} characters each\n",
               message.key.size() - 1);
    return 1;
  }
  set_text(message.module, arguments.module);
  set_text(message.key, arguments.key);
  set_text(message.value, arguments.value);
  const bus::Participant participant("softhand send");
  bus::Reader replies(participant, bus::topics::message_reply);
  bus::Reader statuses(participant, bus::topics::loop_status);
  bus::Writer writer(participant, bus::topics::message);

  wait_for_readers(writer);
  if (!writer.has_readers()) {
    fmt::print(stderr, "softhand send: no module is listening on this domain\n");
    return 1;
  }
  message.id = make_epoch();
  message.stamp.sequence = 1;
  message.stamp.epoch = participant.epoch();
  message.stamp.clock_id = clock_id();
  message.stamp.publish_time = message.stamp.sample_time = now();
  writer.write(message);

  ModuleTable<bool> answered;
  int applied = 0;
  int answers = 0;
  const auto timeout =
      std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(arguments.seconds));
  auto until = std::chrono::steady_clock::now() + timeout;
  while (std::chrono::steady_clock::now() < until) {
    replies.wait(std::chrono::milliseconds(50));
    statuses.take_all([&](const LoopStatus& status) { answered.of(get_text(status.module), now()); });
    replies.take_all([&](const MessageReply& reply) {
      if (reply.id != message.id) return;
      if (bool* const known = answered.of(get_text(reply.module), now())) *known = true;
      until = std::chrono::steady_clock::now() + timeout;
      ++answers;
      applied += reply.result == kReplyApplied;
      const char* result = reply.result == kReplyApplied   ? "applied"
                           : reply.result == kReplyRefused ? "REFUSED"
                                                           : "not mine";
      const std::string line = fmt::format("{:<18} {:<8} {}", get_text(reply.module), result, get_text(reply.text));
      fmt::print("{}\n", terminal_text(line));
    });
  }
  if (answers == 0) fmt::print(stderr, "softhand send: no module answered within {} s\n", arguments.seconds);
  bool all_answered = true;
  for (const auto& [module, has_answered] : answered.rows()) {
    if (has_answered || (arguments.module != "*" && arguments.module != module)) continue;
    all_answered = false;
    fmt::print(stderr, "softhand send: module {} did not answer\n", terminal_text(module));
  }
  return applied > 0 && all_answered ? 0 : 1;
}

}  // namespace softhand
