// Two hands in processes of their own lift one box, and a hand or the world is killed meanwhile. Two hands of one
// process clap. One hand squeezes a ball beside one that lifts a box.
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>
#include <string>
#include <vector>

#include "integration/rig_harness.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "runtime/exit_codes.hpp"
#include "support/own_domain.hpp"

namespace softhand::rig::two_hands_rig_test {
namespace {

using namespace std::chrono_literals;

constexpr std::uint32_t kBox = 2;  // the table is object 1

// The devices and the intermediate layers run slower than usual: two cores do not suffice for ten processes at full
// rate and the test.
const std::vector<std::string> kRig{"--set", "hand.model=right_400.hand.json", "--set", "viewer.port=0",
                                    "--set", "tracking.rate_hz=360",           "--set", "haptic.rate_hz=250"};

Finished reset_all() { return run_program({SOFTHAND_PROGRAMS "/softhand", "send", "*", "reset", "now"}); }

// Whether the processes of two_hands.toml run.
bool all_run(RigListener& listener) {
  constexpr std::array kModules{"world",         "hand_right",   "hand_left",    "tracking_right", "tracking_left",
                                "tracker_right", "tracker_left", "haptic_right", "haptic_left"};
  return listener.wait(30s, [&] {
    return std::all_of(kModules.begin(), kModules.end(),
                       [&](const char* name) { return listener.process_id(name) > 0; });
  });
}

// Kills a process of a rig. Returns whether the supervisor has started it again.
bool kill_and_wait(RigListener& listener, const char* module) {
  const std::int64_t before = listener.process_id(module);
  if (kill(static_cast<pid_t>(before), SIGKILL) != 0) return false;
  return listener.wait(10s, [&] { return listener.process_id(module) > 0 && listener.process_id(module) != before; });
}

class TwoHandsRig : public ::testing::Test {
 protected:
  TwoHandsRig() {
    testing::use_own_domain();
    participant_.emplace("two-hands-test");
    couplings_.emplace(*participant_, bus::topics::object_coupling);
    objects_.emplace(*participant_, bus::topics::objects);
  }

  void poll() {
    couplings_->take_all([this](const ObjectCoupling& each) {
      for (const ObjectTwin& twin : each.twins)
        if (twin.object == kBox) forces_[each.hand.side & 1] = to_vector(twin.contact_force);
    });
    objects_->take_all([this](const WorldObjects& world) {
      for (const ObjectState& object : world.objects) {
        if (object.object != kBox) continue;
        height_ = object.position[1];
        finite_ = finite_ && all_finite(object.position);
        owned_ = object.owned != 0;
      }
    });
  }

  // Starts the motions of both hands together: a tracker that begins alone lifts one end. Returns whether the box is in
  // the air soon.
  bool lift(RigListener& listener) {
    const Finished sent = reset_all();
    EXPECT_EQ(sent.exit_code, 0) << sent.output;
    height_ = 0;
    const bool lifted = listener.wait(6s, [&] {
      poll();
      return height_ > 0.15;
    });
    if (!lifted)
      std::printf("not lifted: the box is at %.3f m, forces %.1f and %.1f N\n", height_, forces_[0].norm(),
                  forces_[1].norm());
    return lifted;
  }

  std::optional<bus::Participant> participant_;
  std::optional<bus::Reader<ObjectCoupling>> couplings_;
  std::optional<bus::Reader<WorldObjects>> objects_;
  std::array<Vector3, 2> forces_{Vector3::Zero(), Vector3::Zero()};
  double height_ = 0;
  bool finite_ = true, owned_ = false;
};

TEST_F(TwoHandsRig, LiftTheBoxTogether) {
  RigListener listener;
  Up up("config/rigs/two_hands.toml", kRig);
  ASSERT_TRUE(all_run(listener)) << up.output();
  for (int round = 0; round < 2; ++round) {
    ASSERT_TRUE(lift(listener)) << up.output();
    double carried = 0, right = 0, lowest = height_;
    int count = 0;
    listener.listen(1s);  // the lift ends
    const Nanoseconds start = now();
    listener.wait(3s, [&] {
      poll();
      carried += forces_[0].y() + forces_[1].y();
      right += forces_[1].y();
      ++count;
      lowest = std::min(lowest, height_);
      return now() - start > 2'000'000'000;
    });
    constexpr double kWeight = 9.81;
    const double ratio = carried / count / kWeight, share = right / carried;
    std::printf("both carried %.3f of the weight, the right hand %.3f of it, lowest %.3f m\n", ratio, share, lowest);
    EXPECT_GT(lowest, 0.12);
    EXPECT_NEAR(ratio, 1, 0.05);
    EXPECT_NEAR(share, 0.5, 0.1);
  }
  EXPECT_TRUE(finite_);
}

TEST_F(TwoHandsRig, KillingAHandAndTheWorldLosesNothing) {
  RigListener listener;
  Up up("config/rigs/two_hands.toml", kRig);
  ASSERT_TRUE(all_run(listener)) << up.output();
  ASSERT_TRUE(lift(listener)) << up.output();
  for (const char* victim : {"hand_left", "world"}) EXPECT_TRUE(kill_and_wait(listener, victim)) << victim;
  // The motion begins again, and both hands lift the box of the new world.
  EXPECT_TRUE(lift(listener)) << up.output();
  EXPECT_TRUE(finite_);
  for (const auto& [topic, number] : listener.nonfinite) EXPECT_EQ(number, 0u) << topic;
  up.send_signal(SIGINT);
  EXPECT_EQ(up.wait(8s), 0) << up.output();
}

// The force of all contacts on a hand, N, world. The message has the axes of the bones.
Vector3 force_on_skin(const SkinTraction& traction, const Skeleton& hand) {
  Vector3 sum = Vector3::Zero();
  for (const SkinRegion& region : traction.regions) {
    const auto joint = slot_of(joint_of(static_cast<Body>(region.body)));
    sum += to_quaternion(hand.joints[joint].orientation) *
           Vector3(region.area * (to_vector(region.shear) - region.pressure * to_vector(region.normal)));
  }
  return sum;
}

TEST(TwoHandsOfOneProcess, ClapBeforeAndAfterTheirProcessWasKilled) {
  testing::use_own_domain();
  RigListener listener;
  bus::Participant participant("clap-test");
  bus::Reader<SkinTraction> tractions(participant, bus::topics::skin_traction);
  bus::Reader<Skeleton> skeletons(participant, bus::topics::simulated_skeleton);
  Up up("config/rigs/two_hands_one_process.toml",
        {"--set", "hand.model=right_400.hand.json", "--set", "viewer.port=0", "--set", "tracker.repeat=true"});
  std::array<SkinTraction, 2> newest;
  std::array<Skeleton, 2> hands;
  // Both hands feel the same force from opposite sides.
  const auto clap = [&] {
    double strongest = 0, cosine = 0;
    const bool heard = listener.wait(40s, [&] {
      skeletons.take_all([&](const Skeleton& each) { hands[each.hand.side & 1] = each; });
      tractions.take_all([&](const SkinTraction& each) { newest[each.hand.side & 1] = each; });
      const bool of_one_step =
          newest[0].stamp.sample_time == newest[1].stamp.sample_time && newest[0].stamp.epoch == newest[1].stamp.epoch;
      if (!of_one_step) return false;
      const Vector3 left = force_on_skin(newest[0], hands[0]), right = force_on_skin(newest[1], hands[1]);
      const double force = std::min(left.norm(), right.norm());
      if (force > strongest) cosine = left.dot(right) / (left.norm() * right.norm());
      strongest = std::max(strongest, force);
      return strongest > 5;
    });
    std::printf("the hands press with up to %.1f N, cosine %.3f\n", strongest, cosine);
    EXPECT_LT(cosine, -0.9);
    return heard;
  };
  ASSERT_TRUE(listener.wait(30s, [&] {
    return listener.process_id("hand") > 0 && listener.process_id("tracker_right") > 0 &&
           listener.process_id("tracker_left") > 0;
  })) << up.output();
  ASSERT_EQ(reset_all().exit_code, 0);  // both motions begin together
  ASSERT_TRUE(clap()) << up.output();
  const std::uint64_t epoch = newest[0].stamp.epoch;
  ASSERT_TRUE(kill_and_wait(listener, "hand")) << up.output();
  EXPECT_TRUE(clap()) << up.output();
  EXPECT_NE(newest[0].stamp.epoch, epoch);
  EXPECT_EQ(listener.counter("hand", "failed_steps"), 0);
  for (const auto& [topic, number] : listener.nonfinite) EXPECT_EQ(number, 0u) << topic;
  up.send_signal(SIGINT);
  EXPECT_EQ(up.wait(8s), 0) << up.output();
}

TEST(TwoHandsOfOneProcess, TheProcessOfTheOtherHandIsRefused) {
  testing::use_own_domain();
  const Finished hand = run_program({SOFTHAND_PROGRAMS "/softhand-hand", "--config",
                                     SOFTHAND_SOURCE_DIR "/config/scenes/clap.toml", "--set", "plays=left"});
  EXPECT_EQ(hand.exit_code, kExitConfiguration);
  EXPECT_NE(hand.output.find("plays: one_process is true, so the process of 'right' simulates 'left' too"),
            std::string::npos)
      << hand.output;
}

// In two processes, at 90 Hz, with hands of 750 nodes.
TEST(BallAndBox, AreHeldAgainAfterTheirHandAndTheWorldWereKilled) {
  constexpr std::uint32_t kLifted = 2;  // the table is object 1; the ball is flexible
  testing::use_own_domain();
  RigListener listener;
  bus::Participant participant("ball-and-box-test");
  bus::Reader<SoftObjectState> balls(participant, bus::topics::soft_object_state);
  bus::Reader<WorldObjects> worlds(participant, bus::topics::objects);
  std::vector<std::string> arguments{"--scene", SOFTHAND_SOURCE_DIR "/config/scenes/ball_and_box.toml"};
  arguments.insert(arguments.end(), kRig.begin(), kRig.end());
  arguments.insert(arguments.end(), {"--set", "hand.model=right_750.hand.json"});
  Up up("config/rigs/two_hands.toml", arguments);
  std::uint32_t contacts = 0, inverted = 0;
  double height = 0;
  const auto both_held = [&] {
    contacts = 0;
    height = 0;
    return listener.wait(40s, [&] {
      balls.take_all([&](const SoftObjectState& each) {
        contacts = each.contact_count;
        inverted = each.inverted_elements;
      });
      worlds.take_all([&](const WorldObjects& world) {
        for (const ObjectState& object : world.objects)
          if (object.object == kLifted) height = object.position[1];
      });
      return contacts >= 10 && height > 0.1;
    });
  };
  const auto state = [&] {
    return "the ball has " + std::to_string(contacts) + " contacts, the box is at " + std::to_string(height) + " m\n" +
           up.output();
  };
  ASSERT_TRUE(all_run(listener)) << up.output();
  ASSERT_EQ(reset_all().exit_code, 0);  // both motions begin together
  ASSERT_TRUE(both_held()) << state();
  for (const char* victim : {"hand_right", "world"}) {
    ASSERT_TRUE(kill_and_wait(listener, victim)) << victim << up.output();
    EXPECT_EQ(reset_all().exit_code, 0);
    listener.listen(500ms);
    EXPECT_TRUE(both_held()) << victim << ": " << state();
  }
  for (const char* hand : {"hand_right", "hand_left"}) {
    const LoopStatus& status = listener.modules.at(hand);
    std::printf("%s: %llu of %llu steps late, %.0f ended by their budget\n", hand,
                static_cast<unsigned long long>(status.deadline_misses), static_cast<unsigned long long>(status.steps),
                listener.counter(hand, "budget_steps"));
    EXPECT_EQ(listener.counter(hand, "failed_steps"), 0) << hand;
  }
  EXPECT_EQ(inverted, 0u);
  for (const auto& [topic, number] : listener.nonfinite) EXPECT_EQ(number, 0u) << topic;
  up.send_signal(SIGINT);
  EXPECT_EQ(up.wait(8s), 0) << up.output();
}

}  // namespace
}  // namespace softhand::rig::two_hands_rig_test
