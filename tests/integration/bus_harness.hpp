// What the tests of the bus share. Each test has its own process and its own domain, so that tests may run in parallel.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "bus/bus.hpp"
#include "integration/bus_fill.hpp"
#include "runtime/clock.hpp"
#include "support/eventually.hpp"
#include "support/own_domain.hpp"

namespace softhand::bus {

using namespace std::chrono_literals;
using testing::eventually;
using Clock = std::chrono::steady_clock;

/// A child process that dies with its handle.
class Child {
 public:
  explicit Child(std::vector<std::string> arguments) {
    std::vector<char*> argv;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    int in[2];
    int out[2];
    if (pipe2(in, O_CLOEXEC) != 0 || pipe2(out, O_CLOEXEC) != 0) throw std::runtime_error("pipe");
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, in[0], 0);
    posix_spawn_file_actions_adddup2(&actions, out[1], 1);
    if (posix_spawn(&pid_, argv[0], &actions, nullptr, argv.data(), environ) != 0)
      throw std::runtime_error("cannot start " + arguments[0]);
    posix_spawn_file_actions_destroy(&actions);
    close(in[0]);
    close(out[1]);
    input_ = in[1];
    output_ = out[0];
  }
  ~Child() {
    kill_now();
    close_input();
    close(output_);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  void kill_now() {
    if (pid_ <= 0) return;
    ::kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
    pid_ = 0;
  }
  void close_input() {
    if (input_ >= 0) close(input_);
    input_ = -1;
  }
  /// Closes the child's input and waits for its end. Returns all that it printed, one "name value" per line.
  std::map<std::string, std::string> finish(int& exit_code) {
    close_input();
    std::string text;
    char buffer[4096];
    for (ssize_t n = 0; (n = read(output_, buffer, sizeof buffer)) > 0;)
      text.append(buffer, static_cast<std::size_t>(n));
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = 0;
    exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    std::map<std::string, std::string> lines;
    std::istringstream stream(text);
    for (std::string name, value; stream >> name >> value;) lines[name] = value;
    return lines;
  }

 private:
  pid_t pid_ = 0;
  int input_ = -1;
  int output_ = -1;
};

/// With a stamp that a reader accepts.
template <typename T>
std::unique_ptr<T> stamped(std::uint64_t seed, bool to_capacity = false) {
  static const Nanoseconds time = now();
  auto message = filled<T>(seed, to_capacity);
  message->stamp.epoch = 1;
  message->stamp.clock_id = clock_id();
  message->stamp.sample_time = message->stamp.publish_time = time;
  return message;
}

/// A writer and a reader of a topic that have found each other, in two participants.
template <typename T>
struct ConnectedPair {
  explicit ConnectedPair(const Topic<T>& topic) : writer(here, topic), reader(there, topic) {
    EXPECT_TRUE(eventually([this] { return writer.has_readers() && reader.writer_count() == 1; }));
  }
  const Participant here{"here", testing::own_domain()}, there{"there", testing::own_domain()};
  Writer<T> writer;
  Reader<T> reader;
};

/// A device's last command is zero. It must arrive although its writer leaves at once.
template <typename T>
void expect_last_samples_arrive(const Topic<T>& topic) {
  const Participant there("there", testing::own_domain());
  Reader<T> reader(there, topic);
  constexpr std::uint64_t kBurst = 200;  // the reader has a backlog when the writer goes
  for (std::uint64_t round = 1; round <= 10; ++round) {
    {
      const Participant here("here", testing::own_domain());
      Writer<T> writer(here, topic);
      ASSERT_TRUE(eventually([&] { return writer.has_readers() && reader.writer_count() == 1; }));
      T sample;
      for (sample.stamp.sequence = 1; sample.stamp.sequence <= kBurst; ++sample.stamp.sequence) writer.write(sample);
    }
    T last;
    EXPECT_TRUE(eventually([&] {
      reader.take_latest(last);
      return last.stamp.sequence == kBurst;
    })) << "round "
        << round;
    ASSERT_TRUE(eventually([&] { return reader.writer_count() == 0; }));
  }
}

/// The lines of `text` that contain `part`.
inline int lines_with(const std::string& text, const std::string& part) {
  std::istringstream in(text);
  int count = 0;
  for (std::string line; std::getline(in, line);) count += line.find(part) != std::string::npos ? 1 : 0;
  return count;
}

/// Anybody on the domain can invent users and module names.
inline HandKey user(int number) { return {static_cast<std::uint32_t>(number), 1}; }

}  // namespace softhand::bus
