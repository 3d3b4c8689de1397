// Cases of bones, their attachments and their joints.
#include <algorithm>
#include <cmath>
#include <limits>

#include "math/rotation.hpp"
#include "stress/cases.hpp"
#include "stress/grasp.hpp"
#include "stress/hand_events.hpp"

namespace softhand::stress {
namespace {

constexpr auto kDistal = static_cast<std::size_t>(Body::index_distal);

Findings displaced_bone() {
  Release release;
  release.disturb = [](State& state) { state.body_poses[kDistal].position += Vector3(0, 0.05, 0); };
  return let_go(release);
}

Findings with_hand(const std::function<void(HandModel&)>& change) {
  Grasp setting;
  setting.held = false;  // stiff or locked joints and soft attachments may prevent a grip
  setting.hand = change;
  return grasp_findings(setting);
}

Findings attachment_stiffness(double factor) {
  return with_hand([factor](HandModel& hand) {
    // N/m, largest value that a hand file may hold; attachments of a coarse palm reach it
    constexpr double kStiffest = 1e9;
    for (Attachment& attachment : hand.attachments)
      attachment.stiffness = std::min(attachment.stiffness * factor, kStiffest);
  });
}

Findings joint_stiffness(double factor) {
  return with_hand([factor](HandModel& hand) {
    for (BodyModel& body : hand.bodies) {
      body.joint.position_stiffness *= factor;
      body.joint.orientation_stiffness *= factor;
      body.joint.limit_stiffness *= factor;
    }
  });
}

// Locks the flexion of every finger joint at its rest angle. The fingers cannot close, and nothing may break.
Findings locked_joints() {
  return with_hand([](HandModel& hand) {
    for (BodyModel& body : hand.bodies) body.joint.flexion_range = {0, 0};
  });
}

Findings turned_range() {
  Grasp setting;
  setting.hand = [](HandModel& hand) { hand.bodies[kDistal].joint.flexion_range = {0.2, -0.2}; };
  return refused(setting);
}

// The coupling turns the last joint of the index finger backwards with `torque`. The other joints are held. The joint
// goes past its limit by torque / stiffness.
Findings limit(double torque) {
  constexpr double kStiffness = 50;  // N m/rad; with the shipped 3 N m/rad the joint would turn by half a turn
  Event event;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    BodyModel& body = event.hand.bodies[b];
    body.coupling_linear_stiffness = 1e6;
    body.coupling_angular_stiffness = 1e4;
    body.coupling_torque_cap = b == kDistal ? torque : 100;
  }
  JointModel& joint = event.hand.bodies[kDistal].joint;
  joint.limit_stiffness = kStiffness;
  HandSimulation simulation(event.hand, {}, 1, 1);
  simulation.enable_ledger(true);
  const auto& rest = event.hand.rest_joints;
  const auto distal = static_cast<std::size_t>(index_of(Joint::index_distal)),
             parent = static_cast<std::size_t>(index_of(Joint::index_intermediate));
  HandWatch watch;
  for (int step = 0; step < 180; ++step) {
    for (int b = 0; b < kBodyCount; ++b) {
      const Body body = static_cast<Body>(b);
      Pose target = rest[static_cast<std::size_t>(index_of(joint_of(body)))];
      if (body == Body::index_distal) target.orientation = target.orientation * rotation_exp(Vector3(1.5, 0, 0));
      simulation.set_target(body, target, {});
    }
    watch.after_step(simulation, simulation.step(kStep), kStep);
  }
  const Pose child = simulation.joint_pose(Joint::index_distal);
  const Quaternion aligned = simulation.joint_pose(Joint::index_intermediate).orientation *
                             rest[parent].orientation.conjugate() * rest[distal].orientation;
  const double angle = rotation_log(aligned.conjugate() * child.orientation).x();
  const double pulled = (child.orientation.conjugate() * simulation.coupling_wrench(Body::index_distal).torque).x();
  Findings findings;
  watch.judge(simulation, findings);
  findings.demand_at_least("loaded", "torque of the coupling", pulled, 0.98 * torque, "N m");
  findings.demand("excess torque / k", "angle past the limit over torque / stiffness, less one",
                  std::abs((angle - joint.flexion_range[1]) * kStiffness / pulled - 1), 0.02, "1");
  return findings;
}

}  // namespace

std::vector<Case> bone_cases() {
  CaseList cases("Bones");
  cases.add("displaced_bone", "recovers")
      .push_back({"50 mm out of its tissue", [] { return displaced_bone(); }, {}, true});
  auto* rows = &cases.add("attachment_stiffness", "");
  for (const double factor : {1e-4, 1e4})
    rows->push_back({named("factor", factor), [factor] { return attachment_stiffness(factor); }, {}, factor > 1});
  rows = &cases.add("joint_stiffness", "");
  for (const double factor : {1e-4, 1e4})
    rows->push_back({named("factor", factor), [factor] { return joint_stiffness(factor); }, {}, factor > 1});
  rows = &cases.add("joint_range", "a range of zero width holds, a range with minimum above maximum is refused");
  rows->push_back({"minimum = maximum", [] { return locked_joints(); }});
  rows->push_back({"minimum > maximum", [] { return turned_range(); }, {}, true});
  cases.add("joint_limit", "the joint passes its limit by torque / stiffness, within 2 %")
      .push_back({"10 N m", [] { return limit(10); }, {}, true});
  return cases.take();
}

}  // namespace softhand::stress
