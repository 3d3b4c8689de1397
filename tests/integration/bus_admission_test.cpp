// What a reader refuses: malformed samples, other definitions of a type, crowds of instances, wrong stamps.
#include <gtest/gtest.h>

#include <algorithm>

#include "bus/bus.hpp"
#include "integration/bus_harness.hpp"
#include "messages/convert.hpp"

namespace softhand::bus::bus_admission_test {
/// device_state as sent by a writer with a larger bound.
struct LongDeviceState {
  std::uint32_t device = 0;
  HandKey hand;
  Stamp stamp;
  std::array<std::uint32_t, 5> numbers{};
  BoundedVector<double, kMaxActuators + 1> commands;
};
template <typename V, Is<LongDeviceState> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("device", m.device);
  v.field("hand", m.hand);
  v.field("stamp", m.stamp);
  v.field("numbers", m.numbers);
  v.field("commands", m.commands);
}
/// device_state as sent by a writer that knows no commands.
struct ShortDeviceState {
  std::uint32_t device = 0;
  HandKey hand;
  Stamp stamp;
};
template <typename V, Is<ShortDeviceState> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("device", m.device);
  v.field("hand", m.hand);
  v.field("stamp", m.stamp);
}

namespace {

TEST(Bus, MalformedSamplesAreRefusedAndCounted) {
  const Participant here("here", testing::own_domain());
  const Participant there("there", testing::own_domain());
  Writer writer(here, Topic<LongDeviceState>{TopicRow(topics::device_state)});
  Reader reader(there, topics::device_state);
  ASSERT_TRUE(eventually([&] { return writer.has_readers() && reader.writer_count() == 1; }));
  LongDeviceState state;
  for (std::size_t i = 0; i < kMaxActuators + 1; ++i) state.commands.push_back(1);
  DeviceState out;
  ASSERT_TRUE(eventually([&] {
    writer.write(state);
    EXPECT_FALSE(reader.take_latest(out));
    return reader.counters().refused > 0;
  }));
  EXPECT_EQ(reader.counters().received, 0u);
  state.commands.count = kMaxActuators;  // the same bytes as a valid sample
  ASSERT_TRUE(eventually([&] {
    writer.write(state);
    return reader.take_latest(out);
  }));
  EXPECT_EQ(out.commands.size(), kMaxActuators);

  Writer proper(here, topics::contacts);
  auto contacts = std::make_unique<Contacts>();
  contacts->contacts.count = kMaxContacts + 1;
  proper.write(*contacts);
  EXPECT_EQ(proper.counters().failed, 1u);
}

// A program of another version writes the same key.
TEST(Bus, MalformedSamplesDoNotDisplaceGoodOnes) {
  const Participant own("own", testing::own_domain()), foreign("foreign", testing::own_domain()),
      here("here", testing::own_domain());
  Writer writer(own, topics::device_state);
  Writer intruder(foreign, Topic<ShortDeviceState>{TopicRow(topics::device_state)});
  Reader reader(here, topics::device_state);
  ASSERT_TRUE(eventually([&] { return reader.writer_count() == 2 && writer.has_readers() && intruder.has_readers(); }));
  DeviceState state;
  int heard = 0;
  for (int round = 0; round < 20; ++round) {
    const std::uint64_t before = reader.counters().refused;
    state.stamp.publish_time = state.stamp.sample_time = now();
    writer.write(state);
    std::this_thread::sleep_for(5ms);
    intruder.write({});
    EXPECT_TRUE(eventually([&] { return reader.counters().refused > before; }));
    heard += reader.take_latest(state) ? 1 : 0;
  }
  EXPECT_GE(heard, 15);  // best effort may lose a sample on a busy machine
  EXPECT_EQ(reader.counters().second_writer, 0u);
}

TEST(Bus, AnotherDefinitionOfATypeIsReportedOnceByBothSides) {
  ::testing::internal::CaptureStderr();
  {
    const Participant here("here", testing::own_domain()), there("there", testing::own_domain());
    const Topic<LongDeviceState> other{TopicRow(topics::device_state)};
    Writer first(here, other), second(here, other);
    Reader<DeviceState> reader(there, topics::device_state);
    Writer<DeviceState> also(there, topics::device_state);
    Writer same(here, topics::contacts);
    Reader<Contacts> contacts(there, topics::contacts);
    EXPECT_TRUE(eventually([&] { return reader.writer_count() == 3 && same.has_readers(); }));
    std::this_thread::sleep_for(100ms);
  }
  const std::string log = ::testing::internal::GetCapturedStderr();
  const std::string what = ": topic softhand/v1/device_state: module ";
  EXPECT_EQ(lines_with(log, "here" + what + "there has another definition"), 1) << log;
  EXPECT_EQ(lines_with(log, "there" + what + "here has another definition"), 1) << log;
  EXPECT_EQ(lines_with(log, "definition"), 2) << log;
}

// The list of other endpoints is limited, so it must forget those that left.
TEST(Bus, EndpointsThatLeftAreForgotten) {
  const Participant here("here", testing::own_domain()), there("there", testing::own_domain());
  const Topic<LongDeviceState> other{TopicRow(topics::device_state)};
  ::testing::internal::CaptureStderr();
  {
    Reader<DeviceState> reader(there, topics::device_state);
    for (int i = 0; i < 2; ++i) {
      {
        Writer<LongDeviceState> writer(here, other);
        EXPECT_TRUE(eventually([&] { return reader.writer_count() == 1; }));
        std::this_thread::sleep_for(100ms);
      }
      EXPECT_TRUE(eventually([&] { return reader.writer_count() == 0; }));
    }
  }
  const std::string log = ::testing::internal::GetCapturedStderr();
  EXPECT_EQ(lines_with(log, "there: topic softhand/v1/device_state: module here has another definition"), 2) << log;
}

constexpr std::uint64_t kOwnEpoch = 7;

// A foreign process writes many instances before ours writes its first sample, and goes on. Returns how many of our 20
// samples arrive.
template <typename T, typename SetKey>
int heard_beside_a_crowd(const Topic<T>& topic, SetKey set_key, auto... only) {
  const Participant foreign("foreign", testing::own_domain()), own("own", testing::own_domain()),
      here("reader", testing::own_domain());
  Writer<T> intruder(foreign, topic), writer(own, topic);
  Reader<T> reader(here, topic, only...);
  EXPECT_TRUE(eventually([&] { return reader.writer_count() == 2 && intruder.has_readers() && writer.has_readers(); }));
  auto sample = std::make_unique<T>();
  int heard = 0;
  const auto take = [&] { reader.take_all([&](const T& each) { heard += each.stamp.epoch == kOwnEpoch ? 1 : 0; }); };
  for (int round = 0; round < 20; ++round) {
    sample->stamp.epoch = 1;
    for (int key = 1; key <= 100; ++key) {
      set_key(*sample, key);
      intruder.write(*sample);
      if (key % 8 == 0) std::this_thread::sleep_for(1ms);
      take();
    }
    std::this_thread::sleep_for(5ms);
    sample->stamp.epoch = kOwnEpoch;
    set_key(*sample, 0);
    writer.write(*sample);
    std::this_thread::sleep_for(5ms);
    take();
  }
  return heard;
}

TEST(Bus, ForeignInstancesLeaveRoomForOurs) {
  const auto of_user = [](auto& message, int number) { message.hand = user(number); };
  const auto of_module = [](LoopStatus& status, int number) { set_text(status.module, "m" + std::to_string(number)); };
  // Best effort may lose a sample on a busy machine. A reader that is full hears none.
  EXPECT_GE(heard_beside_a_crowd(topics::object_coupling, of_user), 15);
  EXPECT_GE(heard_beside_a_crowd(topics::loop_status, of_module), 15);
  EXPECT_GE(heard_beside_a_crowd(topics::tracked_skeleton, of_user, user(0)), 15);
  EXPECT_GE(heard_beside_a_crowd(topics::simulated_skeleton, of_user, user(0)), 15);
}

TEST(Bus, StampsOfTheFutureAndOfOtherHostsAreRefused) {
  const Participant writing("writing", testing::own_domain()), reading("reading", testing::own_domain());
  Writer writer(writing, topics::object_coupling);
  Reader reader(reading, topics::object_coupling);
  ASSERT_TRUE(eventually([&] { return writer.has_readers() && reader.writer_count() == 1; }));
  auto sample = std::make_unique<ObjectCoupling>();
  std::size_t heard = 0;
  const auto write = [&](Nanoseconds ahead, std::uint32_t clock) {
    sample->stamp.sample_time = sample->stamp.publish_time = now() + ahead;
    sample->stamp.clock_id = clock;
    writer.write(*sample);
    std::this_thread::sleep_for(2ms);
    heard += reader.take_all([](const ObjectCoupling&) {});
  };
  for (int i = 0; i < 20; ++i) write(3'600'000'000'000, 0), write(0, clock_id() + 1);
  EXPECT_EQ(heard, 0u);
  EXPECT_TRUE(eventually([&] { return reader.counters().refused_stamp == 40; }));
  EXPECT_TRUE(eventually([&] {
    write(0, clock_id());
    return heard > 0;
  }));
}

// The stamp of a device may be anything, but only on the clock of this host.
TEST(Bus, TrackersOfHostsWithAnUnknownClockAreRefused) {
  const Participant writing("writing", testing::own_domain()), reading("reading", testing::own_domain());
  Writer writer(writing, topics::tracked_skeleton);
  Reader reader(reading, topics::tracked_skeleton, HandKey{0, 1});
  ASSERT_TRUE(eventually([&] { return writer.has_readers() && reader.writer_count() == 1; }));
  Skeleton sample;
  const auto write = [&](std::uint32_t clock) {
    sample.stamp.clock_id = clock;
    writer.write(sample);
    std::this_thread::sleep_for(2ms);
  };
  Skeleton out;
  for (int i = 0; i < 20; ++i) write(clock_id() + 1);
  EXPECT_TRUE(eventually([&] { return reader.counters().refused_stamp == 20; }));
  EXPECT_FALSE(reader.take_latest(out));
  EXPECT_TRUE(eventually([&] {
    write(clock_id());
    return reader.take_latest(out);
  }));
}

TEST(Bus, InstancesThatRestMakeRoom) {
  const Participant writing("writing", testing::own_domain()), reading("reading", testing::own_domain());
  // A writer refuses more instances than the topic has, so the crowd has two.
  Writer<ObjectCoupling> writers[] = {
      {writing, topics::object_coupling}, {writing, topics::object_coupling}, {writing, topics::object_coupling}};
  Reader reader(reading, topics::object_coupling);
  ASSERT_TRUE(eventually([&] {
    return std::all_of(std::begin(writers), std::end(writers), [](auto& each) { return each.has_readers(); }) &&
           reader.writer_count() == 3;
  }));
  auto sample = std::make_unique<ObjectCoupling>();
  const auto write = [&](std::uint64_t epoch, int number) {
    Writer<ObjectCoupling>& writer = writers[epoch == kOwnEpoch ? 0 : epoch];
    sample->stamp.epoch = epoch;
    sample->hand = user(number);
    writer.write(*sample);
    std::this_thread::sleep_for(1ms);
  };
  const auto heard = [&](std::uint64_t epoch) {
    std::size_t count = 0;
    reader.take_all([&](const ObjectCoupling& each) { count += each.stamp.epoch == epoch ? 1 : 0; });
    return count;
  };
  const auto fill = [&] {
    for (int i = 0; i < topics::kHands; ++i) write(1, 100 + i), write(2, 200 + i);
  };
  fill();
  std::size_t first = 0;
  EXPECT_TRUE(eventually([&] { return (first += heard(2)) == topics::kHands; })) << first;
  fill();
  write(kOwnEpoch, 0);
  std::this_thread::sleep_for(50ms);
  EXPECT_EQ(heard(kOwnEpoch), 0u);
  EXPECT_EQ(reader.counters().crowded, 1u) << "the room is full of instances that are used";
  std::this_thread::sleep_for(1100ms);
  EXPECT_TRUE(eventually([&] {
    write(kOwnEpoch, 0);
    return heard(kOwnEpoch) > 0;
  }));
}

// A flood must not hold a loop. Here each taken sample leads to a new one.
TEST(Bus, OneTakeEndsAlthoughSamplesGoOn) {
  const Participant writing("writing", testing::own_domain()), reading("reading", testing::own_domain());
  Writer writer(writing, topics::object_coupling);
  Reader reader(reading, topics::object_coupling);
  ASSERT_TRUE(eventually([&] { return writer.has_readers() && reader.writer_count() == 1; }));
  auto sample = std::make_unique<ObjectCoupling>();
  const auto write = [&] {
    writer.write(*sample);
    std::this_thread::sleep_for(2ms);
  };
  ASSERT_TRUE(eventually([&] {
    write();
    return reader.wait(50ms);
  }));
  std::size_t calls = 0;
  const auto take = [&] {
    reader.take_all([&](const ObjectCoupling&) {
      if (++calls > 1000) throw std::runtime_error("no end");
      write();
    });
  };
  EXPECT_NO_THROW(take());
  EXPECT_GT(calls, 0u);
}

}  // namespace
}  // namespace softhand::bus::bus_admission_test
