// Flexible objects that the hand's loop shares with the world: who moves them, and what is refused.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "messages/plain_bytes.hpp"
#include "support/count_allocations.hpp"
#include "support/counters.hpp"
#include "support/soft_bodies.hpp"
#include "unit/hand_loop_rig.hpp"

namespace softhand::soft_mirror_test {
namespace {

using testing::hand;
using testing::kSecond;
using testing::loop_options;
using testing::skeleton_at;

constexpr double kEdge = 0.04;
const Vector3 kBelow(-0.012, -0.018 - 0.5 * kEdge - 0.001, -0.092), kFar(2, 0, 0);  // places below the fingers, or far

// Two objects of different sizes. The second one is far away unless a test moves it.
std::vector<SoftObject> objects(bool is_shared = true) {
  std::vector<SoftObject> result;
  for (const int cells : {2, 3}) {
    result.push_back(
        {.name = "cube " + std::to_string(cells),
         .body = testing::soft_box({cells, cells, cells}, Vector3::Constant(kEdge), testing::soft_material(1e5)),
         .pose = {.position = kFar + Vector3(0, cells, 0)},
         .is_shared = is_shared});
  }
  return result;
}

class SharedSoftObject : public ::testing::Test {
 protected:
  explicit SharedSoftObject(const ObjectSpring& spring = {}) : loop(model, loop_options(), {}, spring, objects()) {
    const std::vector<SoftObject> all = objects();
    for (std::size_t i = 0; i < 2; ++i) {
      copies[i].object = kFirstSoftObject + static_cast<std::uint32_t>(i);
      for (const Vector3& node : all[i].body->nodes) {
        copies[i].nodes.push_back(to_floats(node));
        copies[i].velocities.push_back({});
      }
    }
    copies[1].centre = to_wire(Vector3(kFar + Vector3(0, 1, 0)));
  }
  // A step with the wrist at a height, and the world's copy of the first object at a place.
  const HandOutput& step(double wrist_y, const Vector3& place) {
    now += 11'111'111;
    sample = skeleton_at(model, {Vector3(0, wrist_y, 0), Quaternion::Identity()}, now, ++sequence);
    copies[0].centre = to_wire(place);
    for (SoftObjectState& copy : copies) copy.stamp.sample_time = now - 5'000'000;
    HandInput input;
    input.skeleton = &sample;
    input.soft_objects = copies;
    counting = counts;
    const HandOutput& output = loop.step(now, input, {});
    counting = false;
    return output;
  }
  // The hand passes through objects in the first tenth of a second.
  void settle() {
    for (int i = 0; i < 15; ++i) step(0, kFar);
  }
  // After the holdoff the world leaves both objects in each other.
  void overlap() {
    settle();
    for (int i = 0; i < 5; ++i) step(0, kFar);
    copies[1].centre = to_wire(Vector3(kFar + Vector3(kEdge - 5e-4, 0, 0)));
    step(0, kFar);
  }
  double refused() const {
    LoopStatus status;
    loop.fill_status(status, now);
    return testing::counter_of(status, "refused_soft");
  }

  HandModel model = hand();
  HandLoop loop;
  std::vector<SoftObjectState> copies = std::vector<SoftObjectState>(2);
  Skeleton sample;
  Nanoseconds now = kSecond;
  std::uint64_t sequence = 0;
  bool counts = false;
};

TEST_F(SharedSoftObject, TheHandOwnsWhatItTouchesAndReleasesItLater) {
  const HandOutput& far = step(0, kFar);
  ASSERT_EQ(far.soft_objects.size(), 2u);
  EXPECT_EQ(far.soft_objects[0].owned, 0u);
  EXPECT_LT((to_vector(far.soft_objects[0].centre) - kFar).norm(), 1e-6) << "it is where the world has it";
  EXPECT_EQ(loop.simulation().work().soft_elements, 0u) << "nothing is near";
  settle();
  step(0, kBelow);
  EXPECT_EQ(step(0, kBelow).soft_objects[0].owned, 0u) << "it is near, but not touched";
  EXPECT_GT(loop.simulation().work().soft_elements, 0u);
  int steps_to_own = 0;
  while (step(-0.006, kBelow).soft_objects[0].owned == 0 && steps_to_own < 60) ++steps_to_own;
  EXPECT_LT(steps_to_own, 60) << "the hand must own an object that it presses";
  EXPECT_GT(loop.output().soft_objects[0].contact_count, 0u);
  const Vector3 pushed = to_vector(step(-0.006, kFar).soft_objects[0].centre);
  EXPECT_LT((pushed - kBelow).norm(), 0.05) << "the world does not move an object that the hand owns";
  int owned_steps = 0;
  while (step(0.05, kFar).soft_objects[0].owned == 1 && owned_steps < 90) ++owned_steps;
  EXPECT_GE(owned_steps, 8) << "for another tenth of a second";
  EXPECT_LT(owned_steps, 90);
  EXPECT_LT((to_vector(step(0.05, kFar).soft_objects[0].centre) - kFar).norm(), 1e-6);
  EXPECT_EQ(loop.output().soft_objects[1].owned, 0u);
  EXPECT_EQ(refused(), 0);
}

TEST_F(SharedSoftObject, TheHandOwnsTwoThatCollideUntilTheyPart) {
  constexpr double kSpeed = 0.5, kBeside = kEdge + 0.02;
  const auto move_second = [&](double distance, double speed) {
    copies[1].centre = to_wire(Vector3(kFar + Vector3(distance, 0, 0)));
    copies[1].linear_velocity = to_wire(Vector3(-speed, 0, 0));
  };
  move_second(kBeside, 0);
  settle();
  EXPECT_EQ(loop.simulation().work().soft_elements, 0u) << "two that rest beside each other do not begin to touch";
  const double period = 1.0 / 90;
  double distance = kBeside + 0.1;
  int steps = 0, simulated = 0;
  do {
    move_second(distance -= period * kSpeed, kSpeed);
    step(0, kFar);
    simulated += loop.simulation().work().soft_elements > 0 ? 1 : 0;
  } while (loop.output().soft_objects[0].owned == 0 && ++steps < 60);
  ASSERT_LT(steps, 60);
  EXPECT_EQ(loop.output().soft_objects[1].owned, 1u);
  EXPECT_GE(simulated, 2) << "the first touch is that of free objects";
  EXPECT_NEAR(distance, kEdge, 2 * period * kSpeed);
  // The world's copies have no say now. The objects part, and the world goes on with both.
  const auto momentum = [&] {
    const SoftObjects& soft = *loop.simulation().soft();
    return soft.mass(0) * loop.output().soft_objects[0].linear_velocity[0] +
           soft.mass(1) * loop.output().soft_objects[1].linear_velocity[0];
  };
  const double before = -loop.simulation().soft()->mass(1) * kSpeed;
  double after = 0;
  int owned_steps = 0;
  while (step(0, kFar).soft_objects[0].owned == 1 && owned_steps < 60) {
    after = momentum();
    ++owned_steps;
  }
  EXPECT_NEAR(after, before, 0.01 * std::abs(before));
  EXPECT_GE(owned_steps, 8) << "for another tenth of a second";
  EXPECT_LT(owned_steps, 60);
}

TEST_F(SharedSoftObject, TheHandOwnsTwoThatTheWorldLeftInEachOther) {
  overlap();
  EXPECT_EQ(loop.output().soft_objects[0].owned, 0u) << "their tissue was not simulated yet";
  step(0, kFar);
  EXPECT_GT(loop.simulation().work().soft_elements, 0u);
  EXPECT_EQ(loop.output().soft_objects[0].owned, 1u);
  EXPECT_EQ(loop.output().soft_objects[1].owned, 1u);
}

TEST_F(SharedSoftObject, AnOldCopyBesideAnotherObjectDoesNotUndoAReset) {
  overlap();
  ASSERT_EQ(step(0, kFar).soft_objects[1].owned, 1u);
  Message message;
  set_text(message.module, "hand");
  set_text(message.key, "object.reset");
  set_text(message.value, "cube 3");
  ASSERT_EQ(loop.answer(message, "hand").result, kReplyApplied);
  // The world has not put it back yet.
  for (int i = 0; i < 5; ++i) EXPECT_EQ(step(0, kFar).soft_objects[1].owned, 0u) << i;
  copies[1].centre = to_wire(Vector3(kFar + Vector3(0, 1, 0)));
  for (int i = 0; i < 30; ++i) EXPECT_EQ(step(0, kFar).soft_objects[1].owned, 0u) << i;
  EXPECT_NEAR(loop.output().soft_objects[1].centre[1], kFar.y() + 1, 1e-6);
}

TEST_F(SharedSoftObject, RefusesWhatIsWrong) {
  step(0, kFar);
  const auto refused_by = [&](auto&& spoil) {
    const SoftObjectState before = copies[0];
    spoil(copies[0]);
    const double count = refused();
    step(0, to_vector(copies[0].centre));
    copies[0] = before;
    return refused() - count;
  };
  EXPECT_EQ(refused_by([](SoftObjectState&) {}), 0);
  EXPECT_EQ(refused_by([](SoftObjectState& s) { s.object = kFirstSoftObject + 2; }), 1);
  EXPECT_EQ(refused_by([](SoftObjectState& s) { s.object = 3; }), 1);
  EXPECT_EQ(refused_by([](SoftObjectState& s) { --s.nodes.count; }), 1);
  EXPECT_EQ(refused_by([](SoftObjectState& s) { s.nodes[4][0] = std::numeric_limits<float>::quiet_NaN(); }), 1);
  EXPECT_EQ(refused_by([](SoftObjectState& s) { s.velocities[4][0] = std::numeric_limits<float>::infinity(); }), 1);
  EXPECT_EQ(refused_by([](SoftObjectState& s) { s.centre[1] = 1e6; }), 1);
  EXPECT_EQ(loop.counters().failed_steps, 0u);
}

TEST_F(SharedSoftObject, AStepAllocatesNothing) {
#ifndef SOFTHAND_COUNT_MALLOC
  GTEST_SKIP() << "the sanitizer brings its own malloc";
#endif
  settle();
  counts = true;
  for (int i = 0; i < 3; ++i) step(0, kBelow);
  int owned = 0;
  for (int i = 0; i < 60; ++i) owned += step(-0.006, kBelow).soft_objects[0].owned == 1 ? 1 : 0;
  EXPECT_GT(owned, 5);
  for (int i = 0; i < 60; ++i) step(0.05, kFar);
  EXPECT_EQ(std::exchange(allocations, 0), 0);
}

TEST_F(SharedSoftObject, ALoopThatLoadsAStateContinuesWithTheSameBits) {
  settle();
  for (int i = 0; i < 3; ++i) step(0, kBelow);
  int owned = 0, steps = 0;
  for (const int more : {3, 30}) {
    for (int i = 0; i < more; ++i) step(-0.006, kBelow);
    std::vector<std::byte> memory(4'000'000);
    ByteWriter out(memory);
    loop.save(out);
    ASSERT_FALSE(out.overflowed());
    loop.forget();
    HandLoop other(model, loop_options(), {}, {}, objects());
    ByteReader in(out.written());
    other.load(in);
    for (int i = 0; i < 40; ++i) {
      const HandOutput& one = step(i < 20 ? -0.006 : 0.05, i < 20 ? kBelow : kFar);
      HandInput input;
      input.skeleton = &sample;
      input.soft_objects = copies;
      ASSERT_EQ(plain_hash(one.soft_objects), plain_hash(other.step(now, input, {}).soft_objects)) << "step " << i;
      owned += one.soft_objects[0].owned == 1 ? 1 : 0;
      ++steps;
    }
  }
  EXPECT_GT(owned, 5);
  EXPECT_LT(owned, steps - 5);
}

// An object that is the hand's alone, without gravity. A hand presses on it from above if its wrist is low.
class OwnSoftObject : public ::testing::TestWithParam<bool> {
 protected:
  OwnSoftObject() : loop(model, loop_options(), {}, GetParam() ? ObjectSpring{20, 0.1, 1} : ObjectSpring{}, bodies()) {}
  static std::vector<SoftObject> bodies() {
    std::vector<SoftObject> all = objects(false);
    all[0].pose.position = kBelow;
    return all;
  }
  const SoftObjectState& step(double wrist_y, const WorldObjects* world = nullptr) {
    now += 11'111'111;
    sample = skeleton_at(model, {Vector3(0, wrist_y, 0), Quaternion::Identity()}, now, ++sequence);
    return loop.step(now, {&sample, nullptr, world}, {}).soft_objects[0];
  }
  // A sample of a world with one object, which is far away.
  WorldObjects world() const { return testing::world_with(7, -kFar, now); }
  ObjectDescription table() const {
    ObjectDescription description = testing::cube(7);
    description.is_static = 1;
    return description;
  }

  HandModel model = hand();
  HandLoop loop;
  Skeleton sample;
  Nanoseconds now = kSecond;
  std::uint64_t sequence = 0;
};

TEST_P(OwnSoftObject, WaitsForTheWorld) {
  for (int i = 0; i < 90; ++i) ASSERT_EQ(step(0).owned, 0u) << "no world";
  EXPECT_LT((to_vector(step(0).centre) - kBelow).norm(), 1e-6);
  WorldObjects far = world();
  EXPECT_EQ(step(0, &far).owned, 0u) << "its table is not described yet";
  loop.describe_object(table());
  EXPECT_EQ(step(0).owned, 0u) << "the place of the table is not known yet";
  far = world();
  EXPECT_EQ(step(0, &far).owned, 1u);
  EXPECT_EQ(step(0).owned, 1u);
  loop.reset(now);
  EXPECT_EQ(step(0).owned, 0u);
  far = world();
  EXPECT_EQ(step(0, &far).owned, 1u);
  Message message;
  set_text(message.module, "hand");
  set_text(message.key, "object.reset");
  set_text(message.value, "cube 2");
  ASSERT_EQ(loop.answer(message, "hand").result, kReplyApplied);
  EXPECT_EQ(step(0).owned, 1u) << "the world is known";
}

TEST_P(OwnSoftObject, WaitsOnlyUntilAHandTouchesIt) {
  for (int i = 0; i < 15; ++i) ASSERT_EQ(step(0).owned, 0u);
  int steps = 0;
  while (step(-0.006).owned == 0 && steps < 60) ++steps;
  EXPECT_LT(steps, 60);
  for (int i = 0; i < 30; ++i) step(-0.006);
  EXPECT_LT(to_vector(step(-0.006).centre).y(), kBelow.y() - 1e-3) << "nothing holds it";
}

INSTANTIATE_TEST_SUITE_P(Modes, OwnSoftObject, ::testing::Values(false, true),
                         [](const auto& symmetric) { return symmetric.param ? "symmetric" : "ownership"; });

// Mode symmetric: a spring to the world's copy pulls the object, and nobody owns it.
class CoupledSoftObject : public SharedSoftObject {
 protected:
  CoupledSoftObject() : SharedSoftObject({20, 0.1, 1}) {}
};

TEST_F(CoupledSoftObject, FollowsItsCopyAndStaysWhereItIsWithoutOne) {
  step(0, kFar);
  for (int i = 1; i <= 100; ++i) step(0, kFar + Vector3(1e-3 * i, 0, 0));
  counts = true;
  for (int i = 0; i < 100; ++i) step(0, kFar + Vector3(0.1, 0, 0));
  counts = false;
#ifdef SOFTHAND_COUNT_MALLOC
  EXPECT_EQ(std::exchange(allocations, 0), 0);
#endif
  EXPECT_EQ(loop.output().soft_objects[0].owned, 0u);
  EXPECT_LT((to_vector(loop.output().soft_objects[0].centre) - kFar - Vector3(0.1, 0, 0)).norm(), 1e-4);
  // The world falls silent. Gravity acts in the world alone.
  for (int i = 0; i < 50; ++i) {
    now += 11'111'111;
    sample = skeleton_at(model, {}, now, ++sequence);
    loop.step(now, {&sample}, {});
  }
  EXPECT_LT((to_vector(loop.output().soft_objects[0].centre) - kFar - Vector3(0.1, 0, 0)).norm(), 1e-3);
}

}  // namespace
}  // namespace softhand::soft_mirror_test
