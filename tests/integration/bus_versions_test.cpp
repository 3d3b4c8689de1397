// Two versions of a topic beside each other, as docs/topics.md describes it under "Change a topic".
#include <gtest/gtest.h>

#include "bus/bus.hpp"
#include "integration/bus_harness.hpp"

namespace softhand::bus::bus_versions_test {
/// A later device_state. It tells the temperature of each actuator, too.
struct DeviceState2 {
  std::uint32_t device = 0;
  HandKey hand;
  Stamp stamp;
  BoundedVector<double, kMaxActuators> commands;
  BoundedVector<double, kMaxActuators> temperatures;
};
template <typename V, Is<DeviceState2> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("device", m.device);
  v.field("hand", m.hand);
  v.field("stamp", m.stamp);
  v.field("commands", m.commands);
  v.field("temperatures", m.temperatures);
}

namespace {

Topic<DeviceState2> second_version() {
  Topic<DeviceState2> topic{TopicRow(topics::device_state)};
  topic.name = "softhand/v2/device_state";
  topic.type = "softhand::v2::DeviceState2";
  return topic;
}

TEST(Bus, TwoVersionsOfATopicRunBesideEachOther) {
  ::testing::internal::CaptureStderr();
  {
    const Participant writing("writing", testing::own_domain()), later("later", testing::own_domain());
    Writer<DeviceState> first(writing, topics::device_state);
    Writer<DeviceState2> second(writing, second_version());
    Reader<DeviceState2> later_reader(later, second_version());
    ASSERT_TRUE(eventually([&] { return second.has_readers() && later_reader.writer_count() == 1; }));
    EXPECT_FALSE(first.has_readers()) << "nobody reads the old version, so it need not be written";

    const Participant older("older", testing::own_domain());
    Reader<DeviceState> older_reader(older, topics::device_state);
    ASSERT_TRUE(eventually([&] { return first.has_readers() && older_reader.writer_count() == 1; }));
    EXPECT_EQ(second.reader_count(), 1) << "the old reader does not read the new version";

    const auto old_sample = stamped<DeviceState>(1, true), old_got = std::make_unique<DeviceState>();
    const auto new_sample = stamped<DeviceState2>(2, true), new_got = std::make_unique<DeviceState2>();
    EXPECT_TRUE(eventually([&] {
      first.write(*old_sample);
      return older_reader.wait(100ms) && older_reader.take_latest(*old_got);
    }));
    EXPECT_TRUE(eventually([&] {
      second.write(*new_sample);
      return later_reader.wait(100ms) && later_reader.take_latest(*new_got);
    }));
    EXPECT_EQ(bytes_of(*old_got), bytes_of(*old_sample));
    EXPECT_EQ(bytes_of(*new_got), bytes_of(*new_sample));
    for (const ReaderCounters& counters : {older_reader.counters(), later_reader.counters()}) {
      EXPECT_EQ(counters.refused, 0u);
      EXPECT_EQ(counters.second_writer, 0u) << "the versions are two topics, not two writers of one";
    }
  }
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "") << "a version reported the other";
}

// A new version keeps all properties of its row.
TEST(Bus, LastSampleOfANewVersionArrives) { expect_last_samples_arrive(second_version()); }

}  // namespace
}  // namespace softhand::bus::bus_versions_test
