// Several writers of one topic: trackers of different strength, and state that has one writer.
#include <gtest/gtest.h>

#include <algorithm>

#include "bus/bus.hpp"
#include "integration/bus_harness.hpp"
#include "messages/convert.hpp"

namespace softhand::bus::bus_writers_test {
namespace {

TEST(Bus, StrongerTrackerOwnsUntilItDies) {
  const Participant here("here", testing::own_domain());
  Reader reader(here, topics::tracked_skeleton, HandKey{0, 1});
  const std::string domain = std::to_string(testing::own_domain());
  Skeleton skeleton;
  Child weak({BUS_PUBLISHER, domain, "1"});
  ASSERT_TRUE(eventually([&] { return reader.take_latest(skeleton) && skeleton.source == 1; }));
  Child strong({BUS_PUBLISHER, domain, "2"});
  ASSERT_TRUE(eventually([&] { return reader.take_latest(skeleton) && skeleton.source == 2; }));
  ASSERT_TRUE(eventually([&] { return reader.live_writer_count() == 2; }));
  // From here on only the strong tracker is heard. (A loaded machine may starve it for 50 ms. Then the weak tracker
  // rightly takes over for a moment.)
  int of_weak = 0;
  int of_strong = 0;
  for (const auto end = Clock::now() + 500ms; Clock::now() < end; std::this_thread::sleep_for(1ms))
    if (reader.take_latest(skeleton)) ++(skeleton.source == 2 ? of_strong : of_weak);
  EXPECT_GT(of_strong, 10);
  EXPECT_LT(of_weak, of_strong);

  strong.kill_now();
  const auto death = Clock::now();
  ASSERT_TRUE(eventually([&] { return reader.take_latest(skeleton) && skeleton.source == 1; }));
  std::printf("handover after %.1f ms\n", std::chrono::duration<double, std::milli>(Clock::now() - death).count());
  EXPECT_TRUE(eventually([&] { return reader.live_writer_count() == 1; }));

  weak.kill_now();
  EXPECT_TRUE(eventually([&] { return reader.live_writer_count() == 0; }));
  EXPECT_TRUE(eventually([&] { return reader.counters().deadline_missed > 0; }));
  Child again({BUS_PUBLISHER, domain, "3"});
  const auto start = Clock::now();
  ASSERT_TRUE(eventually([&] { return reader.take_latest(skeleton) && skeleton.source == 3; }));
  std::printf("restart heard after %.1f ms\n", std::chrono::duration<double, std::milli>(Clock::now() - start).count());
}

TEST(Bus, WeakerTrackerErasesNoSamplesOfTheOwner) {
  const Participant here("here", testing::own_domain());
  const Participant there("there", testing::own_domain());
  Reader reader(here, topics::tracked_skeleton, HandKey{0, 1});
  Writer strong(there, topics::tracked_skeleton, 2);
  Writer weak(there, topics::tracked_skeleton, 1);
  ASSERT_TRUE(
      eventually([&] { return reader.live_writer_count() == 2 && strong.has_readers() && weak.has_readers(); }));
  Skeleton skeleton;
  const auto send = [&skeleton](auto& writer, std::uint32_t source) {
    skeleton.source = source;
    writer.write(skeleton);
    std::this_thread::sleep_for(2ms);
  };
  // The reader is as slow as a hand at 90 Hz. So samples of the weak tracker always arrive between a sample of the
  // strong tracker and its reading.
  int of_strong = 0;
  for (int i = 0; i < 100; ++i) {
    send(strong, 2);
    for (int k = 0; k < 3; ++k) send(weak, 1);
    Skeleton out;
    if (reader.take_latest(out) && out.source == 2) ++of_strong;
  }
  EXPECT_GT(of_strong, 80);
}

TEST(Bus, AWriterThatBecomesStrongerTakesOver) {
  const Participant here("here", testing::own_domain());
  const Participant there("there", testing::own_domain()), elsewhere("elsewhere", testing::own_domain());
  Reader reader(here, topics::tracked_skeleton, HandKey{0, 1});
  Writer first(there, topics::tracked_skeleton, 2);
  Writer second(elsewhere, topics::tracked_skeleton, 1);
  ASSERT_TRUE(
      eventually([&] { return reader.live_writer_count() == 2 && first.has_readers() && second.has_readers(); }));
  Skeleton skeleton, out;
  // True if only `source` is heard for 200 ms, at most 2 s from now.
  const auto is_owner = [&](std::uint32_t source) {
    int alone = 0;
    for (int i = 0; i < 200 && alone < 20; ++i) {
      skeleton.source = 1;
      first.write(skeleton);
      skeleton.source = 2;
      second.write(skeleton);
      std::this_thread::sleep_for(10ms);
      while (reader.take_latest(out)) alone = out.source == source ? alone + 1 : 0;
    }
    return alone >= 20;
  };
  EXPECT_TRUE(is_owner(1));
  second.set_strength(3);
  EXPECT_TRUE(is_owner(2));
  second.set_strength(1);
  EXPECT_TRUE(is_owner(1));
  first.set_strength(0);
  EXPECT_TRUE(is_owner(2));
}

TEST(Bus, NegativeStrengthIsWeakerThanAPositiveOne) {
  const Participant here("here", testing::own_domain());
  Reader reader(here, topics::tracked_skeleton, HandKey{0, 1});
  const std::string domain = std::to_string(testing::own_domain());
  Skeleton skeleton;
  Child negative({BUS_PUBLISHER, domain, "-1"});
  ASSERT_TRUE(eventually([&] { return reader.take_latest(skeleton); }));
  Child strong({BUS_PUBLISHER, domain, "1"});
  EXPECT_TRUE(eventually([&] { return reader.take_latest(skeleton) && skeleton.source == 1; }));
}

// Two writers of one key. Returns the epochs of the samples that a reader gets while both write, each change once, and
// then those after the first writer has stopped.
struct Heard {
  std::vector<std::uint64_t> both, later;
  std::uint64_t refused = 0;  // samples of a second writer
  std::string second_writer;
};
template <typename T>
Heard heard_of_two_writers(const Topic<T>& topic) {
  const Participant first("first", testing::own_domain()), second("second", testing::own_domain()),
      reading("reading", testing::own_domain());
  Writer<T> writers[] = {{first, topic}, {second, topic}};
  Reader<T> reader(reading, topic);
  EXPECT_TRUE(
      eventually([&] { return reader.writer_count() == 2 && writers[0].has_readers() && writers[1].has_readers(); }));
  auto sample = std::make_unique<T>();
  const auto write = [&](std::size_t writer) {
    sample->stamp.epoch = writer + 1;
    ++sample->stamp.sequence;
    sample->stamp.publish_time = sample->stamp.sample_time = now();
    writers[writer].write(*sample);
    std::this_thread::sleep_for(2ms);
  };
  const auto take = [&](std::vector<std::uint64_t>& epochs) {
    reader.take_all([&](const T& each) {
      if (epochs.empty() || epochs.back() != each.stamp.epoch) epochs.push_back(each.stamp.epoch);
    });
  };
  Heard heard;
  EXPECT_TRUE(eventually([&] {
    write(0);
    take(heard.both);
    return !heard.both.empty();
  }));
  for (int i = 0; i < 50; ++i) write(0), write(1), take(heard.both);
  for (const auto end = Clock::now() + 400ms; Clock::now() < end;) write(1), take(heard.later);
  heard.refused = reader.counters().second_writer;
  heard.second_writer = get_text(reading.second_writer());
  return heard;
}

TEST(Bus, AReaderNeverFollowsTwoWritersInTurn) {
  topics::for_each([&]<typename T>(const Topic<T>& topic) {
    if (topic.writers != Writers::one) return;
    const Heard heard = heard_of_two_writers(topic);
    EXPECT_EQ(heard.both, std::vector<std::uint64_t>{1}) << topic.name;
    EXPECT_EQ(heard.later, std::vector<std::uint64_t>{2}) << topic.name << ": the place of a dead writer is free";
    EXPECT_GT(heard.refused, 40u) << topic.name;
    EXPECT_NE(heard.second_writer.find(": unknown, epoch 0000000000000002"), std::string::npos) << heard.second_writer;
  });
}

TEST(Bus, EveryStateTopicHasOneWriter) {
  EXPECT_EQ(topics::tracked_skeleton.writers, Writers::strongest);
  for (const TopicRow& row :
       {TopicRow(topics::intermediate_skeleton), TopicRow(topics::simulated_skeleton), TopicRow(topics::objects),
        TopicRow(topics::object_coupling), TopicRow(topics::bone_wrench), TopicRow(topics::head_pose)})
    EXPECT_EQ(row.writers, Writers::one) << row.name;
}

}  // namespace
}  // namespace softhand::bus::bus_writers_test
