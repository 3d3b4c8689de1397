// Starts, monitors, restarts and stops the processes of a rig. It does not use DDS: the caller decides when a process
// is ready, and passes on its signs of life.
//
// Each child has a process group of its own and a guard: a small process that is its parent. The programs that a child
// starts end with it, also those that leave its group and session, because the kernel hands orphans to the guard. If
// the supervisor itself dies, the guard stops the child. It kills a device that was stopped (SIGSTOP), because a
// process that stands still leaves its last force on the user.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace softhand {

/// When a child is stopped.
enum class StopTurn {
  first,    ///< together with the other children of this turn, before all others: devices, which must go to zero
  in_turn,  ///< alone, the last started first
  last,     ///< together with the other children of this turn, after all others: displays
};

/// One child process with its output on a pipe.
struct ChildSpec {
  std::string name;
  std::vector<std::string> command;  ///< program and arguments
  StopTurn stop = StopTurn::in_turn;
  std::chrono::milliseconds longest_silence{0};  ///< between two calls of `heard`; 0 = the child may be silent
};

class Supervisor {
 public:
  using Clock = std::chrono::steady_clock;
  /// `log` receives each line that a child prints, without its newline.
  using LogLine = std::function<void(const std::string& name, const std::string& line)>;

  /// Sets SIGCHLD of the process to its default.
  explicit Supervisor(LogLine log);
  ~Supervisor();  ///< stops all running children
  Supervisor(const Supervisor&) = delete;
  Supervisor& operator=(const Supervisor&) = delete;

  /// Starts a child. Throws std::runtime_error if the program is not executable or the process cannot be created.
  void start(const ChildSpec& spec);
  /// A sign of life of the process `id`, if it belongs to the child `name`.
  void heard(const std::string& name, pid_t id);
  /// Forwards output (of each child at most 64 KiB a call), reaps dead children, and restarts them after a backoff. The
  /// first restart is immediate. The next backoff is 0.25 s and then doubles up to 8 s. It is reset for a child that
  /// ran for at least 10 s. A child that ends with kExitConfiguration is not restarted. A restart that fails is tried
  /// again after the next backoff. A child that is silent for too long is ended, and then restarted; its first sign of
  /// life may take 30 s. Waits at most `timeout` for an event.
  void poll(std::chrono::milliseconds timeout);
  /// Sends SIGTERM to the children, turn by turn. Sends SIGKILL to those that still run `grace` after their turn began.
  /// The next turn begins when all children of a turn have ended, or 2 s after SIGKILL. Returns true if no child had to
  /// be killed.
  bool stop(std::chrono::milliseconds grace = std::chrono::milliseconds(3000));

  std::uint64_t restarts(const std::string& name) const;
  pid_t process_id(const std::string& name) const;  ///< -1 while it is down
  /// True if the child ended with a configuration error. Without a name: true if any child did.
  bool gave_up(const std::string& name) const;
  bool gave_up() const;

 private:
  struct Child;
  const Child* find(const std::string& name) const;
  void launch(Child& child);
  void read_output(Child& child);
  void bury(Child& child);
  void reap();
  void end_silent_children();
  bool stop_together(const std::vector<Child*>& children, std::chrono::milliseconds grace);

  LogLine log_;
  std::vector<std::unique_ptr<Child>> children_;
  Clock::time_point last_poll_ = Clock::now();
  bool stopping_ = false;
};

}  // namespace softhand
