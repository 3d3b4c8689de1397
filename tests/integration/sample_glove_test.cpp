// The sample glove: the page shows its code, forces of the simulation become packets, and every end is a zero force.
#include <fstream>
#include <iterator>

#include "runtime/clock.hpp"
#include "support/force_packets.hpp"
#include "support/tracker_process.hpp"

namespace softhand::sample_glove_test {
namespace {

std::string text_of(const std::string& path) {
  std::ifstream in(std::string(SOFTHAND_SOURCE_DIR) + "/" + path);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

TEST(SampleGlove, ThePageShowsItsCode) {
  const std::string page = text_of("docs/add-a-device.md");
  for (const char* file : {"CMakeLists.txt", "sample_glove.hpp", "driver.cpp", "main.cpp", "conformance_test.cpp"}) {
    const std::string code = text_of(std::string("services/haptics/sample/") + file);
    ASSERT_FALSE(code.empty()) << file;
    EXPECT_NE(page.find("\n" + code + "```\n"), std::string::npos) << "docs/add-a-device.md differs from " << file;
  }
}

TEST(SampleGlove, ForcesReachTheGloveAndEveryEndIsZero) {
  testing::use_own_domain();
  testing::ForcePackets<5> glove;
  testing::Process driver(
      "softhand-haptic-sample",
      {"--config", std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml", "--set",
       "haptic_sample.port=" + std::to_string(glove.port()), "--set", "haptic_sample.maximum_force=3"},
      false);
  const bus::Participant participant("glove-test");
  bus::Writer<BoneWrench> writer(participant, bus::topics::bone_wrench);
  BoneWrench wrench;
  wrench.simulated_valid = 1;
  wrench.stamp.clock_id = clock_id();
  wrench.stamp.epoch = 7;
  // Sends a force on the index finger for `milliseconds`. Returns true as soon as `done`.
  const auto send = [&](double newton, int milliseconds, const auto& done) {
    for (int i = 0; i < milliseconds / 5; ++i) {
      ++wrench.stamp.sequence;
      wrench.stamp.sample_time = wrench.stamp.publish_time = now();
      wrench.bones[static_cast<std::size_t>(index_of(Body::index_distal))].coupling_force = {0, newton, 0};
      writer.write(wrench);
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      if (done()) return true;
    }
    return false;
  };
  ASSERT_TRUE(send(2, 10'000, [&] { return glove.forces() == std::array<float, 5>{0, 2, 0, 0, 0}; }));
  EXPECT_TRUE(send(50, 10'000, [&] { return glove.forces()[1] == 3; }));  // clamped

  // Silence of the simulation: zero after 40 ms. The bound leaves room for a busy machine.
  const Nanoseconds silent = now();
  while (glove.forces()[1] != 0 && now() - silent < 1'000'000'000) std::this_thread::yield();
  std::printf("zero %.1f ms after the last input\n", static_cast<double>(now() - silent) * 1e-6);
  EXPECT_LT(now() - silent, 100'000'000);

  ASSERT_TRUE(send(2, 10'000, [&] { return glove.forces()[1] == 2; }));
  EXPECT_EQ(driver.end(SIGTERM), 0);
  EXPECT_EQ(glove.forces()[1], 0);
}

}  // namespace
}  // namespace softhand::sample_glove_test
