// The lines of OpenGloves: as its libraries write them, damaged, and forces.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "haptics/opengloves/alpha_line.hpp"
#include "haptics/opengloves/simulated_glove.hpp"
#include "support/count_allocations.hpp"
#include "support/counters.hpp"

namespace softhand::opengloves_test {
namespace {

constexpr std::int64_t kMaximum = 4095;
const std::string kExample = "A0B2047C4095D0E0F2047G2047P0L";

AlphaLine decoded(const std::string& line, std::int64_t maximum = kMaximum) {
  AlphaLine out;
  EXPECT_EQ(decode_alpha_line(line, maximum, out), AlphaRefusal::none) << line;
  return out;
}
AlphaRefusal refusal_of(const std::string& line) {
  AlphaLine out;
  return decode_alpha_line(line, kMaximum, out);
}

TEST(AlphaLine, DecodesCurlsSplaysAndJoints) {
  const AlphaLine example = decoded(kExample);
  for (const FingerCurl& finger : example.fingers) EXPECT_TRUE(finger.valid);
  EXPECT_EQ(example.fingers[0].curl, (std::array<double, 3>{0, 0, 0}));
  EXPECT_EQ(example.fingers[1].curl[2], 2047.0 / 4095);
  EXPECT_EQ(example.fingers[2].curl, (std::array<double, 3>{1, 1, 1}));
  EXPECT_EQ(example.fingers[1].splay, 0);
  EXPECT_FALSE(example.hand);

  const AlphaLine splayed = decoded("A0(AB)0B0(BB)4095");
  EXPECT_EQ(splayed.fingers[0].splay, -1);
  EXPECT_EQ(splayed.fingers[1].splay, 1);
  EXPECT_FALSE(splayed.fingers[2].valid);

  // Joints replace the curl: those of the thumb begin with the metacarpal, those of a finger with the proximal joint.
  const AlphaLine joints = decoded("A1023(AAA)4095(AAC)2047B1023(BAA)1(BAB)2047(BAC)3071(BAD)4095");
  EXPECT_EQ(joints.fingers[0].curl, (std::array<double, 3>{1, 1023.0 / 4095, 2047.0 / 4095}));
  EXPECT_EQ(joints.fingers[1].curl, (std::array<double, 3>{2047.0 / 4095, 3071.0 / 4095, 1}));
  EXPECT_FALSE(decoded("(BAB)1(BAC)2").fingers[1].valid);
  EXPECT_TRUE(decoded("(BAB)1(BAC)2(BAD)3").fingers[1].valid);

  EXPECT_EQ(decoded("A1023", 1023).fingers[0].curl[0], 1);
  EXPECT_EQ(decoded("Z(ZV)42(ZG)0(ZH)0").hand, Side::left);
  EXPECT_EQ(decoded("(ZV)42(ZG)0(ZH)1").hand, Side::right);
  EXPECT_EQ(decoded("A1Q7R(XYZ)5").layout, 1u);  // keys of the future
  EXPECT_EQ(decoded("").layout, 0u);
  EXPECT_EQ(decoded("JML").layout, 0u);
}

TEST(AlphaLine, DecodesTheOlderNumbers) {
  const AlphaLine line = decoded("0&1023&512&0&0&512&512&0&0&0&0&1&0", 1023);
  EXPECT_EQ(line.fingers[1].curl[0], 1);
  EXPECT_TRUE(line.fingers[4].valid);
  EXPECT_EQ(refusal_of("0&1&2"), AlphaRefusal::syntax);
  EXPECT_EQ(refusal_of("0&1&2&3&4&5&6&7&8&9&10&11&12&13"), AlphaRefusal::syntax);
  EXPECT_EQ(refusal_of("0&1&2&3&4&5&6&7&8&9&10&11&"), AlphaRefusal::syntax);
  EXPECT_EQ(refusal_of("5000&1&2&3&4&5&6&7&8&9&10&11&12"), AlphaRefusal::range);
}

TEST(AlphaLine, RefusesMalformedLines) {
  const std::pair<const char*, AlphaRefusal> cases[]{
      {"A", AlphaRefusal::syntax},           {"A0B", AlphaRefusal::syntax},
      {"A-1", AlphaRefusal::syntax},         {"A1.5", AlphaRefusal::syntax},
      {"1A2", AlphaRefusal::syntax},         {"a0", AlphaRefusal::syntax},
      {"A0 B0", AlphaRefusal::syntax},       {"(AB", AlphaRefusal::syntax},
      {"()5", AlphaRefusal::syntax},         {"(A)5", AlphaRefusal::syntax},
      {"(ABCD)5", AlphaRefusal::syntax},     {"(A0)5", AlphaRefusal::syntax},
      {"(AB)", AlphaRefusal::syntax},        {")", AlphaRefusal::syntax},
      {"A4096", AlphaRefusal::range},        {"A123456", AlphaRefusal::range},
      {"P5000", AlphaRefusal::range},        {"(ZH)2", AlphaRefusal::range},
      {"(ZH)", AlphaRefusal::range},         {"A0B0A0B0", AlphaRefusal::repeated},
      {"A0JJ", AlphaRefusal::repeated},      {"(AB)1(AB)1", AlphaRefusal::repeated},
      {"A0B0F1G1F1", AlphaRefusal::repeated}};
  for (const auto& [line, reason] : cases) EXPECT_EQ(refusal_of(line), reason) << line;
  EXPECT_EQ(refusal_of(kExample + kExample), AlphaRefusal::repeated);  // the end of a line was lost
}

// A line of the tests of senseshift/opengloves-lib, with every joint and every splay.
TEST(AlphaLine, DecodesTheLongestLineOfAnotherLibrary) {
  const AlphaLine all = decoded(
      "A1023(AB)2047(AAB)2047(AAC)3071(AAD)4095B1023(BB)2047(BAB)2047(BAC)3071(BAD)4095C1023(CB)2047(CAB)2047(CAC)3071("
      "CAD)4095D1023(DB)2047(DAB)2047(DAC)3071(DAD)4095E1023(EB)2047(EAB)2047(EAC)3071(EAD)4095");
  EXPECT_NEAR(all.fingers[4].splay, 0, 1e-3);
  EXPECT_EQ(all.fingers[4].curl[2], 1);
}

// The file is not part of this project.
TEST(AlphaLine, DecodesTheLinesOfAnotherLibrary) {
  const std::string path = SOFTHAND_SOURCE_DIR "/../shared/data/opengloves/alpha-lines.txt";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "no " << path;
  std::ifstream in(path);
  int lines = 0;
  for (std::string line; std::getline(in, line);) {
    if (line.find('.') != std::string::npos) continue;  // haptic pulses to the glove
    const AlphaLine out = decoded(line);
    EXPECT_TRUE(out.fingers[0].valid || out.hand) << line;
    ++lines;
  }
  EXPECT_GT(lines, 15);
}

class Alpha : public ::testing::Test {
 protected:
  const FingerCurl* take(const std::string& line, std::uint64_t connection = 1, Nanoseconds time = 0) {
    const auto* fingers = decoder_.take({line, time, connection, false});
    return fingers == nullptr ? nullptr : fingers->data();
  }
  double refused(const std::string& name) const {
    LoopStatus status;
    decoder_.refusals().fill_status(status, 0);
    return testing::counter_of(status, "refused_" + name);
  }
  AlphaDecoder decoder_{Side::right, kMaximum};
};

TEST_F(Alpha, RefusesEveryTruncationAfterTheFirstLines) {
  EXPECT_EQ(take("C4095D0E0"), nullptr);  // the end of a line: the port was opened in between
  EXPECT_EQ(take("A1B2C3D4E5"), nullptr);
  EXPECT_EQ(refused("layout"), 1);
  ASSERT_NE(take("A1B2C3D4E5"), nullptr);
  const std::string line = "A100B200C300D400E500";
  for (std::size_t size = 1; size + 3 < line.size(); ++size) {  // but for the last number, no cut is unseen
    EXPECT_EQ(take(line.substr(0, size)), nullptr) << size;
    take(line);
    ASSERT_NE(take(line), nullptr);
  }
  const auto total = decoder_.refusals().total();
  EXPECT_EQ(take("A1B2C3D4E5A1B2C3D4E5"), nullptr);
  EXPECT_EQ(take("A1B9D4E5"), nullptr);  // bytes were lost within the line
  EXPECT_EQ(decoder_.refusals().total(), total + 2);
}

TEST_F(Alpha, FollowsTheNewestConnection) {
  for (int i = 0; i < 2; ++i) take("A0", 1);
  EXPECT_NE(take("A0", 1), nullptr);
  EXPECT_EQ(take("A4095", 2), nullptr);
  EXPECT_NE(take("A4095\r", 2), nullptr);
  EXPECT_EQ(decoder_.connection(), 2u);
  EXPECT_EQ(take("A0", 1), nullptr);
  EXPECT_EQ(decoder_.refusals().total(), 0u);
}

// Anybody may connect: a scanner, a browser, the glove of the other hand. The glove goes on.
TEST_F(Alpha, StaysWithTheGloveWhenOthersConnect) {
  for (int i = 0; i < 2; ++i) take("A0", 1);
  for (const char* line : {"GET / HTTP/1.1", "", "JM", "A99999"}) take(line, 2);
  take("(ZH)0", 3);
  take("A5", 3);
  EXPECT_EQ(take("A5", 3), nullptr);
  EXPECT_EQ(decoder_.connection(), 1u);
  EXPECT_EQ(decoder_.ignored(), 3u);  // "", "JM", "(ZH)0"
  EXPECT_NE(take("A1", 1), nullptr);
  for (std::uint64_t connection = 4; connection < 100; ++connection) take("hello", connection);
  EXPECT_NE(take("A1", 1), nullptr);
  take("(ZH)1", 100);  // the glove is back
  EXPECT_EQ(decoder_.connection(), 100u);
  take("A2", 100);
  EXPECT_NE(take("A2", 100), nullptr);
}

TEST_F(Alpha, ReturnsToTheOlderConnectionIfTheNewestIsSilent) {
  constexpr Nanoseconds second = 1'000'000'000;
  for (int i = 0; i < 2; ++i) take("A0", 1);
  for (int i = 0; i < 2; ++i) take("A0", 2);
  EXPECT_EQ(take("A0", 1, second / 2 - 1), nullptr);
  EXPECT_NE(take("A0", 1, second / 2), nullptr);
  EXPECT_EQ(decoder_.connection(), 1u);
  EXPECT_NE(take("A0", 2, second), nullptr);
  EXPECT_EQ(decoder_.connection(), 2u);
  EXPECT_EQ(take("A0", 1, second), nullptr);
}

TEST_F(Alpha, RefusesAGloveOfTheOtherHand) {
  take("Z(ZV)1(ZH)0");
  EXPECT_EQ(take("A0"), nullptr);
  EXPECT_EQ(take("A0"), nullptr);
  EXPECT_EQ(refused("hand"), 2);
  take("Z(ZV)1(ZH)1");
  take("A0");
  EXPECT_NE(take("A0"), nullptr);
  EXPECT_NE(take("A0"), nullptr);
}

TEST_F(Alpha, DoesNotAllocate) {
  take(kExample);
  const std::string bad = kExample + kExample;
  counting = true;
  for (int i = 0; i < 10; ++i) {
    decoder_.take({kExample, 0, 1, false});
    decoder_.take({bad, 0, 1, false});
  }
  const ForceLine line(std::array<double, 5>{0, 0.5, 1, 0, 0}, 1000);
  counting = false;
  EXPECT_EQ(allocations, 0);
}

TEST(ForceLine, ScalesAndClamps) {
  EXPECT_EQ(ForceLine(std::array<double, 5>{0, 0, 1, 0, 0}, 1000).text(), "A0B0C1000D0E0\n");
  EXPECT_EQ(ForceLine(std::array<double, 5>{0.2, 0.4, 0.6, 0.8, 1}, 4095).text(), "A819B1638C2457D3276E4095\n");
  EXPECT_EQ(ForceLine(std::array<double, 5>{-1, 2, 0.0004, 0.0006, 1}, 1000).text(), "A0B1000C0D1E1000\n");
  EXPECT_EQ(ForceLine(std::array<double, 5>{1, 1, 1, 1, 1}, 65535).text(), "A65535B65535C65535D65535E65535\n");
  std::array<int, 5> forces;
  EXPECT_TRUE(read_forces("A0B0C1000D0E7\n", forces));
  EXPECT_EQ(forces, (std::array<int, 5>{0, 0, 1000, 0, 7}));
}

}  // namespace
}  // namespace softhand::opengloves_test
