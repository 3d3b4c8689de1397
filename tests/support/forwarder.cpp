// forwarder NAMESPACE...: the switch between network namespaces, each of which gets the TAP device eth0. Commands on
// stdin, one per line: `drop P` (share of frames), `delay S` (each frame waits a random time up to this), `cut N` and
// `join N` (the cable of the N-th namespace, from 1). It prints `ready`, and `done` after each command. It ends with
// its input. Each frame draws its own delay, and none overtakes another.
#include <fcntl.h>
#include <linux/if_tun.h>
#include <net/if.h>
#include <poll.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <queue>
#include <random>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;
using Address = std::array<unsigned char, 6>;

constexpr std::chrono::milliseconds kChange{20};  // a direction keeps its delay for this time

struct Direction {
  Clock::time_point next_change{};
  Clock::time_point last_due{};
  double delay = 0;  // s
};

struct Frame {
  Clock::time_point due;
  std::size_t to;
  std::vector<unsigned char> bytes;
  std::uint64_t number;
  bool operator<(const Frame& other) const {  // the earliest comes first
    return due != other.due ? due > other.due : number > other.number;
  }
};

[[noreturn]] void fail(const std::string& what) {
  std::perror(("forwarder: " + what).c_str());
  std::exit(1);
}

// The device belongs to the namespace in which the file is opened. The file can be read from everywhere.
int open_tap(const std::string& name) {
  const int own = open("/proc/self/ns/net", O_RDONLY | O_CLOEXEC);
  const int other = open(("/run/netns/" + name).c_str(), O_RDONLY | O_CLOEXEC);
  if (own < 0 || other < 0 || setns(other, CLONE_NEWNET) != 0) fail("namespace " + name);
  const int tap = open("/dev/net/tun", O_RDWR | O_NONBLOCK | O_CLOEXEC);
  ifreq request{};
  std::strcpy(request.ifr_name, "eth0");
  request.ifr_flags = IFF_TAP | IFF_NO_PI;
  if (tap < 0 || ioctl(tap, TUNSETIFF, &request) != 0) fail("TAP device in " + name);
  if (setns(own, CLONE_NEWNET) != 0) fail("own namespace");
  close(own);
  close(other);
  return tap;
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<int> taps;
  for (int i = 1; i < argc; ++i) taps.push_back(open_tap(argv[i]));
  std::vector<bool> cut(taps.size(), false);
  std::vector<pollfd> inputs{{STDIN_FILENO, POLLIN, 0}};
  for (const int tap : taps) inputs.push_back({tap, POLLIN, 0});
  std::map<Address, std::size_t> places;
  std::map<std::pair<std::size_t, std::size_t>, Direction> directions;
  std::priority_queue<Frame> waiting;
  std::uint64_t number = 0;
  std::mt19937 random(1);
  double drop = 0, delay = 0;
  const auto chance = [&] { return std::uniform_real_distribution<double>(0, 1)(random); };
  const auto forward = [&](std::size_t from, std::size_t to, const std::vector<unsigned char>& bytes) {
    if (cut[from] || cut[to] || chance() < drop) return;
    Direction& direction = directions[{from, to}];
    const Clock::time_point now = Clock::now();
    if (now >= direction.next_change) {
      direction.delay = delay * chance();
      direction.next_change = now + kChange;
    }
    const std::chrono::duration<double> wait(direction.delay);
    direction.last_due = std::max(direction.last_due, now + std::chrono::duration_cast<Clock::duration>(wait));
    waiting.push({direction.last_due, to, bytes, ++number});
  };
  std::puts("ready");
  std::fflush(stdout);
  std::vector<unsigned char> bytes;
  for (std::string typed;;) {
    timespec timeout{1, 0};
    if (!waiting.empty()) {
      const auto left = std::max<std::int64_t>(0, (waiting.top().due - Clock::now()).count());
      timeout = {left / 1'000'000'000, left % 1'000'000'000};
    }
    ppoll(inputs.data(), inputs.size(), &timeout, nullptr);
    for (std::size_t from = 0; from < taps.size(); ++from) {
      for (;;) {
        bytes.resize(2048);
        const ssize_t size = read(taps[from], bytes.data(), bytes.size());
        if (size < 14) break;
        bytes.resize(static_cast<std::size_t>(size));
        Address to, sender;
        std::memcpy(to.data(), bytes.data(), to.size());
        std::memcpy(sender.data(), bytes.data() + 6, sender.size());
        places[sender] = from;
        const auto place = places.find(to);
        for (std::size_t port = 0; port < taps.size(); ++port) {
          if (port != from && (place == places.end() || place->second == port)) forward(from, port, bytes);
        }
      }
    }
    for (; !waiting.empty() && waiting.top().due <= Clock::now(); waiting.pop()) {
      const Frame& frame = waiting.top();
      // A full device loses the frame, as a switch does.
      if (!cut[frame.to] && write(taps[frame.to], frame.bytes.data(), frame.bytes.size()) < 0) continue;
    }
    if (inputs[0].revents == 0) continue;
    char text[256];
    const ssize_t size = read(STDIN_FILENO, text, sizeof text);
    if (size <= 0) return 0;
    typed.append(text, static_cast<std::size_t>(size));
    for (std::size_t end; (end = typed.find('\n')) != std::string::npos; typed.erase(0, end + 1)) {
      std::istringstream line(typed.substr(0, end));
      std::string command;
      double value = 0;
      line >> command >> value;
      const auto port = static_cast<std::size_t>(value) - 1;
      if (command == "drop") drop = value;
      if (command == "delay") delay = value;
      if ((command == "cut" || command == "join") && port < cut.size()) cut[port] = command == "cut";
      std::puts("done");
      std::fflush(stdout);
    }
  }
}
