// Several trackers of one hand as processes: the strongest healthy one owns it, and `softhand trackers` switches.
#include <array>
#include <cstdio>
#include <optional>

#include "device/health.hpp"
#include "support/tracker_process.hpp"

namespace softhand::trackers_command_test {
namespace {

// Output and exit code of `softhand trackers ARGUMENTS`.
std::pair<std::string, int> trackers(const std::string& arguments) {
  std::FILE* const pipe =
      popen((std::string(SOFTHAND_PROGRAMS) + "/softhand trackers " + arguments + " 2>&1").c_str(), "r");
  std::string text;
  for (int c; (c = std::fgetc(pipe)) != EOF;) text += static_cast<char>(c);
  return {text, WEXITSTATUS(pclose(pipe))};
}

class Trackers : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { testing::use_own_domain(); }
  static std::vector<std::string> arguments(const char* module, const char* strength, const char* source,
                                            const std::vector<std::string>& settings = {}) {
    std::vector<std::string> out{"--config",   std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml",
                                 "--module",   module,
                                 "--strength", strength,
                                 "--source",   source};
    for (const std::string& setting : settings) {
      out.emplace_back("--set");
      out.push_back(setting);
    }
    return out;
  }
  // Readers hear only this source, for 200 ms.
  bool owner(std::uint32_t source) {
    int alone = 0;
    return listener_.until([&] { listener_.hands[1].source = 99; },
                           [&] {
                             const std::uint32_t heard = listener_.hands[1].source;
                             const double health = listener_.counter("health");
                             weak_was_well_ = weak_was_well_ && health == static_cast<double>(Health::live);
                             if (heard != 99) alone = heard == source ? alone + 1 : 0;
                             return alone >= 20;
                           });
  }
  testing::TrackerListener listener_;
  bool weak_was_well_ = true;  // by each status that owner() read, once listener_.module is "weak"
};

TEST_F(Trackers, AreListedAndSwitchedByHand) {
  EXPECT_EQ(trackers("").second, 1);  // none
  const testing::Process weak("softhand-tracker-replay", arguments("weak", "1", "1"), false);
  const testing::Process strong("softhand-tracker-replay", arguments("strong", "5", "2"), false);
  ASSERT_TRUE(owner(2));
  const auto [list, code] = trackers("");
  std::printf("%s", list.c_str());
  EXPECT_EQ(code, 0);
  const std::size_t of_strong = list.find("\nstrong"), of_weak = list.find("\nweak");
  ASSERT_TRUE(of_strong != std::string::npos && of_weak != std::string::npos);
  EXPECT_NE(list.find("the right hand of user 0", of_strong), std::string::npos);
  EXPECT_LT(list.find("the right hand of user 0"), of_weak);  // strong is listed first, and weak owns nothing
  EXPECT_EQ(list.find("the right hand of user 0", of_weak), std::string::npos);
  EXPECT_NE(list.find(" live "), std::string::npos);

  EXPECT_EQ(trackers("use weak"), std::pair(std::string("weak owns the right hand of user 0 (strength 6)\n"), 0));
  EXPECT_TRUE(owner(1));
  EXPECT_EQ(trackers("use strong").second, 0);
  EXPECT_TRUE(owner(2));
  EXPECT_EQ(trackers("use nobody").second, 1);
}

// The stronger tracker is in doubt for a second, and later silent for a second. Then the weaker one owns the hand until
// the other has been healthy for a second. A stall of the machine degrades the weaker one too, and then strength
// decides: such an attempt shows nothing and is made again.
TEST_F(Trackers, AHealthyTrackerOwnsBeforeAStrongerOneThatIsNot) {
  const testing::Process weak("softhand-tracker-replay", arguments("weak", "1", "1"), false);
  ASSERT_TRUE(owner(1));
  listener_.module = "weak";
  ASSERT_TRUE(listener_.until_health(Health::live));
  bool is_shown = false;
  for (int attempt = 0; attempt < 5 && !is_shown; ++attempt) {
    const testing::Process strong(
        "softhand-tracker-replay",
        arguments("strong", "5", "2",
                  {"tracker.doubt_at=1", "tracker.doubt_time=1", "tracker.freeze_at=4", "tracker.freeze_time=1"}),
        false);
    weak_was_well_ = true;
    std::array<Nanoseconds, 2> owned{};  // by the weaker one, from doubt and from silence
    for (Nanoseconds& time : owned) {
      ASSERT_TRUE(owner(2)) << attempt;
      ASSERT_TRUE(owner(1)) << attempt;
      const Nanoseconds since = now();
      ASSERT_TRUE(owner(2)) << attempt;
      time = now() - since;
    }
    is_shown = weak_was_well_;
    if (!is_shown) continue;
    EXPECT_GT(owned[0], 1'000'000'000);
    EXPECT_GT(owned[1], 1'000'000'000);
  }
  EXPECT_TRUE(is_shown) << "the machine stalled in every attempt";
}

}  // namespace
}  // namespace softhand::trackers_command_test
