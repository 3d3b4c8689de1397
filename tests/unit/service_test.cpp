// The command line that services share.
#include "service/service.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
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
  const auto status_of = [&](const bus::Participant& participant) {
    LoopStatus status;
    count_inputs(status, participant, reader, reader);  // two inputs add up
    return status;
  };
  EXPECT_EQ(get_text(status_of(reading).second_writer), "");
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
  const LoopStatus status = status_of(reading);
  const std::string text(get_text(status.second_writer));
  const std::string process = " hand, process " + std::to_string(getpid()) + " on ";
  EXPECT_NE(text.find(process), std::string::npos) << text;
  EXPECT_EQ(text.substr(0, 17), "object_coupling: ");
  EXPECT_EQ(status.input_drops, static_cast<std::uint64_t>(2 * refused));
  for (const NamedValue& counter : status.counters)
    EXPECT_EQ(counter.value, get_text(counter.name) == "second_writer" ? 2 * refused : 0) << get_text(counter.name);
  const bus::Participant stranger("stranger", domain + 1);
  EXPECT_EQ(get_text(status_of(stranger).second_writer).substr(0, 24), "object_coupling: unknown");
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
