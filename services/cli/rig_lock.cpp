#include "cli/rig_lock.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <stdexcept>

#include "runtime/own_folder.hpp"

namespace softhand {
namespace {

// The variable may name a folder of another user (sudo) or none at all (containers).
std::string folder() {
  const char* runtime = std::getenv("XDG_RUNTIME_DIR");
  if (runtime != nullptr && is_own_folder(runtime)) return std::string(runtime) + "/softhand";
  return "/tmp/softhand-" + std::to_string(getuid());
}

[[noreturn]] void fail(const std::string& path, const char* reason) {
  throw std::runtime_error(path + ": " + reason + "; expected a file of this user for the lock of the rig");
}

}  // namespace

std::string to_text(const RigHolder& holder) {
  return fmt::format("rig {} (process {} on {})", holder.rig, holder.process_id, holder.host);
}

RigHolder this_process(const std::string& rig) {
  std::array<char, 256> host{};
  gethostname(host.data(), host.size() - 1);
  return {rig, host.data(), getpid()};
}

RigLock::RigLock(int domain) : path_(folder()) {
  make_own_folder(path_);
  path_ += "/rig-" + std::to_string(domain) + ".lock";
  file_ = open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (file_ < 0) fail(path_, std::strerror(errno));
}

// The file stays. If the holder removed it, a rig that has just opened it would lock a file that nobody else sees.
RigLock::~RigLock() { close(file_); }

std::optional<RigHolder> RigLock::take(const RigHolder& self) {
  if (is_held_) return std::nullopt;
  if (flock(file_, LOCK_EX | LOCK_NB) != 0) {
    std::array<char, 1024> text{};
    if (pread(file_, text.data(), text.size() - 1, 0) < 0) text[0] = '\0';
    RigHolder holder;
    std::istringstream in(text.data());
    in >> holder.process_id;
    in.ignore();
    std::getline(in, holder.host);
    std::getline(in, holder.rig);
    return holder;
  }
  is_held_ = true;
  const std::string text = fmt::format("{}\n{}\n{}\n", self.process_id, self.host, self.rig);
  if (ftruncate(file_, 0) != 0 || pwrite(file_, text.data(), text.size(), 0) != static_cast<ssize_t>(text.size()))
    fail(path_, std::strerror(errno));
  return std::nullopt;
}

}  // namespace softhand
