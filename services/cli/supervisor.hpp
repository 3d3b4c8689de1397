// Starts, monitors, restarts and stops the processes of a rig. It does not use DDS: the caller decides when a process
// is ready.
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
  ~Supervisor();  ///< stops all running children
  Supervisor(const Supervisor&) = delete;
  Supervisor& operator=(const Supervisor&) = delete;

  /// Starts a child. Throws std::runtime_error if the program is not executable or the process cannot be created.
  void start(const ChildSpec& spec);
  /// Forwards output, reaps dead children, and restarts them after a backoff. The first restart is immediate. The next
  /// backoff is 0.25 s and then doubles up to 8 s. It is reset for a child that ran for at least 10 s. Waits at most
  /// `timeout` for an event.
  void poll(std::chrono::milliseconds timeout);
  /// Sends SIGTERM to all children, the last started first. Sends SIGKILL to those that still run after `grace`.
  /// Returns true if no child had to be killed.
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
