// The messages of the WEART middleware: tracking, states, damaged ones, and effects.
#include <gtest/gtest.h>

#include <string>

#include "support/count_allocations.hpp"
#include "tactile/weart/weart_messages.hpp"

namespace softhand::weart_test {
namespace {

const std::string kTracking = "Tracking:TrackType1:255:51:0:102:0:0:255:204";

WeartReport report_of(const std::string& text, Side side = Side::right) { return decode_weart(text, side); }
std::string bending(const std::string& fingers) {
  return R"({"type":"TRACKING_BENDING_G2","ts":1,"data":{"handSide":"RIGHT")" + fingers + "}}";
}

TEST(WeartReport, DecodesCurlsOfBothHands) {
  const WeartReport right = report_of(kTracking), left = report_of(kTracking, Side::left);
  EXPECT_EQ(right.kind, WeartKind::tracking);
  EXPECT_EQ(right.fingers[1].curl, (std::array<double, 3>{1, 1, 1}));
  EXPECT_NEAR(right.fingers[0].curl[0], 0.2, 1e-12);
  EXPECT_EQ(right.fingers[0].splay, -1);
  EXPECT_NEAR(right.fingers[2].curl[2], 0.4, 1e-12);
  EXPECT_TRUE(right.fingers[2].valid);
  EXPECT_FALSE(right.fingers[3].valid || right.fingers[4].valid);
  EXPECT_EQ(left.fingers[1].curl[0], 0);
  EXPECT_EQ(left.fingers[0].splay, 1);
  EXPECT_NEAR(left.fingers[2].curl[0], 0.8, 1e-12);
}

TEST(WeartReport, DecodesAllFingersOfAPro) {
  const std::string text = bending(
      R"(,"thumb":{"closure":0.5,"abduction":0.75},"index":{"closure":1,"abduction":0},"pinky":{"closure":0.25},)"
      R"("wrist":{"quaternion":{"x":0}})");
  const WeartReport report = report_of(text);
  EXPECT_EQ(report.kind, WeartKind::tracking);
  EXPECT_EQ(report.fingers[0].curl[0], 0.5);
  EXPECT_EQ(report.fingers[0].splay, 0.5);
  EXPECT_EQ(report.fingers[1].splay, 0);
  EXPECT_EQ(report.fingers[4].curl[2], 0.25);
  EXPECT_FALSE(report.fingers[2].valid || report.fingers[3].valid);
  EXPECT_EQ(report_of(text, Side::left).kind, WeartKind::other);
}

TEST(WeartReport, DecodesStates) {
  EXPECT_EQ(report_of("CalibrationStatus:1:2").kind, WeartKind::calibration);
  EXPECT_EQ(report_of("CalibrationStatus:1:2").value, 2);
  EXPECT_EQ(report_of("CalibrationStatus:0:2").kind, WeartKind::other);
  EXPECT_EQ(report_of("CalibrationStatus:0:2", Side::left).kind, WeartKind::calibration);
  EXPECT_EQ(report_of("CalibrationResult:1:1").value, 1);
  for (const char* type : {"MW_STATUS", "WA_STATUS"}) {
    const WeartReport status =
        report_of(std::string(R"({"type":")") + type + R"(","ts":1,"data":{"status":"RUNNING","statusCode":103}})");
    EXPECT_EQ(status.kind, WeartKind::middleware);
    EXPECT_EQ(status.value, 103);
  }
  const std::string devices =
      R"({"type":"DEVICES_STATUS","ts":1,"data":{"devices":[{"handSide":"RIGHT"},{"handSide":"LEFT"}]}})";
  EXPECT_EQ(report_of(devices).kind, WeartKind::devices);
  EXPECT_EQ(report_of(devices).value, 1);
  for (const std::string text : {R"({"type":"RAW_DATA","ts":1,"data":{}})", "SensorsData:0:1", "disconnect"}) {
    EXPECT_EQ(report_of(text).kind, WeartKind::other) << text;
    EXPECT_EQ(report_of(text).refusal, WeartRefusal::none) << text;
  }
}

TEST(WeartReport, AsksForStatesAndReadsTheVersion) {
  const std::string questions = weart_questions();
  EXPECT_EQ(questions.find(R"({"type":"MW_GET_STATUS","ts":)"), 0u);
  EXPECT_NE(questions.find(R"(}~{"type":"DEVICES_GET_STATUS","ts":)"), std::string::npos);
  EXPECT_EQ(questions.back(), kWeartEnd);
  EXPECT_EQ(questions.find("StartFromClient"), std::string::npos);
  EXPECT_EQ(weart_version(R"({"type":"MW_STATUS","data":{"statusCode":0,"version":"2.0.1"}})"), "2.0.1");
  // Others are not shown: a terminal would obey control characters.
  for (const char* text : {R"({"type":"MW_STATUS","data":{"version":"2\u001b[2J"}})", R"({"data":{"version":2}})",
                           R"({"data":{}})", R"({"data":7})", "[]", "2.0.1", "{", ""})
    EXPECT_EQ(weart_version(text), "") << text;
}

TEST(WeartReport, RefusesMalformedMessages) {
  const std::pair<std::string, WeartRefusal> cases[]{
      {"", WeartRefusal::syntax},
      {"7:8", WeartRefusal::syntax},
      {kTracking + ":0", WeartRefusal::syntax},
      {kTracking + kTracking, WeartRefusal::syntax},  // the end between them was lost
      {"Tracking:TrackType1:1:2:3", WeartRefusal::syntax},
      {"Tracking:TrackType1:1:2:3:4:5:6:7:x", WeartRefusal::syntax},
      {"Tracking:TrackType1:1:2:3:4:5:6:7:", WeartRefusal::syntax},
      {"Tracking:TrackType1:256:2:3:4:5:6:7:8", WeartRefusal::range},
      {"Tracking:TrackType1:-1:2:3:4:5:6:7:8", WeartRefusal::range},
      {"Tracking:TrackType1:99999999999:2:3:4:5:6:7:8", WeartRefusal::syntax},
      {"Tracking::1:2:3:4:5:6:7:8", WeartRefusal::content},
      {"CalibrationStatus:1", WeartRefusal::syntax},
      {"CalibrationStatus:2:0", WeartRefusal::range},
      {"CalibrationStatus:1:3", WeartRefusal::range},
      {"CalibrationResult:1:2", WeartRefusal::range},
      {"{", WeartRefusal::json},
      {"{}", WeartRefusal::content},
      {R"({"type":7})", WeartRefusal::content},
      {R"({"type":"TRACKING_BENDING_G2"})", WeartRefusal::content},
      {R"({"type":"TRACKING_BENDING_G2","data":{}})", WeartRefusal::content},
      {bending(R"(,"index":{})"), WeartRefusal::content},
      {bending(R"(,"index":7)"), WeartRefusal::content},
      {bending(R"(,"index":{"closure":"1"})"), WeartRefusal::content},
      {bending(R"(,"index":{"closure":1.1})"), WeartRefusal::range},
      {bending(R"(,"index":{"closure":1,"abduction":-0.1})"), WeartRefusal::range},
      {R"({"type":"MW_STATUS","data":{}})", WeartRefusal::content},
      {R"({"type":"MW_STATUS","data":{"statusCode":-1}})", WeartRefusal::range},
      {R"({"type":"DEVICES_STATUS","data":{"devices":7}})", WeartRefusal::content},
      {R"({"type":"DEVICES_STATUS","data":{"devices":[7]}})", WeartRefusal::content}};
  for (const auto& [text, reason] : cases) {
    EXPECT_EQ(report_of(text).refusal, reason) << text;
    EXPECT_EQ(report_of(text).kind, WeartKind::other) << text;
  }
  const std::string good = bending(R"(,"index":{"closure":1})");
  for (std::size_t size = 1; size < good.size(); ++size)
    EXPECT_EQ(report_of(good.substr(0, size)).refusal, WeartRefusal::json) << size;
}

TEST(WeartCommand, SetsAndStopsEffects) {
  const std::array<WeartEffects, 2> points{WeartEffects{}, {0.5, -0.5, 0.5}};
  EXPECT_EQ(WeartCommand(Side::right, points, 2, 100).text(),
            "stopForce:RIGHT:THUMB~stopTemperature:RIGHT:THUMB~stopTexture:RIGHT:THUMB~"
            "force:0.500000:0.000000:0.000000:RIGHT:INDEX~temperature:0.250000:RIGHT:INDEX~"
            "texture:2:0.500000:0.000000:0.250000:100.000000:RIGHT:INDEX~");
  const std::array<WeartEffects, 1> most{WeartEffects{7, 7, 7}};
  EXPECT_EQ(WeartCommand(Side::left, most, 21, 50).text(),
            "force:1.000000:0.000000:0.000000:LEFT:THUMB~temperature:1.000000:LEFT:THUMB~"
            "texture:21:0.500000:0.000000:0.500000:50.000000:LEFT:THUMB~");
  std::array<WeartEffects, kWeartPoints.size()> all;
  all.fill({1, 1, 1});
  counting = true;
  const WeartCommand longest(Side::right, all, 21, 100);
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_EQ(longest.text().substr(longest.text().size() - 12), ":RIGHT:PALM~");
}

}  // namespace
}  // namespace softhand::weart_test
