// The bus over real DDS. Each test has its own process and its own domain, so that tests may run in parallel.
#include "bus/bus.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <map>
#include <sstream>
#include <string>
#include <thread>

#include "integration/bus_fill.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "support/own_domain.hpp"

extern char** environ;

namespace softhand::bus {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

/// Polls until `f` is true. Returns false after ten seconds. A healthy bus never needs ten seconds.
template <typename F>
bool eventually(F&& f) {
  const auto end = Clock::now() + 10s;
  while (!f()) {
    if (Clock::now() > end) return false;
    std::this_thread::sleep_for(2ms);
  }
  return true;
}

/// A child process that dies with its handle.
class Child {
 public:
  explicit Child(std::vector<std::string> arguments) {
    std::vector<char*> argv;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    int in[2];
    int out[2];
    if (pipe2(in, O_CLOEXEC) != 0 || pipe2(out, O_CLOEXEC) != 0) throw std::runtime_error("pipe");
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, in[0], 0);
    posix_spawn_file_actions_adddup2(&actions, out[1], 1);
    if (posix_spawn(&pid_, argv[0], &actions, nullptr, argv.data(), environ) != 0)
      throw std::runtime_error("cannot start " + arguments[0]);
    posix_spawn_file_actions_destroy(&actions);
    close(in[0]);
    close(out[1]);
    input_ = in[1];
    output_ = out[0];
  }
  ~Child() {
    kill_now();
    close_input();
    close(output_);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  void kill_now() {
    if (pid_ <= 0) return;
    ::kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
    pid_ = 0;
  }
  void close_input() {
    if (input_ >= 0) close(input_);
    input_ = -1;
  }
  /// Closes the child's input and waits for its end. Returns all that it printed, one "name value" per line.
  std::map<std::string, std::string> finish(int& exit_code) {
    close_input();
    std::string text;
    char buffer[4096];
    for (ssize_t n = 0; (n = read(output_, buffer, sizeof buffer)) > 0;)
      text.append(buffer, static_cast<std::size_t>(n));
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = 0;
    exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    std::map<std::string, std::string> lines;
    std::istringstream stream(text);
    for (std::string name, value; stream >> name >> value;) lines[name] = value;
    return lines;
  }

 private:
  pid_t pid_ = 0;
  int input_ = -1;
  int output_ = -1;
};

/// With a stamp that a reader accepts.
template <typename T>
std::unique_ptr<T> stamped(std::uint64_t seed, bool to_capacity = false) {
  static const Nanoseconds time = now();
  auto message = filled<T>(seed, to_capacity);
  message->stamp.epoch = 1;
  message->stamp.clock_id = clock_id();
  message->stamp.sample_time = message->stamp.publish_time = time;
  return message;
}

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

// A device's last command is zero. It must arrive although its writer leaves at once.
TEST(Bus, LastSampleOfADepartingWriterArrives) {
  const Participant there("there", testing::own_domain());
  Reader reader(there, topics::device_state);
  constexpr std::uint64_t kBurst = 200;  // the reader has a backlog when the writer goes
  for (std::uint64_t round = 1; round <= 10; ++round) {
    {
      const Participant here("here", testing::own_domain());
      Writer writer(here, topics::device_state);
      ASSERT_TRUE(eventually([&] { return writer.has_readers() && reader.writer_count() == 1; }));
      DeviceState state;
      for (state.stamp.sequence = 1; state.stamp.sequence <= kBurst; ++state.stamp.sequence) writer.write(state);
    }
    DeviceState last;
    EXPECT_TRUE(eventually([&] {
      reader.take_latest(last);
      return last.stamp.sequence == kBurst;
    })) << "round "
        << round;
    ASSERT_TRUE(eventually([&] { return reader.writer_count() == 0; }));
  }
}

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
  const Participant here("here", testing::own_domain());
  const Participant there("there", testing::own_domain());
  Writer writer(here, topics::message);
  Reader reader(there, topics::message);
  ASSERT_TRUE(eventually([&] { return writer.has_readers() && reader.writer_count() == 1; }));
  Message message;
  for (message.id = 1; message.id <= 50; ++message.id) writer.write(message);
  std::vector<std::uint64_t> ids;
  ASSERT_TRUE(eventually([&] {
    reader.take_all([&](const Message& m) { ids.push_back(m.id); });
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

}  // namespace

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

/// The lines of `text` that contain `part`.
int lines_with(const std::string& text, const std::string& part) {
  std::istringstream in(text);
  int count = 0;
  for (std::string line; std::getline(in, line);) count += line.find(part) != std::string::npos ? 1 : 0;
  return count;
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

/// Sends a message through Cyclone's generated C type and back. The echo must have the same bytes. Returns the values
/// that the C program printed, by their names.
template <typename T>
std::map<std::string, std::string> through_cyclone(const Topic<T>& topic, T& sent, const std::string& hash = {}) {
  setenv("CYCLONEDDS_URI", "file://" SOFTHAND_SOURCE_DIR "/config/dds/cyclonedds.xml", 1);
  const Participant here("here", testing::own_domain());
  const std::string echo_name = std::string(topic.name) + "_echo";
  Topic<T> echo = topic;
  echo.name = echo_name;
  Writer writer(here, topic, 1);
  Reader reader(here, echo);
  std::vector<std::string> command{CYCLONE_SUBSCRIBER, std::to_string(testing::own_domain()), std::string(topic.name)};
  if (!hash.empty()) command.push_back(hash);
  Child cyclone(command);
  const auto got = std::make_unique<T>();
  EXPECT_TRUE(eventually([&] { return writer.has_readers(); })) << topic.name;
  bool same = eventually([&] {
    writer.write(sent);
    return reader.wait(50ms) && reader.take_latest(*got);
  });
  EXPECT_TRUE(same) << topic.name << ": no echo; refused " << reader.counters().refused << ", writers "
                    << reader.writer_count();
  EXPECT_EQ(bytes_of(*got), bytes_of(sent)) << topic.name;
  int exit_code = 0;
  auto lines = cyclone.finish(exit_code);
  EXPECT_EQ(exit_code, 0) << topic.name;
  return lines;
}

TEST(BusAndCyclone, EveryTopicPassesThroughUnchanged) {
  topics::for_each([&]<typename T>(const Topic<T>& topic) {
    const auto message = stamped<T>(5);
    through_cyclone(topic, *message);
  });
}

// The program sets its user data as docs/topics.md says, and looks at that of others.
TEST(BusAndCyclone, AnotherDefinitionOfATypeIsReportedByBothSides) {
  const auto skeleton = stamped<Skeleton>(5);
  for (const bool is_same : {true, false}) {
    char hash[17];
    std::snprintf(hash, sizeof hash, "%016llx",
                  static_cast<unsigned long long>(definition_hash<Skeleton>() + (is_same ? 0 : 1)));
    ::testing::internal::CaptureStderr();
    const auto lines = through_cyclone(topics::simulated_skeleton, *skeleton, hash);
    const std::string log = ::testing::internal::GetCapturedStderr();
    const std::string what =
        "here: topic softhand/v1/simulated_skeleton: module cyclone_subscriber has another definition";
    EXPECT_EQ(lines_with(log, what), is_same ? 0 : 1) << log;
    const auto found = lines.find("other_definition");
    EXPECT_EQ(found == lines.end() ? "" : found->second, is_same ? "" : "here");
  }
}

double number(const std::map<std::string, std::string>& lines, const std::string& name) {
  const auto found = lines.find(name);
  EXPECT_NE(found, lines.end()) << name;
  return found == lines.end() ? 0 : std::strtod(found->second.c_str(), nullptr);
}

TEST(BusAndCyclone, CReadsTheFieldsUnderTheirNames) {
  const auto skeleton = stamped<Skeleton>(6);
  auto lines = through_cyclone(topics::simulated_skeleton, *skeleton);
  EXPECT_EQ(number(lines, "hand.side"), skeleton->hand.side);
  EXPECT_EQ(lines["stamp.sample_time"], std::to_string(skeleton->stamp.sample_time));
  EXPECT_EQ(number(lines, "confidence"), skeleton->confidence);
  EXPECT_EQ(number(lines, "joints[25].orientation.w"), skeleton->joints[25].orientation[3]);
  EXPECT_EQ(number(lines, "joints[25].radius"), skeleton->joints[25].radius);

  const auto contacts = stamped<Contacts>(6);
  lines = through_cyclone(topics::contacts, *contacts);
  const Contact& contact = contacts->contacts[contacts->contacts.size() - 1];
  EXPECT_EQ(number(lines, "contacts.length"), static_cast<double>(contacts->contacts.size()));
  EXPECT_EQ(number(lines, "fingers[5].area"), contacts->fingers[5].area);
  EXPECT_EQ(number(lines, "contacts[last].force.z"), contact.force[2]);
  EXPECT_EQ(number(lines, "contacts[last].slip_speed"), contact.slip_speed);

  const auto objects = stamped<WorldObjects>(6);
  lines = through_cyclone(topics::objects, *objects);
  const ObjectState& object = objects->objects[objects->objects.size() - 1];
  EXPECT_EQ(number(lines, "objects[last].position.y"), object.position[1]);
  EXPECT_EQ(number(lines, "objects[last].planes[last].mass"), object.planes[object.planes.size() - 1].mass);

  const auto wrench = stamped<BoneWrench>(6);
  lines = through_cyclone(topics::bone_wrench, *wrench);
  EXPECT_EQ(number(lines, "bones[20].coupling_torque.y"), wrench->bones[20].coupling_torque[1]);

  const auto status = stamped<LoopStatus>(6);
  status->module = {"hand"};
  lines = through_cyclone(topics::loop_status, *status);
  EXPECT_EQ(lines["module_name"], std::string(status->module.data()));
  EXPECT_EQ(number(lines, "step_ms_p99"), status->step_ms_p99);
  EXPECT_EQ(number(lines, "passivity_energy"), status->passivity_energy);
  EXPECT_EQ(number(lines, "ledger[last].value"), status->ledger[status->ledger.size() - 1].value);
}

// Anybody on the domain can invent users and module names.
HandKey user(int number) { return {static_cast<std::uint32_t>(number), 1}; }
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

// Two writers of one key. Returns the epochs of the samples that a reader gets while both write, each change once, and
// then those after the first writer has stopped.
struct Heard {
  std::vector<std::uint64_t> both, later;
  ReaderCounters counters;
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
  heard.counters = reader.counters();
  return heard;
}

TEST(Bus, AReaderNeverFollowsTwoWritersInTurn) {
  topics::for_each([&]<typename T>(const Topic<T>& topic) {
    if (topic.writers != Writers::one) return;
    const Heard heard = heard_of_two_writers(topic);
    EXPECT_EQ(heard.both, std::vector<std::uint64_t>{1}) << topic.name;
    EXPECT_EQ(heard.later, std::vector<std::uint64_t>{2}) << topic.name << ": the place of a dead writer is free";
    EXPECT_GT(heard.counters.second_writer, 40u) << topic.name;
    EXPECT_EQ(heard.counters.second_epoch, 2u) << topic.name;
  });
}

TEST(Bus, EveryStateTopicHasOneWriter) {
  EXPECT_EQ(topics::tracked_skeleton.writers, Writers::strongest);
  for (const TopicRow& row :
       {TopicRow(topics::intermediate_skeleton), TopicRow(topics::simulated_skeleton), TopicRow(topics::objects),
        TopicRow(topics::object_coupling), TopicRow(topics::bone_wrench), TopicRow(topics::head_pose)})
    EXPECT_EQ(row.writers, Writers::one) << row.name;
}

TEST(Bus, PeersHaveNamesHostsAndRigs) {
  const Participant one("one", testing::own_domain()), other("other", testing::own_domain(), "my rig");
  Peer peer;
  ASSERT_TRUE(eventually([&] { return one.find_peer(other.epoch(), peer); }));
  EXPECT_EQ(get_text(peer.name), "other");
  EXPECT_EQ(get_text(peer.rig), "my rig");
  EXPECT_EQ(peer.process_id, getpid());
  EXPECT_FALSE(get_text(peer.host).empty());
  EXPECT_NE(one.epoch(), other.epoch());
  ASSERT_TRUE(eventually([&] { return other.find_peer(one.epoch(), peer); }));
  EXPECT_TRUE(get_text(peer.rig).empty());
  { const Participant leaving("leaving", testing::own_domain()); }
  EXPECT_TRUE(eventually([&] { return one.peers().size() == 1; }));
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

// Beacons and their threads are only for networks that leave the host.
TEST(Bus, OnOneHostNoClocksAreExchanged) {
  const Participant one("one", testing::own_domain()), other("other", testing::own_domain());
  const Reader beacons(other, topics::clock_beacon);
  Peer peer;
  ASSERT_TRUE(eventually([&] { return other.find_peer(one.epoch(), peer); }));
  EXPECT_EQ(peer.clock_id, clock_id());
  std::this_thread::sleep_for(300ms);
  EXPECT_EQ(beacons.writer_count(), 0);
  EXPECT_EQ(one.clocks().size(), 0u);
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
  write();
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
}  // namespace softhand::bus
