// The hand of a user: measured from postures with known lengths, written, read, and used.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <random>

#include "device/curl_lifter.hpp"
#include "scene_file.hpp"
#include "support/calibrating_person.hpp"
#include "support/moving_hand.hpp"

namespace softhand::calibration_test {
namespace {

namespace fs = std::filesystem;
using testing::bone_length;
using testing::CalibratingPerson;

const std::string kHand = "/config/hands/right_400.hand.json";
const HandModel& shipped_hand() {
  static const HandModel hand = load_hand(SOFTHAND_SOURCE_DIR + kHand);
  return hand;
}

Skeleton sample_of(const JointFrames& joints) {
  Skeleton out;
  out.confidence = 1;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    out.joints[j].position = to_wire(joints[j].position);
    out.joints[j].orientation = to_wire(joints[j].orientation);
    out.joints[j].radius = 0.009;
    out.joints[j].flags = kJointValid | kJointTracked;
  }
  return out;
}

// Shows the postures for the last 60 % of 5 s each, at 90 Hz. `change` may change a sample, and what posture is shown.
using Change = std::function<void(Posture&, Skeleton&)>;
HandMeasurement measurement_of(const HandModel& hand, const Change& change = nullptr) {
  HandMeasurement out;
  for (std::size_t step = 0; step < kPostureCount; ++step) {
    for (int i = 0; i < 270; ++i) {
      auto shown = static_cast<Posture>(step);
      Skeleton sample;
      if (change) change(shown, sample);
      const Pose wrist{Vector3(0.1, 1, 0.01 * i), rotation_exp(Vector3(0.3, 0.002 * i, 0))};
      sample = sample_of(forward_kinematics(hand, wrist, CalibratingPerson::angles_of(hand, shown)));
      if (change) change(shown, sample);
      out.add(static_cast<Posture>(step), sample);
    }
  }
  return out;
}

std::string reason(const HandMeasurement& measurement) {
  try {
    measurement.measure(Side::right);
  } catch (const std::runtime_error& refused) {
    std::printf("%s\n", refused.what());
    return refused.what();
  }
  return "";
}
bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

// Without noise the lengths are exact. In the second run every joint has a noise of 1 mm and 1 degree, every twentieth
// sample of a joint is wrong by 3 cm, and some joints are in doubt. The lengths are then within 1 %.
TEST(Calibration, MeasuresTheLengthsOfEveryBone) {
  for (const Side side : {Side::right, Side::left}) {
    const HandModel hand = testing::other_lengths(side == Side::right ? shipped_hand() : mirrored(shipped_hand()));
    for (const bool noisy : {false, true}) {
      std::mt19937_64 random(3);
      std::normal_distribution<double> normal;
      const auto noise = [&](double size) -> Vector3 {
        return size * Vector3(normal(random), normal(random), normal(random));
      };
      const HandMeasurement measurement = measurement_of(hand, [&](Posture&, Skeleton& sample) {
        if (!noisy) return;
        for (JointSample& joint : sample.joints) {
          joint.position = to_wire(Vector3(to_vector(joint.position) + noise(1e-3)));
          joint.orientation = to_wire(Quaternion(to_quaternion(joint.orientation) * rotation_exp(noise(0.0175))));
          const auto dice = random() % 20;
          if (dice == 0) joint.position[0] += 0.03;
          if (dice == 1) joint.position[1] = std::numeric_limits<double>::quiet_NaN();
          if (dice == 2) joint.confidence = 0.1, joint.position[2] += 0.2;
          if (dice == 3) joint.flags = 0, joint.position[2] += 0.2;
        }
      });
      const HandModel user =
          fitted(side == Side::right ? shipped_hand() : mirrored(shipped_hand()), measurement.measure(side));
      double worst = 0;
      for (std::size_t j = slot_of(Joint::thumb_metacarpal); j < kJointCount; ++j) {
        const double expected = bone_length(hand.rest_joints, j);
        worst = std::max(worst, std::abs(bone_length(user.rest_joints, j) / expected - 1));
      }
      std::printf("%s: worst error of a length %.4f %%\n", noisy ? "with noise" : "without noise", 100 * worst);
      EXPECT_LT(worst, noisy ? 0.01 : 1e-6);
      EXPECT_EQ(user.joint_radii[slot_of(Joint::index_tip)], 0.009);
    }
  }
}

// A recorded Quest hand opens and closes, and points. Its flat, closed and thumb-near frames stand for the postures.
TEST(Calibration, MeasuresARecordedHand) {
  if (!fs::exists(testing::recorded_hand_path())) GTEST_SKIP() << "no " << testing::recorded_hand_path();
  const Recording recording = Recording::load(testing::recorded_hand_path());
  HandMeasurement measurement;
  std::array<int, kPostureCount> frames{};
  for (const JointFrames& joints : recording.frames()) {
    const auto flexion = [&joints](Joint first) {
      const Quaternion turn = joints[slot_of(first)].orientation.conjugate() * joints[slot_of(first) + 3].orientation;
      return std::abs(rotation_log(turn).x());
    };
    const double index = flexion(Joint::index_metacarpal), middle = flexion(Joint::middle_metacarpal);
    const double thumb =
        (joints[slot_of(Joint::thumb_tip)].position - joints[slot_of(Joint::little_proximal)].position).norm();
    const auto show = [&](Posture posture) {
      measurement.add(posture, sample_of(joints));
      ++frames[static_cast<std::size_t>(posture)];
    };
    show(Posture::relaxed);
    if (index < 0.3 && middle < 0.5 && thumb > 0.11) show(Posture::flat);
    // The index finger is closed in six frames only, so they count four times.
    for (int i = 0; i < 4; ++i)
      if (index > 1.6 && middle > 2) show(Posture::fist);
    if (thumb < 0.08) show(Posture::thumb_across);
  }
  std::printf("%d flat, %d closed, %d with the thumb near, %d\n", frames[0], frames[1], frames[2], frames[3]);
  const HandModel user = fitted(shipped_hand(), measurement.measure(Side::right));
  const HandModel mean = fitted(shipped_hand(), measure_skeleton(recording.frames(), recording.radii()));
  double worst = 0;
  for (std::size_t j = slot_of(Joint::thumb_metacarpal); j < kJointCount; ++j)
    worst = std::max(worst, std::abs(bone_length(user.rest_joints, j) / bone_length(mean.rest_joints, j) - 1));
  std::printf("worst difference of a length from the mean over the recording: %.3f %%\n", 100 * worst);
  EXPECT_LT(worst, 0.01);
}

// A closed glove closes the hand to the user's own fist. Other ranges only grow.
TEST(Calibration, RangesOfMotionAreThoseOfTheUser) {
  const HandModel& model = shipped_hand();
  const UserHand measured = measurement_of(model).measure(Side::right);
  const HandModel user = fitted(model, measured);
  const JointAngles fist = CalibratingPerson::angles_of(model, Posture::fist);
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const JointModel &before = model.bodies[b].joint, &after = user.bodies[b].joint;
    const Finger finger = finger_of(static_cast<Body>(b));
    EXPECT_GE(after.flexion_range[1], before.flexion_range[1]) << kBodyNames[b];
    if (finger == Finger::palm || finger == Finger::thumb || is_metacarpal(static_cast<Body>(b))) {
      EXPECT_LE(after.flexion_range[0], before.flexion_range[0]) << kBodyNames[b];
    } else {
      EXPECT_NEAR(after.flexion_range[0], fist[b].x(), 0.05) << kBodyNames[b];
      EXPECT_GT(after.flexion_range[0], before.flexion_range[0] + 0.02) << kBodyNames[b];
    }
  }
  // The fingertips of the closed glove are those of the fist, against the wrist.
  std::array<FingerCurl, kFingerCount> closed;
  closed.fill({true, {1, 1, 1}, 0});
  Skeleton glove;
  CurlLifter(user, Side::right).lift(closed, glove);
  const JointFrames shown = forward_kinematics(model, Pose{}, fist);
  for (const Joint tip : {Joint::index_tip, Joint::middle_tip, Joint::ring_tip, Joint::little_tip})
    EXPECT_LT((to_vector(glove.joints[slot_of(tip)].position) - shown[slot_of(tip)].position).norm(), 8e-3)
        << kJointNames[slot_of(tip)];
}

TEST(Calibration, SaysWhichStepFailedAndWhatToDo) {
  const HandModel& hand = shipped_hand();
  EXPECT_EQ(reason(measurement_of(hand)), "");
  const auto shows = [](Posture asked, Posture instead) {
    return [=](Posture& shown, Skeleton&) { shown = shown == asked ? instead : shown; };
  };
  EXPECT_TRUE(has(reason(measurement_of(hand, shows(Posture::flat, Posture::fist))),
                  "step 1 of 4 (flat hand): the index finger was bent by"));
  EXPECT_TRUE(has(reason(measurement_of(hand, shows(Posture::fist, Posture::relaxed))),
                  "step 2 of 4 (fist): the index finger closed by"));
  EXPECT_TRUE(has(reason(measurement_of(hand, shows(Posture::thumb_across, Posture::flat))),
                  "step 3 of 4 (thumb across): the tip of the thumb was"));
  EXPECT_TRUE(has(reason(measurement_of(hand,
                                        [](Posture& shown, Skeleton& sample) {
                                          if (shown == Posture::relaxed)
                                            sample.joints[slot_of(Joint::ring_tip)].flags = 0;
                                        })),
                  "step 4 of 4 (relaxed hand): the joint ring_tip was seen well in 0 samples"));
  EXPECT_TRUE(has(reason(measurement_of(hand, [](Posture&, Skeleton& sample) { sample.confidence = 0.4; })),
                  "step 1 of 4 (flat hand): the joint wrist was seen well in 0 samples"));
  EXPECT_TRUE(has(reason(HandMeasurement{}), "step 1 of 4"));
  int i = 0;
  EXPECT_TRUE(has(reason(measurement_of(hand,
                                        [&](Posture&, Skeleton& sample) {
                                          sample.joints[slot_of(Joint::middle_tip)].position[1] +=
                                              ++i % 4 < 2 ? 0.02 : -0.02;
                                        })),
                  "the length from middle_distal to middle_tip varied by"));
}

TEST(Calibration, RefusesLengthsThatAreNotThoseOfAHand) {
  HandModel hand = shipped_hand();
  const UserHand measured = measurement_of(hand).measure(Side::right);
  for (const double factor : {0.3, 2.5}) {
    UserHand user = measured;
    for (double& x : user.joints[slot_of(Joint::index_distal)].offset) x *= factor;
    EXPECT_THROW(fitted(hand, user), std::invalid_argument) << factor;
  }
  EXPECT_THROW(fitted(mirrored(hand), measured), std::invalid_argument);
}

TEST(Calibration, TheFileHasWhatWasMeasured) {
  const UserHand measured = measurement_of(testing::other_lengths(shipped_hand())).measure(Side::right);
  const std::string text = user_hand_text(measured);
  const UserHand read = read_user_hand(text, "test");
  EXPECT_EQ(user_hand_text(read), text);
  for (std::size_t j = 2; j < kJointCount; ++j) {
    EXPECT_LT((to_vector(read.joints[j].offset) - to_vector(measured.joints[j].offset)).norm(), 1e-9);
    EXPECT_EQ(read.joints[j].radius, 0.009);
  }

  const auto refused = [&](const std::string& from, const std::string& to) {
    std::string bad = text;
    const std::size_t place = bad.find(from);
    EXPECT_NE(place, std::string::npos) << from;
    bad.replace(place, from.size(), to);
    try {
      read_user_hand(bad, "users/0-right.toml");
    } catch (const ConfigError& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  EXPECT_TRUE(has(refused("radius = 0.009", "radius = nan"), "palm.radius"));
  EXPECT_TRUE(has(refused("side = \"right\"", "side = \"both\""), "side"));
  EXPECT_TRUE(has(refused("[ring_distal]", "[ring_dist]"), "unknown key 'ring_dist'"));
  const std::size_t cut = text.find("[little_tip]");
  EXPECT_TRUE(has(refused(text.substr(cut), ""), "'little_tip.offset': expected a length from 1 mm to 0.3 m"));
  EXPECT_TRUE(has(refused("orientation = [", "orientation = [9, "), "thumb_metacarpal.orientation"));
  EXPECT_EQ(refused("side", "side"), "accepted");
}

// $XDG_DATA_HOME, without it the home's .local/share. A relative path counts as none (XDG Base Directory
// Specification).
TEST(Calibration, IsKeptInTheFolderOfTheUsersData) {
  const auto path = [](const char* data, const char* home) {
    data == nullptr ? unsetenv("XDG_DATA_HOME") : setenv("XDG_DATA_HOME", data, 1);
    home == nullptr ? unsetenv("HOME") : setenv("HOME", home, 1);
    return user_hand_path({3, 0}).string();
  };
  EXPECT_EQ(path("/data", "/home/me"), "/data/softhand/users/3-left.toml");
  for (const char* data : {static_cast<const char*>(nullptr), "", "data"})
    EXPECT_EQ(path(data, "/home/me"), "/home/me/.local/share/softhand/users/3-left.toml");
  EXPECT_EQ(path(nullptr, nullptr), "");
  EXPECT_EQ(path(nullptr, "me"), "");
}

class CalibratedScene : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directories(folder_ / "softhand/users");
    setenv("XDG_DATA_HOME", folder_.c_str(), 1);
    write("softhand/users/0-right.toml", user_hand_text(measurement_of(other_).measure(Side::right)));
  }
  void TearDown() override { fs::remove_all(folder_); }
  void write(const std::string& file, const std::string& text) { std::ofstream(folder_ / file) << text; }
  static double index_length(const Scene& scene) {
    return bone_length(load_scene_hand(scene, "right_400.hand.json").rest_joints, slot_of(Joint::index_intermediate));
  }
  const fs::path folder_ = fs::temp_directory_path() / ("softhand_calibration_" + std::to_string(getpid()));
  const HandModel other_ = testing::other_lengths(shipped_hand());
  const double shipped_length_ = bone_length(shipped_hand().rest_joints, slot_of(Joint::index_intermediate));
  const double other_length_ = bone_length(other_.rest_joints, slot_of(Joint::index_intermediate));
  const std::string scene_ = SOFTHAND_SOURCE_DIR "/config/scenes/pinch.toml";
};

TEST_F(CalibratedScene, HasTheUsersHandInARigOnly) {
  EXPECT_GT(other_length_, 1.05 * shipped_length_);
  EXPECT_NEAR(index_length(read_own_scene(scene_, {})), other_length_, 1e-6);
  EXPECT_EQ(index_length(read_scene(scene_)), shipped_length_);
  EXPECT_EQ(index_length(read_own_scene(scene_, {"calibration=none"})), shipped_length_);
  EXPECT_EQ(index_length(read_own_scene(scene_, {"user=1"})), shipped_length_);
  const std::string file = (folder_ / "softhand/users/0-right.toml").string();
  EXPECT_NEAR(index_length(read_scene(scene_, {"calibration=" + file})), other_length_, 1e-6);
  EXPECT_THROW(load_scene_hand(read_scene(scene_, {"calibration=" + file, "hand.side=left"})), ConfigError);
  EXPECT_THROW(read_scene(scene_, {"calibration=none_of_these.toml"}), ConfigError);
  write("softhand/users/0-right.toml", "side = \"right\"\n");
  EXPECT_THROW(read_own_scene(scene_, {}), ConfigError);
  fs::remove(file);
  EXPECT_EQ(index_length(read_own_scene(scene_, {})), shipped_length_);
}

}  // namespace
}  // namespace softhand::calibration_test
