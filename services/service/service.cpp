#include "service/service.hpp"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstring>
#include <ctime>
#include <exception>
#include <filesystem>
#include <fstream>
#include <random>

#include "messages/convert.hpp"

namespace softhand {
namespace {

std::atomic<bool> stop_asked{false};
static_assert(std::atomic<bool>::is_always_lock_free);  // a signal handler may touch it

extern "C" void ask_to_stop(int) { stop_asked.store(true); }

constexpr std::size_t kWindow = 16384;  // step times kept for a second, up to 10 kHz

// Hosts are told apart by their boot: FNV-1a of the kernel's boot id.
std::uint32_t boot_clock_id() {
  std::ifstream in("/proc/sys/kernel/random/boot_id");
  std::string text;
  std::getline(in, text);
  std::uint32_t hash = 2166136261u;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 16777619u;
  return hash == 0 ? 1 : hash;
}

std::uint64_t random_epoch() {
  std::random_device device;
  return (static_cast<std::uint64_t>(device()) << 32 | device()) | 1;
}

ServiceArguments with_real_time(const ServiceArguments& arguments) {
  if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    std::fprintf(stderr, "%s: memory is not locked (%s): steps may wait for pages\n", arguments.module.c_str(), std::strerror(errno));
  }
  sched_param parameters{};
  parameters.sched_priority = 20;
  if (const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters); error != 0) {
    std::fprintf(stderr, "%s: real-time priority refused (%s): steps may be late\n", arguments.module.c_str(), std::strerror(error));
  }
  return arguments;
}

}  // namespace

Nanoseconds monotonic_now() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<Nanoseconds>(t.tv_sec) * 1'000'000'000 + t.tv_nsec;
}

ServiceArguments parse_arguments(int argc, char** argv, const std::string& module, const std::string& about,
                                 const std::function<void(CLI::App&)>& extend) {
  ServiceArguments arguments;
  arguments.module = module;
  std::string side = "right";
  CLI::App app(about);
  app.add_option("--config", arguments.config, "TOML file: a scene, or the service's own sections");
  app.add_option("--set", arguments.overrides, "Overrides, dotted.path=value");
  app.add_option("--user", arguments.hand.user, "Whose hand");
  app.add_option("--side", side, "left or right")->check(CLI::IsMember({"left", "right"}));
  app.add_option("--module", arguments.module, "Name of this module on the bus");
  app.add_option("--seconds", arguments.seconds, "Stop after this time; 0 = on a signal");
  if (extend) extend(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    std::exit(app.exit(error));
  }
  arguments.hand.side = side == "left" ? 0 : 1;
  return arguments;
}

std::vector<std::string_view> other_sections(const std::vector<std::string_view>& own) {
  std::vector<std::string_view> others;
  for (const std::string_view name :
       {"name", "hand", "tracking", "motion", "tracker", "world", "objects", "loop", "driver", "run", "outcome", "haptics", "tactile"}) {
    if (std::find(own.begin(), own.end(), name) == own.end()) others.push_back(name);
  }
  return others;
}

std::string find_hand_file(const std::string& name) {
  namespace fs = std::filesystem;
  if (fs::exists(name)) return name;
  const fs::path relative = fs::path("config/hands") / name;
  if (fs::exists(relative)) return relative.string();
  std::error_code error;
  for (fs::path up = fs::read_symlink("/proc/self/exe", error).parent_path(); up.has_relative_path(); up = up.parent_path()) {
    if (fs::exists(up / relative)) return (up / relative).string();
  }
  return name;  // loading it will say what is missing
}

Service::Service(const ServiceArguments& arguments)
    : arguments_(with_real_time(arguments)),
      participant_(arguments.module),
      messages_(participant_, bus::topics::message),
      replies_(participant_, bus::topics::message_reply),
      status_writer_(participant_, bus::topics::loop_status),
      epoch_(random_epoch()),
      clock_id_(boot_clock_id()) {
  stop_asked.store(false);
  struct sigaction action {};
  action.sa_handler = ask_to_stop;
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGINT, &action, nullptr);
}

void Service::stamp(Stamp& out) const {
  out.epoch = epoch_;
  out.clock_id = clock_id_;
  out.publish_time = monotonic_now();
}

void Service::run(double rate_hz, const Callbacks& callbacks) {
  const auto period = static_cast<Nanoseconds>(std::llround(1e9 / rate_hz));
  std::vector<float> window(kWindow), sorted(kWindow);
  std::size_t filled = 0;
  LoopStatus status;
  MessageReply reply;
  std::uint64_t steps = 0, misses = 0, status_sequence = 0, reply_sequence = 0;
  const Nanoseconds begin = monotonic_now();
  Nanoseconds due = begin, next_status = begin + 100'000'000, last_status = begin;
  std::uint64_t last_steps = 0;
  double rate = 0;
  while (!stop_asked.load()) {
    const Nanoseconds started = monotonic_now();
    if (arguments_.seconds > 0 && static_cast<double>(started - begin) * 1e-9 >= arguments_.seconds) break;
    callbacks.step(started);
    const Nanoseconds ended = monotonic_now();
    window[filled++ % kWindow] = static_cast<float>(ended - started) * 1e-6f;
    ++steps;

    messages_.take_all([&](const Message& message) {
      reply = callbacks.answer(message);
      reply.stamp.sequence = ++reply_sequence;
      reply.stamp.sample_time = ended;
      stamp(reply.stamp);
      replies_.write(reply);
    });
    if (ended >= next_status) {
      next_status = ended + 100'000'000;
      const double elapsed = static_cast<double>(ended - last_status) * 1e-9;
      if (elapsed >= 1 || rate == 0) {
        rate = static_cast<double>(steps - last_steps) / elapsed;
        last_steps = steps;
        last_status = ended;
      }
      if (status_writer_.has_readers()) {
        status = LoopStatus{};
        set_text(status.module, arguments_.module);
        status.process_id = static_cast<std::uint32_t>(getpid());
        status.nominal_rate_hz = rate_hz;
        status.rate_hz = rate;
        status.steps = steps;
        status.deadline_misses = misses;
        const std::size_t count = std::min({filled, kWindow, static_cast<std::size_t>(std::max(rate_hz, 1.0))});
        for (std::size_t i = 0; i < count; ++i) sorted[i] = window[(filled - 1 - i) % kWindow];
        const auto last = sorted.begin() + static_cast<std::ptrdiff_t>(count);
        std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(count / 2), last);
        status.step_ms_p50 = static_cast<double>(sorted[count / 2]);
        const std::size_t p99 = std::min(count - 1, count * 99 / 100);
        std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(p99), last);
        status.step_ms_p99 = static_cast<double>(sorted[p99]);
        callbacks.fill_status(status, ended);
        status.stamp.sequence = ++status_sequence;
        status.stamp.sample_time = ended;
        stamp(status.stamp);
        status_writer_.write(status);
      }
    }

    due += period;
    const Nanoseconds now = monotonic_now();
    if (now > due) {
      // Too late for the next start: it comes at once, and those missed since then do not come at all.
      const Nanoseconds skipped = (now - due) / period;
      misses += static_cast<std::uint64_t>(skipped) + 1;
      due += skipped * period;
      continue;
    }
    const timespec wake{due / 1'000'000'000, static_cast<long>(due % 1'000'000'000)};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &wake, nullptr);
  }
}

int guarded_main(const std::string& module, const std::function<void()>& body) {
  try {
    body();
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", module.c_str(), error.what());
    return 1;
  }
}

}  // namespace softhand
