// Clock, signals, locked memory, hashing.
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

#include "runtime/clock.hpp"
#include "runtime/scheduling.hpp"
#include "runtime/sha256.hpp"
#include "runtime/signals.hpp"

// Stands in for the kernel, which grants a process without privileges every limit but 0, as long as there is room.
static bool locked_memory = false;
extern "C" int mlockall(int) noexcept {
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  locked_memory = limit.rlim_cur > 0;
  errno = EPERM;
  return locked_memory ? 0 : -1;
}

namespace softhand::runtime_process_test {
namespace {

std::span<const std::byte> bytes(std::string_view text) { return std::as_bytes(std::span(text.data(), text.size())); }

TEST(Clock, IsMonotonicAndTheKernelsClock) {
  timespec before{};
  clock_gettime(CLOCK_MONOTONIC, &before);
  const Nanoseconds first = now();
  const Nanoseconds second = now();
  EXPECT_GE(first, before.tv_sec * 1'000'000'000 + before.tv_nsec);
  EXPECT_GE(second, first);
}

TEST(Clock, IdIsConstantOnAHostAndEpochsDiffer) {
  EXPECT_NE(clock_id(), 0u);
  EXPECT_EQ(clock_id(), clock_id());
  const std::uint64_t epoch = make_epoch();
  EXPECT_NE(epoch, 0u);
  EXPECT_NE(epoch, make_epoch());
}

TEST(StopSignal, RequestsAStopOnEverySignalAndForgetsOldOnes) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    const StopSignal stop;
    EXPECT_FALSE(stop.requested());
    std::raise(signal);
    EXPECT_TRUE(stop.requested());
    EXPECT_TRUE(stop.flag().load());
  }
}

TEST(StopSignal, RestoresFormerHandlers) {
  struct sigaction before {};
  sigaction(SIGTERM, nullptr, &before);
  { const StopSignal stop; }
  struct sigaction after {};
  sigaction(SIGTERM, nullptr, &after);
  EXPECT_EQ(before.sa_handler, after.sa_handler);
}

TEST(StopSignal, IgnoredHangUpStaysIgnored) {
  struct sigaction before {};
  struct sigaction ignored {};  // as nohup sets it
  ignored.sa_handler = SIG_IGN;
  sigaction(SIGHUP, &ignored, &before);
  {
    const StopSignal stop;
    std::raise(SIGHUP);
    EXPECT_FALSE(stop.requested());
  }
  sigaction(SIGHUP, &before, nullptr);
}

// `softhand up | tee log`: Ctrl-C ends tee first. The processes must survive their next line.
TEST(StopSignal, AMissingReaderDoesNotEndTheProcess) {
  struct sigaction before {};
  sigaction(SIGPIPE, nullptr, &before);
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  close(ends[0]);
  const pid_t child = fork();
  if (child == 0) {
    const StopSignal stop;
    _exit(write(ends[1], "x", 1) < 0 && errno == EPIPE ? 0 : 1);
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  close(ends[1]);
  { const StopSignal stop; }
  struct sigaction after {};
  sigaction(SIGPIPE, nullptr, &after);
  EXPECT_EQ(before.sa_handler, after.sa_handler);
}

// Under a finite limit the kernel locked future memory, too, and a later allocation failed.
TEST(LockMemory, AFiniteLimitIsAWarning) {
  const pid_t child = fork();
  if (child == 0) {
    rlimit limit{}, after{};
    getrlimit(RLIMIT_MEMLOCK, &limit);
    limit.rlim_cur = std::min<rlim_t>(limit.rlim_max, 1 << 20);
    setrlimit(RLIMIT_MEMLOCK, &limit);
    const std::vector<std::string> warnings = lock_memory();
    getrlimit(RLIMIT_MEMLOCK, &after);
    _exit((locked_memory ? 1 : 0) + (warnings.size() == 1 ? 0 : 2) + (after.rlim_cur == limit.rlim_cur ? 0 : 4));
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0) << "1: it is locked, 2: no warning, 4: the limit has changed";
}

TEST(Sha256, KnownAnswersOfFips180) {
  EXPECT_EQ(Sha256().hex(), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  Sha256 hasher;
  hasher.add(bytes("a"));
  EXPECT_EQ(hasher.hex(), "ca978112ca1bbdcafac231b39a23dc4da786eff8147c4e72b9807785afee48bb");
  hasher.add(bytes("bc"));  // hex() does not end the stream
  EXPECT_EQ(hasher.hex(), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  Sha256 million;
  for (int i = 0; i < 1000; ++i) million.add(bytes(std::string(1000, 'a')));
  EXPECT_EQ(million.hex(), "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

}  // namespace
}  // namespace softhand::runtime_process_test
