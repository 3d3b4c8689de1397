// The command line that services share.
#include "service/service.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "runtime/exit_codes.hpp"
#include "service/loop_log.hpp"

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

TEST(ServiceArguments, PriorityAndCoresAreChecked) {
  EXPECT_FALSE(parsed({"tracker", "--config", "scene.toml"}).priority.has_value());
  const auto chosen = parsed({"tracker", "--config", "scene.toml", "--priority", "40", "--cores", "0-1,3"});
  EXPECT_EQ(chosen.priority, 40);
  EXPECT_EQ(chosen.cores, "0-1,3");
  const auto is_configuration = [](int status) { return WEXITSTATUS(status) == kExitConfiguration; };
  EXPECT_EXIT(parsed({"tracker", "--config", "scene.toml", "--priority", "100"}), is_configuration, "--priority");
  EXPECT_EXIT(parsed({"tracker", "--config", "scene.toml", "--cores", "two"}), is_configuration, "expected cores");
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
