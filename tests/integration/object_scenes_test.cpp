// The shipped scenes with object files: each succeeds with hands of 750 and 1,450 nodes, and from three starting poses.
#include <gtest/gtest.h>

#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/virtual_rig.hpp"
#include "trackers/replay/replay_tracker.hpp"

namespace softhand {
namespace {

/// Where the hand starts, and by how much it misses the place for which its motion was made (docs/objects.md).
struct StartingPose {
  std::array<double, 3> offset, turn, aim;  // m, rad, m
};
constexpr StartingPose kPoses[]{
    {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}},
    {{0.06, 0.03, 0.04}, {0.3, 0.4, 0}, {0.004, 0.002, -0.004}},
    {{-0.06, 0, 0.03}, {-0.3, -0.4, 0.2}, {-0.004, -0.002, 0.004}},
};

struct Play {
  const char* scene;
  const char* nodes;
  std::size_t pose;
};

class ObjectScenes : public ::testing::TestWithParam<Play> {};

TEST_P(ObjectScenes, Succeed) {
  const Play& play = GetParam();
  Scene scene = read_scene(std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/" + play.scene + ".toml",
                           {std::string("hand.model=right_") + play.nodes + ".hand.json"});
  GeneratorOptions& generator = scene.options.generator;
  const StartingPose& pose = kPoses[play.pose];
  generator.start_offset = pose.offset;
  generator.start_turn = pose.turn;
  for (std::size_t i = 0; i < 3; ++i) generator.object_position[i] += pose.aim[i];
  const HandModel hand = load_scene_hand(scene);
  const auto motion = make_scene_motion(scene, hand);
  VirtualRig rig(scene, hand, std::make_unique<ReplayTracker>(motion, scene.options.tracker, hand_key(scene)));
  rig.run(motion->duration() + 0.5, [](const HandStepView&) {});
  const auto summary = rig.outcome().summary(outcome_frame(scene, VirtualRig::kStart));
  const std::string because = summary["success_because"].get<std::string>();
  std::printf("  %s\n", because.c_str());
  EXPECT_EQ(summary["success"], true) << because;
  EXPECT_EQ(summary["nonfinite_published"], 0);
}

std::vector<Play> plays() {
  std::vector<Play> all;
  for (const char* scene : {"mug", "scissors", "bottle", "drawer", "button"}) {
    for (std::size_t pose = 0; pose < std::size(kPoses); ++pose) all.push_back({scene, "750", pose});
    all.push_back({scene, "1450", 0});
  }
  return all;
}
INSTANTIATE_TEST_SUITE_P(Shipped, ObjectScenes, ::testing::ValuesIn(plays()), [](const auto& instance) {
  return std::string(instance.param.scene) + "_" + instance.param.nodes + "_pose" + std::to_string(instance.param.pose);
});

}  // namespace
}  // namespace softhand
