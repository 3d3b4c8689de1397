// A loop that hangs, in a process whose other threads go on.
#pragma once

#include <gtest/gtest.h>
#include <sys/ptrace.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace softhand::testing {

/// Holds the first thread of a child process, in which its loop runs, as a debugger does. The destructor lets it go on.
class HungLoop {
 public:
  explicit HungLoop(pid_t process) : process_(process) {
    EXPECT_EQ(ptrace(PTRACE_SEIZE, process, nullptr, nullptr), 0) << std::strerror(errno);
    EXPECT_EQ(ptrace(PTRACE_INTERRUPT, process, nullptr, nullptr), 0) << std::strerror(errno);
    int status = 0;
    EXPECT_EQ(waitpid(process, &status, __WALL), process);
    EXPECT_TRUE(WIFSTOPPED(status));
  }
  ~HungLoop() { EXPECT_EQ(ptrace(PTRACE_DETACH, process_, nullptr, nullptr), 0) << std::strerror(errno); }
  HungLoop(const HungLoop&) = delete;
  HungLoop& operator=(const HungLoop&) = delete;

 private:
  pid_t process_;
};

}  // namespace softhand::testing
