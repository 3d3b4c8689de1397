// Rigs that extend the demo, and a rig that messages restart with another scene and another tracker.
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "integration/rig_harness.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "support/own_domain.hpp"

namespace softhand::rig {
namespace {

using namespace std::chrono_literals;

const std::vector<std::string> kFreePorts{"--set", "viewer.port=0",           "--set", "tracker_webxr.port=0",
                                          "--set", "tracker_landmarks.port=0"};

class Choice : public ::testing::Test {
 protected:
  Choice() { testing::use_own_domain(); }
  static bool all_present(const RigListener& listener) {
    const auto modules = {"world", "hand", "tracking", "haptic", "tactile", "tracker"};
    return std::all_of(modules.begin(), modules.end(),
                       [&](const char* module) { return listener.process_id(module) > 0; });
  }
  static std::string program_of(const RigListener& listener, const std::string& module) {
    std::error_code error;
    return std::filesystem::read_symlink("/proc/" + std::to_string(listener.process_id(module)) + "/exe", error)
        .filename()
        .string();
  }
  static bool is_in_arguments(const RigListener& listener, const std::string& module, const std::string& argument) {
    std::ifstream in("/proc/" + std::to_string(listener.process_id(module)) + "/cmdline");
    return std::string(std::istreambuf_iterator<char>(in), {}).find(argument) != std::string::npos;
  }
};

class Choices {
 public:
  explicit Choices(const bus::Participant& participant) : reader_(participant, bus::topics::rig_choices) {}
  bool known() { return reader_.take_latest(newest_) || newest_.choices.size() > 0; }
  /// Empty if there is no such choice.
  std::optional<bool> runs(std::string_view what, std::string_view choice) {
    known();
    for (const RigChoice& each : newest_.choices)
      if (get_text(each.what) == what && get_text(each.choice) == choice) return each.running != 0;
    return std::nullopt;
  }

 private:
  bus::Reader<RigChoices> reader_;
  RigChoices newest_;
};

class ShippedRig : public Choice, public ::testing::WithParamInterface<const char*> {};

TEST_P(ShippedRig, StartsWithItsTrackerAndStops) {
  RigListener listener;
  Up up("config/rigs/" + std::string(GetParam()) + ".toml", kFreePorts);
  ASSERT_TRUE(listener.wait(30s, [&] { return all_present(listener); })) << up.output();
  EXPECT_EQ(program_of(listener, "tracker"), "softhand-tracker-" + std::string(GetParam()));
  bus::Participant participant("reader of choices");  // it comes late, and gets what was written once
  Choices choices(participant);
  ASSERT_TRUE(listener.wait(5s, [&] { return choices.known(); }));
  EXPECT_EQ(choices.runs("tracker", GetParam()), true);
  EXPECT_EQ(choices.runs("tracker", "replay"), false);
  EXPECT_EQ(choices.runs("tracker", "telepathy"), std::nullopt);
  EXPECT_EQ(choices.runs("scene", "pinch_lift"), false);
  const Finished status = run_program({SOFTHAND_PROGRAMS "/softhand", "status", "--once"});
  EXPECT_NE(status.output.find("rig tracker: " + std::string(GetParam()) + "; others: "), std::string::npos)
      << status.output;
  const Finished json = run_program({SOFTHAND_PROGRAMS "/softhand", "status", "--json"});
  const auto parsed = nlohmann::json::parse(json.output, nullptr, false);
  ASSERT_TRUE(parsed.is_object()) << json.output;
  EXPECT_EQ(parsed["rig"]["choices"]["tracker"]["replay"], false);
  EXPECT_EQ(parsed["rig"]["choices"]["tracker"][GetParam()], true);
  // No hand is tracked yet, so there is no simulated hand.
  EXPECT_TRUE(listener.simulated.empty());
  up.send_signal(SIGINT);
  EXPECT_EQ(up.wait(8s), 0) << up.output();
}
INSTANTIATE_TEST_SUITE_P(Rigs, ShippedRig, ::testing::Values("webxr", "landmarks"));

TEST_F(Choice, RestartsWithAnotherTrackerAndAnotherScene) {
  RigListener listener;
  bus::Participant participant("chooser");
  bus::Writer<Message> request_writer(participant, bus::topics::message);
  bus::Reader<MessageReply> replies(participant, bus::topics::message_reply);
  Choices choices(participant);
  Up up("config/rigs/demo.toml", kFreePorts);
  ASSERT_TRUE(listener.wait(30s, [&] { return all_present(listener) && listener.process_id("rig") > 0; }))
      << up.output();
  EXPECT_EQ(program_of(listener, "tracker"), "softhand-tracker-replay");
  std::uint64_t id = 0;
  // Returns the answer of `rig`.
  const auto request = [&](const char* key, const char* value) {
    Message message;
    message.id = ++id;
    message.stamp.sequence = id;
    message.stamp.sample_time = message.stamp.publish_time = now();
    set_text(message.module, "rig");
    set_text(message.key, key);
    set_text(message.value, value);
    request_writer.write(message);
    std::optional<std::uint32_t> result;
    listener.wait(3s, [&] {
      replies.take_all([&](const MessageReply& reply) {
        if (reply.id == id && get_text(reply.module) == "rig") result = reply.result;
      });
      return result.has_value();
    });
    return result;
  };
  EXPECT_EQ(request("tracker", "telepathy"), kReplyRefused);
  EXPECT_EQ(request("scene", "../rigs/demo"), kReplyRefused);
  EXPECT_EQ(request("coffee", "black"), kReplyIgnored);

  EXPECT_EQ(request("tracker", "webxr"), kReplyApplied);
  EXPECT_TRUE(listener.wait(30s, [&] {
    return all_present(listener) && program_of(listener, "tracker") == "softhand-tracker-webxr";
  })) << up.output();
  EXPECT_EQ(request("tracker", "replay"), kReplyApplied);
  EXPECT_EQ(request("scene", "pinch_lift"), kReplyApplied);
  ASSERT_TRUE(listener.wait(30s, [&] {
    return program_of(listener, "tracker") == "softhand-tracker-replay" &&
           is_in_arguments(listener, "tracker", "pinch_lift.toml") &&
           is_in_arguments(listener, "hand", "pinch_lift.toml");
  })) << up.output();
  EXPECT_TRUE(listener.wait(5s, [&] { return choices.runs("scene", "pinch_lift") == true; }));
  EXPECT_EQ(choices.runs("tracker", "replay"), true);
  listener.simulated.clear();
  EXPECT_TRUE(listener.wait(20s, [&] { return listener.simulated.size() > 90; })) << up.output();
  up.send_signal(SIGINT);
  EXPECT_EQ(up.wait(8s), 0) << up.output();
}

TEST_F(Choice, DemoRunsTheDemoRigWithTheNamedScene) {
  const std::string summary = std::filesystem::temp_directory_path() / ("softhand_demo_" + std::to_string(getpid()));
  std::vector<std::string> command{SOFTHAND_PROGRAMS "/softhand", "demo", "fist", "--seconds", "5", "--json", summary};
  command.insert(command.end(), kFreePorts.begin(), kFreePorts.end());
  const Finished demo = run_program(command);
  EXPECT_EQ(demo.exit_code, 0) << demo.output;
  EXPECT_EQ(demo.output.rfind("fist: The hand closes", 0), 0u) << demo.output;
  EXPECT_NE(demo.output.find("demo is up: "), std::string::npos) << demo.output;
  std::ifstream in(summary);
  const auto json = nlohmann::json::parse(in, nullptr, false);
  std::filesystem::remove(summary);
  ASSERT_TRUE(json.is_object());
  EXPECT_EQ(std::filesystem::path(json["scene"].get<std::string>()).filename(), "fist.toml");
  EXPECT_GT(json["loops"]["hand"]["rate_hz"], 0) << json.dump(1);
}

// World, hand and viewer load the object file. The finger presses the button 2 s after its start.
TEST_F(Choice, DemoWithAnObjectFileRunsLive) {
  const std::string summary = std::filesystem::temp_directory_path() / ("softhand_button_" + std::to_string(getpid()));
  std::vector<std::string> command{
      SOFTHAND_PROGRAMS "/softhand",   "demo", "button", "--seconds", "6", "--json", summary, "--set",
      "hand.model=right_400.hand.json"};
  command.insert(command.end(), kFreePorts.begin(), kFreePorts.end());
  const Finished demo = run_program(command);
  EXPECT_EQ(demo.exit_code, 0) << demo.output;
  std::ifstream in(summary);
  const auto json = nlohmann::json::parse(in, nullptr, false);
  std::filesystem::remove(summary);
  ASSERT_TRUE(json.is_object());
  for (const auto& [process, restarts] : json["restarts"].items()) EXPECT_EQ(restarts, 0) << process << demo.output;
  EXPECT_GT(json["travel_mm"], 1) << json.dump(1) << demo.output;
}

TEST_F(Choice, DemoRefusesAnUnknownName) {
  const Finished demo = run_program({SOFTHAND_PROGRAMS "/softhand", "demo", "juggling"});
  EXPECT_EQ(demo.exit_code, 1);
  EXPECT_NE(demo.output.find("expected one of: bottle, "), std::string::npos) << demo.output;
}

}  // namespace
}  // namespace softhand::rig
