// The command line that services share.
#include "service/service.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "device/answer.hpp"
#include "messages/convert.hpp"
#include "runtime/exit_codes.hpp"
#include "service/loop_log.hpp"
#include "support/own_domain.hpp"

namespace softhand {
namespace {

TrackerArguments parsed(std::vector<std::string> words) {
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  return parse_tracker_arguments(static_cast<int>(argv.size()), argv.data(), "A tracker");
}

TEST(TrackerArguments, ANegativeStrengthIsRefused) {
  EXPECT_EQ(parsed({"tracker", "--config", "scene.toml", "--strength", "2"}).strength, 2);
  EXPECT_EXIT(
      parsed({"tracker", "--config", "scene.toml", "--strength", "-1"}), [](int status) { return status != 0; },
      "--strength");
}

// A name that is cut would be another name.
TEST(ServiceArguments, LongModuleNamesAreRefused) {
  const std::string longest(63, 'm');
  EXPECT_EQ(parsed({"tracker", "--config", "scene.toml", "--module", longest}).module, longest);
  const auto is_configuration = [](int status) { return WEXITSTATUS(status) == kExitConfiguration; };
  for (const std::string& name : {longest + "m", std::string()})
    EXPECT_EXIT(parsed({"tracker", "--config", "scene.toml", "--module", name}), is_configuration, "--module");
}

TEST(ServiceArguments, PriorityAndCoresAreChecked) {
  EXPECT_FALSE(parsed({"tracker", "--config", "scene.toml"}).priority.has_value());
  const auto chosen = parsed({"tracker", "--config", "scene.toml", "--priority", "40", "--cores", "0-1,3"});
  EXPECT_EQ(chosen.priority, 40);
  EXPECT_EQ(chosen.cores, "0-1,3");
  const auto is_configuration = [](int status) { return WEXITSTATUS(status) == kExitConfiguration; };
  EXPECT_EXIT(parsed({"tracker", "--config", "scene.toml", "--priority", "100"}), is_configuration, "--priority");
  EXPECT_EXIT(parsed({"tracker", "--config", "scene.toml", "--cores", "two"}), is_configuration, "expected cores");
}

TEST(CountInputs, ASecondWriterIsCountedAndNamed) {
  const int domain = testing::own_domain();
  const bus::Participant first("first hand", domain), second("second hand", domain), reading("reading", domain);
  bus::Writer<ObjectCoupling> writers[] = {{first, bus::topics::object_coupling},
                                           {second, bus::topics::object_coupling}};
  bus::Reader reader(reading, bus::topics::object_coupling);
  const auto status_now = [&] {
    LoopStatus status;
    count_inputs(status, reading, reader, reader);  // two inputs add up
    return status;
  };
  EXPECT_EQ(get_text(status_now().second_writer), "");
  auto sample = std::make_unique<ObjectCoupling>();
  for (int i = 0; i < 1000 && reader.counters().second_writer == 0; ++i) {
    for (bus::Writer<ObjectCoupling>& writer : writers) {
      sample->stamp.epoch = (&writer == writers ? first : second).epoch();
      sample->stamp.publish_time = sample->stamp.sample_time = now();
      writer.write(*sample);
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  }
  const auto refused = static_cast<double>(reader.counters().second_writer);
  ASSERT_GT(refused, 0);
  LoopStatus status = status_now();
  // The text is missing while another thread uses the list of peers.
  for (int i = 0; i < 1000 && get_text(status.second_writer).empty(); ++i) status = status_now();
  const std::string text(get_text(status.second_writer));
  const std::string process = " hand, process " + std::to_string(getpid()) + " on ";
  EXPECT_NE(text.find(process), std::string::npos) << text;
  EXPECT_EQ(text.substr(0, 17), "object_coupling: ");
  EXPECT_EQ(status.input_drops, static_cast<std::uint64_t>(2 * refused));
  for (const NamedValue& counter : status.counters)
    EXPECT_EQ(counter.value, get_text(counter.name) == "second_writer" ? 2 * refused : 0) << get_text(counter.name);
}

// Of several readers, the last one that refused a sample names the second writer. The name stays when the writer
// leaves.
TEST(CountInputs, TheLastSecondWriterIsNamedAndItsNameStays) {
  const int domain = testing::own_domain();
  const bus::Participant own("own", domain), reading("reading", domain);
  bus::Writer<ObjectCoupling> coupling(own, bus::topics::object_coupling);
  bus::Writer<HeadPose> head(own, bus::topics::head_pose);
  bus::Reader couplings(reading, bus::topics::object_coupling);
  bus::Reader heads(reading, bus::topics::head_pose);
  // A second writer with this epoch disturbs the first one until the reader has refused it.
  const auto disturb = [](auto& first, auto& second, std::uint64_t epoch, auto& reader, auto sample) {
    const auto write = [&](auto& writer, std::uint64_t writer_epoch) {
      sample->stamp.epoch = writer_epoch;
      sample->stamp.publish_time = sample->stamp.sample_time = now();
      writer.write(*sample);
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    };
    for (int i = 0; i < 1000 && !reader.take_latest(*sample); ++i) write(first, 1);
    for (int i = 0; i < 1000 && reader.counters().second_writer == 0; ++i) write(first, 1), write(second, epoch);
    EXPECT_GT(reader.counters().second_writer, 0u);
  };
  {
    const bus::Participant intruder("intruder", domain);
    bus::Writer<HeadPose> second_head(intruder, bus::topics::head_pose);
    bus::Writer<ObjectCoupling> second_coupling(intruder, bus::topics::object_coupling);
    disturb(head, second_head, 7, heads, std::make_unique<HeadPose>());
    EXPECT_EQ(get_text(reading.second_writer()), "head_pose: unknown, epoch 0000000000000007");
    disturb(coupling, second_coupling, intruder.epoch(), couplings, std::make_unique<ObjectCoupling>());
  }
  for (int i = 0; i < 1000 && reading.peers().size() > 1; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  EXPECT_EQ(reading.peers().size(), 1u);
  LoopStatus status;
  count_inputs(status, reading, couplings, heads);
  const std::string text(get_text(status.second_writer));
  EXPECT_EQ(text.find("object_coupling: intruder, process " + std::to_string(getpid()) + " on "), 0u) << text;
}

// Each answer costs time of the loop, so a flood of messages must not come all at once.
TEST(Service, AnswersFewMessagesBetweenTwoSteps) {
  testing::use_own_domain();
  const bus::Participant flooder("flooder");
  bus::Writer messages(flooder, bus::topics::message);
  ServiceArguments arguments;
  arguments.role = "client";
  arguments.module = "answering";
  Service service(arguments, 100, Pacing::real, Urgency::ordinary);
  for (int i = 0; i < 1000 && !messages.has_readers(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  ASSERT_TRUE(messages.has_readers());
  constexpr int kSent = 50;
  int steps = 0, answers = 0, most = 0, since_step = 0;
  service.run({[&](Nanoseconds) {
                 most = std::max(most, std::exchange(since_step, 0));
                 if (++steps == 10) {
                   Message message;
                   set_text(message.module, "answering");
                   for (message.id = 1; message.id <= kSent; ++message.id) messages.write(message);
                 }
                 if (answers == kSent || steps == 2000) raise(SIGTERM);
               },
               [&](const Message& message) {
                 ++answers, ++since_step;
                 return reply_to(message, "answering", kReplyApplied, "");
               },
               [](LoopStatus&, Nanoseconds) {}});
  EXPECT_EQ(answers, kSent);
  EXPECT_LE(most, 4);
}

TEST(Service, CountsMessagesThatOutlivedTheirTime) {
  testing::use_own_domain();
  const bus::Participant asker("asker");
  bus::Writer messages(asker, bus::topics::message);
  bus::Reader statuses(asker, bus::topics::loop_status);
  ServiceArguments arguments;
  arguments.role = "client";
  arguments.module = "counting";
  Service service(arguments, 100, Pacing::real, Urgency::ordinary);
  double refused = 0;
  int steps = 0, answers = 0;
  service.run({[&](Nanoseconds) {
                 if (++steps == 500 || refused > 0) raise(SIGTERM);
                 if (steps % 100 == 1) {
                   Message message;
                   set_text(message.module, "counting");
                   message.stamp.sample_time = message.stamp.publish_time = now() - 3'000'000'000;
                   messages.write(message);
                 }
                 statuses.take_all([&](const LoopStatus& status) {
                   for (const NamedValue& counter : status.counters)
                     if (get_text(counter.name) == "refused_stamp") refused = counter.value;
                 });
               },
               [&](const Message& message) {
                 ++answers;
                 return reply_to(message, "counting", kReplyApplied, "");
               },
               [](LoopStatus&, Nanoseconds) {}});
  EXPECT_GT(refused, 0);
  EXPECT_EQ(answers, 0);
}

// A status from the time of the first argument, s.
LoopStatus status_at(double seconds, double pace, double behind) {
  LoopStatus status;
  status.stamp.sample_time = static_cast<Nanoseconds>(seconds * 1e9);
  add_counter(status, "pace", pace);
  add_counter(status, "behind_s", behind);
  return status;
}

TEST(RigClock, IsTheClockThatWroteTheStatus) {
  SimulatedClock clock;
  clock.command(3'000'000'007, 0.3);
  clock.command(5'000'000'000, 1, 7'000'000'000);
  for (const double seconds : {2.0, 4.000000001, 6.0, 8.0}) {
    const auto at = std::llround(1e9 * seconds);
    LoopStatus status;
    status.stamp.sample_time = at;
    add_clock(status, clock, at);
    const std::optional<SimulatedClock> read = clock_of(status);
    ASSERT_TRUE(read) << at;
    // Until the next command.
    for (const Nanoseconds later : {Nanoseconds{0}, Nanoseconds{500'000'000}})
      EXPECT_NEAR(static_cast<double>(read->at(at + later) - clock.at(at + later)), 0, 1) << at << " " << later;
    EXPECT_EQ(read->halt(at), clock.halt(at)) << at;
  }
  EXPECT_EQ(clock.halt(6'000'000'000), 7'000'000'000);
  EXPECT_EQ(clock.halt(7'000'000'000), SimulatedClock::kNever) << "it has halted";
}

TEST(RigClock, ACommandHoldsOnlyIfTheStatusIsOlder) {
  const SimulatedClock taken(10'000, 4'000, 1);
  SimulatedClock clock = taken;
  clock.command(9'000, 0);
  EXPECT_EQ(clock.at(12'000), taken.at(12'000)) << "the status has this command already";
  clock.command(11'000, 0);
  EXPECT_EQ(clock.at(12'000), 5'000);
  EXPECT_EQ(SimulatedClock::from_text(clock.text()).at(12'000), 5'000);
}

TEST(RigClock, IsEmptyForAStatusThatCannotBeUsed) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(clock_of(status_at(100, 1, 2)));
  EXPECT_FALSE(clock_of(LoopStatus{})) << "it has no simulated clock";
  EXPECT_FALSE(clock_of(status_at(0, 1, 0))) << "its time is not known";
  EXPECT_FALSE(clock_of(status_at(100, 1.5, 2)));
  EXPECT_FALSE(clock_of(status_at(100, kNan, 2)));
  EXPECT_FALSE(clock_of(status_at(100, 1, -1)));
  EXPECT_FALSE(clock_of(status_at(100, 1, 101)));
  EXPECT_FALSE(clock_of(status_at(100, 1, kNan)));
  LoopStatus halting = status_at(100, 1, 2);
  add_counter(halting, "halts_in_s", 1e300);
  EXPECT_FALSE(clock_of(halting));
  LoopStatus foreign = status_at(100, 1, 2);
  foreign.stamp.clock_id = clock_id() + 1;
  EXPECT_FALSE(clock_of(foreign));
}

// A module of a rig that was slowed down for a time: its clock is 2.5 s behind.
class SlowedRig {
 public:
  SlowedRig() {
    set_text(status_.module, "the world");
    status_.stamp.epoch = participant_.epoch();
    add_counter(status_, "pace", 1);
    add_counter(status_, "behind_s", 2.5);
  }

 private:
  void write(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      ++status_.stamp.sequence;
      status_.stamp.sample_time = status_.stamp.publish_time = now();
      statuses_.write(status_);
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
  }
  bus::Participant participant_{"world"};
  bus::Writer<LoopStatus> statuses_{participant_, bus::topics::loop_status};
  LoopStatus status_;
  std::jthread thread_{[this](const std::stop_token& stop) { write(stop); }};
};

ServiceArguments latecomer() {
  ServiceArguments arguments;
  arguments.role = "client";
  arguments.module = "latecomer";
  return arguments;
}

TEST(Service, TakesOverTheClockOfTheModulesThatRun) {
  testing::use_own_domain();
  const SlowedRig rig;
  for (const Pacing pacing : {Pacing::simulated, Pacing::real}) {
    const Service service(latecomer(), 100, pacing, Urgency::ordinary);
    const Nanoseconds at = now();
    EXPECT_EQ(at - service.clock().at(at), 2'500'000'000);
  }
}

TEST(Service, NamesAModuleWhoseSimulatedClockDiffers) {
  testing::use_own_domain();
  const SlowedRig rig;
  ::testing::internal::CaptureStderr();
  setenv(kClockVariable, SimulatedClock().text().c_str(), 1);  // so it does not take over the other clock
  {
    Service service(latecomer(), 100, Pacing::simulated, Urgency::ordinary);
    int steps = 0;
    service.run({.step =
                     [&](Nanoseconds) {
                       if (++steps == 120) raise(SIGTERM);
                     },
                 .fill_status = [](LoopStatus&, Nanoseconds) {}});
  }
  unsetenv(kClockVariable);
  const std::string text = ::testing::internal::GetCapturedStderr(),
                    start = "latecomer: the simulated clock of module the world is 2.500 s behind that of this process";
  const std::size_t line = text.find(start);
  EXPECT_NE(line, std::string::npos) << text;
  EXPECT_EQ(text.find("the simulated clock", line + 1 + start.size()), std::string::npos) << "only once";
}

// Nobody reads stderr for a while, and its pipe is full. A loop must not wait for the reader.
TEST(LoopLog, NeverWaitsForTheReader) {
  int ends[2];
  ASSERT_EQ(pipe2(ends, O_NONBLOCK), 0);
  std::size_t filling = 0;
  const std::string block(4096, '.');
  for (ssize_t count = 0; (count = write(ends[1], block.data(), block.size())) > 0;)
    filling += static_cast<std::size_t>(count);
  fcntl(ends[1], F_SETFL, 0);
  const int before = dup(STDERR_FILENO);
  dup2(ends[1], STDERR_FILENO);
  std::string text;
  std::thread reader;
  {
    LoopLog log("program");
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < 30; ++i) log.line("line {} {}", i, std::string(i == 29 ? 1000 : 1, 'x'));
    EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(1));
    dup2(before, STDERR_FILENO);
    close(before);
    close(ends[1]);
    fcntl(ends[0], F_SETFL, 0);
    reader = std::thread([&] {
      char buffer[4096];
      for (ssize_t count = 0; (count = read(ends[0], buffer, sizeof buffer)) > 0;)
        text.append(buffer, static_cast<std::size_t>(count));
    });
  }
  reader.join();
  close(ends[0]);
  text.erase(0, filling);
  EXPECT_EQ(text.find("program: line 0 x\nprogram: line 1 x\n"), 0u) << text;
  EXPECT_TRUE(text.ends_with("x\n"));
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 30);
}

}  // namespace
}  // namespace softhand
