// Two hands in processes of their own lift one box, and a hand or the world is killed meanwhile.
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>
#include <string>

#include "integration/rig_harness.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "support/own_domain.hpp"

namespace softhand::rig::two_hands_rig_test {
namespace {

using namespace std::chrono_literals;

constexpr std::uint32_t kBox = 2;  // the table is object 1

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

  // Starts the rig and the motions of both hands together. Returns when the box is in the air.
  void lift(RigListener& listener, Up& up) {
    ASSERT_TRUE(listener.wait(30s, [&] {
      return std::all_of(kModules.begin(), kModules.end(),
                         [&](const char* name) { return listener.process_id(name) > 0; });
    })) << up.output();
    // A tracker that begins alone lifts one end. So the motions begin again, together.
    const Finished sent = run_program({SOFTHAND_PROGRAMS "/softhand", "send", "*", "reset", "now"});
    ASSERT_EQ(sent.exit_code, 0) << sent.output;
    height_ = 0;
    ASSERT_TRUE(listener.wait(6s,
                              [&] {
                                poll();
                                return height_ > 0.15;
                              }))
        << "the box is at " << height_ << " m, forces " << forces_[0].norm() << " and " << forces_[1].norm() << " N\n"
        << sent.output << up.output();
  }

  static constexpr std::array kModules{"world",          "hand_right",    "hand_left",
                                       "tracking_right", "tracking_left", "tracker_right",
                                       "tracker_left",   "haptic_right",  "haptic_left"};
  std::optional<bus::Participant> participant_;
  std::optional<bus::Reader<ObjectCoupling>> couplings_;
  std::optional<bus::Reader<WorldObjects>> objects_;
  std::array<Vector3, 2> forces_{Vector3::Zero(), Vector3::Zero()};
  double height_ = 0;
  bool finite_ = true, owned_ = false;
};

TEST_F(TwoHandsRig, LiftTheBoxTogether) {
  RigListener listener;
  Up up("config/rigs/two_hands.toml", {"--set", "hand.model=right_400.hand.json", "--set", "viewer.port=0"});
  for (int round = 0; round < 2; ++round) {
    lift(listener, up);
    if (HasFatalFailure()) return;
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
  Up up("config/rigs/two_hands.toml", {"--set", "hand.model=right_400.hand.json", "--set", "viewer.port=0"});
  lift(listener, up);
  if (HasFatalFailure()) return;
  for (const char* victim : {"hand_left", "world"}) {
    const std::int64_t before = listener.process_id(victim);
    ASSERT_EQ(kill(static_cast<pid_t>(before), SIGKILL), 0);
    EXPECT_TRUE(listener.wait(10s, [&] {
      poll();
      return listener.process_id(victim) != before && listener.process_id(victim) > 0;
    })) << victim;
  }
  // The motion begins again, and both hands lift the box of the new world.
  EXPECT_EQ(run_program({SOFTHAND_PROGRAMS "/softhand", "send", "*", "reset", "now"}).exit_code, 0);
  listener.listen(500ms);
  height_ = 0;
  EXPECT_TRUE(listener.wait(15s,
                            [&] {
                              poll();
                              return height_ > 0.15;
                            }))
      << "the box is at " << height_ << " m";
  EXPECT_TRUE(finite_);
  for (const auto& [topic, number] : listener.nonfinite) EXPECT_EQ(number, 0u) << topic;
  up.send_signal(SIGINT);
  EXPECT_EQ(up.wait(8s), 0) << up.output();
}

}  // namespace
}  // namespace softhand::rig::two_hands_rig_test
