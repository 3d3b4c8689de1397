// Contact of skin with skin: derivatives, balance, which pairs may touch, tunnelling, exit from the inside, friction.
#include "energies/skin_contact.hpp"

#include <gtest/gtest.h>

#include "energies/derivative_suite.hpp"
#include "energies/inertia.hpp"
#include "energies/memory_suite.hpp"
#include "energies/tissue.hpp"
#include "support/two_fingers.hpp"

namespace softhand::skin_contact_test {
namespace {

using namespace testing;

constexpr double kStep = 1.0 / 90;
constexpr double kStiffness = 9e8;  // N/m^3
const Vector3 kSize(0.01, 0.01, 0.02);

HandModel fingers(const Vector3& offset) { return two_fingers({2, 2, 3}, kSize, {.position = offset}); }

void move(State& state, const HandModel& hand, Body body, const Vector3& by, const Vector3& velocity = {0, 0, 0}) {
  for (int n = 0; n < hand.node_count(); ++n) {
    if (hand.node_body[static_cast<std::size_t>(n)] != index_of(body)) continue;
    state.node_positions.col(n) += by;
    state.node_velocities.col(n) = velocity;
  }
}

Vector3 middle(const State& state, const HandModel& hand, Body body) {
  Vector3 sum = Vector3::Zero();
  double count = 0;
  for (int n = 0; n < hand.node_count(); ++n) {
    if (hand.node_body[static_cast<std::size_t>(n)] != index_of(body)) continue;
    sum += state.node_positions.col(n);
    ++count;
  }
  return sum / count;
}

// Two fingers side by side, 0.2 mm apart and offset so that no node faces a node. The second is then pressed into the
// first: its nodes and those of the first are all moved at random.
struct Pressed {
  HandModel hand = fingers({0.0102, 0.0013, 0.0021});
  SkinContact skin;
  State start = rest_state(hand), state;
  explicit Pressed(double friction, double sideways = 0) : skin(hand, lumped_masses(hand), kStiffness, friction) {
    bound_matrix(skin, start);
    move(start, hand, Body::middle_distal, {0, 0, 0}, {-0.06, 0, 0});
    state = start;
    move(state, hand, Body::middle_distal, {-5e-4, sideways, 0});
    state = perturbed(state, 7, 5e-5, 0);
    skin.begin_step(start, kStep);
    skin.revise(state);
    skin.end_step(state);
    state.node_velocities.setZero();
  }
};

TEST(SkinContact, DerivativesWhileItSticks) {
  Pressed pressed(0.8);
  ASSERT_GT(pressed.skin.anchors().size(), 3u);
  State moved = perturbed(pressed.state, 11, 2e-5, 0);
  move(moved, pressed.hand, Body::middle_distal, {0, 5e-5, 3e-5});
  check_term(pressed.skin, pressed.state, kStep, moved, {.step = 1e-7});
  check_balance(pressed.skin, moved);
  check_rigid_motion(pressed.skin, moved, {{0.1, -0.2, 0.3}, Quaternion(0.5, 0.1, -0.7, 0.3).normalized()}, 1e-8);
}

TEST(SkinContact, DerivativesWhileItSlides) {
  Pressed pressed(0.3);
  State moved = perturbed(pressed.state, 12, 2e-5, 0);
  move(moved, pressed.hand, Body::middle_distal, {0, 1e-3, 5e-4});
  check_term(pressed.skin, pressed.state, kStep, moved, {.step = 1e-7});
  check_balance(pressed.skin, moved);
}

TEST(SkinContact, DerivativesOfAPointOnATriangleOfSeveralNodes) {
  Pressed pressed(0.5, 2e-4);
  for (const SkinAnchor& anchor : pressed.skin.anchors()) {
    EXPECT_NE(pressed.hand.node_body[static_cast<std::size_t>(pressed.skin.points().main_node(anchor.point))],
              pressed.hand.node_body[static_cast<std::size_t>(pressed.skin.search().corners(anchor.triangle)[0])]);
  }
  check_term(pressed.skin, pressed.state, kStep, perturbed(pressed.state, 13, 3e-5, 0), {.step = 1e-7});
}

TEST(SkinContact, ExactHessianOfACollapsedTriangleIsFinite) {
  Pressed pressed(0.5);
  const int triangle = pressed.skin.anchors().front().triangle;
  const auto corners = pressed.skin.search().corners(triangle);
  for (std::size_t k = 1; k < 3; ++k)
    pressed.state.node_positions.col(corners[k]) = pressed.state.node_positions.col(corners[0]);
  BlockMatrix matrix = bound_matrix(pressed.skin, pressed.state);
  pressed.skin.begin_step(pressed.state, kStep);
  pressed.skin.add_hessian(pressed.state, matrix, Curvature::exact);
  EXPECT_TRUE(matrix.dense().allFinite());
}

// The second finger is turned inside out. Its skin looks inward and would pull the fingers into each other.
TEST(SkinContact, SkinOverInvertedTissueDoesNotTouch) {
  Pressed pressed(0.5);
  ASSERT_GT(pressed.skin.anchors().size(), 3u);
  State& state = pressed.state;
  const double centre = middle(state, pressed.hand, Body::middle_distal).x();
  const auto mirror = [&] {
    for (int n = 0; n < pressed.hand.node_count(); ++n) {
      if (pressed.hand.node_body[static_cast<std::size_t>(n)] == index_of(Body::middle_distal))
        state.node_positions(0, n) = 2 * centre - state.node_positions(0, n);
    }
  };
  mirror();
  for (int step = 0; step < 3; ++step) {
    pressed.skin.begin_step(state, kStep);
    pressed.skin.revise(state);
    EXPECT_TRUE(pressed.skin.anchors().empty()) << step;
    pressed.skin.end_step(state);
  }
  // Mirrored back, it touches again, also where it is far inside.
  mirror();
  move(state, pressed.hand, Body::middle_distal, {-2e-3, 0, 0});
  pressed.skin.begin_step(state, kStep);
  EXPECT_FALSE(pressed.skin.anchors().empty());
}

// Nodes were put elsewhere. The contacts of all other nodes persist.
TEST(SkinContact, OnlyTheContactsOfMovedNodesEnd) {
  Pressed pressed(0.5);
  const std::vector<SkinAnchor> before(pressed.skin.anchors().begin(), pressed.skin.anchors().end());
  std::vector<std::uint8_t> moved(pressed.hand.nodes.size(), 0);
  for (const std::int32_t node : {pressed.skin.points().main_node(before.front().point),
                                  pressed.skin.search().corners(before.back().triangle)[1]}) {
    moved[static_cast<std::size_t>(node)] = 1;
    pressed.state.node_positions(1, node) += 1e-9;
  }
  pressed.skin.release_moved(pressed.state);
  std::vector<int> expected, found;
  for (const SkinAnchor& anchor : before) {
    bool ends = pressed.skin.points().is_marked(anchor.point, moved);
    for (const std::int32_t node : pressed.skin.search().corners(anchor.triangle))
      ends = ends || moved[static_cast<std::size_t>(node)] != 0;
    if (!ends) expected.push_back(anchor.point);
  }
  for (const SkinAnchor& anchor : pressed.skin.anchors()) found.push_back(anchor.point);
  EXPECT_EQ(found, expected);
  EXPECT_FALSE(found.empty());
  EXPECT_LT(found.size(), before.size());
}

TEST(SkinContact, CarriesItsMemory) {
  HandModel hand = fingers({0.0102, 0.0013, 0.0021});
  SkinContact skin(hand, lumped_masses(hand), kStiffness, 0.5);
  Inertia inertia(lumped_masses(hand), 0);
  State state = rest_state(hand);
  move(state, hand, Body::middle_distal, {0, 0, 0}, {-0.1, 0.03, 0});
  DenseStepper stepper({&inertia, &skin}, state);
  std::size_t most = 0;
  check_memory(skin, state, [&](State& s) {
    stepper.step(s, 1e-3);
    most = std::max(most, skin.anchors().size());
  });
  EXPECT_GT(most, 3u);
}

// All forces balance in a collision: the change of momentum is zero, and so is its moment about any point.
TEST(SkinContact, CollisionKeepsMomentum) {
  HandModel hand = fingers({0.0102, 0.004, 0.0021});
  const std::vector<double> masses = lumped_masses(hand);
  SkinContact skin(hand, masses, kStiffness, 0.5);
  Inertia inertia(masses, 0);
  State state = rest_state(hand);
  move(state, hand, Body::middle_distal, {0, 0, 0}, {-0.5, 0.2, 0});
  DenseStepper stepper({&inertia, &skin}, state);
  double largest = 0;
  for (int i = 0; i < 20; ++i) {
    const Eigen::Matrix3Xd before = state.node_velocities;
    stepper.step(state, 1e-4);
    Vector3 linear = Vector3::Zero(), angular = Vector3::Zero();
    double change = 0;
    for (int n = 0; n < hand.node_count(); ++n) {
      const Vector3 p = masses[static_cast<std::size_t>(n)] * (state.node_velocities.col(n) - before.col(n));
      linear += p;
      angular += Vector3(state.node_positions.col(n)).cross(p);
      change += p.norm();
    }
    largest = std::max(largest, change);
    EXPECT_LE(linear.norm(), 1e-9 * change + 1e-15);
    EXPECT_LE(angular.norm(), 1e-9 * 0.02 * change + 1e-15);
  }
  EXPECT_GT(largest, 1e-5) << "nothing collided";
}

// A finger at 5 m/s passes the other one in a single step of 60 Hz: the step must notice.
TEST(SkinContact, FastFingerDoesNotTunnel) {
  for (const double z : {0.0, 0.0031, -0.0087}) {
    HandModel hand = fingers({0.03, 0.0004, z});
    SkinContact skin(hand, lumped_masses(hand), kStiffness, 0.5);
    State state = rest_state(hand);
    bound_matrix(skin, state);
    move(state, hand, Body::middle_distal, {0, 0, 0}, {-5, 0, 0});
    skin.begin_step(state, 1.0 / 60);
    const std::size_t predicted = skin.anchors().size();
    EXPECT_GT(predicted, 4u);
    for (const SkinAnchor& anchor : skin.anchors()) {
      EXPECT_TRUE(anchor.two_sided);
      EXPECT_LE(skin.offset(anchor, state).depth, 0.0301) << "the first triangle on the way, not the far side";
      EXPECT_GT(skin.offset(anchor, state).depth, 0.0);
    }
    skin.cancel_step();
    EXPECT_TRUE(skin.anchors().empty());
    // Without a velocity the step does not predict it, but finds it afterwards.
    state.node_velocities.setZero();
    skin.begin_step(state, 1.0 / 60);
    EXPECT_TRUE(skin.anchors().empty());
    State beyond = state;
    move(beyond, hand, Body::middle_distal, {-0.08, 0, 0});
    EXPECT_TRUE(skin.revise(beyond));
    EXPECT_EQ(skin.anchors().size(), predicted);
  }
}

TEST(SkinContact, QueriesNothingButThePartsWhileNothingIsNear) {
  HandModel hand = fingers({0.03, 0, 0});
  SkinContact skin(hand, lumped_masses(hand), kStiffness, 0.5);
  State state = rest_state(hand);
  bound_matrix(skin, state);
  for (int i = 0; i < 5; ++i) {
    skin.begin_step(state, kStep);
    skin.revise(state);
    skin.end_step(state);
  }
  EXPECT_EQ(skin.search().queries(), 0u);
  // The first step looks for skin that is deep inside, the second lists what is near.
  EXPECT_EQ(skin.search().patches().part_queries(), 2u) << "one query for each pair of parts that have skin";
}

void give_points_the_bodies_of_their_nodes(HandModel& hand) {
  for (SkinPoint& point : hand.contact_points) {
    const auto& corners = hand.tetrahedra[static_cast<std::size_t>(point.tetrahedron)];
    const auto k = std::max_element(point.weights.begin(), point.weights.end()) - point.weights.begin();
    point.body = hand.node_body[static_cast<std::size_t>(corners[static_cast<std::size_t>(k)])];
  }
}

// The same block divided into two fingers: all of the skin is near along the surface.
TEST(SkinContact, SkinThatIsNearAlongTheSurfaceDoesNotTouch) {
  HandModel hand = two_fingers({6, 2, 2}, {0.02, 0.006, 0.006}, {.position = {0.1, 0, 0}});
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
    if (hand.nodes[n].x() < 0.05 && hand.nodes[n].x() > 0.0101)
      hand.node_body[n] = static_cast<std::uint8_t>(index_of(Body::ring_distal));
  }
  give_points_the_bodies_of_their_nodes(hand);
  const ContactPoints points(hand, lumped_masses(hand));
  const SkinPatches patches(hand, points);
  const int count = static_cast<int>(patches.patches().size());
  int index_ring = 0, index_middle = 0;
  for (int a = 0; a < count; ++a) {
    for (int b = 0; b < a; ++b) {
      const int parts[2]{patches.patches()[static_cast<std::size_t>(a)].part,
                         patches.patches()[static_cast<std::size_t>(b)].part};
      const auto is = [&](int one, int other) {
        return (parts[0] == one && parts[1] == other) || (parts[0] == other && parts[1] == one);
      };
      EXPECT_EQ(patches.can_touch(a, b), patches.can_touch(b, a));
      EXPECT_FALSE(parts[0] == parts[1] && patches.can_touch(a, b));
      if (is(1, 3)) index_ring += patches.can_touch(a, b) ? 1 : 0;
      if (is(1, 2)) index_middle += patches.can_touch(a, b) ? 1 : 0;
    }
  }
  EXPECT_EQ(index_ring, 0);
  EXPECT_GT(index_middle, 0);
}

// A block with edges of 40 mm, divided into two fingers.
TEST(SkinContact, ATriangleDoesNotTouchItsOwnCorners) {
  HandModel hand = two_fingers({3, 1, 1}, {0.12, 0.03, 0.03}, {.position = {0.2, 0, 0}});
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
    if (hand.nodes[n].x() > 0.06 && hand.nodes[n].x() < 0.15)
      hand.node_body[n] = static_cast<std::uint8_t>(index_of(Body::ring_distal));
  }
  give_points_the_bodies_of_their_nodes(hand);
  const ContactPoints points(hand, lumped_masses(hand));
  const SkinPatches patches(hand, points);
  int joined = 0;
  for (int point = 0; point < points.count(); ++point) {
    for (const std::int32_t triangle : patches.triangles_around(points.main_node(point))) {
      const int own = patches.patch_of_point(point), other = patches.patch_of_triangle(triangle);
      EXPECT_FALSE(patches.can_touch(own, other)) << "point " << point << ", triangle " << triangle;
      joined += own != other ? 1 : 0;
    }
  }
  EXPECT_GT(joined, 0);
}

// Two fingers cross each other, and one is partly inside the other. They come apart at 1 m/s at most, to the nearer
// side.
TEST(SkinContact, InterlockedFingersComeApartWithoutABang) {
  for (const double overlap : {0.001, 0.003, -0.002}) {
    const Pose across{{-0.01, 0.02, 0.02}, Quaternion(Eigen::AngleAxisd(M_PI / 2, Vector3::UnitY()))};
    HandModel hand = two_fingers({2, 2, 6}, {0.01, 0.01, 0.03}, across);
    SkinContact skin(hand, lumped_masses(hand), kStiffness, 0.5);
    Inertia inertia(lumped_masses(hand), 0);
    State state = rest_state(hand);
    move(state, hand, Body::middle_distal, {0, (overlap > 0 ? -0.01 : -0.03) - overlap, 0});
    Tissue tissue(hand);
    DenseStepper stepper({&inertia, &tissue, &skin}, state);
    double fastest = 0;
    for (int i = 0; i < 30; ++i) {
      stepper.step(state, kStep, 1e-7);
      fastest = std::max(fastest, std::sqrt(state.node_velocities.colwise().squaredNorm().maxCoeff()));
    }
    const double gap = middle(state, hand, Body::middle_distal).y() - middle(state, hand, Body::index_distal).y();
    EXPECT_GT(fastest, 0.0);
    EXPECT_LE(fastest, 1.0);
    EXPECT_GT(overlap > 0 ? gap : -gap, 0.0099) << overlap;
    EXPECT_TRUE(skin.anchors().empty());
  }
}

// A block on another one that is held: it sticks while tan < mu, and slides with mu N.
TEST(SkinContact, SlidesWithCoulombsForce) {
  HandModel hand = two_fingers({4, 2, 8}, {0.02, 0.01, 0.04}, {.position = {0, 0.01005, 0.013}});
  const std::vector<double> masses = lumped_masses(hand);
  for (const double mu : {0.3, 0.8, 1.5}) {
    SkinContact skin(hand, masses, kStiffness, mu);
    State state = rest_state(hand);
    bound_matrix(skin, state);
    // A prescribed motion: down by 0.2 mm, then sideways along the long axis.
    const auto go = [&](const Vector3& by) {
      move(state, hand, Body::middle_distal, {0, 0, 0}, by / kStep);
      skin.begin_step(state, kStep);
      move(state, hand, Body::middle_distal, by, by / kStep);
      skin.revise(state);
      skin.end_step(state);
    };
    go({0, -2.5e-4, 0});
    for (int i = 0; i < 20; ++i) go({0, 0, -5e-4});
    Vector3 force = Vector3::Zero();
    for (const SkinAnchor& anchor : skin.anchors()) {
      // The edges of a block that moves rigidly cut into the end faces of the other.
      if (std::abs(skin.offset(anchor, state).normal.y()) < 0.99) continue;
      const bool is_upper = hand.node_body[static_cast<std::size_t>(skin.points().main_node(anchor.point))] ==
                            index_of(Body::middle_distal);
      force += is_upper ? anchor.force : Vector3(-anchor.force);
    }
    EXPECT_GT(force.y(), 1.0) << mu;
    EXPECT_NEAR(force.z() / force.y(), mu, 0.02 * mu);
    EXPECT_GT(skin.dissipated(), 0.0);
  }
}

}  // namespace
}  // namespace softhand::skin_contact_test
