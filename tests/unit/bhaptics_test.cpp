// The messages of the bHaptics Player: reports, damaged ones, and frames.
#include <gtest/gtest.h>

#include <string>

#include "support/count_allocations.hpp"
#include "tactile/bhaptics/player_messages.hpp"

namespace softhand::bhaptics_test {
namespace {

const std::string kReport =
    R"({"ConnectedDeviceCount":2,"ConnectedPositions":["GloveL","GloveR"],"ActiveKeys":["a"],"RegisteredKeys":[],)"
    R"("Status":{"GloveL":[0,0,0,0,0,0],"GloveR":[1,2,3,4,5,100,0,0]}})";

PlayerReport report_of(const std::string& text) { return decode_player_report(text, Side::right); }

TEST(PlayerReport, FindsTheGloveOfTheHand) {
  const PlayerReport report = report_of(kReport);
  EXPECT_EQ(report.refusal, PlayerRefusal::none);
  EXPECT_TRUE(report.has_positions && report.is_connected && report.has_motors);
  EXPECT_EQ(report.motors, (std::array<std::uint8_t, kGloveMotors>{1, 2, 3, 4, 5, 100}));
  EXPECT_FALSE(report_of(R"({"ConnectedPositions":["GloveL"]})").is_connected);
  EXPECT_TRUE(decode_player_report(R"({"ConnectedPositions":["GloveL"]})", Side::left).is_connected);
  EXPECT_FALSE(report_of("{}").has_positions);
}

TEST(PlayerReport, TakesTheSpellingsOfOtherVersions) {
  EXPECT_TRUE(report_of(R"({"connectedPositions":[203,204]})").is_connected);
  EXPECT_FALSE(report_of(R"({"connectedPositions":[203]})").is_connected);
  EXPECT_EQ(report_of(R"({"status":{"GloveR":[7,0,0,0,0,0]}})").motors[0], 7);
  EXPECT_FALSE(report_of(R"({"status":{"GloveL":[7,0,0,0,0,0]}})").has_motors);
}

TEST(PlayerReport, RefusesMalformedMessages) {
  for (std::size_t size = 0; size < kReport.size(); ++size)
    EXPECT_EQ(report_of(kReport.substr(0, size)).refusal, PlayerRefusal::json) << size;
  const std::pair<std::string, PlayerRefusal> cases[]{
      {kReport + kReport, PlayerRefusal::json},
      {"[]", PlayerRefusal::json},
      {R"({"ConnectedPositions":7})", PlayerRefusal::content},
      {R"({"ConnectedPositions":[null]})", PlayerRefusal::content},
      {R"({"Status":[]})", PlayerRefusal::content},
      {R"({"Status":{"GloveR":7}})", PlayerRefusal::content},
      {R"({"Status":{"GloveR":[1,2,3]}})", PlayerRefusal::content},
      {R"({"Status":{"GloveR":[1,2,3,4,5,0.5]}})", PlayerRefusal::content},
      {R"({"Status":{"GloveR":[1,2,3,4,5,"6"]}})", PlayerRefusal::content},
      {R"({"Status":{"GloveR":[1,2,3,4,5,101]}})", PlayerRefusal::range},
      {R"({"Status":{"GloveR":[-1,2,3,4,5,6]}})", PlayerRefusal::range}};
  for (const auto& [text, reason] : cases) {
    EXPECT_EQ(report_of(text).refusal, reason) << text;
    EXPECT_FALSE(report_of(text).has_motors || report_of(text).has_positions) << text;
  }
}

TEST(PlayerFrame, HasTheMotorsThatVibrate) {
  EXPECT_EQ(PlayerFrame(Side::right, std::array<double, 6>{0, 0.6, 0, 0, 0, 2}, 50).text(),
            R"({"Register":[],"Submit":[{"Type":"frame","Key":"softhandGloveR","Frame":{"DurationMillis":50,)"
            R"("Position":"GloveR","Texture":0,"DotPoints":[{"Index":1,"Intensity":60},{"Index":5,"Intensity":100}],)"
            R"("PathPoints":[]}}]})");
  EXPECT_EQ(PlayerFrame(Side::left, std::array<double, 6>{0.004}, 100).text(),
            R"({"Register":[],"Submit":[{"Type":"frame","Key":"softhandGloveL","Frame":{"DurationMillis":100,)"
            R"("Position":"GloveL","Texture":0,"DotPoints":[],"PathPoints":[]}}]})");
  counting = true;
  const PlayerFrame longest(Side::right, std::array<double, 6>{1, 1, 1, 1, 1, 1}, 1000);
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_EQ(longest.text().substr(longest.text().size() - 4), "}}]}");
}

}  // namespace
}  // namespace softhand::bhaptics_test
