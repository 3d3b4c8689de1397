// softhand-hand with hand.model = "auto" measures at start. It reports the chosen size in its log and in its status.
#include <gtest/gtest.h>
#include <signal.h>

#include <cmath>

#include "integration/rig_harness.hpp"
#include "support/own_domain.hpp"

namespace softhand::rig::hand_size_test {
namespace {

using namespace std::chrono_literals;

TEST(AutoHand, StartsWithASizeThatFitsAndReportsIt) {
  testing::use_own_domain();
  RigListener listener;
  Up up("tests/integration/rig_hand_alone.toml", {});
  ASSERT_TRUE(listener.wait(20s, [&] { return !std::isnan(listener.counter("hand", "work_budget")); })) << up.output();
  const double nodes = listener.counter("hand", "hand_nodes"), budget = listener.counter("hand", "work_budget");
  EXPECT_TRUE(budget >= 2 || nodes < 500) << nodes << " nodes, " << budget << " fast steps";
  EXPECT_NE(up.output().find("hand.model = auto"), std::string::npos) << up.output();
  up.send_signal(SIGINT);
  EXPECT_EQ(up.wait(8s), 0) << up.output();
}

TEST(AutoHand, FixedSizeIsUsedAndHasAWorkBudget) {
  testing::use_own_domain();
  RigListener listener;
  Up up("tests/integration/rig_hand_alone.toml", {"--hand", "right_750.hand.json"});
  ASSERT_TRUE(listener.wait(20s, [&] { return !std::isnan(listener.counter("hand", "hand_nodes")); })) << up.output();
  EXPECT_GT(listener.counter("hand", "hand_nodes"), 500);
  EXPECT_LT(listener.counter("hand", "hand_nodes"), 900);
  EXPECT_GT(listener.counter("hand", "work_budget"), 0);
  EXPECT_GT(listener.counter("hand", "fast_step_ms"), 0);
  EXPECT_EQ(up.output().find("hand.model = auto"), std::string::npos) << up.output();
  up.send_signal(SIGINT);
  EXPECT_EQ(up.wait(8s), 0) << up.output();
}

}  // namespace
}  // namespace softhand::rig::hand_size_test
