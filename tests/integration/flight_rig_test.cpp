// The demo with flight recorders: a process is killed, another one is stopped for a while, and an object is teleported.
// The files of all loops are then repeated, and every state must have the recorded bits.
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "integration/rig_harness.hpp"
#include "support/own_domain.hpp"

namespace softhand::rig::flight_rig_test {
namespace {

using namespace std::chrono_literals;
namespace fs = std::filesystem;

const std::string kProgram = SOFTHAND_PROGRAMS "/softhand";

struct Files {
  explicit Files(const char* name)
      : folder(fs::path(::testing::TempDir()) / (std::string(name) + std::to_string(getpid()))) {
    fs::remove_all(folder);
  }
  ~Files() { fs::remove_all(folder); }
  /// Files of one module.
  std::vector<std::string> of(const std::string& module) const {
    std::vector<std::string> found;
    if (!fs::exists(folder)) return found;
    for (const auto& entry : fs::directory_iterator(folder)) {
      const std::string name = entry.path().filename().string();
      if (name.starts_with(module + "-") && entry.path().extension() == ".flight")
        found.push_back(entry.path().string());
    }
    return found;
  }
  fs::path folder;
};

// Repeats a file. Every state and snapshot must have the recorded bits. Returns the output.
std::string repeat(const std::string& file) {
  const Finished repeated = run_program({kProgram, "simulate", "--from", file});
  const std::string tail =
      repeated.output.substr(repeated.output.size() - std::min<std::size_t>(repeated.output.size(), 2000));
  EXPECT_EQ(repeated.exit_code, 0) << tail;
  EXPECT_NE(repeated.output.find(": 0 different states, 0 different snapshots"), std::string::npos) << tail;
  EXPECT_EQ(repeated.output.find("DIFFER"), std::string::npos) << tail;
  std::printf("%s", tail.substr(tail.rfind("written because")).c_str());
  return repeated.output;
}

TEST(FlightRig, RepeatsALiveRunWithAKillAStallAndATeleport) {
  testing::use_own_domain();
  Files files("softhand_flight_rig_");
  RigListener listener;
  {
    // Short periods: the run has several snapshots.
    Up up("config/rigs/demo.toml", {"--flight", files.folder.string(), "--set", "flight.snapshot_period=3"});
    const auto is_up = [&] {
      return listener.process_id("world") > 0 && listener.process_id("hand") > 0 &&
             listener.process_id("tracking") > 0 && listener.process_id("tracker") > 0;
    };
    ASSERT_TRUE(listener.wait(20s, is_up)) << up.output();
    listener.listen(4s);
    ASSERT_EQ(kill(static_cast<pid_t>(listener.process_id("tracking")), SIGKILL), 0);
    listener.listen(2s);
    const auto hand = static_cast<pid_t>(listener.process_id("hand"));
    ASSERT_EQ(kill(hand, SIGSTOP), 0);
    listener.listen(400ms);
    ASSERT_EQ(kill(hand, SIGCONT), 0);
    listener.listen(1s);
    const Finished teleport = run_program({kProgram, "send", "world", "object.teleport", "cube 0.02 0.4 0.01"});
    EXPECT_EQ(teleport.exit_code, 0) << teleport.output;
    listener.listen(2s);
    const Finished asked = run_program({kProgram, "send", "hand", "flight.write", "asked by the test"});
    EXPECT_EQ(asked.exit_code, 0) << asked.output;
    listener.listen(3s);
    up.send_signal(SIGINT);
    EXPECT_EQ(up.wait(20s), 0) << up.output();
  }
  EXPECT_EQ(files.of("hand").size(), 2u) << "one on request and one at the end";
  EXPECT_EQ(files.of("world").size(), 1u);
  EXPECT_EQ(files.of("tracking").size(), 1u) << "of the process that was started after the kill";
  bool teleported = false, asked = false;
  for (const char* module : {"hand", "world", "tracking"}) {
    for (const std::string& file : files.of(module)) {
      const std::string output = repeat(file);
      teleported = teleported || output.find("message object.teleport cube") != std::string::npos;
      asked = asked || output.find("written because: asked by the test") != std::string::npos;
    }
  }
  EXPECT_TRUE(teleported);
  EXPECT_TRUE(asked);
}

TEST(FlightRig, RepeatsTwoHandsOfOneProcess) {
  testing::use_own_domain();
  Files files("softhand_flight_two_hands_");
  {
    RigListener listener;
    Up up("config/rigs/two_hands_one_process.toml",
          {"--flight", files.folder.string(), "--set", "hand.model=right_400.hand.json", "--set", "viewer.port=0"});
    ASSERT_TRUE(listener.wait(20s, [&] { return listener.modules["hand"].steps > 300; })) << up.output();
    listener.listen(1s);
    up.send_signal(SIGINT);
    EXPECT_EQ(up.wait(20s), 0) << up.output();
  }
  ASSERT_EQ(files.of("hand").size(), 1u);
  repeat(files.of("hand")[0]);
}

TEST(FlightRig, RefusesAFileThatIsNoFlight) {
  Files files("softhand_flight_none_");
  fs::create_directories(files.folder);
  const std::string path = (files.folder / "none.flight").string();
  std::FILE* file = std::fopen(path.c_str(), "w");
  ASSERT_NE(file, nullptr);
  std::fputs("nothing", file);
  std::fclose(file);
  const Finished repeated = run_program({kProgram, "simulate", "--from", path});
  EXPECT_EQ(repeated.exit_code, 1);
  EXPECT_NE(repeated.output.find("is not an MCAP file"), std::string::npos) << repeated.output;
}

}  // namespace
}  // namespace softhand::rig::flight_rig_test
