// The command line that services share.
#include "service/service.hpp"

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <string>
#include <vector>

#include "runtime/exit_codes.hpp"

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

}  // namespace
}  // namespace softhand
