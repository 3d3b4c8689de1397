#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <stdexcept>

#include "cli/commands.hpp"

namespace softhand {

int run_sibling(const std::string& program, const std::vector<std::string>& arguments) {
  const std::string path = std::filesystem::read_symlink("/proc/self/exe").parent_path() / program;
  std::vector<const char*> argv{path.c_str()};
  for (const std::string& argument : arguments) argv.push_back(argument.c_str());
  argv.push_back(nullptr);
  execv(path.c_str(), const_cast<char**>(argv.data()));
  if (errno == ENOENT) throw std::runtime_error(path + " is missing; `deploy/build` builds it, `deploy/run` does not");
  throw std::runtime_error(path + ": " + std::strerror(errno));
}

}  // namespace softhand
