// Descriptions leave the world's loop through a thread of their own.
#include <gtest/gtest.h>

#include <atomic>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "support/count_allocations.hpp"
#include "world/description_changes.hpp"
#include "world_objects.hpp"

namespace softhand::world_descriptions_test {
namespace {

using test::cube;
using test::table;

struct Written {
  std::string name;
  std::uint32_t removed;
  Nanoseconds time;
  std::uint64_t sequence;
  std::thread::id thread;
};

class WorldDescriptions : public ::testing::Test {
 protected:
  static JointOptions hinge() {
    JointOptions joint;
    joint.name = "hinge";
    joint.parent = "table";
    joint.child = "cube";
    return joint;
  }
  void tell(const char* key, const char* value) {
    Message message;
    set_text(message.module, "world");
    set_text(message.key, key);
    set_text(message.value, value);
    ASSERT_EQ(world_.answer(message).result, kReplyApplied);
  }
  template <typename Description>
  void keep(const Description& description) {
    while (held_) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    const std::lock_guard lock(mutex_);
    written_.push_back({std::string(get_text(description.name)), description.removed, description.stamp.sample_time,
                        description.stamp.sequence, std::this_thread::get_id()});
  }
  // The descriptions that were written since the last call, after `count` of them have come.
  std::vector<Written> take(std::size_t count) {
    for (int i = 0; i < 10000; ++i) {
      {
        const std::lock_guard lock(mutex_);
        if (written_.size() >= count) return std::exchange(written_, {});
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return {};
  }

  WorldLoop world_{{}, {table(), cube(0.05, 0.02)}, 1.0 / 90, {hinge()}};
  std::atomic<bool> held_ = false;
  std::mutex mutex_;
  std::vector<Written> written_;
  DescriptionChanges changes_{world_, [this](ObjectDescription& each) { keep(each); },
                              [this](ObjectJointDescription& each) { keep(each); }};
};

TEST_F(WorldDescriptions, AreWrittenByAnotherThreadObjectsFirstAndOnlyThoseThatChanged) {
  const std::vector<Written> first = take(3);
  ASSERT_EQ(first.size(), 3u);
  EXPECT_EQ(first[0].name, "table");
  EXPECT_EQ(first[1].name, "cube");
  EXPECT_EQ(first[2].name, "hinge");
  for (const Written& each : first) {
    EXPECT_EQ(each.time, 0);
    EXPECT_NE(each.thread, std::this_thread::get_id());
  }
  changes_.pass_on(world_, 4'000'000);
  tell("object.remove", "cube");
  changes_.pass_on(world_, 8'000'000);
  std::vector<Written> changed = take(2);
  ASSERT_EQ(changed.size(), 2u);
  EXPECT_EQ(changed[0].name, "cube");
  EXPECT_EQ(changed[1].name, "hinge");
  for (const Written& each : changed) {
    EXPECT_EQ(each.removed, 1u);
    EXPECT_EQ(each.time, 8'000'000);
    EXPECT_GT(each.sequence, first[2].sequence);
  }
  tell("object.reset", "cube");
  changes_.pass_on(world_, 12'000'000);
  changed = take(2);
  ASSERT_EQ(changed.size(), 2u);
  for (const Written& each : changed) EXPECT_EQ(each.removed, 0u);
}

TEST_F(WorldDescriptions, TheLoopDoesNotWaitForTheWriterAndLosesNoChange) {
  take(3);
  held_ = true;  // as a full socket would
  Nanoseconds time = 0;
  for (int i = 0; i < 50; ++i) {
    tell("object.remove", "cube");
    changes_.pass_on(world_, time += 4'000'000);
    tell("object.reset", "cube");
    counting = true;
    changes_.pass_on(world_, time += 4'000'000);
    counting = false;
    EXPECT_EQ(allocations, 0);
  }
  tell("object.remove", "cube");
  changes_.pass_on(world_, time += 4'000'000);
  held_ = false;
  bool cube_removed = false, hinge_removed = false;
  for (int i = 0; i < 10000 && !(cube_removed && hinge_removed); ++i) {
    changes_.pass_on(world_, time += 4'000'000);
    for (const Written& each : take(0)) (each.name == "cube" ? cube_removed : hinge_removed) = each.removed != 0;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_TRUE(cube_removed);
  EXPECT_TRUE(hinge_removed);
}

}  // namespace
}  // namespace softhand::world_descriptions_test
