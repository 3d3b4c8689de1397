#include <fmt/format.h>

#include <chrono>
#include <thread>

#include "cli/commands.hpp"
#include "cli/topic_recording.hpp"
#include "runtime/signals.hpp"

namespace softhand {

int run_record(const RecordArguments& arguments) {
  const StopSignal stop;
  const bus::Participant participant("softhand record");
  TopicRecorder recorder(participant, arguments.path, arguments.topics);
  const auto started = std::chrono::steady_clock::now();
  const auto elapsed = [&started] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  };
  fmt::print("recording to {}{}\n", arguments.path,
             arguments.seconds > 0 ? fmt::format(" for {:g} s", arguments.seconds) : " until Ctrl-C");
  std::fflush(stdout);
  while (!stop.requested() && (arguments.seconds <= 0 || elapsed() < arguments.seconds)) {
    recorder.poll();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  const double seconds = elapsed();
  recorder.finish();
  std::uint64_t total = 0;
  for (const auto& [topic, count] : recorder.counts()) {
    total += count.messages;
    if (count.messages + count.lost + count.refused == 0) continue;
    fmt::print("{:<22} {:>9} messages, {:>7.1f} a second{}{}\n", topic, count.messages,
               static_cast<double>(count.messages) / seconds,
               count.lost > 0 ? fmt::format(", {} lost", count.lost) : "",
               count.refused > 0 ? fmt::format(", {} malformed", count.refused) : "");
  }
  if (total == 0) fmt::print(stderr, "softhand record: no message was received on this domain\n");
  return total > 0 ? 0 : 1;
}

}  // namespace softhand
