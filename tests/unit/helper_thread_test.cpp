// Work in two halves: each half is done once, by either thread, however long the helper has slept.
#include "math/helper_thread.hpp"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <set>
#include <thread>

#include "support/cores.hpp"
#include "support/count_allocations.hpp"

namespace softhand::helper_thread_test {
namespace {

TEST(HelperThread, BothHalvesAreDoneOnceAndSeenByTheCaller) {
  HelperThread helper;
  int first = 0, second = 0;
  for (int run = 0; run < 20000; ++run) {
    helper.run([&] { ++first; }, [&] { ++second; });
    ASSERT_EQ(first, run + 1);
    ASSERT_EQ(second, run + 1);
  }
}

TEST(HelperThread, WakesAfterItFellAsleepAndAllocatesNothing) {
  if (testing::allowed_cores() < 2) GTEST_SKIP() << "one core";
  HelperThread helper;
  ASSERT_TRUE(helper.present());
  int by_helper = 0;
  const auto caller = std::this_thread::get_id();
  counting = true;
  for (int run = 0; run < 20; ++run) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    bool done = false;
    const auto waiting_until = std::chrono::steady_clock::now() + std::chrono::seconds(2);
    std::atomic<bool> started{false};
    helper.run(
        [&] {
          while (!started && std::chrono::steady_clock::now() < waiting_until) {
          }
        },
        [&] {
          started = true;
          done = true;
          if (std::this_thread::get_id() != caller) ++by_helper;
        });
    ASSERT_TRUE(done);
  }
  counting = false;
  EXPECT_EQ(by_helper, 20);
  EXPECT_EQ(allocations, 0);
}

TEST(HelperThread, ReturnsTheCallersCores) {
  cpu_set_t before, after;
  ASSERT_EQ(pthread_getaffinity_np(pthread_self(), sizeof(before), &before), 0);
  {
    HelperThread helper;
    EXPECT_EQ(testing::allowed_cores(), 1) << "with all cores allowed, there is nothing to return";
  }
  ASSERT_EQ(pthread_getaffinity_np(pthread_self(), sizeof(after), &after), 0);
  EXPECT_TRUE(CPU_EQUAL(&before, &after));
}

CorePair choose(int core_count, int here, std::set<int>& claimed) {
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  for (int core = 0; core < core_count; ++core) CPU_SET(core, &allowed);
  return choose_cores(allowed, here, [&](int core) { return claimed.insert(core).second; });
}

TEST(HelperThread, TwoHandsShareNoCoreIfThereAreFour) {
  for (int second_here = 0; second_here < 4; ++second_here) {
    std::set<int> claimed;
    const CorePair one = choose(4, 2, claimed), two = choose(4, second_here, claimed);
    EXPECT_EQ(one.caller, 2);
    EXPECT_EQ(one.helper, 0);
    EXPECT_EQ((std::set{one.caller, one.helper, two.caller, two.helper}), (std::set{0, 1, 2, 3})) << second_here;
  }
}

TEST(HelperThread, HandsShareCoresOnlyIfTheyMust) {
  std::set<int> claimed;
  choose(3, 0, claimed);
  const CorePair third = choose(3, 0, claimed);
  EXPECT_EQ(third.caller, 2) << "the free core";
  EXPECT_GE(third.helper, 0);
  EXPECT_NE(third.helper, third.caller);
  const CorePair fourth = choose(3, 1, claimed);
  EXPECT_EQ(fourth.caller, 1) << "it stays";
  EXPECT_EQ(fourth.helper, 0);
  claimed.clear();
  EXPECT_EQ(choose(1, 0, claimed).helper, -1);
}

TEST(HelperThread, AnotherProcessSeesTheClaimOfACore) {
  const int core = 1000000 + getpid();
  const auto child_can_claim = [core] {
    const pid_t child = fork();
    if (child == 0) _exit(CoreClaim(core).holds() ? 1 : 0);
    int status = 0;
    waitpid(child, &status, 0);
    return WEXITSTATUS(status) == 1;
  };
  {
    const CoreClaim claim(core);
    ASSERT_TRUE(claim.holds());
    EXPECT_FALSE(CoreClaim(core).holds());
    EXPECT_FALSE(child_can_claim());
  }
  EXPECT_TRUE(child_can_claim());
  EXPECT_TRUE(CoreClaim(core).holds()) << "the claim of a process ends with it";
}

}  // namespace
}  // namespace softhand::helper_thread_test
