// The messages of the Haply Inverse Service: as documented, damaged, and commands.
#include <gtest/gtest.h>

#include <string>

#include "haptics/haply/haply_messages.hpp"
#include "support/count_allocations.hpp"

namespace softhand::haply_test {
namespace {

// With the members that a service of version 3.5 sends first.
const std::string kInventory =
    R"({"session_id":7,"inverse3":[{"device_id":"049D","config":{"type":"inverse3","basis":{"permutation":"XYZ"}},)"
    R"("state":{"cursor_position":{"x":0.01,"y":-0.12,"z":0.15},"cursor_velocity":{"x":0.1,"y":0.2,"z":0.3},)"
    R"("current_cursor_force":{"x":0,"y":0,"z":1.5},"control_mode":"idle"},"status":{"calibrated":true}}],)"
    R"("wireless_verse_grip":[{"device_id":"61","state":{"buttons":{"a":false}}}]})";
const std::string kState = R"({"inverse3":[{"device_id":"A1","state":{"cursor_position":{"x":0,"y":0,"z":0}}},)"
                           R"({"device_id":"B2","state":{"cursor_position":{"x":0.2,"y":0,"z":0}}}]})";

HaplyReport report_of(const std::string& text, std::string_view id = "") { return decode_haply_report(text, id); }

TEST(HaplyReport, TurnsTheAxesOfTheService) {
  const HaplyReport report = report_of(kInventory);
  EXPECT_EQ(report.refusal, HaplyRefusal::none);
  EXPECT_TRUE(report.has_device && report.is_inventory && report.has_session);
  EXPECT_STREQ(report.device_id.data(), "049D");
  EXPECT_EQ(report.position, (Vec3{0.01, 0.15, 0.12}));
  EXPECT_EQ(report.velocity, (Vec3{0.1, 0.3, -0.2}));
  EXPECT_TRUE(report.has_velocity && report.has_force);
  EXPECT_EQ(report.force[1], 1.5);
}

TEST(HaplyReport, FindsTheWantedDevice) {
  EXPECT_STREQ(report_of(kState).device_id.data(), "A1");
  EXPECT_EQ(report_of(kState, "B2").position[0], 0.2);
  EXPECT_FALSE(report_of(kState, "B2").has_velocity);
  EXPECT_FALSE(report_of(kState, "B2").is_inventory || report_of(kState).has_session);
  EXPECT_FALSE(report_of(kState, "C3").has_device);
  EXPECT_EQ(report_of(kState, "C3").refusal, HaplyRefusal::none);
  EXPECT_FALSE(report_of(R"({"inverse3":[]})").has_device);
  EXPECT_FALSE(report_of("{}").has_device);
}

TEST(HaplyReport, RefusesEveryTruncation) {
  for (std::size_t size = 0; size < kInventory.size(); ++size)
    EXPECT_EQ(report_of(kInventory.substr(0, size)).refusal, HaplyRefusal::json) << size;
}

TEST(HaplyReport, RefusesMalformedMessages) {
  const auto device = [](const std::string& state) {
    return R"({"inverse3":[{"device_id":"049D","state":)" + state + "}]}";
  };
  const std::pair<std::string, HaplyRefusal> cases[]{
      {kInventory + kInventory, HaplyRefusal::json},
      {"7", HaplyRefusal::json},
      {R"({"inverse3":{}})", HaplyRefusal::content},
      {R"({"inverse3":[7]})", HaplyRefusal::content},
      {R"({"inverse3":[{"device_id":7}]})", HaplyRefusal::content},
      {R"({"inverse3":[{"device_id":""}]})", HaplyRefusal::content},
      {R"({"inverse3":[{"device_id":"a\"}"}]})", HaplyRefusal::content},
      {R"({"inverse3":[{"device_id":")" + std::string(32, 'a') + R"("}]})", HaplyRefusal::content},
      {R"({"inverse3":[{"device_id":"049D"}]})", HaplyRefusal::content},
      {device("7"), HaplyRefusal::content},
      {device(R"({"cursor_position":{"x":0,"y":0}})"), HaplyRefusal::content},
      {device(R"({"cursor_position":{"x":0,"y":0,"z":"0"}})"), HaplyRefusal::content},
      {device(R"({"cursor_position":{"x":0,"y":0,"z":null}})"), HaplyRefusal::content},
      {device(R"({"cursor_position":[0,0,0]})"), HaplyRefusal::content},
      {device(R"({"cursor_position":{"x":0,"y":0,"z":0},"cursor_velocity":7})"), HaplyRefusal::content},
      {device(R"({"cursor_position":{"x":0,"y":1.1,"z":0}})"), HaplyRefusal::range},
      {device(R"({"cursor_position":{"x":0,"y":0,"z":0},"cursor_velocity":{"x":0,"y":0,"z":11}})"),
       HaplyRefusal::range},
      {device(R"({"cursor_position":{"x":0,"y":0,"z":0},"current_cursor_force":{"x":0,"y":0,"z":1e300}})"),
       HaplyRefusal::range}};
  for (const auto& [text, reason] : cases) {
    const HaplyReport report = report_of(text);
    EXPECT_EQ(report.refusal, reason) << text;
    EXPECT_FALSE(report.has_device) << text;
  }
  EXPECT_EQ(report_of(device(R"({"cursor_position":{"x":NaN,"y":0,"z":0}})")).refusal, HaplyRefusal::json);
}

TEST(HaplyEvent, KnowsWhatStopsADevice) {
  const auto event = [](const std::string& name, const std::string& data) {
    return decode_haply_event(R"({"name":")" + name + R"(","category":"device","level":"warning","data":)" + data +
                              R"(,"message":"text"})");
  };
  const auto safety = [&](const std::string& type) {
    return event("device-safety-triggered", R"({"device_id":"049D","safety_type":")" + type + R"("})");
  };
  EXPECT_EQ(safety("ebrake_triggered").kind, HaplyEventKind::brake);
  EXPECT_STREQ(safety("ebrake_triggered").device_id.data(), "049D");
  EXPECT_EQ(safety("ebrake_released").kind, HaplyEventKind::release);
  EXPECT_EQ(safety("stall_detected").kind, HaplyEventKind::stop);
  EXPECT_EQ(safety("stability_ceiling").kind, HaplyEventKind::stop);
  EXPECT_EQ(safety("fod_stage_changed").kind, HaplyEventKind::other);
  EXPECT_EQ(event("device-disconnected", "{}").kind, HaplyEventKind::stop);
  EXPECT_EQ(event("device-sleep", "{}").kind, HaplyEventKind::other);
  EXPECT_EQ(event("device-safety-triggered", "{}").refusal, HaplyRefusal::content);
  EXPECT_EQ(event("device-sleep", R"({"device_id":7})").refusal, HaplyRefusal::content);
  EXPECT_EQ(decode_haply_event("{}").refusal, HaplyRefusal::content);
  EXPECT_EQ(decode_haply_event("{").refusal, HaplyRefusal::json);
}

TEST(HaplyCommand, WritesBothKeysInTheAxesOfTheService) {
  const HaplyId id{'0', '4', '9', 'D'};
  EXPECT_EQ(HaplyCommand(id, HaplyForceKey::vector, {1, 2, 3}).text(),
            R"({"inverse3":[{"device_id":"049D","commands":{"set_cursor_force":)"
            R"({"vector":{"x":1.000000,"y":-3.000000,"z":2.000000}}}}]})");
  EXPECT_EQ(HaplyCommand(id, HaplyForceKey::values, {-40, 0, 0}).text(),
            R"({"inverse3":[{"device_id":"049D","commands":{"set_cursor_force":)"
            R"({"values":{"x":-40.000000,"y":0.000000,"z":0.000000}}}}]})");
  HaplyId longest;
  longest.fill('a');
  longest.back() = '\0';
  counting = true;
  const HaplyCommand command(longest, HaplyForceKey::vector, {-40.123456, -40.123456, 40.123456});
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_EQ(command.text().substr(command.text().size() - 6), "}}}}]}");
}

}  // namespace
}  // namespace softhand::haply_test
