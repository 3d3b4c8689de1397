// The command line that services share.
#include "service/service.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

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

}  // namespace
}  // namespace softhand
