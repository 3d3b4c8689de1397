#include "runtime/own_folder.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace softhand {

bool is_own_folder(const std::string& path) {
  struct stat found {};
  return lstat(path.c_str(), &found) == 0 && S_ISDIR(found.st_mode) && found.st_uid == getuid();
}

void make_own_folder(const std::string& path) {
  const bool is_made = mkdir(path.c_str(), 0700) == 0 || errno == EEXIST;
  const char* const reason = !is_made ? std::strerror(errno) : "not a folder of this user";
  if (!is_made || !is_own_folder(path) || chmod(path.c_str(), 0700) != 0)
    throw std::runtime_error(path + ": " + reason + "; expected a folder of this user alone");
}

}  // namespace softhand
