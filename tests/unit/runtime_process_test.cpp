// Clock, signals, hashing.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <string_view>

#include "runtime/clock.hpp"
#include "runtime/sha256.hpp"
#include "runtime/signals.hpp"

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

TEST(StopSignal, RequestsAStopWhenTheParentEnds) {
  // A middle process starts a child and then ends. The child has asked to be stopped with its parent. It reports
  // through the pipe how it was stopped.
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t middle = fork();
  if (middle == 0) {
    int ready[2];
    if (pipe(ready) != 0) _exit(1);
    if (fork() == 0) {
      const StopSignal stop;
      char result = stop_with_parent() ? 'y' : 'n';
      if (write(ready[1], &result, 1) != 1) _exit(1);
      for (int i = 0; i < 500 && !stop.requested(); ++i) usleep(10'000);
      result = stop.requested() ? 's' : 'o';
      if (write(ends[1], &result, 1) != 1) _exit(1);
      _exit(0);
    }
    char ignored = 0;
    _exit(read(ready[0], &ignored, 1) == 1 && ignored == 'y' ? 0 : 1);
  }
  int status = 0;
  waitpid(middle, &status, 0);
  EXPECT_EQ(WEXITSTATUS(status), 0);
  char result = 0;
  ASSERT_EQ(read(ends[0], &result, 1), 1);
  EXPECT_EQ(result, 's');
  close(ends[0]);
  close(ends[1]);
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
