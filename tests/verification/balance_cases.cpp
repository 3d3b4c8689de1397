// Newton's third law: the forces of a term inside the hand, or between hand and object, sum to no force and no torque.
#include <algorithm>

#include "energies/contact.hpp"
#include "energies/friction.hpp"
#include "energies/joint.hpp"
#include "energies/skeleton_tissue.hpp"
#include "energies/tissue.hpp"
#include "math/rotation.hpp"
#include "support/block_hand.hpp"
#include "support/box_mesh.hpp"
#include "support/node_contact.hpp"
#include "verification/cases.hpp"

namespace softhand::verification {
namespace {

/// Sums force and torque over the gradient of `term`. The force is relative to the term's largest force. The torque is
/// relative to the torque of this force at `arm` metres.
std::vector<Measurement> balance(const Energy& term, const State& state, double arm) {
  const DofLayout layout = state.layout();
  VectorX gradient = VectorX::Zero(layout.dof_count());
  term.add_gradient(state, gradient);
  Vector3 force = Vector3::Zero(), torque = Vector3::Zero();
  double largest = 0;
  const auto add = [&](const Vector3& at, const Vector3& f) {
    force += f;
    torque += at.cross(f);
    largest = std::max(largest, f.norm());
  };
  for (int n = 0; n < layout.node_count; ++n)
    add(state.node_positions.col(n), gradient.segment<3>(3 * layout.node_block(n)));
  for (int b = 0; b < layout.body_count; ++b) {
    add(state.body_poses[static_cast<std::size_t>(b)].position,
        gradient.segment<3>(3 * layout.body_translation_block(b)));
    torque += gradient.segment<3>(3 * layout.body_rotation_block(b));
  }
  // If no force acts, the result is 0/0 = NaN and the row fails, because an empty balance proves nothing.
  return {{"sum of forces / largest", force.norm() / largest, 0, 1e-9, "1", {}},
          {"sum of torques / (largest force, its arm)", torque.norm() / (largest * arm), 0, 1e-9, "1", {}}};
}

/// A block of tissue with the skeleton in it. Its nodes move at random by up to `displacement` metres. Its bones move
/// likewise, and turn by up to ten times as many radians.
struct ShakenHand {
  explicit ShakenHand(const Parameters& p) : hand(testing::block_hand()), state(testing::rest_state(hand)) {
    for (int b = 0; b < kBodyCount; ++b) state.body_poses.push_back(hand.body_rest_pose(static_cast<Body>(b)));
    state.body_velocities.resize(kBodyCount);
    testing::Random random(static_cast<std::uint64_t>(p.whole("seed")));
    VectorX direction(state.layout().dof_count());
    for (Eigen::Index i = 0; i < direction.size(); ++i) direction[i] = p["displacement"] * random();
    for (int b = 0; b < kBodyCount; ++b) direction.segment<3>(3 * state.layout().body_rotation_block(b)) *= 10;
    apply_increment(state, direction);
  }
  HandModel hand;
  State state;
};

constexpr double kHandArm = 0.1;  // m

std::vector<Measurement> tissue_balance(const Parameters& p) {
  const ShakenHand shaken(p);
  return balance(Tissue(shaken.hand), shaken.state, kHandArm);
}

std::vector<Measurement> joint_balance(const Parameters& p) {
  const ShakenHand shaken(p);
  return balance(JointEnergy(hand_joints(shaken.hand), shaken.state.layout()), shaken.state, kHandArm);
}

std::vector<Measurement> attachment_balance(const Parameters& p) {
  const ShakenHand shaken(p);
  return balance(SkeletonTissue(shaken.hand, shaken.state.layout()), shaken.state, kHandArm);
}

// Three nodes hit a free ball at an angle. The balance is taken in the step after the hit.
std::vector<Measurement> contact_balance(const Parameters& p) {
  HandModel skin;
  skin.nodes = {Vector3(0, 0, 0), Vector3(0, 0, 0.01), Vector3(0.01, 0, 0)};
  skin.surface = {{0, 1, 2}};
  skin.node_body.assign(3, 0);
  Shape shape;
  shape.kind = static_cast<std::uint32_t>(ShapeKind::sphere);
  shape.size = {0.05, 0, 0};
  const ShapeGeometry ball(shape);
  ContactSet contacts(testing::contact_at_nodes(skin, std::vector<double>(3, 1e-4)), 3,
                      testing::contact_stiffness(skin, 700), 0, 1, 1);
  ContactEnergy contact(contacts);
  const FrictionEnergy friction(contacts);
  contacts.set_object(0, &ball, p["friction"], 1, ContactObject::moving);
  State state = testing::rest_state(skin);
  testing::Random random(static_cast<std::uint64_t>(p.whole("seed")));
  const Vector3 place = 0.1 * random.vector(), turn = 2 * random.vector();
  state.body_poses = {Pose{place, rotation_exp(turn)}};
  state.body_velocities.resize(1);
  constexpr double time_step = 0.01;
  for (int n = 0; n < 3; ++n) {
    const Vector3 outward = random.vector().normalized();
    state.node_positions.col(n) = state.body_poses[0].position + 0.0505 * outward;
    state.node_velocities.col(n) = -0.3 * outward + 0.2 * outward.unitOrthogonal();
  }
  contact.begin_step(state, time_step);
  state.node_positions += time_step * state.node_velocities;
  contact.end_step(state);
  contact.begin_step(state, time_step);
  state.node_positions += 0.1 * time_step * state.node_velocities;
  std::vector<Measurement> both = balance(contact, state, 0.05);
  for (Measurement& m : both) m.quantity = "contact: " + m.quantity;
  for (Measurement& m : balance(friction, state, 0.05)) {
    m.quantity = "friction: " + m.quantity;
    both.push_back(std::move(m));
  }
  return both;
}

}  // namespace

std::vector<Case> balance_cases() {
  const std::vector<Parameters> shaken{{{"displacement", 0.002}, {"seed", 1}}, {{"displacement", 0.02}, {"seed", 2}}};
  return {
      {"tissue_balance", "forces and torques sum to zero, inverted elements included", shaken, tissue_balance},
      {"joint_balance", "forces and torques sum to zero", shaken, joint_balance},
      {"attachment_balance", "forces and torques sum to zero", shaken, attachment_balance},
      {"contact_balance",
       "forces and torques on skin and object sum to zero",
       {{{"friction", 0.7}, {"seed", 1}}, {{"friction", 0.1}, {"seed", 2}}},
       contact_balance},
  };
}

}  // namespace softhand::verification
