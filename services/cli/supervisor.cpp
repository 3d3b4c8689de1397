#include "cli/supervisor.hpp"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace softhand {
namespace {

using std::chrono::milliseconds;
constexpr milliseconds kFirstBackoff{250};
constexpr milliseconds kLongestBackoff{8000};
constexpr std::chrono::seconds kCleanSlate{10};

std::string how_it_ended(int status) {
  if (WIFSIGNALED(status)) return "killed by signal " + std::to_string(WTERMSIG(status));
  return "exit code " + std::to_string(WEXITSTATUS(status));
}

}  // namespace

struct Supervisor::Child {
  ChildSpec spec;
  pid_t pid = -1;
  int output = -1;
  std::string partial_line;
  Clock::time_point started;
  Clock::time_point restart_at;
  milliseconds backoff{0};
  std::uint64_t restarts = 0;
};

Supervisor::Supervisor(LogLine log) : log_(std::move(log)) {}

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
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0)
    throw std::runtime_error(child.spec.name + ": cannot create a pipe: " + std::strerror(errno));
  std::vector<char*> arguments;
  for (const std::string& word : child.spec.command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const pid_t parent = getpid();
  // Between fork and exec the child still runs our signal handlers, so a SIGINT or SIGTERM in that window would be
  // lost. Both signals stay blocked until the child has the default handlers.
  sigset_t stops, before;
  sigemptyset(&stops);
  sigaddset(&stops, SIGINT);
  sigaddset(&stops, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &stops, &before);
  const pid_t pid = fork();
  if (pid != 0) pthread_sigmask(SIG_SETMASK, &before, nullptr);
  if (pid < 0) throw std::runtime_error(child.spec.name + ": cannot fork: " + std::strerror(errno));
  if (pid == 0) {
    signal(SIGINT, SIG_DFL);
    signal(SIGTERM, SIG_DFL);
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
    // The child dies when its supervisor dies for any reason. The child gets its own process group, so that Ctrl-C
    // reaches only the supervisor, which stops the children in order.
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent) _exit(1);
    setpgid(0, 0);
    dup2(ends[1], STDOUT_FILENO);
    dup2(ends[1], STDERR_FILENO);
    // Without this, the children would inherit sockets and lock files of DDS. If the supervisor dies, the children
    // would then keep its ports busy.
    close_range(STDERR_FILENO + 1, ~0U, 0);
    execv(arguments[0], arguments.data());
    _exit(127);
  }
  close(ends[1]);
  fcntl(ends[0], F_SETFL, O_NONBLOCK);
  child.pid = pid;
  child.output = ends[0];
  child.started = Clock::now();
}

void Supervisor::read_output(Child& child) {
  char buffer[4096];
  for (;;) {
    const ssize_t count = read(child.output, buffer, sizeof buffer);
    if (count <= 0) {
      if (count == 0) {
        close(child.output);
        child.output = -1;
      }
      return;
    }
    child.partial_line.append(buffer, static_cast<std::size_t>(count));
    for (std::size_t end; (end = child.partial_line.find('\n')) != std::string::npos;) {
      log_(child.spec.name, child.partial_line.substr(0, end));
      child.partial_line.erase(0, end + 1);
    }
  }
}

void Supervisor::reap() {
  const auto now = Clock::now();
  for (auto& child : children_) {
    if (child->pid < 0) continue;
    int status = 0;
    if (waitpid(child->pid, &status, WNOHANG) != child->pid) continue;
    if (child->output >= 0) read_output(*child);
    if (child->output >= 0) close(child->output);
    child->output = -1;
    if (!child->partial_line.empty()) log_(child->spec.name, std::exchange(child->partial_line, {}));
    child->pid = -1;
    if (stopping_) {
      if (status != 0) log_(child->spec.name, "stopped, " + how_it_ended(status));
      continue;
    }
    child->backoff = now - child->started >= kCleanSlate ? milliseconds(0)
                     : child->restarts == 0              ? milliseconds(0)
                     : child->backoff.count() == 0       ? kFirstBackoff
                                                         : std::min(2 * child->backoff, kLongestBackoff);
    child->restart_at = now + child->backoff;
    log_(child->spec.name, how_it_ended(status) + "; restarts in " + std::to_string(child->backoff.count()) + " ms");
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
    } else if (child->pid < 0 && !stopping_) {
      wake = std::min(wake, child->restart_at);
    }
  }
  const auto remaining = std::chrono::duration_cast<milliseconds>(wake - Clock::now()).count();
  ::poll(waits.data(), waits.size(), static_cast<int>(std::max<std::int64_t>(remaining, 0)));
  for (std::size_t i = 0; i < waits.size(); ++i) {
    if (waits[i].revents != 0) read_output(*owners[i]);
  }
  reap();
  for (auto& child : children_) {
    if (child->pid < 0 && !stopping_ && Clock::now() >= child->restart_at) {
      ++child->restarts;
      launch(*child);
    }
  }
}

bool Supervisor::stop(std::chrono::milliseconds grace) {
  stopping_ = true;
  bool clean = true;
  for (auto child = children_.rbegin(); child != children_.rend(); ++child) {
    if ((*child)->pid > 0) kill((*child)->pid, SIGTERM);
  }
  const auto deadline = Clock::now() + grace;
  const auto anyone = [this] {
    return std::any_of(children_.begin(), children_.end(), [](const auto& child) { return child->pid > 0; });
  };
  while (anyone() && Clock::now() < deadline) poll(milliseconds(20));
  for (auto& child : children_) {
    if (child->pid <= 0) continue;
    clean = false;
    log_(child->spec.name, "did not stop in time; killing it");
    kill(child->pid, SIGKILL);
    waitpid(child->pid, nullptr, 0);
    child->pid = -1;
  }
  return clean;
}

std::uint64_t Supervisor::restarts(const std::string& name) const {
  for (const auto& child : children_) {
    if (child->spec.name == name) return child->restarts;
  }
  return 0;
}

pid_t Supervisor::process_id(const std::string& name) const {
  for (const auto& child : children_) {
    if (child->spec.name == name) return child->pid;
  }
  return -1;
}

}  // namespace softhand
