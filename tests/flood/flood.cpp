// flood [--topic NAME]... [--rate HZ] [--seconds S]: how much a rig suffers when an outsider floods a topic.
//
// Starts a pinch with a hand of 400 nodes, and floods one topic after the other. The outsider is a process of its own
// at ordinary priority. Its samples have the key of the rig's own ones, fresh stamps and empty lists. Prints a table
// in Markdown. The figures in brackets are those of the same time before the flood. Exit code 1: a process of the rig
// ended, or was silent after a flood. Deadlines do not decide.
#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "bus/bus.hpp"
#include "integration/rig_harness.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "support/own_domain.hpp"

namespace softhand {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr std::array<const char*, 6> kModules{"tracker", "tracking", "hand", "world", "haptic", "tactile"};
constexpr std::string_view kPrefix = "softhand/v1/";

double cpu_seconds_of_this_process() {
  rusage used{};
  getrusage(RUSAGE_SELF, &used);
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
  };
  return seconds(used.ru_utime) + seconds(used.ru_stime);
}

/// The outsider. Prints "start" when it begins, and at the end samples and CPU seconds per second, and whether anybody
/// reads the topic.
template <typename T>
void write_flood(const bus::Topic<T>& topic, double rate_hz, double seconds) {
  const bus::Participant participant("outsider");
  bus::Writer writer(participant, topic);
  const auto patience = Clock::now() + 3s;
  while (!writer.has_readers() && Clock::now() < patience) std::this_thread::sleep_for(10ms);
  std::this_thread::sleep_for(500ms);
  auto message = std::make_unique<T>();
  if constexpr (requires { message->hand; }) message->hand = {0, 1};
  if constexpr (requires { message->object; }) message->object = 1;
  if constexpr (requires { message->module; }) set_text(message->module, "hand");
  message->stamp.epoch = participant.epoch();
  message->stamp.clock_id = clock_id();
  fmt::print("start\n");
  std::fflush(stdout);
  const double used = cpu_seconds_of_this_process();
  const auto begin = Clock::now();
  std::uint64_t written = 0;
  double elapsed = 0;
  while ((elapsed = std::chrono::duration<double>(Clock::now() - begin).count()) < seconds) {
    if (static_cast<double>(written) >= elapsed * rate_hz) {
      std::this_thread::sleep_for(200us);
      continue;
    }
    message->stamp.sequence = ++written;
    message->stamp.sample_time = message->stamp.publish_time = now();
    writer.write(*message);
  }
  fmt::print("{:.0f} {:.3f} {}\n", static_cast<double>(written) / elapsed,
             (cpu_seconds_of_this_process() - used) / elapsed, writer.has_readers() ? 1 : 0);
}

struct CpuTime {
  double busy = 0;
  double all = 0;
};
CpuTime cpu_time_of_the_machine() {
  std::ifstream in("/proc/stat");
  std::string word;
  in >> word;
  CpuTime out;
  double part = 0;
  for (int i = 0; i < 8 && in >> part; ++i) {
    out.all += part;
    if (i != 3 && i != 4) out.busy += part;  // idle, waiting for a disk
  }
  return out;
}

/// What happened in a span of time.
struct Span {
  double busy = 0;  ///< share of the machine
  std::map<std::string, LoopStatus> before, after;
};

struct Row {
  std::string topic;
  std::string reached = "-";
  std::string cpu = "-";
  std::string busy;
  std::map<std::string, std::string> missed;  ///< by module
  bool is_alive = true;                       ///< every process went on
};

/// The statuses of the processes that ran at the start. The outsider may write statuses under their names.
class Modules {
 public:
  Modules() : reader_(participant_, bus::topics::loop_status) {}
  void poll() {
    reader_.take_all([this](const LoopStatus& status) {
      const auto found = newest_.find(std::string(get_text(status.module)));
      if (found != newest_.end() && found->second.process_id != status.process_id) return;
      newest_[std::string(get_text(status.module))] = status;
    });
  }
  void listen(std::chrono::milliseconds time) {
    for (const auto end = Clock::now() + time; Clock::now() < end; std::this_thread::sleep_for(5ms)) poll();
  }
  /// True as soon as each of them has reported from now on.
  bool all_report(std::chrono::milliseconds timeout) {
    const Nanoseconds since = now();
    const auto reports = [&](const char* module) {
      const auto found = newest_.find(module);
      return found != newest_.end() && found->second.stamp.publish_time > since;
    };
    for (const auto end = Clock::now() + timeout; Clock::now() < end; std::this_thread::sleep_for(5ms)) {
      poll();
      if (std::all_of(kModules.begin(), kModules.end(), reports)) return true;
    }
    return false;
  }
  const std::map<std::string, LoopStatus>& newest() const { return newest_; }

 private:
  bus::Participant participant_{"flood"};
  bus::Reader<LoopStatus> reader_;
  std::map<std::string, LoopStatus> newest_;
};

std::string missed_in(const Span& span, const std::string& module) {
  const LoopStatus &before = span.before.at(module), &after = span.after.at(module);
  const double seconds = 1e-9 * static_cast<double>(after.stamp.publish_time - before.stamp.publish_time);
  if (seconds <= 0) return "unknown";
  const double share = static_cast<double>(after.deadline_misses - before.deadline_misses) /
                       (seconds * std::max(1.0, after.nominal_rate_hz));
  const std::string text = fmt::format("{:.2f} %", 100 * share);
  return share > 0.01 ? "**" + text + "**" : text;
}

Span observe(Modules& modules, double seconds) {
  Span span;
  modules.listen(200ms);
  span.before = modules.newest();
  const CpuTime before = cpu_time_of_the_machine();
  modules.listen(std::chrono::milliseconds(std::llround(1000 * seconds) - 400));
  const CpuTime after = cpu_time_of_the_machine();
  span.after = modules.newest();
  span.busy = (after.busy - before.busy) / std::max(1.0, after.all - before.all);
  return span;
}

Row measure(Modules& modules, const std::string& topic, double rate_hz, double seconds) {
  Row row;
  row.topic = topic;
  const Span quiet = observe(modules, seconds);
  std::array<char, 256> line{};
  const auto self = std::filesystem::read_symlink("/proc/self/exe").string();
  std::FILE* outsider =
      popen(fmt::format("'{}' --write {} --rate {} --seconds {}", self, topic, rate_hz, seconds).c_str(), "r");
  if (outsider == nullptr || std::fgets(line.data(), line.size(), outsider) == nullptr)
    throw std::runtime_error("the outsider did not start");
  const Span flooded = observe(modules, seconds);
  row.busy = fmt::format("{:.0f} % ({:.0f} %)", 100 * flooded.busy, 100 * quiet.busy);
  for (const char* module : kModules)
    row.missed[module] = fmt::format("{} ({})", missed_in(flooded, module), missed_in(quiet, module));
  double reached = 0, cpu = 0;
  int is_read = 0;
  if (std::fgets(line.data(), line.size(), outsider) != nullptr &&
      std::sscanf(line.data(), "%lf %lf %d", &reached, &cpu, &is_read) == 3) {
    row.reached = fmt::format("{:.0f}{}", reached, is_read != 0 ? "" : ", not read");
    row.cpu = fmt::format("{:.0f} %", 100 * cpu);
  }
  pclose(outsider);
  row.is_alive = modules.all_report(5s);
  return row;
}

void print(const Row& row) {
  fmt::print("| `{}` | {} | {} | {} |", row.topic, row.reached, row.cpu, row.busy);
  for (const char* module : kModules) fmt::print(" {} |", row.missed.at(module));
  fmt::print(" {} |\n", row.is_alive ? "yes" : "**no**");
  std::fflush(stdout);
}

int run(const std::vector<std::string>& topics, double rate_hz, double seconds) {
  testing::use_own_domain();
  Modules modules;
  rig::Up up("config/rigs/demo.toml", {"--scene", SOFTHAND_SOURCE_DIR "/config/scenes/pinch.toml", "--set",
                                       "hand.model=right_400.hand.json", "--set", "viewer.port=0"});
  if (!modules.all_report(60s)) {
    fmt::print(stderr, "the rig did not start:\n{}", up.output());
    return 2;
  }
  modules.listen(2s);
  fmt::print("| flooded topic | samples a second | CPU of the outsider | machine busy |");
  for (const char* module : kModules) fmt::print(" {} misses |", module);
  fmt::print(" all went on |\n|{}\n", [] {
    std::string line;
    for (std::size_t i = 0; i < 5 + kModules.size(); ++i) line += " --- |";
    return line;
  }());
  bool is_alive = true;
  for (const std::string& topic : topics) {
    const Row row = measure(modules, topic, rate_hz, seconds);
    is_alive = is_alive && row.is_alive;
    print(row);
    if (!row.is_alive) break;  // the counters of another process are no measure
  }
  if (!is_alive) fmt::print(stderr, "{}", up.output());
  up.send_signal(SIGINT);
  up.wait(20s);
  return is_alive ? 0 : 1;
}

}  // namespace
}  // namespace softhand

int main(int argc, char** argv) {
  using namespace softhand;
  std::vector<std::string> names;
  bus::topics::for_each([&](const auto& topic) { names.emplace_back(topic.name.substr(kPrefix.size())); });
  std::vector<std::string> topics;
  std::string write;
  double rate_hz = 100'000, seconds = 5;
  CLI::App app("Floods the topics of a running rig, one after the other");
  app.add_option("--topic", topics, "Topic to flood; repeatable; default: all")->check(CLI::IsMember(names));
  app.add_option("--rate", rate_hz, "Samples a second")->check(CLI::Range(1.0, 1e7))->capture_default_str();
  app.add_option("--seconds", seconds, "Length of each flood")->check(CLI::Range(1.0, 600.0))->capture_default_str();
  app.add_option("--write", write, "Only flood this topic on this process's domain, without a rig")
      ->check(CLI::IsMember(names));
  CLI11_PARSE(app, argc, argv);
  if (write.empty()) return run(topics.empty() ? names : topics, rate_hz, seconds);
  bus::topics::for_each([&](const auto& topic) {
    if (topic.name.substr(kPrefix.size()) == write) write_flood(topic, rate_hz, seconds);
  });
  return 0;
}
