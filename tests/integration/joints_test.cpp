// A hand and articulated objects, through all loops on the virtual clock. A drawer is pulled to its limit, a lid is
// opened, and a button is pressed. Two linked boxes are owned and released together.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <numbers>

#include "cli/virtual_rig.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "support/skeleton.hpp"
#include "trackers/replay/replay_tracker.hpp"

namespace softhand::joints_test {
namespace {

const std::string kScene = std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch_lift.toml";

Scene scene_with(const std::vector<ObjectOptions>& objects, const std::vector<JointOptions>& joints,
                 std::vector<std::string> overrides = {}) {
  overrides.insert(overrides.end(),
                   {"hand.model=right_400.hand.json", "tracker.position_noise=0", "tracker.rotation_noise=0"});
  Scene scene = read_scene(kScene, overrides);
  scene.options.objects = objects;
  scene.options.joints = joints;
  std::int64_t movable = 0;
  for (const ObjectOptions& object : objects) movable += object.mass > 0 ? 1 : 0;
  scene.options.hand.mirrored_objects = std::min<std::int64_t>(4, movable);
  scene.options.hand.static_objects = static_cast<std::int64_t>(objects.size()) - movable;
  scene.options.hand.object_joints = static_cast<std::int64_t>(joints.size());
  return scene;
}

ObjectOptions box(const char* name, double mass, const Vector3& half, const Vector3& at) {
  ObjectOptions o;
  o.name = name;
  o.mass = mass;
  o.half_extents = to_wire(half);
  o.position = to_wire(at);
  return o;
}

JointOptions joint(const char* kind, const char* parent, const char* child, const Vector3& position,
                   const Vector3& axis, std::array<double, 2> limits = {0, 0}) {
  JointOptions j;
  j.kind = kind;
  j.parent = parent;
  j.child = child;
  j.position = to_wire(position);
  j.axis = to_wire(axis);
  j.limits = limits;
  return j;
}

// A hand in its rest pose whose wrist follows a path.
class StiffHand final : public TrackerSource {
 public:
  StiffHand(const HandModel& hand, std::function<Pose(double)> path) : hand_(hand), path_(std::move(path)) {}
  void poll(Nanoseconds now, TrackerSink& out) override {
    const Nanoseconds period = 11'111'111;
    if (now < VirtualRig::kStart + static_cast<Nanoseconds>(count_) * period) return;
    Skeleton sample =
        testing::skeleton_at(hand_, path_(static_cast<double>(now - VirtualRig::kStart) * 1e-9), now, ++count_);
    sample.hand = {0, 1};
    sample.source = 1;
    sample.confidence = 1;
    out.hand(sample);
  }

 private:
  HandModel hand_;
  std::function<Pose(double)> path_;
  std::uint64_t count_ = 0;
};

double smooth(double x) {
  x = std::clamp(x, 0.0, 1.0);
  return x * x * (3 - 2 * x);
}

// Heights of the lowest and the highest node of a hand at rest around a place in the horizontal plane.
std::pair<double, double> heights_around(const HandModel& hand, const Vector3& place, double half) {
  std::pair<double, double> range{1e9, -1e9};
  for (const Vector3& node : hand.nodes) {
    if (std::abs(node.x() - place.x()) > half || std::abs(node.z() - place.z()) > half) continue;
    range = {std::min(range.first, node.y()), std::max(range.second, node.y())};
  }
  return range;
}

// Follows joint 1 and all objects through a run.
struct Track {
  double q = 0, q_most = -1e9, q_least = 1e9;  // in the world
  double world_gap = 0, hand_gap = 0;          // m, largest of joint 1
  double follow_gap = 0;                       // m, largest distance between a twin and its copy
  double least_q_while_owned = 1e9;
  std::uint64_t owned_steps = 0, partly_owned_steps = 0;
  double largest_jump = 0;  // m, of a copy in a world step beyond its velocity, at the release
  double defect = 0;
  std::map<std::uint32_t, Vec3> last;
};

Track run(
    VirtualRig& rig, double seconds, const std::string& name = "joint",
    const std::function<void(double, const Track&)>& after = [](double, const Track&) {}) {
  Track t;
  rig.run(seconds, [&](const HandStepView& view) {
    t.q = rig.world().joint_coordinate(name);
    t.q_most = std::max(t.q_most, t.q);
    t.q_least = std::min(t.q_least, t.q);
    t.world_gap = std::max(t.world_gap, rig.world().joint_gap(name));
    std::size_t owned = 0;
    for (const ObjectTwin& twin : view.output->coupling.twins) {
      if (twin.owned == 0) continue;
      ++owned;
      for (const ObjectState& state : view.objects->objects)
        if (state.object == twin.object)
          t.follow_gap = std::max(t.follow_gap, (to_vector(state.position) - to_vector(twin.position)).norm());
    }
    if (owned > 0) {
      ++t.owned_steps;
      t.hand_gap = std::max(t.hand_gap, view.simulation->joint_gap(0));
      if (owned < view.output->coupling.twins.size()) ++t.partly_owned_steps;
    }
    after(static_cast<double>(view.time - VirtualRig::kStart) * 1e-9, t);
  });
  t.defect = rig.hand().simulation().ledger().defect();
  std::printf(
      "  q %.6g in [%.6g, %.6g], joint gap %.4f mm in the world, %.4f mm in the hand, copies within %.2f mm, "
      "owned %d steps, ledger defect %.2g\n",
      t.q, t.q_least, t.q_most, 1e3 * t.world_gap, 1e3 * t.hand_gap, 1e3 * t.follow_gap,
      static_cast<int>(t.owned_steps), t.defect);
  return t;
}

// The published states of the objects: their largest move beyond their velocity within a world step.
class JumpWitness final : public RigWitness {
 public:
  using RigWitness::published;
  void published(RigLoop, const WorldObjects& objects) override {
    for (const ObjectState& state : objects.objects) {
      const auto before = last_.find(state.object);
      if (before != last_.end()) {
        const Vector3 moved = to_vector(state.position) - to_vector(before->second.position);
        const double speed =
            std::max(to_vector(state.linear_velocity).norm(), to_vector(before->second.linear_velocity).norm());
        if (before->second.owned != 0 && state.owned == 0) {
          ++releases;
          jump = std::max(jump, moved.norm() - objects.step_period * speed);
          speed_jump = std::max(speed_jump,
                                (to_vector(state.linear_velocity) - to_vector(before->second.linear_velocity)).norm());
        }
      }
      last_[state.object] = state;
    }
  }
  int releases = 0;
  double jump = 0;        // m
  double speed_jump = 0;  // m/s

 private:
  std::map<std::uint32_t, ObjectState> last_;
};

TEST(Joints, APinchedDrawerMovesAlongItsAxisOnlyAndStopsAtItsLimit) {
  // The cube of pinch_lift is a drawer in a housing below the table: it slides up by 60 mm. The hand lifts by 100 mm
  // and then turns by 60 degrees, which the drawer does not do.
  JointOptions slide = joint("slider", "table", "cube", {0, 0.02, 0}, {0, 1, 0}, {0, 0.06});
  slide.friction = 0.3;
  Scene scene = scene_with({}, {slide},
                           {"generator.lift_height=0.1", "generator.approach_time=0.4", "generator.hold_time=0.5",
                            "generator.turn_time=0.5"});
  scene.options.objects = read_scene(kScene).options.objects;
  scene.options.hand.mirrored_objects = scene.options.hand.static_objects = 1;
  const HandModel hand = load_scene_hand(scene);
  const auto motion = make_scene_motion(scene, hand);
  JumpWitness witness;
  VirtualRig rig(scene, hand, std::make_unique<ReplayTracker>(motion, scene.options.tracker, hand_key(scene)),
                 &witness);
  double sideways = 0, turned = 0;
  const Track t = run(rig, motion->duration() + 1, "joint", [&](double, const Track&) {
    for (const ObjectState& state : rig.world().objects().objects) {
      if (state.object != 2) continue;
      sideways = std::max(sideways, std::hypot(state.position[0], state.position[2]));
      turned = std::max(turned, rotation_log(to_quaternion(state.orientation)).norm());
    }
  });
  std::printf("  sideways %.4f mm, turned %.4f degrees, released %d times, jump %.4f mm, %.4f m/s\n", 1e3 * sideways,
              turned * 180 / std::numbers::pi, witness.releases, 1e3 * witness.jump, witness.speed_jump);
  EXPECT_GT(t.owned_steps, 100u);
  EXPECT_GT(t.q_most, 0.059) << "pulled to its limit";
  EXPECT_LT(t.q_most, 0.0605) << "stays at its limit";
  EXPECT_GE(t.q_least, -5e-4);
  EXPECT_LT(sideways, 5e-4);
  EXPECT_LT(turned, 0.01);
  EXPECT_LT(t.hand_gap, 1e-4);
  EXPECT_LT(t.world_gap, 1e-4);
  EXPECT_GE(witness.releases, 1);
  EXPECT_LT(witness.jump, 1e-4);
}

TEST(Joints, APinchedCapTurnsAndAdvancesByItsPitch) {
  JointOptions thread = joint("screw", "table", "cube", {0, 0.02, 0}, {0, 1, 0}, {0, 20});
  thread.pitch = 0.003;
  thread.friction = 0.005;
  Scene scene = scene_with({}, {thread}, {"generator.lift_height=0", "generator.hold_time=0.3"});
  scene.options.objects = read_scene(kScene).options.objects;
  scene.options.hand.mirrored_objects = scene.options.hand.static_objects = 1;
  const HandModel hand = load_scene_hand(scene);
  const auto motion = make_scene_motion(scene, hand);
  VirtualRig rig(scene, hand, std::make_unique<ReplayTracker>(motion, scene.options.tracker, hand_key(scene)));
  double off_thread = 0;
  const Track t = run(rig, motion->duration() + 0.5, "joint", [&](double, const Track& now) {
    const double height = rig.world().objects().objects[1].position[1] - 0.02;
    off_thread = std::max(off_thread, std::abs(height - thread.pitch * now.q / (2 * std::numbers::pi)));
  });
  std::printf("  off the thread by %.4f mm\n", 1e3 * off_thread);
  EXPECT_NEAR(t.q_most, std::numbers::pi / 3, 0.1);
  EXPECT_LT(off_thread, 2e-5);
  EXPECT_LT(t.hand_gap, 2e-4);
}

TEST(Joints, ALidOpensOnItsHingeAndFallsShut) {
  // The fingertips push the lid's free edge up from below and let it down again. The lid rests at q = 0.
  Scene scene = scene_with({}, {});
  const HandModel hand = load_scene_hand(scene);
  const Vector3 tip = hand.rest_joints[static_cast<std::size_t>(index_of(Joint::middle_tip))].position;
  const Vector3 edge(tip.x(), 0.2, tip.z());
  const double highest = heights_around(hand, tip, 0.06).second;
  const std::vector<ObjectOptions> objects{box("chest", 0, {0.06, 0.02, 0.02}, edge + Vector3(0, 0, -0.13)),
                                           box("lid", 0.1, {0.06, 0.003, 0.055}, edge + Vector3(0, 0, -0.05))};
  JointOptions hinge = joint("hinge", "chest", "lid", Vector3(0, 0, 0.02), {-1, 0, 0}, {0, 1.2});
  hinge.friction = 0.005;
  scene = scene_with(objects, {hinge});
  JumpWitness witness;
  VirtualRig rig(
      scene, hand,
      std::make_unique<StiffHand>(hand,
                                  [&](double time) {
                                    const double up = smooth((time - 0.5) / 1.0) - smooth((time - 2.0) / 1.0);
                                    return Pose{Vector3(0, 0.177 - highest + 0.1 * up, 0), Quaternion::Identity()};
                                  }),
      &witness);
  const Track t = run(rig, 4);
  std::printf("  released %d times, jump %.4f mm, %.4f m/s\n", witness.releases, 1e3 * witness.jump,
              witness.speed_jump);
  EXPECT_GT(t.owned_steps, 50u);
  EXPECT_GT(t.q_most, 0.25) << "opened";
  EXPECT_NEAR(t.q, 0, 0.01) << "shut again";
  EXPECT_GE(t.q_least, -0.02);
  EXPECT_LT(t.hand_gap, 2e-4);
  EXPECT_LT(t.world_gap, 5e-4);
  EXPECT_LT(witness.jump, 1e-4);
}

TEST(Joints, AButtonGoesThroughItsDetentAndReturns) {
  Scene scene = scene_with({}, {});
  const HandModel hand = load_scene_hand(scene);
  const Vector3 tip = hand.rest_joints[static_cast<std::size_t>(index_of(Joint::index_distal))].position;
  const Vector3 top(tip.x(), 0.2, tip.z() - 0.008);
  const double lowest = heights_around(hand, top, 0.008).first;
  ObjectOptions cap = box("cap", 0.005, {0.006, 0.004, 0.006}, top);
  const std::vector<ObjectOptions> objects{box("case", 0, {0.006, 0.005, 0.006}, top + Vector3(0, -0.02, 0)), cap};
  JointOptions slide = joint("slider", "case", "cap", Vector3::Zero(), {0, 1, 0}, {-0.004, 0});
  slide.stiffness = 150;
  slide.rest = 0.002;
  slide.damping = 0.5;
  slide.detents = {{-0.0025, 0.0003, 0.0015, 0}};
  scene = scene_with(objects, {slide});
  double pressed = 0;
  JumpWitness witness;
  VirtualRig rig(
      scene, hand,
      std::make_unique<StiffHand>(hand,
                                  [&](double time) {
                                    const double down = smooth((time - 0.5) / 1.0) - smooth((time - 2.5) / 0.5);
                                    return Pose{Vector3(0, 0.214 - lowest - 0.017 * down, 0), Quaternion::Identity()};
                                  }),
      &witness);
  double q_hand = 0;
  const Track t = run(rig, 4, "joint", [&](double time, const Track& now) {
    if (time > 1.8 && time < 2.4) pressed = now.q;
    if (now.owned_steps > 0) q_hand = std::min(q_hand, rig.hand().simulation().joint_coordinate(0));
  });
  std::printf("  pressed to %.4f mm, in the hand to %.4f mm, jump %.4f mm, %.4f m/s\n", 1e3 * pressed, 1e3 * q_hand,
              1e3 * witness.jump, witness.speed_jump);
  EXPECT_NEAR(pressed, -0.004, 2e-4);
  EXPECT_NEAR(t.q, 0, 5e-5) << "returned";
  EXPECT_LT(t.hand_gap, 2e-4);
  EXPECT_LT(t.world_gap, 2e-4);
  EXPECT_LT(witness.jump, 1e-4);
}

TEST(Joints, LinkedBoxesAreOwnedAndReleasedTogetherAndAMissingSlotTakesNone) {
  // A box slides on a static post, and a second box hangs on it by a hinge. The hand pushes the second one up, draws
  // back, and lets both fall.
  Scene scene = scene_with({}, {});
  const HandModel hand = load_scene_hand(scene);
  const Vector3 tip = hand.rest_joints[static_cast<std::size_t>(index_of(Joint::middle_distal))].position;
  const Vector3 at(tip.x(), 0.2, tip.z());
  const double highest = heights_around(hand, tip, 0.05).second;
  const std::vector<ObjectOptions> objects{box("post", 0, {0.01, 0.1, 0.01}, at + Vector3(0, 0, -0.12)),
                                           box("slide", 0.05, {0.02, 0.01, 0.02}, at + Vector3(0, 0, -0.065)),
                                           box("flap", 0.05, {0.02, 0.01, 0.02}, at + Vector3(0, 0, -0.02))};
  JointOptions hinge = joint("hinge", "slide", "flap", {0, 0, 0.0225}, {-1, 0, 0}, {-0.1, 0.2});
  JointOptions rail = joint("slider", "post", "slide", {0, 0, 0.02}, {0, 1, 0}, {0, 0.1});
  rail.name = "rail";
  rail.friction = 0.1;
  const auto path = [&](double time) {
    return Pose{Vector3(0, 0.185 - highest + 0.1 * smooth((time - 0.5) / 1.5), 0.4 * smooth((time - 2.5) / 0.5)),
                Quaternion::Identity()};
  };
  for (const std::int64_t slots : {2, 1}) {
    scene = scene_with(objects, {hinge, rail});
    scene.options.hand.mirrored_objects = slots;
    JumpWitness witness;
    VirtualRig rig(scene, hand, std::make_unique<StiffHand>(hand, path), &witness);
    double lifted = 0;
    const Track t = run(rig, 4, "joint",
                        [&](double, const Track&) { lifted = std::max(lifted, rig.world().joint_coordinate("rail")); });
    std::printf("  rail up to %.2f mm, at last %.4f mm, released %d times, jump %.4f mm, %.4f m/s\n", 1e3 * lifted,
                1e3 * rig.world().joint_coordinate("rail"), witness.releases, 1e3 * witness.jump, witness.speed_jump);
    EXPECT_EQ(t.partly_owned_steps, 0u);
    if (slots == 1) {
      EXPECT_EQ(t.owned_steps, 0u);
      EXPECT_GT(rig.hand().counters().objects_without_slot, 0u);
      continue;
    }
    EXPECT_GT(t.owned_steps, 50u);
    EXPECT_GT(lifted, 0.01);
    EXPECT_NEAR(rig.world().joint_coordinate("rail"), 0, 1e-4);
    EXPECT_GE(witness.releases, 2);
    EXPECT_EQ(witness.releases % 2, 0);
    EXPECT_LT(t.hand_gap, 2e-4);
    EXPECT_LT(t.world_gap, 5e-4);
    EXPECT_LT(witness.jump, 1e-4);
  }
}

TEST(Joints, EqualRunsGiveEqualBits) {
  const auto hash = [] {
    JointOptions slide = joint("slider", "table", "cube", {0, 0.02, 0}, {0, 1, 0}, {0, 0.06});
    slide.friction = 0.3;
    Scene scene = scene_with({}, {slide}, {"generator.approach_time=0.2"});
    scene.options.objects = read_scene(kScene).options.objects;
    scene.options.hand.mirrored_objects = scene.options.hand.static_objects = 1;
    const HandModel hand = load_scene_hand(scene);
    VirtualRig rig(
        scene, hand,
        std::make_unique<ReplayTracker>(make_scene_motion(scene, hand), scene.options.tracker, hand_key(scene)));
    rig.run(2.0, [](const HandStepView&) {});
    return rig.state_hash();
  };
  EXPECT_EQ(hash(), hash());
}

}  // namespace
}  // namespace softhand::joints_test
