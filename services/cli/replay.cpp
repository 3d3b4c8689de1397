#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "cli/commands.hpp"
#include "cli/topic_recording.hpp"
#include "runtime/clock.hpp"
#include "runtime/signals.hpp"

namespace softhand {

int run_replay(const ReplayArguments& arguments) {
  using std::chrono::milliseconds;
  const StopSignal stop;
  const bus::Participant participant("softhand replay");
  TopicPlayer player(participant, arguments.path, arguments.topics, arguments.speed);
  fmt::print("{}: {:.1f} s{}\n", arguments.path, static_cast<double>(player.duration()) * 1e-9,
             player.truncated() ? ", truncated" : "");
  std::fflush(stdout);
  std::this_thread::sleep_for(milliseconds(700));  // time for readers to discover the writers
  while (!stop.requested() && player.play(now())) {
    const Nanoseconds wait = std::clamp<Nanoseconds>(player.next_due() - now(), 0, 50'000'000);
    std::this_thread::sleep_for(std::chrono::nanoseconds(wait));
  }
  std::this_thread::sleep_for(milliseconds(200));  // time to deliver the last messages
  std::uint64_t refused = 0;
  for (const auto& [topic, count] : player.counts()) {
    fmt::print("{:<22} {:>9} messages{}\n", topic, count.messages,
               count.refused > 0 ? fmt::format(", {} malformed", count.refused) : "");
    refused += count.refused;
  }
  return refused == 0 ? 0 : 1;
}

}  // namespace softhand
