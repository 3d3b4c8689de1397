// A tracker that is wrong about a joint and says so disturbs a held object less than one that does not say it.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "cli/virtual_rig.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "trackers/replay/replay_tracker.hpp"

namespace softhand::confidence_test {
namespace {

double seconds(Nanoseconds now) { return static_cast<double>(now - VirtualRig::kStart) * 1e-9; }

constexpr double kFrom = 4;  // s; the cube is held from 3.3 s on

// What a tracker says about some joints from `kFrom` on. If it is wrong about them, they jump to and fro by 6 mm and 20
// degrees, twice a second.
struct Doubt {
  std::vector<Joint> joints;
  bool is_wrong;
  double confidence;
};
const std::vector<Joint> kFingertip{Joint::index_distal, Joint::index_tip};

// The samples of a replay with this doubt.
class DoubtfulTracker final : public TrackerSource, private TrackerSink {
 public:
  DoubtfulTracker(std::unique_ptr<TrackerSource> played, Doubt doubt)
      : played_(std::move(played)), doubt_(std::move(doubt)) {}
  void poll(Nanoseconds now, TrackerSink& out) override {
    now_ = now;
    out_ = &out;
    played_->poll(now, *this);
  }

 private:
  void hand(const Skeleton& sample) override {
    Skeleton changed = sample;
    const double since = seconds(now_) - kFrom;
    const double away = std::fmod(since, 0.5) < 0.25 ? 1 : -1;
    for (const Joint doubted : doubt_.joints) {
      if (since < 0) break;
      JointSample& joint = changed.joints[slot_of(doubted)];
      joint.confidence = doubt_.confidence;
      if (!doubt_.is_wrong) continue;
      joint.position[0] += 0.006 * away;
      joint.orientation =
          to_wire((rotation_exp(Vector3(0, 0.35 * away, 0)) * to_quaternion(joint.orientation)).normalized());
    }
    out_->hand(changed);
  }
  void head(const HeadPose&) override {}

  std::unique_ptr<TrackerSource> played_;
  Doubt doubt_;
  Nanoseconds now_ = 0;
  TrackerSink* out_ = nullptr;
};

struct Disturbance {
  double rms = 0, height = 1;  // m: distance of the cube from its mean place, its least height
};

Disturbance held_cube(const Doubt& doubt, const char* direct) {
  const Scene scene = read_scene(SOFTHAND_SOURCE_DIR "/config/scenes/pinch.toml",
                                 {"hand.model=right_400.hand.json", "generator.hold_time=60", "generator.lift_time=1",
                                  std::string("hand.direct=") + direct});
  const HandModel hand = load_scene_hand(scene);
  auto played = std::make_unique<ReplayTracker>(make_scene_motion(scene, hand), scene.options.tracker, hand_key(scene));
  VirtualRig rig(scene, hand, std::make_unique<DoubtfulTracker>(std::move(played), doubt));
  const OutcomeFrame frame = outcome_frame(scene, VirtualRig::kStart);
  Disturbance result;
  std::vector<Vector3> places;
  Vector3 mean = Vector3::Zero();
  rig.run(kFrom + 3, [&](const HandStepView& view) {
    for (const ObjectState& object : rig.world().objects().objects) {
      if (object.object != frame.object || seconds(view.time) < kFrom) continue;
      places.push_back(to_vector(object.position));
      mean += places.back();
      result.height = std::min(result.height, object.position[1]);
    }
  });
  mean /= static_cast<double>(places.size());
  for (const Vector3& place : places) result.rms += (place - mean).squaredNorm() / static_cast<double>(places.size());
  result.rms = std::sqrt(result.rms);
  return result;
}

TEST(Confidence, AJointInDoubtDisturbsAHeldCubeLess) {
  for (const char* direct : {"false", "true"}) {
    const Disturbance still = held_cube({kFingertip, false, 1}, direct),
                      sure = held_cube({kFingertip, true, 1}, direct),
                      doubtful = held_cube({kFingertip, true, 0.1}, direct);
    std::printf("direct %s: the cube moves by %.2f mm RMS; with a wrong joint by %.2f mm, if it is in doubt %.2f mm\n",
                direct, 1e3 * still.rms, 1e3 * sure.rms, 1e3 * doubtful.rms);
    EXPECT_GT(sure.rms, 5 * still.rms) << direct;
    EXPECT_LT(doubtful.rms, 0.5 * sure.rms) << direct;
    EXPECT_GT(doubtful.height, 0.14) << direct << ": the cube must stay held";
  }
}

// Fingers that grasp are often hidden. What a device guesses about them must not drop the object.
TEST(Confidence, AHandThatIsGuessedKeepsTheCube) {
  std::vector<Joint> all;
  for (int j = 0; j < kJointCount; ++j) all.push_back(static_cast<Joint>(j));
  const Disturbance guessed = held_cube({all, false, kGuessedConfidence}, "false");
  std::printf("the cube moves by %.2f mm RMS, least height %.0f mm\n", 1e3 * guessed.rms, 1e3 * guessed.height);
  EXPECT_GT(guessed.height, 0.14);
  EXPECT_LT(guessed.rms, 5e-3);
}

}  // namespace
}  // namespace softhand::confidence_test
