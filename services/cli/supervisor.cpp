#include "cli/supervisor.hpp"

#include <dirent.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <stdexcept>
#include <utility>

#include "runtime/exit_codes.hpp"

namespace softhand {
namespace {

using std::chrono::milliseconds;
constexpr milliseconds kFirstBackoff{250};
constexpr milliseconds kLongestBackoff{8000};
constexpr std::chrono::seconds kCleanSlate{10};
constexpr std::chrono::seconds kFirstSign{30};  // a process may compute for a while before its loop starts
constexpr milliseconds kMercy{500};             // from SIGTERM to SIGKILL for a silent child
constexpr milliseconds kLongestPoll{100};       // a longer pause is the caller's, and no silence of the children
constexpr unsigned kGuardGrace = 3;             // s, from the end of the supervisor to SIGKILL
constexpr int kMostRounds = 100;                // of 10 ms, in which a guard waits for the end of orphans
constexpr milliseconds kGuardEnd{1500};         // from kStopNow to the end of a guard, which ends orphans meanwhile
constexpr milliseconds kKilled{500};            // from SIGKILL to the end of a process
constexpr std::size_t kMostOutput = 65536;      // B, of one child before the others have their turn: a full pipe
constexpr std::size_t kLongestLine = 4096;      // B; a longer one is passed on in parts
constexpr int kStopNow = SIGUSR2;               // from the supervisor to a guard: SIGKILL for the child
constexpr int kSupervisorGone = SIGUSR1;        // from the kernel to a guard

std::string how_it_ended(int status) {
  if (WIFSIGNALED(status)) return "killed by signal " + std::to_string(WTERMSIG(status));
  return "exit code " + std::to_string(WEXITSTATUS(status));
}

milliseconds longer(milliseconds backoff) {
  return backoff.count() == 0 ? kFirstBackoff : std::min(2 * backoff, kLongestBackoff);
}

}  // namespace

struct Supervisor::Child {
  ChildSpec spec;
  pid_t pid = -1;
  pid_t guard = -1;  // and process group. It ends after the child, in the same way
  int output = -1;
  std::string partial_line;
  Clock::time_point started;
  Clock::time_point restart_at;
  milliseconds backoff{0};
  Clock::time_point silent_since;
  bool has_reported = false;
  bool is_ending = false;  // got SIGTERM because of its silence
  bool gave_up = false;
  std::uint64_t restarts = 0;

  Clock::time_point longest_wait() const {
    if (is_ending) return silent_since + kMercy;
    return silent_since +
           (has_reported ? spec.longest_silence : std::max<milliseconds>(kFirstSign, spec.longest_silence));
  }
};

namespace {

// Between fork and exec only functions that are safe in a signal handler may be called, because other threads may hold
// locks.

[[noreturn]] void become(char* const* command, pid_t guard, int output, const sigset_t& signals) {
  signal(SIGINT, SIG_DFL);
  signal(SIGTERM, SIG_DFL);
  // A device prints while it stops. It must not die of that before it has sent zero commands, when the supervisor is
  // gone.
  signal(SIGPIPE, SIG_IGN);
  pthread_sigmask(SIG_SETMASK, &signals, nullptr);
  // The child dies when its guard dies for any reason. It is in the process group of the guard, so that Ctrl-C reaches
  // only the supervisor, which stops the children in order.
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() != guard) _exit(1);
  dup2(output, STDOUT_FILENO);
  dup2(output, STDERR_FILENO);
  // Without this, the children would inherit sockets and lock files of DDS. If the supervisor dies, the children
  // would then keep its ports busy.
  close_range(STDERR_FILENO + 1, ~0U, 0);
  execv(command[0], command);
  constexpr char kWhy[] = "the program cannot be executed\n";
  [[maybe_unused]] const ssize_t ignored = write(STDERR_FILENO, kWhy, sizeof kWhy - 1);
  _exit(kExitConfiguration);
}

// Number of the parent of the process with this number; 0 if there is no such process.
pid_t parent_of(const char* process) {
  char path[64] = "/proc/";
  if (std::strlen(process) > 20) return 0;
  std::strcat(std::strcat(path, process), "/stat");
  const int file = open(path, O_RDONLY | O_CLOEXEC);
  if (file < 0) return 0;
  char text[512];
  const ssize_t size = read(file, text, sizeof text);
  close(file);
  // NUMBER (NAME) STATE PARENT. The name may contain parentheses.
  const char* at = size > 0 ? static_cast<const char*>(memrchr(text, ')', static_cast<std::size_t>(size))) : nullptr;
  if (at == nullptr) return 0;
  pid_t parent = 0;
  for (at += 4; at < text + size && *at >= '0' && *at <= '9'; ++at) parent = 10 * parent + (*at - '0');
  return parent;
}

void kill_own_children() {
  const pid_t self = getpid();
  const int folder = open("/proc", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder < 0) return;
  alignas(dirent64) char entries[4096];
  for (ssize_t size; (size = getdents64(folder, entries, sizeof entries)) > 0;) {
    for (ssize_t at = 0; at < size;) {
      const auto* entry = reinterpret_cast<const dirent64*>(entries + at);
      at += entry->d_reclen;
      if (entry->d_name[0] < '1' || entry->d_name[0] > '9' || parent_of(entry->d_name) != self) continue;
      pid_t process = 0;
      for (const char* digit = entry->d_name; *digit != '\0'; ++digit) process = 10 * process + (*digit - '0');
      kill(process, SIGKILL);
    }
  }
  close(folder);
}

// The child has ended. All its descendants have this process as their parent now, or get it when their own parent is
// killed. Those that cannot be killed, for example of another user, stay.
void end_orphans() {
  for (int round = 0; round < kMostRounds; ++round) {
    kill_own_children();
    pid_t ended;
    while ((ended = waitpid(-1, nullptr, WNOHANG)) > 0) continue;
    if (ended < 0) return;  // no child is left
    usleep(10000);
  }
}

// Ends in the same way as the child.
[[noreturn]] void end_like(int status) {
  if (WIFSIGNALED(status)) {
    const int signal_number = WTERMSIG(status);
    prctl(PR_SET_DUMPABLE, 0);  // the child has left its core already
    signal(signal_number, SIG_DFL);
    sigset_t one;
    sigemptyset(&one);
    sigaddset(&one, signal_number);
    sigprocmask(SIG_UNBLOCK, &one, nullptr);
    kill(getpid(), signal_number);
  }
  _exit(WEXITSTATUS(status));
}

// The process of a guard. All signals are blocked. It passes on the signals of the supervisor, because it alone knows
// for sure whether the child still exists. Its number is also that of the group.
[[noreturn]] void guard(char* const* command, pid_t supervisor, int output, int report, const sigset_t& signals,
                        bool may_stop) {
  setpgid(0, 0);
  signal(SIGCHLD, SIG_DFL);
  prctl(PR_SET_NAME, "softhand-guard");
  prctl(PR_SET_CHILD_SUBREAPER, 1);
  prctl(PR_SET_PDEATHSIG, kSupervisorGone);
  if (getppid() != supervisor) _exit(1);
  const pid_t self = getpid();
  const pid_t child = _Fork();
  if (child == 0) become(command, self, output, signals);
  if (child < 0 || write(report, &child, sizeof child) != sizeof child) _exit(1);
  close_range(0, ~0U, 0);
  sigset_t all;
  sigfillset(&all);
  for (;;) {
    switch (sigwaitinfo(&all, nullptr)) {
      case SIGTERM:
        kill(child, SIGTERM);
        break;
      case kSupervisorGone:
        kill(child, SIGTERM);
        alarm(kGuardGrace);
        break;
      case SIGALRM:
      case kStopNow:
        kill(child, SIGKILL);
        break;
      case SIGCHLD: {
        int status = 0;
        for (pid_t changed; (changed = waitpid(-1, &status, WNOHANG | WUNTRACED)) > 0;) {
          if (changed != child) continue;
          if (WIFSTOPPED(status)) {
            if (!may_stop) kill(child, SIGKILL);
            continue;
          }
          end_orphans();
          end_like(status);
        }
        break;
      }
      default:
        break;
    }
  }
}

// Waits for the end of a child of this process, and reaps it.
bool ends_within(pid_t process, milliseconds longest) {
  const auto deadline = Supervisor::Clock::now() + longest;
  for (;;) {
    if (waitpid(process, nullptr, WNOHANG) != 0) return true;
    if (Supervisor::Clock::now() >= deadline) return false;
    usleep(5000);
  }
}

}  // namespace

// A program that ignores SIGCHLD passes this on. The kernel would then hide how children end.
Supervisor::Supervisor(LogLine log) : log_(std::move(log)) { signal(SIGCHLD, SIG_DFL); }

Supervisor::~Supervisor() { stop(); }

void Supervisor::start(const ChildSpec& spec) {
  if (access(spec.command.at(0).c_str(), X_OK) != 0) {
    throw std::runtime_error(spec.name + ": cannot run " + spec.command[0] + ": " + std::strerror(errno));
  }
  children_.push_back(std::make_unique<Child>());
  children_.back()->spec = spec;
  launch(*children_.back());
}

void Supervisor::launch(Child& child) {
  int ends[2], report[2];
  if (pipe2(ends, O_CLOEXEC) != 0)
    throw std::runtime_error(child.spec.name + ": cannot create a pipe: " + std::strerror(errno));
  if (pipe2(report, O_CLOEXEC) != 0) {
    const int error = errno;
    close(ends[0]), close(ends[1]);
    throw std::runtime_error(child.spec.name + ": cannot create a pipe: " + std::strerror(error));
  }
  std::vector<char*> arguments;
  for (const std::string& word : child.spec.command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const pid_t supervisor = getpid();
  // Between fork and exec a process still has our signal handlers, so a SIGINT or SIGTERM in that window would be lost.
  // All signals stay blocked until the child has the default handlers. The guard keeps them blocked. Here they stay
  // blocked until the guard has reported, because a signal would interrupt the read.
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  const pid_t own_guard = fork();
  if (own_guard == 0)
    guard(arguments.data(), supervisor, ends[1], report[1], before, child.spec.stop != StopTurn::first);
  const int error = errno;
  close(ends[1]), close(report[1]);
  pid_t pid = -1;
  const bool started = own_guard > 0 && read(report[0], &pid, sizeof pid) == sizeof pid;
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  close(report[0]);
  if (!started) {
    close(ends[0]);
    if (own_guard > 0) kill(own_guard, SIGKILL);
    while (own_guard > 0 && waitpid(own_guard, nullptr, 0) < 0 && errno == EINTR) continue;
    throw std::runtime_error(child.spec.name + ": cannot fork: " + std::strerror(own_guard < 0 ? error : EAGAIN));
  }
  fcntl(ends[0], F_SETFL, O_NONBLOCK);
  child.pid = pid;
  child.guard = own_guard;
  child.output = ends[0];
  child.started = child.silent_since = Clock::now();
  child.has_reported = child.is_ending = false;
}

void Supervisor::read_output(Child& child) {
  char buffer[4096];
  for (std::size_t total = 0; total < kMostOutput;) {
    const ssize_t count = read(child.output, buffer, sizeof buffer);
    if (count <= 0) {
      if (count == 0) {
        close(child.output);
        child.output = -1;
      }
      return;
    }
    total += static_cast<std::size_t>(count);
    child.partial_line.append(buffer, static_cast<std::size_t>(count));
    for (std::size_t end; (end = child.partial_line.find('\n')) != std::string::npos;) {
      log_(child.spec.name, child.partial_line.substr(0, end));
      child.partial_line.erase(0, end + 1);
    }
    if (child.partial_line.size() > kLongestLine) log_(child.spec.name, std::exchange(child.partial_line, {}));
  }
}

// The child has ended, and what it left behind.
void Supervisor::bury(Child& child) {
  child.pid = child.guard = -1;
  if (child.output >= 0) read_output(child);
  if (child.output >= 0) close(child.output);
  child.output = -1;
  if (!child.partial_line.empty()) log_(child.spec.name, std::exchange(child.partial_line, {}));
}

void Supervisor::reap() {
  const auto now = Clock::now();
  for (auto& child : children_) {
    if (child->pid < 0) continue;
    int status = 0;
    if (waitpid(child->guard, &status, WNOHANG | WUNTRACED) != child->guard) continue;
    if (WIFSTOPPED(status)) {  // for example its whole group. It must see that a device has stopped
      kill(child->guard, SIGCONT);
      continue;
    }
    bury(*child);
    if (stopping_) {
      if (status != 0) log_(child->spec.name, "stopped, " + how_it_ended(status));
      continue;
    }
    if (WIFEXITED(status) && WEXITSTATUS(status) == kExitConfiguration) {
      child->gave_up = true;
      log_(child->spec.name, "its configuration is wrong (" + how_it_ended(status) + "); not restarted");
      continue;
    }
    child->backoff = now - child->started >= kCleanSlate ? milliseconds(0)
                     : child->restarts == 0              ? milliseconds(0)
                                                         : longer(child->backoff);
    log_(child->spec.name, how_it_ended(status) + "; restarts in " + std::to_string(child->backoff.count()) + " ms");
    child->restart_at = Clock::now() + child->backoff;  // after the line: a restart never comes earlier than it says
  }
}

void Supervisor::heard(const std::string& name, pid_t id) {
  for (auto& child : children_) {
    // The program may be a script that runs the process with this id.
    if (child->spec.name != name || child->pid < 0 || getpgid(id) != child->guard || child->is_ending) continue;
    child->silent_since = Clock::now();
    child->has_reported = true;
  }
}

void Supervisor::end_silent_children() {
  const auto now = Clock::now();
  // The caller was late, for example because it was stopped. It could not pass on what it did not receive.
  const auto pause = std::exchange(last_poll_, now);
  const auto late = now - pause > kLongestPoll ? now - pause : Clock::duration(0);
  for (auto& child : children_) {
    if (child->pid < 0 || stopping_ || child->spec.longest_silence.count() == 0) continue;
    child->silent_since += late;
    if (now < child->longest_wait()) continue;
    if (!child->is_ending) {
      const auto silence = std::chrono::duration<double>(now - child->silent_since).count();
      char text[64];
      std::snprintf(text, sizeof text, "no status for %.1f s; ending it", silence);
      log_(child->spec.name, text);
    }
    kill(child->guard, child->is_ending ? kStopNow : SIGTERM);
    child->silent_since = now;
    child->is_ending = true;
  }
}

void Supervisor::poll(std::chrono::milliseconds timeout) {
  std::vector<pollfd> waits;
  std::vector<Child*> owners;
  auto wake = Clock::now() + timeout;
  for (auto& child : children_) {
    if (child->output >= 0) {
      waits.push_back({child->output, POLLIN, 0});
      owners.push_back(child.get());
    } else if (child->pid < 0 && !stopping_ && !child->gave_up) {
      wake = std::min(wake, child->restart_at);
    }
  }
  const auto remaining = std::chrono::duration_cast<milliseconds>(wake - Clock::now()).count();
  ::poll(waits.data(), waits.size(), static_cast<int>(std::max<std::int64_t>(remaining, 0)));
  for (std::size_t i = 0; i < waits.size(); ++i) {
    if (waits[i].revents != 0) read_output(*owners[i]);
  }
  reap();
  end_silent_children();
  for (auto& child : children_) {
    if (child->pid >= 0 || stopping_ || child->gave_up || Clock::now() < child->restart_at) continue;
    try {
      launch(*child);
      ++child->restarts;
    } catch (const std::exception& error) {  // the machine may have free files and processes again later
      child->backoff = longer(child->backoff);
      log_(child->spec.name,
           std::string(error.what()) + "; restarts in " + std::to_string(child->backoff.count()) + " ms");
      child->restart_at = Clock::now() + child->backoff;
    }
  }
}

bool Supervisor::stop(std::chrono::milliseconds grace) {
  stopping_ = true;
  std::vector<std::vector<Child*>> turns(1);
  std::vector<Child*> last;
  for (auto child = children_.rbegin(); child != children_.rend(); ++child) {
    switch ((*child)->spec.stop) {
      case StopTurn::first:
        turns[0].push_back(child->get());
        break;
      case StopTurn::in_turn:
        turns.push_back({child->get()});
        break;
      case StopTurn::last:
        last.push_back(child->get());
        break;
    }
  }
  turns.push_back(last);
  bool clean = true;
  for (const std::vector<Child*>& turn : turns) clean = stop_together(turn, grace) && clean;
  return clean;
}

bool Supervisor::stop_together(const std::vector<Child*>& children, std::chrono::milliseconds grace) {
  const auto runs = [](const Child* child) { return child->pid > 0; };
  for (Child* child : children) {
    if (runs(child)) kill(child->guard, SIGTERM);
  }
  const auto deadline = Clock::now() + grace;
  while (std::any_of(children.begin(), children.end(), runs) && Clock::now() < deadline) poll(milliseconds(20));
  bool clean = true;
  for (Child* child : children) {
    if (!runs(child)) continue;
    clean = false;
    log_(child->spec.name, "did not stop in time; killing it");
    kill(-child->guard, SIGCONT);  // a stopped guard would do nothing
    kill(child->guard, kStopNow);
    if (!ends_within(child->guard, kGuardEnd)) {
      // The child may have left the group. While the guard is its parent, its number is not used again.
      if (parent_of(std::to_string(child->pid).c_str()) == child->guard) kill(child->pid, SIGKILL);
      kill(-child->guard, SIGKILL);
      if (!ends_within(child->guard, kKilled)) log_(child->spec.name, "cannot be killed");
    }
    bury(*child);
  }
  return clean;
}

const Supervisor::Child* Supervisor::find(const std::string& name) const {
  const auto child =
      std::find_if(children_.begin(), children_.end(), [&name](const auto& each) { return each->spec.name == name; });
  return child == children_.end() ? nullptr : child->get();
}

std::uint64_t Supervisor::restarts(const std::string& name) const {
  const Child* child = find(name);
  return child == nullptr ? 0 : child->restarts;
}

pid_t Supervisor::process_id(const std::string& name) const {
  const Child* child = find(name);
  return child == nullptr ? -1 : child->pid;
}

bool Supervisor::gave_up(const std::string& name) const {
  const Child* child = find(name);
  return child != nullptr && child->gave_up;
}

bool Supervisor::gave_up() const {
  return std::any_of(children_.begin(), children_.end(), [](const auto& child) { return child->gave_up; });
}

}  // namespace softhand
