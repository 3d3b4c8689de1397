// The world alone: its physics, the input that it refuses, and its messages.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <functional>
#include <map>
#include <random>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "messages/newest_couplings.hpp"
#include "unit/world_objects.hpp"
#include "world/follow.hpp"
#include "world/world_loop.hpp"

namespace softhand::world_test {
namespace {

using test::cube;
using test::object;
using test::position;
using test::table;

// --- physics -------------------------------------------------------------------------------------

TEST(WorldFollow, ClosedFormEqualsTheImplicitStep) {
  // A free body moves under the wrench and gravity. The wrench must equal that of the spring and damper at the END of
  // the step.
  std::mt19937 random(7);
  std::uniform_real_distribution<double> one(-1, 1);
  const auto vector = [&](double scale) { return Vector3(scale * Vector3(one(random), one(random), one(random))); };
  for (int trial = 0; trial < 50; ++trial) {
    const double step = trial % 2 ? 1.0 / 250 : 1.0 / 60, kappa = 0.25;
    Follower b;
    b.mass = 0.01 + 0.1 * trial;
    b.inertia = b.mass * 1e-4 * Matrix3::Identity();
    b.velocity = {vector(0.01), vector(0.1)};
    b.gravity = {0, -9.81, 0};
    Leader a;
    a.pose = increment(b.pose, vector(1e-3), vector(0.01));
    a.velocity = {vector(0.1), vector(0.5)};
    a.wrench = {vector(0.1 * b.mass), vector(1e-5 * b.mass)};
    const Wrench w = owner_wrench(b, a, kappa, step);
    const Vector3 v = b.velocity.linear + step * (w.force / b.mass + b.gravity);
    const double k = kappa * b.mass / (step * step), d = 2 * std::sqrt(k * b.mass);
    const Vector3 e = a.pose.position - b.pose.position;
    // The force beyond f_h is that of the spring and damper at the end of the step. It includes the share that cancels
    // the effect of f_h + m g during the step.
    const Vector3 end = k * (e - step * v) + d * (a.velocity.linear - v);
    EXPECT_LT((w.force - a.wrench.force - end).norm(), 1e-9 * (1 + end.norm()));
    const Vector3 spin = b.velocity.angular + step * (b.inertia.inverse() * w.torque);
    const Vector3 turn = rotation_log(a.pose.orientation * b.pose.orientation.conjugate());
    const Vector3 end_turn = kappa / (step * step) * (b.inertia * (turn - step * spin)) +
                             2 * std::sqrt(kappa) / step * (b.inertia * (a.velocity.angular - spin));
    EXPECT_LT((w.torque - a.wrench.torque - end_turn).norm(), 1e-9 * (1e-3 + end_turn.norm()));
  }
}

TEST(WorldFollow, ForceIsCapped) {
  Follower b;
  b.mass = 10;
  Leader a;
  a.pose.position = {10, 0, 0};
  a.velocity.linear = {1e6, 0, 0};
  EXPECT_NEAR(owner_wrench(b, a, 0.25, 0.004).force.norm(), 100, 1e-9);
}

TEST(WorldSolid, HullOfABoxHasTheInertiaOfTheBox) {
  ObjectOptions hull = cube(0.3, 0), box = cube(0.3, 0);
  hull.shape = "convex_hull";
  box.half_extents = {0.01, 0.02, 0.03};
  const Vector3 shift(0.1, -0.2, 0.05);
  for (int i = 0; i < 8; ++i)
    hull.vertices.push_back(
        {{shift.x() + (i & 1 ? 0.01 : -0.01), shift.y() + (i & 2 ? 0.02 : -0.02), shift.z() + (i & 4 ? 0.03 : -0.03)}});
  const Solid a = make_solid(hull), b = make_solid(box);
  EXPECT_LT((a.body_frame.position - shift).norm(), 1e-5);  // rounding to the hull's integer grid
  Vector3 sorted = b.inertia;
  std::sort(sorted.begin(), sorted.end());
  EXPECT_LT((a.inertia - sorted).norm(), 1e-3 * sorted.norm());
  // A hull whose vertices are away from its origin is placed where its vertices are.
  WorldLoop world({}, {hull});
  EXPECT_LT((position(object(world.step(4000000, {}), 1)) - shift).norm(), 1e-3);
}

TEST(WorldSolid, PlaneOfABoxOverATableIsTheTablesFace) {
  for (double gap : {0.004, 1e-4, 0.0, -3e-4}) {
    WorldLoop world({}, {table(), cube(0.05, 0.02 + gap)});
    ObjectCoupling near;  // mirrored, not owned
    near.stamp.sample_time = 4000000;
    near.step_period = 1.0 / 90;
    ObjectTwin twin;
    twin.object = 2;
    near.twins.push_back(twin);
    const ObjectState& state = object(world.step(4000000, {{&near, 1}}), 2);
    ASSERT_EQ(state.planes.size(), 1u) << gap;
    EXPECT_EQ(state.owned, 0u);
    EXPECT_LT((to_vector(state.planes[0].normal) - Vector3::UnitY()).norm(), 1e-9);
    EXPECT_NEAR(state.planes[0].point[1], 0, 1e-7);
    EXPECT_NEAR(state.planes[0].gap, state.position[1] - 0.02, 2e-6);
    EXPECT_EQ(state.planes[0].kind, kNeighbourStatic);
    EXPECT_NEAR(state.planes[0].friction, 0.8, 1e-9);
  }
}

// --- resting and sliding in Bullet ---------------------------------------------------------------

TEST(WorldBullet, EveryShapeRestsOnTheTableAtItsTrueHeight) {
  for (const char* shape : {"sphere", "box", "cylinder", "capsule", "convex_hull"}) {
    for (double size : {0.005, 0.02, 0.05}) {
      ObjectOptions o = cube(size < 0.01 ? 0.001 : 0.05, 0);
      o.shape = shape;
      o.radius = o.half_length = size;
      o.half_extents = {size, size, size};
      if (std::strcmp(shape, "convex_hull") == 0)
        for (int i = 0; i < 8; ++i)
          o.vertices.push_back({{i & 1 ? size : -size, i & 2 ? size : -size, i & 4 ? size : -size}});
      const double height = std::strcmp(shape, "capsule") == 0 ? 2 * size : size;
      o.position = {0.1, height + 0.002, 0.05};
      if (std::strcmp(shape, "sphere") == 0 || std::strcmp(shape, "capsule") == 0)
        o.friction = 1;  // a capsule on its tip is not stable: see below
      WorldLoop world({}, {table(), o});
      Vector3 at = Vector3::Zero();
      const bool tips = std::strcmp(shape, "capsule") == 0;
      for (int i = 1; i <= 250 * (tips ? 1 : 3); ++i) {
        const ObjectState& state = object(world.step(i * 4000000LL, {}), 2);
        at = position(state);
        if (tips && i > 100) break;  // long enough to land
      }
      EXPECT_NEAR(at.y(), height, 1e-4) << shape << " " << size;
    }
  }
}

TEST(WorldBullet, RestDoesNotCreep) {
  WorldLoop world({}, {table(), cube(0.05, 0.0201)});
  Vector3 settled = Vector3::Zero(), last = settled;
  for (int i = 1; i <= 250 * 23; ++i) {
    last = position(object(world.step(i * 4000000LL, {}), 2));
    if (i == 250 * 3) settled = last;
  }
  EXPECT_LT((last - settled).norm() / 20, 1e-6);  // m/s
}

TEST(WorldBullet, StackWithHeavierCubesOnTopStands) {
  for (double ratio : {1.0, 1.5, 2.0}) {
    std::vector<ObjectOptions> objects{table()};
    for (int i = 0; i < 5; ++i) {
      objects.push_back(cube(0.05 * std::pow(ratio, i), 0.02 + 0.04 * i));
      objects.back().name += std::to_string(i);
    }
    WorldLoop world({}, objects);
    const WorldOutput* out = nullptr;
    for (int i = 1; i <= 250 * 10; ++i) out = &world.step(i * 4000000LL, {});
    for (int i = 0; i < 5; ++i)
      EXPECT_LT((position(object(*out, static_cast<std::uint32_t>(2 + i))) - Vector3(0, 0.02 + 0.04 * i, 0)).norm(),
                1e-3)
          << "cube " << i << ", ratio " << ratio;
  }
}

TEST(WorldBullet, SlidesAndSticksByCoulombsLaw) {
  // Gravity tilted by 26.565 degrees in the table's plane: a = g (sin - mu cos).
  for (double mu : {0.3, 0.55}) {
    WorldOptions options;
    const double angle = std::atan(0.5);
    options.gravity = {9.81 * std::sin(angle), -9.81 * std::cos(angle), 0};
    ObjectOptions a = table(), b = cube(0.05, 0.02);
    a.half_extents[0] = 5;
    a.friction = b.friction = mu;
    WorldLoop world(options, {a, b});
    double v = 0;
    for (int i = 1; i <= 250; ++i) v = object(world.step(i * 4000000LL, {}), 2).linear_velocity[0];
    const double expected = mu < 0.5 ? 9.81 * (std::sin(angle) - mu * std::cos(angle)) : 0;
    EXPECT_NEAR(v, expected, 0.02 * expected + 1e-3) << mu;
  }
}

TEST(WorldBullet, SameBitsOnEveryRun) {
  const auto run = [] {
    std::vector<ObjectOptions> objects{table()};
    for (int i = 0; i < 6; ++i) {
      objects.push_back(cube(0.02, 0.03 + 0.045 * i));
      objects.back().name = "cube" + std::to_string(i);
      objects.back().position[0] = 0.004 * i;
    }
    WorldLoop world({}, objects);
    std::vector<double> trace;
    for (int i = 1; i <= 500; ++i)
      for (const ObjectState& s : world.step(i * 4000000LL, {}).objects.objects)
        trace.insert(trace.end(), s.position.begin(), s.position.end());
    return trace;
  };
  const auto first = run(), second = run();
  ASSERT_EQ(first.size(), second.size());
  EXPECT_EQ(std::memcmp(first.data(), second.data(), first.size() * sizeof(double)), 0);
}

// --- refused options -----------------------------------------------------------------------------

TEST(WorldOptions, RefusesBadOptionsAndSuggestsOnesThatWork) {
  EXPECT_TRUE(check_world({}, {table(), cube(0.05, 0.02)}).empty());
  const auto refused = [](const std::function<void(WorldOptions&, ObjectOptions&)>& corrupt, const std::string& word) {
    WorldOptions w;
    ObjectOptions o = cube(0.05, 0.02);
    corrupt(w, o);
    const auto wrong = check_world(w, {table(), o});
    ASSERT_FALSE(wrong.empty()) << word;
    EXPECT_NE(wrong[0].find(word), std::string::npos) << wrong[0];
    EXPECT_THROW(WorldLoop(w, {table(), o}), std::invalid_argument);
  };
  refused([](WorldOptions& w, ObjectOptions&) { w.follow_stiffness = 1.5; }, "nearest value that works: 1");
  refused([](WorldOptions&, ObjectOptions& o) { o.name = "table"; }, "twice");
  refused([](WorldOptions&, ObjectOptions& o) { o.shape = "plane"; }, "static");
  refused([](WorldOptions&, ObjectOptions& o) { o.mass = 1e-6; }, "0.0001");
  refused([](WorldOptions&, ObjectOptions& o) { o.orientation = {0, 0, 0, 0}; }, "unit quaternion");
  refused([](WorldOptions&, ObjectOptions& o) { o.shape = "convex_hull"; }, "4 to 256");
  refused([](WorldOptions&, ObjectOptions& o) { o.mass = 0, o.floating = true; }, "float");
}

// After rounding to the hull's grid, vertices in one plane enclose some cubic millimetres.
TEST(WorldOptions, RefusesAHullOfVerticesInOnePlaneOfAnyOrientation) {
  std::mt19937_64 generator(1);
  std::uniform_real_distribution<double> uniform(-0.05, 0.05);
  for (int plane = 0; plane < 200; ++plane) {
    const Quaternion turn =
        rotation_exp(Vector3(60 * uniform(generator), 60 * uniform(generator), 60 * uniform(generator)));
    const Vector3 shift(uniform(generator), uniform(generator), uniform(generator));
    ObjectOptions flat = cube(0.05, 0.1);
    flat.shape = "convex_hull";
    for (int i = 0; i < 4 + plane % 9; ++i)
      flat.vertices.push_back({to_wire(Vector3(shift + turn * Vector3(uniform(generator), 0, uniform(generator))))});
    const auto wrong = check_world({}, {table(), flat});
    ASSERT_FALSE(wrong.empty()) << plane;
    EXPECT_NE(wrong[0].find("span no volume"), std::string::npos) << wrong[0];
    for (VertexOptions& vertex : std::vector(flat.vertices))
      flat.vertices.push_back({to_wire(Vector3(to_vector(vertex.at) + turn * Vector3(0, 5e-4, 0)))});
    EXPECT_TRUE(check_world({}, {table(), flat}).empty()) << plane << ": a plate of half a millimetre is valid";
  }
}

TEST(WorldOptions, SymmetricGrowthHasItsKnownValue) {
  // Without damping and with states that are two periods old, every stiffness is unstable. The growth is 1.035 for a
  // kappa of 0.1.
  const double step = 1.0 / 60;
  EXPECT_NEAR(symmetric_growth(0.1 / (step * step), 0, step, step), 1.035, 5e-4);
  for (double kappa : {0.01, 0.1, 1.0})
    EXPECT_GT(symmetric_growth(kappa / (step * step), 0, step, step), 1.001) << kappa;
  // A value that a refusal suggests must be accepted.
  WorldOptions w;
  w.mode = "symmetric";
  w.damping_ratio = 0;
  w.stiffness = 5000;
  const auto wrong = check_world(w, {cube(0.05, 0.02)});
  ASSERT_FALSE(wrong.empty());
  const auto at = wrong[0].find("nearest value that works: ");
  if (at != std::string::npos) {
    w.stiffness = std::stod(wrong[0].substr(at + 26));
    for (const auto& text : check_world(w, {cube(0.05, 0.02)}))
      EXPECT_EQ(text.find("world.stiffness"), std::string::npos) << text;
  } else {
    EXPECT_NE(wrong[0].find("use mode owner"), std::string::npos) << wrong[0];
  }
}

TEST(WorldMessages, AcceptsNamesWithBlanks) {
  std::vector<ObjectOptions> objects{table(), cube(0.05, 0.02), cube(0.05, 0.1), cube(0.05, 0.2)};
  objects[2].name = "cube 2";
  objects[3].name = "the cube";
  WorldLoop world({}, objects);
  const auto send = [&](const char* key, const char* value) {
    Message m;
    set_text(m.module, "world");
    set_text(m.key, key);
    set_text(m.value, value);
    return world.answer(m).result;
  };
  EXPECT_EQ(send("object.teleport", "the cube 0.1 0.2 0.3"), kReplyApplied);
  EXPECT_EQ(send("object.teleport", "cube 2 -0.1  0.2 0.3 "), kReplyApplied);
  EXPECT_EQ(send("object.teleport", "cube 0.3 0.2 0.3"), kReplyApplied);
  EXPECT_EQ(send("object.teleport", "cube 2 3"), kReplyRefused) << "two numbers";
  EXPECT_EQ(send("object.teleport", "cube 0 0 0 0"), kReplyRefused) << "four numbers";
  EXPECT_EQ(send("object.teleport", "cube 0x1 0 0"), kReplyRefused) << "no decimal number";
  EXPECT_EQ(send("object.teleport", "the cube"), kReplyRefused);
  const WorldOutput& out = world.step(4000000, {});
  EXPECT_NEAR(object(out, 2).position[0], 0.3, 1e-6);
  EXPECT_NEAR(object(out, 3).position[0], -0.1, 1e-6);
  EXPECT_NEAR(object(out, 4).position[0], 0.1, 1e-6);
  EXPECT_EQ(send("object.remove", "the cube"), kReplyApplied);
  EXPECT_EQ(world.descriptions()[3].removed, 1u);
  EXPECT_EQ(send("object.reset", "the cube"), kReplyApplied);
  EXPECT_EQ(world.descriptions()[3].removed, 0u);
}

TEST(WorldMessages, ResetRemoveTeleportAnswer) {
  WorldLoop world({}, {table(), cube(0.05, 0.02)});
  const auto send = [&](const char* key, const char* value, const char* module = "world") {
    Message m;
    m.id = 5;
    set_text(m.module, module);
    set_text(m.key, key);
    set_text(m.value, value);
    return world.answer(m);
  };
  const MessageReply elsewhere = send("object.reset", "cube", "hand");
  EXPECT_EQ(elsewhere.result, kReplyIgnored);
  EXPECT_EQ(get_text(elsewhere.text), "not for this module");
  const MessageReply unknown = send("glove.gain", "1", "*");
  EXPECT_EQ(unknown.result, kReplyIgnored);
  EXPECT_NE(get_text(unknown.text).find("object.reset"), std::string_view::npos) << "the answer lists the known keys";
  EXPECT_EQ(send("object.reset", "ball").result, kReplyRefused);
  EXPECT_EQ(send("object.teleport", "cube 1 nan 0").result, kReplyRefused);
  EXPECT_EQ(send("object.teleport", "cube 0.1 0.2 0.3").result, kReplyApplied);
  EXPECT_NEAR(object(world.step(4000000, {}), 2).position[0], 0.1, 1e-6);
  const auto version = world.descriptions_version();
  EXPECT_EQ(send("object.remove", "cube").result, kReplyApplied);
  EXPECT_GT(world.descriptions_version(), version);
  EXPECT_EQ(world.descriptions()[1].removed, 1u);
  EXPECT_EQ(world.step(8000000, {}).objects.objects.size(), 1u);
  EXPECT_EQ(send("object.remove", "cube").result, kReplyRefused);
  EXPECT_EQ(send("object.reset", "*", "*").result, kReplyApplied);
  EXPECT_EQ(world.step(12000000, {}).objects.objects.size(), 2u);
  EXPECT_EQ(world.descriptions()[1].removed, 0u);
  // A hand releases every object that is described again. So only the reset object may be described again.
  const auto reset = world.descriptions_version();
  EXPECT_EQ(send("object.reset", "cube").result, kReplyApplied);
  EXPECT_LE(world.descriptions()[0].stamp.sequence, reset);
  EXPECT_GT(world.descriptions()[1].stamp.sequence, reset);
}

// The centre of mass of a hull need not be at the origin of its vertices.
TEST(WorldMessages, TeleportPositionMeansTheSameAsInTheScene) {
  ObjectOptions wedge = cube(0.05, 0.2);
  wedge.shape = "convex_hull";
  wedge.vertices = {{{0, 0, 0}}, {{0.06, 0, 0}}, {{0, 0.03, 0}}, {{0, 0, 0.02}}};
  wedge.orientation = {0.5, 0.5, 0.5, 0.5};
  wedge.floating = true;
  WorldLoop world({}, {wedge});
  const Vector3 before = position(object(world.step(4000000, {}), 1));
  EXPECT_GT((before - to_vector(wedge.position)).norm(), 0.01);
  Message message;
  set_text(message.module, "world");
  set_text(message.key, "object.teleport");
  for (const auto& [place, moved] :
       {std::pair{"cube 0 0.2 0", Vector3(0, 0, 0)}, std::pair{"cube 1 0.2 0", Vector3(1, 0, 0)}}) {
    set_text(message.value, place);
    ASSERT_EQ(world.answer(message).result, kReplyApplied);
    EXPECT_LT((position(object(world.step(8000000, {}), 1)) - before - moved).norm(), 1e-6) << place;
  }
}

// Foreign users must not keep a hand out for ever.
TEST(NewestCouplings, ANewHandTakesThePlaceOfTheOneHeardLongestAgo) {
  NewestCouplings newest(3);
  const auto put = [&newest](std::uint32_t user, double step_period) {
    ObjectCoupling coupling;
    coupling.hand = {user, 1};
    coupling.step_period = step_period;
    newest.put(coupling, 0);
  };
  for (const std::uint32_t user : {10u, 11u, 12u}) put(user, 1);
  put(10, 2);
  put(0, 3);
  std::map<std::uint32_t, double> found;
  for (const ObjectCoupling& each : newest.all()) found[each.hand.user] = each.step_period;
  EXPECT_EQ(found, (std::map<std::uint32_t, double>{{0, 3}, {10, 2}, {12, 1}}));
}

}  // namespace
}  // namespace softhand::world_test
