// Work in two halves: each half is done once, by either thread, however long the helper has slept.
#include "math/helper_thread.hpp"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <thread>

#include "support/cores.hpp"
#include "support/count_allocations.hpp"

namespace softhand {
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

}  // namespace
}  // namespace softhand
