// Starts, watches, restarts and stops the processes of a rig. Knows nothing of DDS: the caller says when a process is
// ready.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace softhand {

/// One child process with its output on a pipe.
struct ChildSpec {
  std::string name;
  std::vector<std::string> command;  ///< program and arguments
};

class Supervisor {
 public:
  using Clock = std::chrono::steady_clock;
  /// `log` receives each line that a child prints, without its newline.
  using LogLine = std::function<void(const std::string& name, const std::string& line)>;

  explicit Supervisor(LogLine log);
  ~Supervisor();  ///< stops what still runs
  Supervisor(const Supervisor&) = delete;
  Supervisor& operator=(const Supervisor&) = delete;

  /// Starts a child. Throws std::runtime_error where the program cannot be started at all.
  void start(const ChildSpec& spec);
  /// Forwards output, reaps the dead, restarts after a backoff: at once for the first death, then 0.25 s doubling to 8
  /// s; a child that lived 10 s has a clean slate. Waits at most `timeout` for something to happen.
  void poll(std::chrono::milliseconds timeout);
  /// SIGTERM to all, last started first; SIGKILL to those that live on after `grace`. Returns true when nobody had to
  /// be killed.
  bool stop(std::chrono::milliseconds grace = std::chrono::milliseconds(3000));

  std::uint64_t restarts(const std::string& name) const;
  pid_t process_id(const std::string& name) const;  ///< -1 while it is down

 private:
  struct Child;
  void launch(Child& child);
  void read_output(Child& child);
  void reap();

  LogLine log_;
  std::vector<std::unique_ptr<Child>> children_;
  bool stopping_ = false;
};

}  // namespace softhand
