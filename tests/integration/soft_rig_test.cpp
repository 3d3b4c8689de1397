// A rig of real processes with a flexible object. A ball of foam is squeezed and put back by a reset. The hand's
// process and the world are killed meanwhile.
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>

#include "integration/rig_harness.hpp"
#include "messages/convert.hpp"
#include "runtime/object_store.hpp"
#include "support/own_domain.hpp"

namespace softhand::rig::soft_rig_test {
namespace {

using namespace std::chrono_literals;

constexpr double kWidth = 0.05;  // m, of the ball

class SoftRig : public ::testing::Test {
 protected:
  SoftRig() {
    testing::use_own_domain();
    participant_.emplace("soft-test");
    descriptions_.emplace(*participant_, bus::topics::soft_object_description);
    states_.emplace(*participant_, bus::topics::soft_object_state);
    contacts_.emplace(*participant_, bus::topics::contacts);
  }

  void poll() {
    descriptions_->take_all([this](const SoftObjectDescription& each) { described_ = each; });
    states_->take_all([this](const SoftObjectState& each) {
      ++samples_;
      finite_ = finite_ && all_finite(each.centre) && all_finite(each.hand_force);
      centre_ = to_vector(each.centre);
      lowest_ = std::min(lowest_, centre_.y());
      touched_ = each.contact_count > 0;
      owned_ = each.owned != 0;
      if (each.nodes.size() != described_.node_count) return;
      // The fingers press along z. Beside them the ball bulges.
      constexpr float kFingertip = 0.006f;
      float low = 0, high = 0;
      for (const auto& node : each.nodes) {
        finite_ = finite_ && std::isfinite(node[0]) && std::isfinite(node[1]) && std::isfinite(node[2]);
        if (std::abs(node[0]) > kFingertip || std::abs(node[1]) > kFingertip) continue;
        low = std::min(low, node[2]);
        high = std::max(high, node[2]);
      }
      width_ = high - low;
      least_ = std::min(least_, width_);
    });
    contacts_->take_all([this](const Contacts& each) {
      for (const FingerContact& finger : each.fingers) felt_ = felt_ || finger.object == kFirstSoftObject;
    });
  }
  std::optional<bus::Participant> participant_;
  std::optional<bus::Reader<SoftObjectDescription>> descriptions_;
  std::optional<bus::Reader<SoftObjectState>> states_;
  std::optional<bus::Reader<Contacts>> contacts_;
  SoftObjectDescription described_;
  std::uint64_t samples_ = 0;
  Vector3 centre_ = Vector3::Zero();
  double width_ = 0, least_ = kWidth, lowest_ = kWidth;
  bool touched_ = false, owned_ = false, felt_ = false, finite_ = true;
};

TEST_F(SoftRig, ABallIsSqueezedAgainAfterItsHandAndItsWorldWereKilled) {
  RigListener listener;
  Up up("config/rigs/demo.toml",
        {"--scene", SOFTHAND_SOURCE_DIR "/config/scenes/sponge.toml", "--set", "hand.model=right_400.hand.json",
         "--set", "viewer.port=0", "--set", "hand.simulation.solver.work_budget=3"});
  const auto waits = [&](std::chrono::milliseconds time, auto&& done) {
    return listener.wait(time, [&] {
      poll();
      return done();
    });
  };
  const auto squeezed = [this] { return width_ > 0 && width_ < 0.85 * kWidth; };
  const auto state = [&] {
    return "at " + std::to_string(centre_.x()) + " " + std::to_string(centre_.y()) + " " + std::to_string(centre_.z()) +
           ", touched " + std::to_string(touched_) + ", width " + std::to_string(width_) + ", least " +
           std::to_string(least_) + ", samples " + std::to_string(samples_) + ", hand's steps " +
           std::to_string(listener.modules["hand"].steps) + "\n" + up.output();
  };
  ASSERT_TRUE(waits(30s, [this] { return samples_ > 20; })) << state();
  EXPECT_GT(width_, 0.95 * kWidth) << state();
  EXPECT_EQ(get_text(described_.name), "ball");
  const auto file = find_object(std::string(get_text(described_.file.name)),
                                std::string(get_text(described_.file.sha256)), {SOFTHAND_SOURCE_DIR "/config/objects"});
  ASSERT_TRUE(file && file->model.soft) << "name and SHA-256 lead to the file";
  EXPECT_EQ(file->model.soft->nodes.size(), described_.node_count);

  // Without its hand nobody moves the ball. The new process starts it at its place, and on its table.
  const auto hand = static_cast<pid_t>(listener.process_id("hand"));
  ASSERT_EQ(kill(hand, SIGKILL), 0);
  ASSERT_TRUE(waits(20s, [&] { return listener.process_id("hand") != hand; })) << state();
  const std::uint64_t before = samples_;
  ASSERT_TRUE(waits(20s, [&] { return samples_ > before + 20; })) << state();
  EXPECT_GT(lowest_, 0.45 * kWidth) << state();
  ASSERT_EQ(run_program({SOFTHAND_PROGRAMS "/softhand", "send", "*", "reset", "now"}).exit_code, 0);
  ASSERT_TRUE(waits(30s, squeezed)) << state();
  EXPECT_TRUE(touched_);
  EXPECT_TRUE(waits(5s, [this] { return felt_; })) << "the contacts name the ball";

  const auto world = static_cast<pid_t>(listener.process_id("world"));
  ASSERT_EQ(kill(world, SIGKILL), 0);
  ASSERT_TRUE(waits(20s, [&] { return listener.process_id("world") != world; })) << state();
  ASSERT_TRUE(waits(30s, squeezed)) << state();
  EXPECT_TRUE(finite_);
  EXPECT_EQ(listener.counter("hand", "failed_steps"), 0);

  up.send_signal(SIGINT);
  EXPECT_EQ(up.wait(20s), 0) << up.output();
  ASSERT_TRUE(waits(5s, [&] { return described_.removed == 1; })) << "the ball ends with its process";
}

// The world has the ball while nobody touches it. If its hand is killed, the world goes on with it. If the world is
// killed, the hand that squeezes the ball keeps it.
TEST_F(SoftRig, ASharedBallOutlivesItsHandAndItsWorld) {
  RigListener listener;
  bus::Reader<SoftObjectState> copies(*participant_, bus::topics::soft_object_copy);
  SoftObjectState copy;
  std::uint64_t samples = 0;
  Up up("config/rigs/demo.toml",
        {"--scene", SOFTHAND_SOURCE_DIR "/config/scenes/sponge.toml", "--set", "hand.model=right_400.hand.json",
         "--set", "viewer.port=0", "--set", "hand.simulation.solver.work_budget=4", "--set", "world.soft=world"});
  const auto waits = [&](std::chrono::milliseconds time, auto&& done) {
    return listener.wait(time, [&] {
      poll();
      copies.take_all([&](const SoftObjectState& each) {
        copy = each;
        ++samples;
      });
      return done();
    });
  };
  const auto squeezed = [this] { return owned_ && width_ > 0 && width_ < 0.85 * kWidth; };
  const auto state = [&] {
    return "at " + std::to_string(centre_.x()) + " " + std::to_string(centre_.y()) + " " + std::to_string(centre_.z()) +
           ", owned " + std::to_string(owned_) + ", width " + std::to_string(width_) + ", copies " +
           std::to_string(samples) + " at " + std::to_string(copy.centre[1]) + "\n" + up.output();
  };
  ASSERT_TRUE(waits(30s, [&] { return samples > 20 && samples_ > 20 && copy.owned == 0 && !owned_; })) << state();
  EXPECT_LT((to_vector(copy.centre) - centre_).norm(), 2e-3) << state();
  EXPECT_GT(copy.nodes.size(), 100u);
  ASSERT_TRUE(waits(30s, [&] { return squeezed() && copy.owned == 1; })) << state();
  EXPECT_LT((to_vector(copy.centre) - centre_).norm(), 5e-3) << "the copy follows the hand";

  const auto world = static_cast<pid_t>(listener.process_id("world"));
  ASSERT_EQ(kill(world, SIGKILL), 0);
  ASSERT_TRUE(waits(20s, [&] { return listener.process_id("world") != world; })) << state();
  ASSERT_TRUE(waits(30s, [&] { return squeezed() && copy.owned == 1; })) << state();

  // The ball is let go by a hand that is no more. The world has it after half a second, and it comes to rest.
  const auto hand = static_cast<pid_t>(listener.process_id("hand"));
  ASSERT_EQ(kill(hand, SIGKILL), 0);
  ASSERT_TRUE(waits(20s, [&] { return copy.owned == 0; })) << state();
  ASSERT_TRUE(waits(20s, [&] { return listener.process_id("hand") != hand; })) << state();
  const auto is_at_copy = [&] { return !owned_ && (to_vector(copy.centre) - centre_).norm() < 2e-3; };
  ASSERT_TRUE(waits(20s, is_at_copy)) << "the new hand has the ball where the world has it\n" << state();
  ASSERT_TRUE(waits(30s, [this] { return owned_ && touched_; })) << "and takes it there\n" << state();
  // A ball that was let go in a squeeze may have rolled aside. The fingers then squeeze its edge, not its middle.
  ASSERT_EQ(run_program({SOFTHAND_PROGRAMS "/softhand", "send", "*", "object.reset", "ball"}).exit_code, 0);
  ASSERT_TRUE(waits(30s, [&] { return squeezed() && copy.owned == 1; })) << state();
  EXPECT_TRUE(finite_);
  EXPECT_EQ(listener.counter("hand", "refused_soft"), 0);
  EXPECT_EQ(listener.counter("world", "refused_soft"), 0);

  up.send_signal(SIGINT);
  EXPECT_EQ(up.wait(20s), 0) << up.output();
}

}  // namespace
}  // namespace softhand::rig::soft_rig_test
