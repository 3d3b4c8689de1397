// `softhand calibrate` with a tracker as a process: a person with other bone lengths shows the postures. Then the hand
// of a rig has these lengths, and a flight file repeats after the calibration has changed.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <optional>

#include "integration/rig_harness.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "support/calibrating_person.hpp"
#include "support/moving_hand.hpp"
#include "support/own_domain.hpp"

namespace softhand::rig::calibration_process_test {
namespace {

using namespace std::chrono_literals;
namespace fs = std::filesystem;

const std::string kProgram = std::string(SOFTHAND_PROGRAMS) + "/softhand";
const std::string kScene = std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/free_motion.toml";
constexpr double kSeconds = 10;

class CalibrationProcess : public ::testing::Test {
 protected:
  CalibrationProcess() {
    testing::use_own_domain();
    fs::create_directories(folder_);
    setenv("XDG_DATA_HOME", folder_.c_str(), 1);
    const testing::CalibratingPerson person(hand_, kSeconds / kPostureCount);
    std::vector<double> times;
    for (double time = 0; time < person.duration(); time += 1.0 / 90) times.push_back(time);
    std::ofstream(motion_) << testing::recording_text(person, times);
    std::ofstream(flat_) << testing::recording_text(person, {0, 1});
  }
  ~CalibrationProcess() override { fs::remove_all(folder_); }

  std::vector<std::string> with_scene(const std::string& program, std::vector<std::string> arguments = {}) const {
    arguments.insert(arguments.begin(), {std::string(SOFTHAND_PROGRAMS) + "/" + program, "--config", kScene});
    return arguments;
  }
  std::vector<std::string> tracker(const std::string& motion) const {
    return with_scene("softhand-tracker-replay",
                      {"--set", "motion=" + motion, "--set", "fit_hand=false", "--set", "calibration=none"});
  }
  // Runs `softhand calibrate` beside a tracker that begins the motion when the first step begins.
  Finished calibrate(const std::string& motion) {
    const Program person(tracker(motion));
    bus::Participant participant("calibration test");
    bus::Writer messages(participant, bus::topics::message);
    std::FILE* const pipe =
        popen((kProgram + " calibrate --seconds " + std::to_string(kSeconds) + " 2>&1").c_str(), "r");
    Finished result;
    std::array<char, 512> line;
    while (std::fgets(line.data(), line.size(), pipe) != nullptr) {
      result.output += line.data();
      if (std::string(line.data()).find("1/4 ") != 0) continue;
      Message message;
      set_text(message.module, "*");
      set_text(message.key, "restart");
      set_text(message.value, "now");
      message.id = 1;
      message.stamp.sequence = 1;
      message.stamp.epoch = participant.epoch();
      message.stamp.clock_id = clock_id();
      message.stamp.publish_time = message.stamp.sample_time = now();
      messages.write(message);
    }
    result.exit_code = WEXITSTATUS(pclose(pipe));
    std::printf("%s", result.output.c_str());
    return result;
  }
  std::string text_of_file() const {
    std::ifstream file(file_);
    return {std::istreambuf_iterator<char>(file), {}};
  }

  // The largest relative difference of a bone's length between the simulated hand and the person's, while the person
  // shows the flat hand. Negative: no simulated hand.
  double difference(const std::vector<std::string>& settings, const std::string& flight = "") {
    const Program person(tracker(flat_));
    std::optional<Program> tracking(with_scene("softhand-tracking", settings));
    auto arguments = settings;
    if (!flight.empty()) arguments.insert(arguments.end(), {"--flight", flight});
    std::optional<Program> hand(with_scene("softhand-hand", arguments));
    bus::Participant participant("calibration test");
    bus::Reader<Skeleton> reader(participant, bus::topics::simulated_skeleton);
    Skeleton newest;
    int count = 0;
    for (const Nanoseconds end = now() + 30'000'000'000; count < 150 && now() < end;) {
      usleep(2000);
      reader.take_all([&](const Skeleton& sample) { newest = sample, ++count; });
    }
    for (auto* program : {&hand, &tracking}) {
      (*program)->send_signal(SIGTERM);
      EXPECT_EQ((*program)->wait(10s), 0) << (*program)->output();
    }
    if (count < 150) return -1;
    JointFrames joints;
    for (std::size_t j = 0; j < kJointCount; ++j) joints[j] = to_pose(newest.joints[j]);
    double worst = 0;
    for (std::size_t j = 2; j < kJointCount; ++j) {
      const double expected = testing::bone_length(hand_.rest_joints, j);
      worst = std::max(worst, std::abs(testing::bone_length(joints, j) / expected - 1));
    }
    return worst;
  }

  const fs::path folder_ = fs::temp_directory_path() / ("softhand_calibrate_" + std::to_string(getpid()));
  const std::string motion_ = (folder_ / "person.csv").string(), flat_ = (folder_ / "flat.csv").string();
  const fs::path file_ = folder_ / "softhand/users/0-right.toml";
  const HandModel hand_ =
      testing::other_lengths(load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json"));
};

TEST_F(CalibrationProcess, TheSimulatedHandGetsTheBonesOfThePerson) {
  const Finished done = calibrate(motion_);
  ASSERT_EQ(done.exit_code, 0);
  EXPECT_NE(done.output.find("the right hand of user 0 is in " + file_.string()), std::string::npos);
  EXPECT_EQ(fs::status(file_).permissions(), fs::perms::owner_read | fs::perms::owner_write);

  const std::vector<std::string> small{"--set", "hand.model=right_400.hand.json"};
  auto none = small;
  none.insert(none.end(), {"--set", "calibration=none"});
  const std::string flight = (folder_ / "flight").string();
  const double without = difference(none), with = difference(small, flight);
  std::printf("largest difference of a bone's length: %.2f %%, without calibration %.2f %%\n", 100 * with,
              100 * without);
  EXPECT_GT(without, 0.05);
  EXPECT_GE(with, 0);
  EXPECT_LT(with, 0.01);

  // The flight file has the calibration, so it repeats without the file.
  fs::remove(file_);
  ASSERT_TRUE(fs::exists(flight));
  int files = 0;
  for (const auto& entry : fs::directory_iterator(flight)) {
    const Finished repeated = run_program({kProgram, "simulate", "--brief", "--from", entry.path().string()});
    EXPECT_EQ(repeated.exit_code, 0) << repeated.output;
    EXPECT_NE(repeated.output.find(": 0 different states, 0 different snapshots"), std::string::npos)
        << repeated.output;
    ++files;
  }
  EXPECT_EQ(files, 1);
}

TEST_F(CalibrationProcess, ARefusedCalibrationKeepsTheFile) {
  fs::create_directories(file_.parent_path());
  std::ofstream(file_) << "kept";
  const Finished refused = calibrate(flat_);
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_NE(refused.output.find("the right hand is refused: step 2 of 4 (fist): the index finger closed by 0 degrees"),
            std::string::npos);
  EXPECT_EQ(text_of_file(), "kept");
}

TEST_F(CalibrationProcess, WithoutAHandItSaysSo) {
  const Finished nobody = run_program({kProgram, "calibrate", "--seconds", "4", "--user", "7"});
  EXPECT_EQ(nobody.exit_code, 1);
  EXPECT_NE(nobody.output.find("no hand of user 7 within 10 s"), std::string::npos) << nobody.output;
}

}  // namespace
}  // namespace softhand::rig::calibration_process_test
