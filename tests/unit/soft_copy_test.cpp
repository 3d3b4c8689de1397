// The world's copies of flexible objects: what rests on them, what passes through them, and what is refused.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <span>
#include <stdexcept>
#include <string_view>
#include <utility>
#include <vector>

#include "support/box_mesh.hpp"
#include "support/count_allocations.hpp"
#include "support/counters.hpp"
#include "unit/world_objects.hpp"
#include "world/world_loop.hpp"

namespace softhand::soft_copy_test {
namespace {

using test::cube;
using test::object;
using test::table;

constexpr Nanoseconds kPeriod = 4'000'000;
constexpr double kHeight = 0.04;  // m, of the flexible block

// A block of 80 x 40 x 80 mm around the origin, which stands on the table.
SoftObject block(double height = 0.5 * kHeight, bool is_shared = false) {
  const HandModel mesh = testing::box_mesh({4, 2, 4}, Vector3(0.08, kHeight, 0.08), {});
  auto body = std::make_shared<SoftBody>();
  for (const Vector3& node : mesh.nodes) body->nodes.push_back(node - Vector3(0.04, 0.5 * kHeight, 0.04));
  body->tetrahedra = mesh.tetrahedra;
  body->friction = 0.8;
  body->material.youngs_modulus = 2e4;
  body->material.poisson_ratio = 0.3;
  body->material.density = 100;
  body->material.strain_limit_energy = 500;
  body->material.strain_limit_stiffness = 500;
  SoftObject result;
  result.name = "block";
  result.body = body;
  result.pose.position = {0, height, 0};
  result.gravity = {0, -9.81, 0};
  result.is_shared = is_shared;
  return result;
}

// A table, a cube of 40 mm above the block, and the block as the hand's process publishes it.
class SoftCopyInWorld : public ::testing::Test {
 protected:
  static WorldLoop make_world(const WorldOptions& options = {}) {
    return WorldLoop(options, {table(), cube(0.1, kHeight + 0.025)}, 1.0 / 90, {}, {block()});
  }
  SoftObjectState& block_at(Nanoseconds time, const Vector3& shift, const Vector3& velocity = Vector3::Zero()) {
    const SoftObject object = block();
    *state_ = {};
    state_->object = kFirstSoftObject;
    state_->stamp.sample_time = time;
    state_->centre = to_wire(Vector3(object.pose.position + shift));
    state_->linear_velocity = to_wire(velocity);
    for (const Vector3& node : object.body->nodes) {
      state_->nodes.push_back(to_floats(node));
      state_->velocities.push_back({});
    }
    return *state_;
  }
  // Steps without a state of the block, and one with it.
  void run(WorldLoop& world, int steps) {
    for (int i = 0; i < steps; ++i) world.step(now_ += kPeriod, {couplings_});
  }
  void step(WorldLoop& world, const SoftObjectState& state) {
    world.step(now_ += kPeriod, {couplings_, std::span(&state, 1)});
  }
  // `to` goes on from the saved state of `from`, which forgets the rest.
  static void hand_over(WorldLoop& from, WorldLoop& to) {
    std::vector<std::byte> bytes(1'000'000);
    ByteWriter out(bytes);
    from.save(out);
    ASSERT_FALSE(out.overflowed());
    from.forget();
    ByteReader in(bytes);
    to.load(in);
  }
  static Vector3 cube_in(const WorldLoop& world) { return to_vector(world.objects().objects[1].position); }
  static double counter(const WorldLoop& world, std::string_view name) {
    LoopStatus status;
    world.fill_status(status, 0);
    return testing::counter_of(status, name);
  }

  Nanoseconds now_ = 1'000'000'000;
  std::vector<ObjectCoupling> couplings_;
  std::unique_ptr<SoftObjectState> state_ = std::make_unique<SoftObjectState>();
};

TEST_F(SoftCopyInWorld, ACubeRestsOnTheBlockOnceItsStateIsKnown) {
  WorldLoop without = make_world();
  run(without, 500);
  EXPECT_NEAR(cube_in(without).y(), 0.02, 1e-3) << "no process simulates the block";
  EXPECT_EQ(counter(without, "soft_copies"), 0);

  WorldLoop with = make_world();
  step(with, block_at(now_, Vector3::Zero()));
  run(with, 500);
  EXPECT_NEAR(cube_in(with).y(), kHeight + 0.02, 5e-4);
  EXPECT_LT(to_vector(with.objects().objects[1].linear_velocity).norm(), 1e-3);
  EXPECT_LT(std::hypot(cube_in(with).x(), cube_in(with).z()), 1e-4);
  EXPECT_EQ(counter(with, "soft_copies"), 1);
  run(with, 1500);
  EXPECT_EQ(counter(with, "asleep"), 1) << "on a copy that rests";
}

TEST_F(SoftCopyInWorld, AFastCubeDoesNotPassThroughIt) {
  for (const double height : {0.2, 0.5, 1.0}) {
    WorldLoop world({}, {table(), cube(0.1, height)}, 1.0 / 90, {}, {block()});
    step(world, block_at(now_, Vector3::Zero()));
    double lowest = height;
    for (int i = 0; i < 500; ++i) {
      run(world, 1);
      lowest = std::min(lowest, cube_in(world).y());
    }
    EXPECT_GT(lowest, kHeight + 0.01) << height;
    EXPECT_NEAR(cube_in(world).y(), kHeight + 0.02, 5e-4) << height;
    std::printf("from %.1f m: lowest %.2f mm, end %.2f mm off, drift %.2f mm\n", height,
                1e3 * (lowest - kHeight - 0.02), 1e3 * (cube_in(world).y() - kHeight - 0.02),
                1e3 * std::hypot(cube_in(world).x(), cube_in(world).z()));
  }
}

// The states of a hand's process at 90 Hz are up to a period old.
TEST_F(SoftCopyInWorld, ACubeIsLiftedByIt) {
  const double speed = 0.05;
  WorldLoop world = make_world();
  step(world, block_at(now_, Vector3::Zero()));
  run(world, 250);
  const double before = cube_in(world).y();
  const Nanoseconds start = now_;
  const Vector3 velocity(0, speed, 0);
  while (now_ < start + 500'000'000) {
    const double lifted = speed * static_cast<double>(now_ - start) * 1e-9;
    step(world, block_at(now_, lifted * Vector3::UnitY(), velocity));
    run(world, 2);
  }
  EXPECT_NEAR(cube_in(world).y() - before, speed * static_cast<double>(now_ - start) * 1e-9, 5e-4);
  EXPECT_NEAR(to_vector(world.objects().objects[1].linear_velocity).y(), speed, 0.1 * speed);
}

// The middle of the top sinks by 10 mm, and takes the cube along.
TEST_F(SoftCopyInWorld, ItDeforms) {
  WorldLoop world = make_world();
  step(world, block_at(now_, Vector3::Zero()));
  run(world, 250);
  for (int i = 1; i <= 100; ++i) {
    SoftObjectState& state = block_at(now_, Vector3::Zero());
    for (auto& node : state.nodes) {
      if (node[1] > 0.019f) node[1] -= 1e-4f * static_cast<float>(i);
    }
    step(world, state);
  }
  run(world, 250);
  EXPECT_NEAR(cube_in(world).y(), kHeight + 0.01, 5e-4);
}

TEST_F(SoftCopyInWorld, AnObjectThatAHandOwnsPassesThroughIt) {
  WorldLoop world = make_world();
  step(world, block_at(now_, Vector3::Zero()));
  ObjectCoupling& hand = couplings_.emplace_back();
  hand.step_period = 1.0 / 90;
  hand.stamp.sample_time = now_;
  run(world, 100);  // the world accepts the claims of a new hand after 0.2 s
  ObjectTwin twin;
  twin.object = 2;
  twin.owned = 1;
  twin.contact_force = {0, 0.1 * 9.81, 0};
  const double top = cube_in(world).y();
  for (int i = 0; i < 250; ++i) {
    twin.position = {0, top - 1e-4 * i, 0};
    twin.linear_velocity = {0, -0.025, 0};
    hand.twins.clear();
    hand.twins.push_back(twin);
    hand.stamp.sample_time = now_;
    run(world, 1);
  }
  EXPECT_LT(cube_in(world).y(), top - 0.02);
}

TEST_F(SoftCopyInWorld, ItVanishesWithTheHandsProcessAndWithAReset) {
  for (const bool by_reset : {false, true}) {
    WorldLoop world = make_world();
    step(world, block_at(now_, Vector3::Zero()));
    run(world, 250);
    ASSERT_GT(cube_in(world).y(), kHeight);
    if (by_reset) {
      world.reset(now_);
      step(world, block_at(now_ - kPeriod, Vector3::Zero()));  // from before the reset
    } else {
      SoftObjectDescription description;
      description.object = kFirstSoftObject;
      world.describe_soft_object(description);
      run(world, 100);
      EXPECT_GT(cube_in(world).y(), kHeight) << "the object is only described";
      description.removed = 1;
      world.describe_soft_object(description);
    }
    run(world, 250);
    EXPECT_NEAR(cube_in(world).y(), 0.02, 1e-3);
  }
}

TEST_F(SoftCopyInWorld, RefusesWhatIsWrong) {
  WorldLoop world = make_world();
  const auto refused = [&](auto&& spoil) {
    SoftObjectState& state = block_at(now_, Vector3::Zero());
    spoil(state);
    const double before = counter(world, "refused_soft");
    step(world, state);
    return counter(world, "refused_soft") - before;
  };
  EXPECT_EQ(refused([](SoftObjectState& s) { s.object = kFirstSoftObject + 1; }), 1);
  EXPECT_EQ(refused([](SoftObjectState& s) { s.object = 2; }), 1);
  EXPECT_EQ(refused([](SoftObjectState& s) { --s.nodes.count; }), 1);
  EXPECT_EQ(refused([](SoftObjectState& s) { --s.velocities.count; }), 1);
  EXPECT_EQ(refused([](SoftObjectState& s) { s.nodes[3][1] = std::numeric_limits<float>::quiet_NaN(); }), 1);
  EXPECT_EQ(refused([](SoftObjectState& s) { s.velocities[3][1] = std::numeric_limits<float>::infinity(); }), 1);
  EXPECT_EQ(refused([](SoftObjectState& s) { s.centre[0] = 1e5; }), 1);
  EXPECT_EQ(refused([](SoftObjectState& s) { s.stamp.sample_time += 1'000'000'000; }), 1);
  EXPECT_EQ(counter(world, "soft_copies"), 0);
  EXPECT_EQ(refused([](SoftObjectState&) {}), 0);
  EXPECT_EQ(counter(world, "soft_copies"), 1);
  EXPECT_THROW(WorldLoop({}, {}, 1.0 / 90, {}, std::vector<SoftObject>(kMaxSoftObjects + 1, block())),
               std::invalid_argument);
}

TEST_F(SoftCopyInWorld, ALoopThatLoadsAStateContinuesWithTheSameBits) {
  for (const int before : {0, 10, 300}) {
    WorldLoop one = make_world(), two = make_world();
    const auto advance = [&](WorldLoop& world, int i) {
      const Vector3 velocity(0.01, 0.05, 0);
      const bool moves = i > 250 && i < 400;
      const double time = 4e-3 * std::clamp(i - 250, 0, 150);
      if (i % 3 == 0) {
        world.step(
            now_ + i * kPeriod,
            {{},
             std::span(&block_at(now_ + i * kPeriod, time * velocity, moves ? velocity : Vector3(Vector3::Zero())),
                       1)});
      } else {
        world.step(now_ + i * kPeriod, {});
      }
    };
    for (int i = 0; i < before; ++i) advance(one, i);
    hand_over(one, two);
    for (int i = before; i < before + 400; ++i) {
      advance(one, i);
      advance(two, i);
      ASSERT_EQ(plain_hash(one.objects()), plain_hash(two.objects())) << "step " << i << " after " << before;
    }
    EXPECT_GT(cube_in(one).y(), kHeight);
  }
}

// The world simulates the block while no hand owns it.
class SharedSoftCopy : public SoftCopyInWorld {
 protected:
  static WorldLoop make_world(double height) { return WorldLoop({}, {table()}, 1.0 / 90, {}, {block(height, true)}); }
  // Makes a step and keeps the state of the block, if one is to be published.
  void advance(WorldLoop& world, std::span<const SoftObjectState> states = {}) {
    const WorldOutput& out = world.step(now_ += kPeriod, {couplings_, states});
    for (std::size_t i = 0; i < out.soft_count; ++i) {
      published_ = out.soft_objects[i];
      ++count_;
    }
  }
  void run_free(WorldLoop& world, int steps) {
    for (int i = 0; i < steps; ++i) advance(world);
  }
  double height() const { return published_.centre[1]; }
  SoftObjectState published_;
  int count_ = 0;
};

TEST_F(SharedSoftCopy, FallsComesToRestAndSleeps) {
  constexpr double kDrop = 0.1;
  WorldLoop world = make_world(0.5 * kHeight + kDrop);
  run_free(world, 25);
  EXPECT_EQ(published_.object, kFirstSoftObject);
  EXPECT_EQ(published_.owned, 0u);
  EXPECT_EQ(published_.nodes.size(), block().body->nodes.size());
  // Implicit Euler falls by another half step.
  EXPECT_NEAR(height(), 0.5 * kHeight + kDrop - 0.5 * 9.81 * 0.1 * 0.104, 1e-3);
  EXPECT_NEAR(count_, 10, 1) << "100 states a second";
  EXPECT_EQ(counter(world, "free_soft_objects"), 1);
  run_free(world, 1000);
  EXPECT_NEAR(height(), 0.5 * kHeight, 5e-4);
  EXPECT_LT(to_vector(published_.linear_velocity).norm(), 1e-6);
  EXPECT_EQ(counter(world, "free_soft_objects"), 0) << "it sleeps";
  count_ = 0;
  run_free(world, 250);
  EXPECT_NEAR(count_, 10, 1) << "10 states a second";
  // Its support goes away.
  Message message;
  set_text(message.module, "world");
  set_text(message.key, "object.remove");
  set_text(message.value, "table");
  EXPECT_EQ(world.answer(message).result, kReplyApplied);
  run_free(world, 50);
  EXPECT_LT(height(), 0);
}

TEST_F(SharedSoftCopy, FollowsTheHandThatOwnsItAndGoesOnFromThere) {
  WorldLoop world = make_world(0.5 * kHeight);
  run_free(world, 100);
  const Vector3 velocity(0.5, 0.4, 0);
  Vector3 shift = Vector3::Zero();
  for (int i = 0; i < 50; ++i) {
    shift = 4e-3 * i * velocity;
    SoftObjectState& state = block_at(now_, shift, velocity);
    state.owned = 1;
    state.contact_count = 3;
    state.hand_force = {0, 1, 0};
    advance(world, {&state, 1});
  }
  EXPECT_EQ(published_.owned, 1u);
  EXPECT_EQ(published_.contact_count, 3u);
  EXPECT_EQ(published_.hand_force[1], 1);
  EXPECT_EQ(counter(world, "free_soft_objects"), 0);
  EXPECT_NEAR(published_.centre[0], shift.x(), 0.01 * 0.5) << "a state is published every 10 ms";
  // The hand throws it.
  SoftObjectState& state = block_at(now_, shift, velocity);
  advance(world, {&state, 1});
  const Vector3 thrown_from = to_vector(block_at(now_, shift).centre);
  constexpr double kTime = 0.1;
  run_free(world, 25);
  EXPECT_EQ(published_.owned, 0u);
  EXPECT_EQ(published_.contact_count, 0u);
  EXPECT_NEAR(published_.centre[0], thrown_from.x() + velocity.x() * kTime, 5e-3);
  EXPECT_NEAR(height(), thrown_from.y() + velocity.y() * kTime - 0.5 * 9.81 * kTime * kTime, 6e-3);
}

TEST_F(SharedSoftCopy, FallsWhenTheOwnerHasVanished) {
  WorldLoop world = make_world(0.5 * kHeight);
  run_free(world, 100);
  SoftObjectState& state = block_at(now_, Vector3(0, 0.1, 0));
  state.owned = 1;
  advance(world, {&state, 1});
  run_free(world, 120);
  EXPECT_NEAR(height(), 0.5 * kHeight + 0.1, 1e-3) << "the owner may come back for half a second";
  run_free(world, 500);
  EXPECT_NEAR(height(), 0.5 * kHeight, 5e-4);
}

TEST_F(SharedSoftCopy, GoesBackByMessageAlsoIfAHandHoldsIt) {
  WorldLoop world = make_world(0.5 * kHeight);
  run_free(world, 100);
  const auto hold = [&] {
    SoftObjectState& state = block_at(now_, Vector3(0, 0.1, 0));
    state.owned = 1;
    advance(world, {&state, 1});
  };
  for (int i = 0; i < 10; ++i) hold();
  EXPECT_NEAR(height(), 0.5 * kHeight + 0.1, 1e-3);
  Message message;
  set_text(message.module, "world");
  set_text(message.key, "object.reset");
  set_text(message.value, "block");
  EXPECT_EQ(world.answer(message).result, kReplyApplied);
  for (int i = 0; i < 10; ++i) hold();  // the hand has not heard of it
  EXPECT_NEAR(height(), 0.5 * kHeight, 1e-3);
  run_free(world, 50);
  for (int i = 0; i < 10; ++i) hold();
  EXPECT_NEAR(height(), 0.5 * kHeight + 0.1, 1e-3) << "the hand has taken it again";
}

TEST_F(SharedSoftCopy, ALoopThatLoadsAStateContinuesWithTheSameBits) {
  for (const int before : {0, 10, 60}) {
    WorldLoop one = make_world(0.5 * kHeight + 0.05), two = make_world(0.5 * kHeight + 0.05);
    const auto step_at = [&](WorldLoop& world, int i) {
      SoftObjectState& state = block_at(now_ + i * kPeriod, Vector3(1e-3 * i, 0.1, 0), Vector3(0.25, 0, 0));
      state.owned = i > 150 && i < 200 ? 1 : 0;
      world.step(now_ + i * kPeriod, {{}, std::span(&state, i % 3 == 0 ? 1 : 0)});
    };
    for (int i = 0; i < before; ++i) step_at(one, i);
    hand_over(one, two);
    for (int i = before; i < before + 300; ++i) {
      step_at(one, i);
      step_at(two, i);
      one.for_each_part([&, part = 0](const char* name, const auto& value) mutable {
        std::vector<std::uint64_t> hashes;
        two.for_each_part([&](const char*, const auto& other) { hashes.push_back(plain_hash(other)); });
        ASSERT_EQ(plain_hash(value), hashes.at(static_cast<std::size_t>(part++))) << name << " in step " << i;
      });
      if (HasFailure()) return;
    }
  }
}

TEST_F(SharedSoftCopy, AStepAllocatesNothing) {
#ifndef SOFTHAND_COUNT_MALLOC
  GTEST_SKIP() << "the sanitizer brings its own malloc";
#endif
  WorldLoop world = make_world(0.5 * kHeight + 0.01);
  run_free(world, 20);
  counting = true;
  run_free(world, 300);
  world.forget();
  run_free(world, 100);
  counting = false;
  EXPECT_EQ(std::exchange(allocations, 0), 0);
}

TEST_F(SoftCopyInWorld, AStepAllocatesNothing) {
#ifndef SOFTHAND_COUNT_MALLOC
  GTEST_SKIP() << "the sanitizer brings its own malloc";
#endif
  counting = true;
  ::operator delete(::operator new(64));
  counting = false;
  ASSERT_EQ(std::exchange(allocations, 0), 1) << "the counter does not count";
  WorldLoop world = make_world();
  step(world, block_at(now_, Vector3::Zero()));
  run(world, 10);
  for (int i = 0; i < 100; ++i) {
    const SoftObjectState& state = block_at(now_, Vector3(0, 1e-4 * i, 0));
    counting = true;
    step(world, state);
    if (i == 50) world.forget();
    counting = false;
  }
  EXPECT_EQ(std::exchange(allocations, 0), 0);
}

TEST(NoSoftCopy, ASceneWithoutFlexibleObjectsHasNoCounters) {
  WorldLoop world({}, {table()});
  LoopStatus status;
  world.fill_status(status, 0);
  EXPECT_EQ(testing::counter_of(status, "refused_soft"), -1);
  EXPECT_EQ(testing::counter_of(status, "soft_copies"), -1);
}

}  // namespace
}  // namespace softhand::soft_copy_test
