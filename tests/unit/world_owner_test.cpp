// Which hand owns an object of the world: two hands with one object, owners that vanish, and claims that are refused.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <span>
#include <vector>

#include "messages/newest_couplings.hpp"
#include "unit/world_objects.hpp"
#include "world/world_loop.hpp"

namespace softhand::world_owner_test {
namespace {

using test::accept_claims;
using test::cube;
using test::object;
using test::table;

TEST(WorldCoupling, KeepsTheFirstOwnerAndRefusesANonFiniteTwin) {
  WorldLoop world({}, {table(), cube(0.05, 0.3)});
  accept_claims(world);
  std::array<ObjectCoupling, 2> couplings;
  for (std::uint32_t side : {0u, 1u}) {
    ObjectCoupling& c = couplings[side];
    c.hand = {0, side};
    c.step_period = 1.0 / 90;
    ObjectTwin twin;
    twin.object = 2;
    twin.owned = side;  // at first only the right hand owns the object
    twin.position = {side ? 0.01 : -0.01, 0.3, 0};
    twin.contact_force = {0, 0.05 * 9.81, 0};
    c.twins.push_back(twin);
  }
  Nanoseconds now = 0;
  const auto step = [&] {
    now += 4000000;
    for (auto& c : couplings) c.stamp.sample_time = now;
    return object(world.step(now, {couplings}), 2);
  };
  EXPECT_EQ(step().owner_side, 1u);
  couplings[0].twins[0].owned = 1;
  EXPECT_EQ(step().owner_side, 1u);
  couplings[1].twins[0].owned = 0;
  couplings[1].twins[0].contact_force = {};
  EXPECT_EQ(step().owner_side, 0u);
  couplings[0].twins[0].position[1] = std::nan("");
  const ObjectState last = step();
  EXPECT_EQ(last.owned, 0u);
  EXPECT_TRUE(std::isfinite(last.position[1]));
  EXPECT_EQ(world.counters().refused_nonfinite, 1u);
}

// Two hands and one cube in the air. Each hand has a twin of it.
struct TwoHands {
  TwoHands() : world({}, {table(), cube(0.05, 0.3)}) {
    accept_claims(world);
    for (std::uint32_t side : {0u, 1u}) {
      couplings[side].hand = {0, side};
      couplings[side].step_period = 1.0 / 90;
      ObjectTwin twin;
      twin.object = 2;
      twin.position = {0, 0.3, 0};
      couplings[side].twins.push_back(twin);
    }
  }
  ObjectTwin& twin(std::uint32_t side) { return couplings[side].twins.items[0]; }
  void touch(std::uint32_t side, double newton) { twin(side).contact_force = {0, newton, 0}; }
  ObjectState step() {
    now += 4000000;
    for (ObjectCoupling& each : couplings) each.stamp.sample_time = now;
    return object(world.step(now, {couplings}), 2);
  }
  WorldLoop world;
  std::array<ObjectCoupling, 2> couplings;
  Nanoseconds now = 0;
};

TEST(WorldCoupling, AnObjectGoesFromTheOwnerToTheHandThatStillTouchesIt) {
  constexpr double kWeight = 0.05 * 9.81;
  TwoHands hands;
  hands.twin(1).owned = 1;
  hands.touch(1, kWeight);
  EXPECT_EQ(hands.step().owner_side, 1u);
  hands.touch(0, 0.2);  // both touch: nothing changes
  for (int n = 0; n < 50; ++n) EXPECT_EQ(hands.step().owner_side, 1u);
  // The owner lets go. The other hand is the next owner, and until it claims the object the twin of the first one
  // leads.
  hands.touch(1, 0);
  const ObjectState before = hands.step();
  EXPECT_EQ(before.owner_side, 0u);
  for (int n = 0; n < 5; ++n) EXPECT_EQ(hands.step().owned, 1u);
  // The first owner gives it up before the second has claimed it: the object does not fall.
  hands.twin(1).owned = 0;
  ObjectState state;
  for (int n = 0; n < 5; ++n) state = hands.step();
  EXPECT_EQ(state.owned, 1u);
  EXPECT_EQ(state.owner_side, 0u);
  EXPECT_LT(std::abs(state.position[1] - before.position[1]), 1e-3);
  hands.twin(0).owned = 1;
  hands.touch(0, kWeight);
  for (int n = 0; n < 100; ++n) state = hands.step();
  EXPECT_EQ(state.owner_side, 0u);
  EXPECT_NEAR(state.position[1], 0.3, 1e-3);
  EXPECT_EQ(hands.world.counters().vanished, 0u);
}

// Of a hand that touches the cube at this height and does not claim it.
ObjectCoupling touching(double height) {
  ObjectCoupling coupling;
  coupling.step_period = 1.0 / 90;
  ObjectTwin twin;
  twin.object = 2;
  twin.position = {0, height, 0};
  twin.contact_force = {0, 1, 0};
  coupling.twins.push_back(twin);
  return coupling;
}

// A reset reaches the processes one after another. A closed hand that does not know it yet finds the cube between its
// fingers at the old place, and would throw it.
TEST(WorldCoupling, AfterAResetNoHandGetsAnObjectForATime) {
  WorldLoop world({}, {table(), cube(0.05, 0.02)});
  std::array couplings{touching(0.02)};
  constexpr Nanoseconds kStep = 4'000'000, kReset = 1'000'000'000;
  // The world knows the hand, so only the reset keeps the cube from it.
  for (Nanoseconds now = kReset - 300'000'000; now < kReset; now += kStep) {
    couplings[0].stamp.sample_time = now;
    world.step(now, {couplings});
  }
  world.reset(kReset);
  // The hand does not claim the cube before it knows the new place.
  for (Nanoseconds now = kReset + kStep; now < kReset + 190'000'000; now += kStep) {
    couplings[0].twins.items[0].owned = now > kReset + 50'000'000 ? 1 : 0;
    couplings[0].stamp.sample_time = now;
    ASSERT_EQ(object(world.step(now, {couplings}), 2).owned, 0u) << now;
  }
  std::uint32_t owned = 0;
  for (Nanoseconds now = kReset + 200'000'000; now < kReset + 250'000'000; now += kStep) {
    couplings[0].stamp.sample_time = now;
    owned = object(world.step(now, {couplings}), 2).owned;
  }
  EXPECT_EQ(owned, 1u);
}

// The same for a world that was started again. The hand goes on to hold the cube at the place in the earlier world. The
// two processes find each other late, and the hand hears of the new world after that.
TEST(WorldCoupling, ANewWorldDoesNotGiveAnObjectToAHandThatHoldsTheOldOne) {
  WorldLoop world({}, {table(), cube(0.05, 0.02)});
  std::array couplings{touching(0.25)};
  ObjectTwin twin = couplings[0].twins.items[0];
  twin.owned = 1;
  twin.contact_force = {0, 0.05 * 9.81, 0};
  constexpr Nanoseconds kStep = 4'000'000, kFound = 400'000'000, kHeard = 550'000'000, kClaimsAgain = 700'000'000;
  for (Nanoseconds now = kStep; now < kClaimsAgain; now += kStep) {
    couplings[0].stamp.sample_time = now;
    couplings[0].twins.clear();
    if (now < kHeard) couplings[0].twins.push_back(twin);
    const ObjectState state = object(world.step(now, {std::span(couplings).first(now < kFound ? 0 : 1)}), 2);
    ASSERT_EQ(state.owned, 0u) << now;
    ASSERT_NEAR(state.position[1], 0.02, 1e-3) << now;
  }
  couplings[0].stamp.sample_time = kClaimsAgain;
  twin.position = {0, 0.02, 0};
  couplings[0].twins.push_back(twin);
  EXPECT_EQ(object(world.step(kClaimsAgain, {couplings}), 2).owned, 1u);
}

TEST(WorldCoupling, AnObjectFallsIfTheNextOwnerDoesNotClaimIt) {
  TwoHands hands;
  hands.twin(1).owned = 1;
  hands.touch(1, 0.5);
  hands.step();
  hands.touch(0, 0.2);
  hands.touch(1, 0);
  hands.twin(1).owned = 0;
  EXPECT_EQ(hands.step().owner_side, 0u);
  hands.touch(0, 0);
  ObjectState state;
  for (int n = 0; n < 100; ++n) state = hands.step();
  EXPECT_EQ(state.owned, 0u);
  EXPECT_LT(state.position[1], 0.25);
}

// An owner's samples that must not reach the engine. Each would make the object's motion infinite or hold it for ever.
TEST(WorldCoupling, RefusesAbsurdVelocitiesForcesPeriodsAndSamplesFromTheFuture) {
  WorldLoop world({}, {table(), cube(0.05, 0.3)});
  accept_claims(world);
  Nanoseconds now = 0;
  const auto step = [&](const std::function<void(ObjectCoupling&)>& change) {
    ObjectCoupling coupling;
    coupling.step_period = 1.0 / 90;
    now += 4000000;
    coupling.stamp.sample_time = now;
    ObjectTwin twin;
    twin.object = 2;
    twin.owned = 1;
    twin.position = {0, 0.3, 0};
    coupling.twins.push_back(twin);
    change(coupling);
    return object(world.step(now, {{&coupling, 1}}), 2);
  };
  const auto twin = [](ObjectCoupling& c) -> ObjectTwin& { return c.twins.items[0]; };
  const std::vector<std::function<void(ObjectCoupling&)>> absurd{
      [&](ObjectCoupling& c) {
        twin(c).linear_velocity = {1e308, 0, 0};
      },
      [&](ObjectCoupling& c) {
        twin(c).angular_velocity = {0, 1e308, 0};
      },
      [&](ObjectCoupling& c) {
        twin(c).contact_force = {0, 0, 1e308};
      },
      [&](ObjectCoupling& c) {
        twin(c).coupling_torque = {0, 0, -1e9};
      },
      [&](ObjectCoupling& c) { c.step_period = std::nan(""); },
      [&](ObjectCoupling& c) { c.step_period = std::numeric_limits<double>::infinity(); },
  };
  std::uint64_t refused = 0;
  for (const auto& change : absurd) {
    EXPECT_EQ(step([](ObjectCoupling&) {}).owned, 1u);
    const ObjectState state = step(change);
    EXPECT_EQ(state.owned, 0u);
    EXPECT_TRUE(std::isfinite(state.position[1]));
    EXPECT_EQ(world.counters().refused_nonfinite, ++refused);
  }
  EXPECT_EQ(step([](ObjectCoupling&) {}).owned, 1u);
  EXPECT_EQ(step([](ObjectCoupling& c) { c.stamp.sample_time += 3'600'000'000'000; }).owned, 0u);
  EXPECT_EQ(world.counters().refused_future, 1u);
  // A sample that was taken while the step began is not from the future.
  EXPECT_EQ(step([](ObjectCoupling& c) { c.stamp.sample_time += 1'000'000; }).owned, 1u);
  EXPECT_LT(std::abs(step([](ObjectCoupling&) {}).position[1] - 0.3), 0.05);
}

// The newest coupling of a hand stays in the list of inputs. When the time of a future stamp has come, it must not be
// taken for a present one.
TEST(WorldCoupling, AClaimFromTheFutureIsNeverFollowed) {
  constexpr Nanoseconds kHour = 3'600'000'000'000;
  WorldLoop world({}, {table(), cube(0.05, 0.3)});
  accept_claims(world);
  NewestCouplings newest(4);
  ObjectCoupling claim;
  claim.step_period = 1.0 / 90;
  ObjectTwin twin;
  twin.object = 2;
  twin.owned = 1;
  twin.position = {0, 0.3, 0};
  claim.twins.push_back(twin);
  Nanoseconds now = 1'000'000'000;
  const auto step = [&] { return object(world.step(now += 4'000'000, {newest.all()}), 2).owned; };
  const auto input_age_ms = [&] {
    LoopStatus status;
    world.fill_status(status, now);
    return status.input_age_ms;
  };
  claim.stamp.sample_time = now;
  newest.put(claim, now);
  EXPECT_EQ(step(), 1u);
  claim.stamp.sample_time = now + kHour;
  newest.put(claim, now);
  step();
  EXPECT_GE(input_age_ms(), 0);
  now += 1'000'000'000;
  EXPECT_EQ(step(), 0u) << "the last good sample has vanished";
  now += kHour - 1'004'000'000;
  for (int i = 0; i < 10; ++i) EXPECT_EQ(step(), 0u);
  EXPECT_EQ(newest.refused_future(), 1u);
}

TEST(WorldCoupling, SecondHandTakesOverWhenTheOwnerVanishes) {
  WorldLoop world({}, {table(), cube(0.05, 0.2)});
  accept_claims(world);
  std::array<ObjectCoupling, 2> hands;
  for (std::uint32_t side : {0u, 1u}) {
    hands[side].hand = {0, side};
    hands[side].step_period = 1.0 / 90;
    ObjectTwin twin;
    twin.object = 2;
    twin.owned = 1;
    twin.position = {0, 0.2, 0};
    hands[side].twins.push_back(twin);
  }
  const auto run = [&](int from, int to, bool both) {
    ObjectState state;
    for (int i = from; i < to; ++i) {
      const Nanoseconds now = i * 4000000LL;
      hands[1].stamp.sample_time = now;
      if (both) hands[0].stamp.sample_time = now;
      state = object(world.step(now, {hands}), 2);
    }
    return state;
  };
  EXPECT_EQ(run(1, 50, true).owner_side, 0u);
  EXPECT_EQ(run(50, 150, false).owner_side, 0u) << "0.4 s: the silent hand may come back";
  EXPECT_EQ(world.counters().stalls, 1u);
  const ObjectState taken = run(150, 250, false);
  EXPECT_EQ(taken.owned, 1u);
  EXPECT_EQ(taken.owner_side, 1u);
  EXPECT_NEAR(taken.position[1], 0.2, 2e-3);
  EXPECT_EQ(world.counters().vanished, 1u);
  EXPECT_EQ(world.counters().stalls, 1u);
}

}  // namespace
}  // namespace softhand::world_owner_test
