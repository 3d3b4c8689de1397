// The bus over real DDS: what arrives, and who is there.
#include "bus/bus.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <stdexcept>
#include <string>

#include "bus/qos.hpp"
#include "integration/bus_harness.hpp"
#include "messages/convert.hpp"
#include "support/wall_clock.hpp"

namespace softhand::bus::bus_test {
namespace {

TEST(Bus, EveryTopicCarriesEveryField) {
  const Participant here("here", testing::own_domain());
  const Participant there("there", testing::own_domain());
  topics::for_each([&]<typename T>(const Topic<T>& topic) {
    SCOPED_TRACE(topic.name);
    Writer writer(here, topic, 1);
    Reader reader(there, topic);
    ASSERT_TRUE(eventually([&] { return writer.has_readers() && reader.live_writer_count() == 1; }));
    EXPECT_EQ(reader.writer_count(), 1);
    for (std::uint64_t seed = 1; seed <= 2; ++seed) {
      const auto sent = stamped<T>(seed, seed == 2);
      const auto got = std::make_unique<T>();
      // A best-effort sample of many packets may be lost on a busy machine.
      ASSERT_TRUE(eventually([&] {
        writer.write(*sent);
        return reader.wait(100ms) && reader.take_latest(*got) && bytes_of(*got) == bytes_of(*sent);
      }));
    }
    EXPECT_EQ(writer.counters().failed, 0u);
    EXPECT_GE(writer.counters().written, 2u);
    EXPECT_GE(reader.counters().received, 2u);
    EXPECT_EQ(reader.counters().refused, 0u);
  });
}

TEST(Bus, WriterKnowsWhetherItHasReaders) {
  const Participant here("here", testing::own_domain());
  const Participant there("there", testing::own_domain());
  Writer writer(here, topics::contacts);
  std::this_thread::sleep_for(200ms);
  EXPECT_FALSE(writer.has_readers());
  {
    const Reader reader(there, topics::contacts);
    EXPECT_TRUE(eventually([&] { return writer.has_readers(); }));
  }
  EXPECT_TRUE(eventually([&] { return !writer.has_readers(); }));
}

TEST(Bus, TakeLatestGivesTheNewestOnce) {
  const Participant here("here", testing::own_domain());
  const Participant there("there", testing::own_domain());
  Writer writer(here, topics::bone_wrench);
  Reader reader(there, topics::bone_wrench, HandKey{0, 1});
  BoneWrench out;
  EXPECT_FALSE(reader.take_latest(out));
  EXPECT_FALSE(reader.wait(10ms));
  ASSERT_TRUE(eventually([&] { return writer.has_readers() && reader.writer_count() == 1; }));
  BoneWrench wrench;
  for (wrench.stamp.sequence = 1; wrench.stamp.sequence <= 20; ++wrench.stamp.sequence) writer.write(wrench);
  ASSERT_TRUE(eventually([&] { return reader.take_latest(out) && out.stamp.sequence == 20; }));
  EXPECT_FALSE(reader.take_latest(out));
}

TEST(Bus, LastSampleOfADepartingWriterArrives) { expect_last_samples_arrive(topics::device_state); }

TEST(Bus, ReaderOfOneHandIgnoresOtherHands) {
  const Participant here("here", testing::own_domain());
  const Participant there("there", testing::own_domain());
  Writer writer(here, topics::simulated_skeleton);
  Reader left(there, topics::simulated_skeleton, HandKey{0, 0});
  Reader all(there, topics::simulated_skeleton);
  ASSERT_TRUE(eventually([&] { return left.writer_count() == 1 && all.writer_count() == 1 && writer.has_readers(); }));
  Skeleton skeleton;
  std::map<std::uint32_t, int> sides;
  ASSERT_TRUE(eventually([&] {
    for (std::uint32_t side : {0u, 1u}) {
      skeleton.hand = {0, side};
      writer.write(skeleton);
    }
    std::this_thread::sleep_for(5ms);
    all.take_all([&](const Skeleton& s) { ++sides[s.hand.side]; });
    return sides[0] > 0 && sides[1] > 0;
  }));
  Skeleton out;
  out.hand.side = 7;
  ASSERT_TRUE(eventually([&] { return left.take_latest(out); }));
  EXPECT_EQ(out.hand.side, 0u);
}

TEST(Bus, LateReadersGetEveryDescription) {
  const Participant here("here", testing::own_domain());
  Writer objects(here, topics::object_description);
  Writer hands(here, topics::hand_description);
  for (std::uint32_t id = 1; id <= 200; ++id) {
    auto description = stamped<ObjectDescription>(id);
    description->object = id;
    objects.write(*description);
  }
  const auto hand = stamped<HandDescription>(1, true);  // 1.1 MB
  hands.write(*hand);

  const Participant there("there", testing::own_domain());
  Reader late_objects(there, topics::object_description);
  Reader late_hands(there, topics::hand_description);
  std::map<std::uint32_t, std::vector<std::byte>> got;
  ASSERT_TRUE(eventually([&] {
    late_objects.take_all([&](const ObjectDescription& d) { got[d.object] = bytes_of(d); });
    return got.size() == 200;
  }));
  for (std::uint32_t id = 1; id <= 200; ++id) {
    auto description = stamped<ObjectDescription>(id);
    description->object = id;
    EXPECT_EQ(got[id], bytes_of(*description)) << id;
  }
  const auto out = std::make_unique<HandDescription>();
  ASSERT_TRUE(eventually([&] { return late_hands.take_latest(*out); }));
  EXPECT_EQ(bytes_of(*out), bytes_of(*hand));
}

TEST(Bus, EveryMessageArrivesInOrder) {
  ConnectedPair pair(topics::message);
  Message message;
  for (message.id = 1; message.id <= 50; ++message.id) pair.writer.write(message);
  std::vector<std::uint64_t> ids;
  ASSERT_TRUE(eventually([&] {
    pair.reader.take_all([&](const Message& m) { ids.push_back(m.id); });
    return ids.size() >= 50;
  }));
  for (std::size_t i = 0; i < 50; ++i) EXPECT_EQ(ids[i], i + 1);
}

TEST(Bus, TakesSomeAndLeavesTheOthers) {
  ConnectedPair pair(topics::message);
  Message message;
  for (message.id = 1; message.id <= 50; ++message.id) pair.writer.write(message);
  std::vector<std::uint64_t> ids;
  const auto keep = [&](const Message& m) { ids.push_back(m.id); };
  ASSERT_TRUE(eventually([&] {
    EXPECT_LE(pair.reader.take_some(4, keep), 4u);
    return ids.size() >= 50;
  }));
  for (std::size_t i = 0; i < 50; ++i) EXPECT_EQ(ids[i], i + 1);
}

TEST(Bus, MessageReachesReadersFoundWithinItsLifespan) {
  const Participant here("here", testing::own_domain());
  Writer writer(here, topics::message);
  Message message;
  message.id = 1;
  writer.write(message);
  const Participant there("there", testing::own_domain());
  {
    Reader soon(there, topics::message);
    ASSERT_TRUE(eventually([&] { return soon.take_latest(message); })) << "this reader came after the message";
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(topics::message.lifespan_ms + 200));
  Reader late(there, topics::message);
  message.id = 2;
  writer.write(message);
  std::vector<std::uint64_t> ids;
  ASSERT_TRUE(eventually([&] {
    late.take_all([&](const Message& m) { ids.push_back(m.id); });
    return !ids.empty();
  }));
  EXPECT_EQ(ids, std::vector<std::uint64_t>{2}) << "an expired command arrived";
}

TEST(Bus, MessagePassesBetweenHostsWhoseWallClocksDiffer) {
  ConnectedPair pair(topics::message);
  Message message;
  for (const time_t shift : {-3600, -10, 10, 3600}) {
    message.id = static_cast<std::uint64_t>(4000 + shift);
    message.stamp.publish_time = now();
    testing::wall_clock_shift = shift;  // Fast DDS stamps a sample in the thread that writes
    pair.writer.write(message);
    testing::wall_clock_shift = 0;
    Message taken;
    EXPECT_TRUE(eventually([&] { return pair.reader.take_latest(taken) && taken.id == message.id; })) << shift << " s";
  }
}

TEST(Bus, MessageOlderThanItsLifespanIsRefusedAndCounted) {
  ConnectedPair pair(topics::message);
  const Nanoseconds second = 1'000'000'000;
  const std::uint32_t other = clock_id() + 1;
  // Another vendor's program may leave the time out. The clock of another host is not known here.
  const std::vector<std::pair<std::uint32_t, Nanoseconds>> stamps{{clock_id(), now() - 3 * second},
                                                                  {0, now() - 3 * second},
                                                                  {clock_id(), now() + 3 * second},
                                                                  {clock_id(), now()},
                                                                  {clock_id(), 0},
                                                                  {other, 1}};
  Message message;
  for (const auto& [clock, time] : stamps) {
    ++message.id;
    message.stamp.clock_id = clock;
    message.stamp.publish_time = time;
    pair.writer.write(message);
  }
  std::vector<std::uint64_t> ids;
  ASSERT_TRUE(eventually([&] {
    pair.reader.take_all([&](const Message& m) { ids.push_back(m.id); });
    return !ids.empty() && ids.back() == stamps.size();
  }));
  EXPECT_EQ(ids, (std::vector<std::uint64_t>{4, 5, 6}));
  EXPECT_EQ(pair.reader.counters().refused_stamp, 3u);
}

TEST(Bus, ADescriptionFromAnUnknownClockHasNoTime) {
  const Participant here("here", testing::own_domain());
  const Participant there("there", testing::own_domain());
  Writer writer(here, topics::object_description);
  Reader reader(there, topics::object_description);
  ObjectDescription description;
  description.stamp.sample_time = description.stamp.publish_time = 12;
  for (const std::uint32_t clock : {clock_id(), clock_id() + 1}) {
    ++description.object;
    description.stamp.clock_id = clock;
    writer.write(description);
    ObjectDescription taken;
    ASSERT_TRUE(eventually([&] { return reader.take_latest(taken) && taken.object == description.object; }));
    EXPECT_EQ(taken.stamp.sample_time, clock == clock_id() ? 12 : 0);
  }
}

TEST(Bus, DomainComesFromTheEnvironment) {
  unsetenv("SOFTHAND_DOMAIN");
  EXPECT_EQ(domain_from_environment(), 0);
  setenv("SOFTHAND_DOMAIN", "17", 1);
  EXPECT_EQ(domain_from_environment(), 17);
  for (const char* bad : {"-1", "231", "seven", "1x", " 1"}) {
    setenv("SOFTHAND_DOMAIN", bad, 1);
    EXPECT_THROW(domain_from_environment(), std::runtime_error) << bad;
  }
}

// Without this port a process hears nobody. Fast DDS binds the last two addresses, and 0.0.0.0 is all addresses.
TEST(Bus, APortOfDiscoveryThatAnotherProgramHasIsAnError) {
  const int domain = testing::own_domain();
  for (const char* address : {"0.0.0.0", "127.0.0.1", "239.255.0.1"}) {
    const int other = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<std::uint16_t>(7400 + 250 * domain));
    ASSERT_EQ(inet_pton(AF_INET, address, &to.sin_addr), 1);
    ASSERT_EQ(bind(other, reinterpret_cast<const sockaddr*>(&to), sizeof to), 0) << address;
    try {
      const Participant refused("refused", domain);
      ADD_FAILURE() << address;
    } catch (const std::runtime_error& error) {
      const std::string port = "UDP port " + std::to_string(7400 + 250 * domain);
      EXPECT_NE(std::string(error.what()).find(port), std::string::npos) << error.what();
    }
    close(other);
  }
  const Participant joined("joined", domain), second("second", domain);
  EXPECT_TRUE(eventually([&] { return joined.peers().size() == 1; }));
}

// A reader hears of a loss with the next heartbeat. The message must not be too old by then.
TEST(Bus, SeveralHeartbeatsFitIntoTheLifeOfASample) {
  topics::for_each([](const TopicRow& row) {
    if (row.reliability != Reliability::reliable || row.lifespan_ms == 0) return;
    eprosima::fastdds::dds::DataWriterQos qos;
    detail::apply(qos, row);
    EXPECT_LE(10 * qos.reliable_writer_qos().times.heartbeatPeriod.to_ns(), 1'000'000ll * row.lifespan_ms) << row.name;
  });
}

TEST(Bus, PeersHaveNamesHostsAndRigs) {
  const Participant one("one", testing::own_domain()), other("other", testing::own_domain(), "my rig");
  ASSERT_TRUE(eventually([&] { return one.peers().size() == 1; }));
  Peer peer = one.peers().front();
  EXPECT_EQ(peer.epoch, other.epoch());
  EXPECT_EQ(get_text(peer.name), "other");
  EXPECT_EQ(get_text(peer.rig), "my rig");
  EXPECT_EQ(peer.process_id, getpid());
  EXPECT_FALSE(get_text(peer.host).empty());
  EXPECT_NE(one.epoch(), other.epoch());
  ASSERT_TRUE(eventually([&] { return other.peers().size() == 1; }));
  peer = other.peers().front();
  EXPECT_EQ(peer.epoch, one.epoch());
  EXPECT_TRUE(get_text(peer.rig).empty());
  { const Participant leaving("leaving", testing::own_domain()); }
  EXPECT_TRUE(eventually([&] { return one.peers().size() == 1; }));
}

// A process that makes participants one after another meets the id of its first one again.
TEST(Bus, ManyParticipantsOneAfterAnotherLeaveTheFirstOneAlone) {
  Network network;
  network.options.multicast = false;  // the shorter range of ids
  const Participant first("first", testing::own_domain(), {}, "client", network);
  for (int i = 0; i < 24; ++i) EXPECT_NO_THROW(Participant("next", testing::own_domain(), {}, "client", network)) << i;
}

// Beacons and their threads are only for networks that leave the host.
TEST(Bus, OnOneHostNoClocksAreExchanged) {
  const Participant one("one", testing::own_domain()), other("other", testing::own_domain());
  const Reader beacons(other, topics::clock_beacon);
  ASSERT_TRUE(eventually([&] { return other.peers().size() == 1; }));
  EXPECT_EQ(other.peers().front().clock_id, clock_id());
  std::this_thread::sleep_for(300ms);
  EXPECT_EQ(beacons.writer_count(), 0);
  EXPECT_EQ(one.clocks().size(), 0u);
}

}  // namespace
}  // namespace softhand::bus::bus_test
