// Recording and replay over real DDS, in the test's own domain.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <functional>
#include <thread>
#include <vector>

#include "bus/bus.hpp"
#include "cli/topic_recording.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "support/own_domain.hpp"

namespace softhand::cli_recording_test {
namespace {

using std::chrono::milliseconds;

bool wait_for(const std::function<bool()>& done) {
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (!done() && std::chrono::steady_clock::now() < until) std::this_thread::sleep_for(milliseconds(2));
  return done();
}

class RecordingTest : public ::testing::Test {
 protected:
  void TearDown() override { std::filesystem::remove(path_); }
  std::string path_ =
      (std::filesystem::temp_directory_path() / ("softhand_recording_" + std::to_string(getpid()) + ".mcap")).string();
};

constexpr int kCount = 40;

BoneWrench wrench(int i, Nanoseconds time) {
  BoneWrench w;
  w.hand = {2, 0};
  w.stamp.sequence = static_cast<std::uint64_t>(i + 1);
  w.stamp.epoch = 77;
  w.stamp.clock_id = 0;  // stands for the clock of the reader
  w.stamp.sample_time = time - 3'000'000;
  w.stamp.publish_time = time;
  w.stamp.chain.tracker_sample = time - 20'000'000;
  w.bones[3].coupling_force = {1.5 * i, -2, 1e-300};
  return w;
}

TEST_F(RecordingTest, ReplaysRecordedMessagesWithShiftedTimes) {
  std::vector<BoneWrench> sent;
  Nanoseconds described_at = 0;
  {
    const bus::Participant participant("recording test", testing::own_domain());
    TopicRecorder recorder(participant, path_, {"bone_wrench", "object_description"});
    bus::Writer<BoneWrench> writer(participant, bus::topics::bone_wrench);
    bus::Writer<ObjectDescription> descriptions(participant, bus::topics::object_description);
    bus::Writer<Message> messages(participant, bus::topics::message);  // this topic is not recorded
    ASSERT_TRUE(wait_for([&] { return writer.has_readers() && descriptions.has_readers(); }));
    ObjectDescription cube;
    cube.object = 4;
    cube.mass = 0.05;
    described_at = cube.stamp.publish_time = now();
    set_text(cube.name, "cube");
    descriptions.write(cube);
    messages.write(Message{});
    for (int i = 0; i < kCount; ++i) {
      sent.push_back(wrench(i, now()));
      writer.write(sent.back());
      std::this_thread::sleep_for(milliseconds(2));
      if (i % 5 == 4) recorder.poll();  // several messages arrive between two polls: none is lost
    }
    ASSERT_TRUE(wait_for([&] {
      recorder.poll();
      return recorder.counts()["bone_wrench"].messages == kCount &&
             recorder.counts()["object_description"].messages == 1;
    })) << recorder.counts()["bone_wrench"].messages;
    recorder.finish();
    EXPECT_EQ(recorder.counts().size(), 2u);
  }

  // The file holds topics, types, times, and a schema that names the type.
  RecordReader file(path_);
  RecordedMessage message;
  int wrenches = 0;
  Nanoseconds first_logged = 0;
  while (file.next(message)) {
    if (first_logged == 0) first_logged = message.log_time;
    const RecordReader::Channel& channel = file.channels().at(message.channel);
    EXPECT_EQ(channel.message_encoding, "cdr");
    EXPECT_EQ(channel.schema->encoding, "omgidl");
    if (channel.topic != "softhand/v1/bone_wrench") continue;
    EXPECT_EQ(channel.schema->name, "softhand::v1::BoneWrench");
    EXPECT_NE(channel.schema->text.find("struct BoneWrench"), std::string::npos);
    EXPECT_EQ(message.publish_time, sent[static_cast<std::size_t>(wrenches)].stamp.publish_time);
    EXPECT_GE(message.log_time, message.publish_time);
    ++wrenches;
  }
  EXPECT_EQ(wrenches, kCount);
  EXPECT_FALSE(file.truncated());

  // Replay the file, twice as fast.
  const bus::Participant participant("replay test", testing::own_domain());
  bus::Reader<BoneWrench> reader(participant, with_history(bus::topics::bone_wrench, 64));
  TopicPlayer player(participant, path_, {}, 2.0);
  ASSERT_TRUE(wait_for([&] { return reader.writer_count() > 0; }));
  std::this_thread::sleep_for(milliseconds(300));  // the writer has to find the reader too
  std::vector<BoneWrench> received;
  const Nanoseconds started = now();
  Nanoseconds moment = started;
  while (player.play(moment))
    moment = player.next_due();  // the test's own clock: it does not wait, but each message has its due time
  EXPECT_EQ(player.counts()["bone_wrench"].messages, static_cast<std::uint64_t>(kCount));
  ASSERT_TRUE(wait_for([&] {
    reader.take_all([&received](const BoneWrench& w) { received.push_back(w); });
    return received.size() >= kCount;
  })) << received.size();
  for (std::size_t i = 0; i < received.size(); ++i) {
    const BoneWrench& before = sent[i];
    const BoneWrench& after = received[i];
    EXPECT_EQ(after.hand, before.hand);
    EXPECT_EQ(after.stamp.sequence, before.stamp.sequence);
    EXPECT_NE(after.stamp.epoch, before.stamp.epoch) << "else a receiver would take it for an old sample";
    EXPECT_EQ(after.stamp.epoch, received[0].stamp.epoch);
    EXPECT_EQ(after.stamp.clock_id, clock_id());
    EXPECT_EQ(after.bones[3].coupling_force, before.bones[3].coupling_force);
    // Twice the speed halves the time between any two stamps.
    EXPECT_NEAR(static_cast<double>(after.stamp.publish_time - after.stamp.chain.tracker_sample), 10e6, 2);
    EXPECT_NEAR(static_cast<double>(after.stamp.publish_time - received[0].stamp.publish_time),
                0.5 * static_cast<double>(before.stamp.publish_time - sent[0].stamp.publish_time), 2);
    EXPECT_EQ(after.stamp.chain.wrench_published, 0) << "an unknown time stays unknown";
  }
  EXPECT_NEAR(static_cast<double>(received[0].stamp.publish_time - started),
              0.5 * static_cast<double>(sent[0].stamp.publish_time - first_logged), 2);
  EXPECT_LT(described_at, started);
}

TEST_F(RecordingTest, RefusesAnUnknownTopicAndListsTheKnownOnes) {
  const bus::Participant participant("recording test", testing::own_domain());
  try {
    TopicRecorder(participant, path_, {"contact"});
    FAIL() << "no error";
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("'contact'"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("contacts, "), std::string::npos) << error.what();
  }
  EXPECT_FALSE(std::filesystem::exists(path_)) << "no file may be created";
}

TEST_F(RecordingTest, AFileWithoutTheChosenTopicIsRefused) {
  const bus::Participant participant("recording test", testing::own_domain());
  {
    RecordWriter file(path_);
    const auto channel = file.add_channel({"softhand/v1/contacts", "cdr", "softhand::v1::Contacts", "", ""});
    file.write(channel, 1, 1, 1, {});
    file.finish();
  }
  EXPECT_THROW(TopicPlayer(participant, path_, {"bone_wrench"}, 1), std::invalid_argument);
  TopicPlayer player(participant, path_, {}, 1);
  player.play(now());
  EXPECT_EQ(player.counts()["contacts"].refused, 1u) << "an empty payload is not a message";
  EXPECT_EQ(player.counts()["contacts"].messages, 0u);
}

TEST_F(RecordingTest, AChannelOfAnotherTypeIsRefused) {
  const bus::Participant participant("recording test", testing::own_domain());
  {
    RecordWriter file(path_);
    const auto channel = file.add_channel({"softhand/v1/contacts", "cdr", "softhand::v2::Contacts", "", ""});
    file.write(channel, 1, 1, 1, {});
    file.finish();
  }
  EXPECT_THROW(TopicPlayer(participant, path_, {}, 1), std::runtime_error);
}

}  // namespace
}  // namespace softhand::cli_recording_test
