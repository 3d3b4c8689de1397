#include "bench/service_cost.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <thread>
#include <vector>

#include "bus/bus.hpp"
#include "support/own_domain.hpp"

namespace softhand::bench {
namespace {

// A service of this build as a child process. Its output is discarded. The process ends with this object.
class Child {
 public:
  explicit Child(const std::vector<std::string>& command) {
    std::vector<char*> argv;
    for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
    argv.push_back(nullptr);
    pid_ = fork();
    if (pid_ < 0) throw std::runtime_error(std::string("cannot start a process: ") + std::strerror(errno));
    if (pid_ == 0) {
      const int null = open("/dev/null", O_RDWR);
      dup2(null, STDOUT_FILENO);
      dup2(null, STDERR_FILENO);
      execv(argv[0], argv.data());
      _exit(127);
    }
  }
  ~Child() {
    kill(pid_, SIGTERM);
    waitpid(pid_, nullptr, 0);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  /// Resident memory, MB.
  double megabytes() const {
    std::ifstream status(fmt::format("/proc/{}/status", pid_));
    for (std::string word; status >> word;) {
      double kilobytes = 0;
      if (word == "VmRSS:" && status >> kilobytes) return kilobytes / 1024;
    }
    return std::nan("");
  }

 private:
  pid_t pid_ = 0;
};

}  // namespace

ServiceCost measure_service(const std::string& scene) {
  testing::use_own_domain();
  const std::string programs = std::filesystem::read_symlink("/proc/self/exe").parent_path().string();
  bus::Participant participant("bench");
  bus::Reader simulated(participant, bus::topics::simulated_skeleton, HandKey{0, 1});
  const Child tracker({programs + "/softhand-tracker-replay", "--config", scene, "--module", "tracker"});
  bus::Reader tracked(participant, bus::topics::tracked_skeleton, HandKey{0, 1});
  Skeleton skeleton;
  ServiceCost cost;
  if (!tracked.wait(std::chrono::seconds(10))) return cost;
  const auto started = std::chrono::steady_clock::now();
  const Child hand({programs + "/softhand-hand", "--config", scene, "--module", "hand", "--set", "hand.direct=true"});
  const auto seconds = [&started] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  };
  while (!simulated.take_latest(skeleton) && seconds() < 20) simulated.wait(std::chrono::milliseconds(100));
  if (seconds() < 20) cost.start_seconds = seconds();
  std::this_thread::sleep_for(std::chrono::seconds(2));
  cost.megabytes = hand.megabytes();
  return cost;
}

}  // namespace softhand::bench
