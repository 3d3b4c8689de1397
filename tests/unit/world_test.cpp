#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <complex>
#include <cstdio>
#include <cstring>
#include <deque>
#include <functional>
#include <random>
#include <stdexcept>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "unit/world_twin.hpp"
#include "world/follow.hpp"
#include "world/world_loop.hpp"

namespace softhand {
namespace {

using test::Twin;
using test::TwinTarget;

ObjectOptions table() {
  ObjectOptions o;
  o.name = "table";
  o.half_extents = {0.5, 0.02, 0.5};
  o.position = {0, -0.02, 0};
  return o;
}
ObjectOptions cube(double mass, double height) {
  ObjectOptions o;
  o.name = "cube";
  o.mass = mass;
  o.position = {0, height, 0};
  return o;
}
const ObjectState& object(const WorldOutput& out, std::uint32_t id) {
  for (const ObjectState& state : out.objects.objects)
    if (state.object == id) return state;
  throw std::runtime_error("object is not in the snapshot");
}
Vector3 position(const ObjectState& state) { return to_vector(state.position); }
Nanoseconds nanoseconds(double s) { return std::llround(s * 1e9); }

/// A world and a twin at their own rates, each reading what the other published some time ago.
struct Rig {
  double hand_step, world_step, staleness;
  WorldLoop world;
  Twin twin;
  ObjectCoupling coupling;  // what the twin's process last published
  WorldOutput seen;         // what the world last published
  bool owned = true;
  std::uint32_t id = 2;
  double hand_next = 0, world_next;
  std::deque<std::pair<double, ObjectCoupling>> to_world;
  std::deque<std::pair<double, WorldObjects>> to_hand;
  ObjectCoupling at_world;
  WorldObjects at_hand;
  bool hand_runs = true, world_runs = true;

  Rig(double hand_hz, double world_hz, double stale, double mass, double height)
      : hand_step(1 / hand_hz), world_step(1 / world_hz), staleness(stale),
        world([&] { WorldOptions o; o.rate_hz = world_hz; return o; }(), {table(), cube(mass, height)}, 1 / hand_hz),
        world_next(0.37 * world_step) {
    twin.mass = mass;
    twin.pose.position = {0, height, 0};
  }

  /// Runs until `end`; `target(t)` is where the hand wants the object; `watch(t, twin, state)` sees each world step.
  void run(double end, const std::function<TwinTarget(double)>& target, const std::function<void(double, const ObjectState&)>& at_world_step,
           const std::function<void(double)>& at_hand_step = {}) {
    while (std::min(hand_next, world_next) < end) {
      if (hand_next <= world_next) {
        const double t = hand_next;
        hand_next += hand_step;
        if (!hand_runs) continue;
        while (!to_hand.empty() && to_hand.front().first <= t) at_hand = to_hand.front().second, to_hand.pop_front();
        const ObjectState* state = nullptr;
        for (const ObjectState& candidate : at_hand.objects)
          if (candidate.object == id) state = &candidate;
        std::span<const NeighbourPlane> planes;
        if (state != nullptr) planes = {state->planes.begin(), state->planes.size()};
        if (owned) {
          twin.step(hand_step, target(t), planes, t - static_cast<double>(at_hand.stamp.sample_time) * 1e-9);
        } else if (state != nullptr) {
          twin.pose = to_pose(state->position, state->orientation);
          twin.velocity = {to_vector(state->linear_velocity), to_vector(state->angular_velocity)};
          twin.hand = {};
        }
        if (at_hand_step) at_hand_step(t);
        ObjectCoupling out;
        out.stamp.sample_time = nanoseconds(t);
        out.step_period = hand_step;
        ObjectTwin wire;
        wire.object = id;
        wire.owned = owned ? 1 : 0;
        wire.position = to_wire(twin.pose.position);
        wire.orientation = to_wire(twin.pose.orientation);
        wire.linear_velocity = to_wire(twin.velocity.linear);
        wire.angular_velocity = to_wire(twin.velocity.angular);
        wire.contact_force = to_wire(twin.hand.force);
        wire.contact_torque = to_wire(twin.hand.torque);
        out.twins.push_back(wire);
        to_world.emplace_back(t + staleness * hand_step, out);
      } else {
        const double t = world_next;
        world_next += world_step;
        if (!world_runs) continue;
        while (!to_world.empty() && to_world.front().first <= t) at_world = to_world.front().second, to_world.pop_front();
        const bool heard = at_world.twins.size() > 0;
        const WorldOutput& out = world.step(nanoseconds(t), {heard ? std::span<const ObjectCoupling>(&at_world, 1) : std::span<const ObjectCoupling>()});
        to_hand.emplace_back(t + staleness * world_step, out.objects);
        if (at_world_step) at_world_step(t, object(out, id));
      }
    }
  }
};

const std::function<void(double, const ObjectState&)> nothing;

TwinTarget still(const Vector3& at) { return {{at, Quaternion::Identity()}, {}}; }

/// Minimum-jerk from 0 to 1 over [0, 1], with its slope.
double smooth(double s) { s = std::clamp(s, 0.0, 1.0); return s * s * s * (10 + s * (-15 + 6 * s)); }
double slope(double s) { return s <= 0 || s >= 1 ? 0 : 30 * s * s * (1 - s) * (1 - s); }

// --- laws -----------------------------------------------------------------------------------------------------------------------------------------------

TEST(WorldFollow, ClosedFormIsTheImplicitStep) {
  // A free body under the wrench and gravity ends where the spring and damper, taken at the END of the step, hold it.
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
    // What pushes beyond f_h is the spring and damper at the end, plus the share that undoes f_h + m g in flight.
    const Vector3 end = k * (e - step * v) + d * (a.velocity.linear - v);
    EXPECT_LT((w.force - a.wrench.force - end).norm(), 1e-9 * (1 + end.norm()));
    const Vector3 spin = b.velocity.angular + step * (b.inertia.inverse() * w.torque);
    const Vector3 turn = rotation_log(a.pose.orientation * b.pose.orientation.conjugate());
    const Vector3 end_turn = kappa / (step * step) * (b.inertia * (turn - step * spin)) + 2 * std::sqrt(kappa) / step * (b.inertia * (a.velocity.angular - spin));
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

TEST(WorldSolid, HullOfABoxWeighsLikeTheBox) {
  ObjectOptions hull = cube(0.3, 0), box = cube(0.3, 0);
  hull.shape = "convex_hull";
  box.half_extents = {0.01, 0.02, 0.03};
  const Vector3 shift(0.1, -0.2, 0.05);
  for (int i = 0; i < 8; ++i)
    hull.vertices.push_back({{shift.x() + (i & 1 ? 0.01 : -0.01), shift.y() + (i & 2 ? 0.02 : -0.02), shift.z() + (i & 4 ? 0.03 : -0.03)}});
  const Solid a = make_solid(hull), b = make_solid(box);
  EXPECT_LT((a.body_frame.position - shift).norm(), 1e-5);  // the hull's integer grid
  Vector3 sorted = b.inertia;
  std::sort(sorted.begin(), sorted.end());
  EXPECT_LT((a.inertia - sorted).norm(), 1e-3 * sorted.norm());
  // A hull inserted off its origin stands where its vertices say.
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

// --- Bullet stands where it should ----------------------------------------------------------------------------------------------------------------------

TEST(WorldBullet, EveryShapeRestsOnTheTableAtItsTrueHeight) {
  for (const char* shape : {"sphere", "box", "cylinder", "capsule", "convex_hull"}) {
    for (double size : {0.005, 0.02, 0.05}) {
      ObjectOptions o = cube(size < 0.01 ? 0.001 : 0.05, 0);
      o.shape = shape;
      o.radius = o.half_length = size;
      o.half_extents = {size, size, size};
      if (std::strcmp(shape, "convex_hull") == 0)
        for (int i = 0; i < 8; ++i) o.vertices.push_back({{i & 1 ? size : -size, i & 2 ? size : -size, i & 4 ? size : -size}});
      const double height = std::strcmp(shape, "capsule") == 0 ? 2 * size : size;
      o.position = {0.1, height + 0.002, 0.05};
      if (std::strcmp(shape, "sphere") == 0 || std::strcmp(shape, "capsule") == 0) o.friction = 1;  // a capsule on its tip is not stable: see below
      WorldLoop world({}, {table(), o});
      Vector3 at = Vector3::Zero();
      const bool tips = std::strcmp(shape, "capsule") == 0;
      for (int i = 1; i <= 250 * (tips ? 1 : 3); ++i) {
        const ObjectState& state = object(world.step(i * 4000000LL, {}), 2);
        at = position(state);
        if (tips && i > 100) break;  // long enough to have landed
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

TEST(WorldBullet, AStackWithTheHeavierOnTopStands) {
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
      EXPECT_LT((position(object(*out, static_cast<std::uint32_t>(2 + i))) - Vector3(0, 0.02 + 0.04 * i, 0)).norm(), 1e-3) << "cube " << i << ", ratio " << ratio;
  }
}

TEST(WorldBullet, SlidesAndSticksAsCoulombSays) {
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
      for (const ObjectState& s : world.step(i * 4000000LL, {}).objects.objects) trace.insert(trace.end(), s.position.begin(), s.position.end());
    return trace;
  };
  const auto first = run(), second = run();
  ASSERT_EQ(first.size(), second.size());
  EXPECT_EQ(std::memcmp(first.data(), second.data(), first.size() * sizeof(double)), 0);
}

// --- the coupling in three dimensions -------------------------------------------------------------------------------------------------------------------

struct Shaken {
  double in_phase = 0, magnitude = 0, trail = 0, growth = 0, turn = 0;
  bool finite = true;
};

Shaken shake(double hand_hz, double world_hz, double stale, double mass) {
  Rig rig(hand_hz, world_hz, stale, mass, 0.3);
  // +-50 mm, or what takes 40 N: the coupling's force is capped at 100 N beyond the weight.
  const double w = 2 * M_PI * 3, amplitude = std::min(0.05, 40 / (mass * w * w)), sway = 0.5;
  const Vector3 along = Vector3(1, 0.5, -0.3).normalized(), about = Vector3(0.2, 1, 0.4).normalized();
  const auto target = [&](double t) {
    const double ease = smooth(t / 0.5), ease_rate = slope(t / 0.5) / 0.5;
    const double s = std::sin(w * t), c = w * std::cos(w * t);
    const double x = ease * s, v = ease * c + ease_rate * s;
    return TwinTarget{{Vector3(0, 0.3, 0) + amplitude * x * along, rotation_exp(sway * x * about)}, {amplitude * v * along, sway * v * about}};
  };
  std::vector<std::pair<double, Vector3>> places;
  std::vector<double> forces;
  Shaken result;
  double middle = 0, late = 0;
  const double end = 3;
  rig.run(end, target,
          [&](double t, const ObjectState& state) {
            const Vector3 gap = position(state) - rig.twin.pose.position;
            const double turn = rotation_log(to_quaternion(state.orientation) * rig.twin.pose.orientation.conjugate()).norm();
            if (!gap.allFinite()) result.finite = false;
            if (t > 1 && t < 2) middle = std::max(middle, gap.norm());
            if (t > 2) late = std::max(late, gap.norm()), result.turn = std::max(result.turn, turn);
          },
          [&](double t) {
            places.emplace_back(t, rig.twin.pose.position);
            forces.push_back((rig.twin.hand.force + mass * rig.twin.gravity).dot(along));
          });
  // Fundamental at 3 Hz of force and of acceleration by central differences, over whole periods: the last two seconds.
  std::complex<double> force = 0, acceleration = 0;
  const double h = rig.hand_step;
  for (std::size_t i = 1; i + 1 < places.size(); ++i) {
    const double t = places[i].first;
    if (t < end - 2) continue;
    const std::complex<double> wave = std::polar(1.0, -w * t);
    force += forces[i] * wave;
    acceleration += (places[i + 1].second - 2 * places[i].second + places[i - 1].second).dot(along) / (h * h) * wave;
  }
  const std::complex<double> ratio = force / acceleration / mass;
  result.in_phase = ratio.real();
  result.magnitude = std::abs(ratio);
  result.trail = late;
  result.growth = late / middle;
  return result;
}

TEST(WorldCoupling, ShakenAtThreeHertzWeighsRightAndNothingGrows) {
  std::printf("| hand Hz | world Hz | stale | worst in-phase F/(m a) | worst |F|/(m |a|) | trail mm | turn deg | growth a second |\n|---|---|---|---|---|---|---|---|\n");
  int count = 0;
  for (double hand_hz : {60.0, 90.0, 240.0, 1000.0}) {
    for (double world_hz : {60.0, 100.0, 250.0}) {
      for (double stale : {0.0, 1.0, 2.0}) {
        double in_phase = 1, magnitude = 1, trail = 0, turn = 0, growth = 0;
        for (double mass : {0.001, 0.05, 1.0, 10.0}) {
          const Shaken s = shake(hand_hz, world_hz, stale, mass);
          const auto context = [&] { return std::to_string(hand_hz) + "/" + std::to_string(world_hz) + " stale " + std::to_string(stale) + " m " + std::to_string(mass); };
          ++count;
          ASSERT_TRUE(s.finite) << context();
          EXPECT_NEAR(s.magnitude, 1, 0.02) << context();
          EXPECT_GE(s.in_phase, hand_hz >= 240 ? 0.98 : 0.94) << context();
          EXPECT_LE(s.in_phase, 1.02) << context();
          EXPECT_LT(s.growth, 1.1) << context();
          EXPECT_LT(s.trail, 0.08) << context();
          if (std::abs(s.in_phase - 1) > std::abs(in_phase - 1)) in_phase = s.in_phase;
          if (std::abs(s.magnitude - 1) > std::abs(magnitude - 1)) magnitude = s.magnitude;
          trail = std::max(trail, s.trail), turn = std::max(turn, s.turn), growth = std::max(growth, s.growth);
        }
        std::printf("| %.0f | %.0f | %.0f | %.4f | %.4f | %.1f | %.1f | %.3f |\n", hand_hz, world_hz, stale, in_phase, magnitude, 1e3 * trail, turn * 180 / M_PI, growth);
      }
    }
  }
  std::printf("%d runs\n", count);
}

TEST(WorldCoupling, PressedOnTheTableWithFiveNewtons) {
  std::printf("| hand Hz | world Hz | stale | twin-table mm | copy-table mm | twin-copy mm | ripple um |\n|---|---|---|---|---|---|---|\n");
  for (double hand_hz : {60.0, 90.0, 240.0, 1000.0}) {
    for (double world_hz : {60.0, 100.0, 250.0}) {
      for (double stale : {0.0, 1.0, 2.0}) {
        double twin_depth = 0, copy_depth = 0, apart = 0, ripple = 0;
        for (double mass : {0.001, 0.05, 1.0, 10.0}) {
          Rig rig(hand_hz, world_hz, stale, mass, 0.03);
          // The grip carries the weight and pushes 5 N more.
          const double k = rig.twin.grip_stiffness();
          const double k_plane = std::max(1e4, (mass * 9.81 + 5) / 0.5e-3);
          const Vector3 push(0, -5 / k - 5 / k_plane, 0);
          const auto target = [&](double t) {
            const double s = smooth(t / 0.5);
            const double into = smooth((t - 0.6) / 0.4);
            const Vector3 weight(0, mass * 9.81 / k, 0);
            return TwinTarget{{Vector3(0, 0.03 - 0.01 * s, 0) + weight + into * push, Quaternion::Identity()},
                              {Vector3(0, -0.01 * slope(t / 0.5) / 0.5, 0) + push * slope((t - 0.6) / 0.4) / 0.4, Vector3::Zero()}};
          };
          double low = 1, high = -1;
          rig.run(2.5, target, [&](double t, const ObjectState& state) {
            if (t < 2) return;
            low = std::min(low, state.position[1]), high = std::max(high, state.position[1]);
            copy_depth = std::max(copy_depth, std::abs(state.position[1] - 0.02));
            twin_depth = std::max(twin_depth, 0.02 - rig.twin.pose.position.y());
            apart = std::max(apart, std::abs(state.position[1] - rig.twin.pose.position.y()));
          });
          ripple = std::max(ripple, high - low);
          EXPECT_LE(apart, 0.505e-3) << hand_hz << "/" << world_hz << " stale " << stale << " m " << mass;
          EXPECT_LE(high - low, 2e-5) << hand_hz << "/" << world_hz << " stale " << stale << " m " << mass;
          EXPECT_NEAR(rig.twin.hand.force.y(), mass * 9.81 - 5, 0.1);
        }
        std::printf("| %.0f | %.0f | %.0f | %.3f | %.3f | %.3f | %.2f |\n", hand_hz, world_hz, stale, 1e3 * twin_depth, 1e3 * copy_depth, 1e3 * apart, 1e6 * ripple);
      }
    }
  }
}

TEST(WorldCoupling, PressedOnAnEdgeNothingGrows) {
  for (double hand_hz : {90.0, 240.0}) {
    for (double world_hz : {60.0, 250.0}) {
      for (double mass : {0.001, 0.05, 1.0}) {
        Rig rig(hand_hz, world_hz, 1, mass, 0.04);
        const double k = rig.twin.grip_stiffness();
        const double tilt = 10 * M_PI / 180, edge = 0.02 * (std::cos(tilt) + std::sin(tilt));
        double low = 1, high = -1, turned = 0;
        rig.run(3, [&](double t) {
          const double s = smooth(t / 0.5), into = smooth((t - 0.6) / 0.4);
          return TwinTarget{{Vector3(0, 0.04 + (edge - 0.04) * s + (mass * 9.81 - 3 * into) / k, 0), rotation_exp({0, 0, s * tilt})}, {}};
        }, [&](double t, const ObjectState& state) {
          if (t < 2) return;
          low = std::min(low, state.position[1]), high = std::max(high, state.position[1]);
          turned = std::max(turned, rotation_log(to_quaternion(state.orientation) * rig.twin.pose.orientation.conjugate()).norm());
        });
        EXPECT_LT(high - low, 1e-4) << hand_hz << "/" << world_hz << " m " << mass;
        EXPECT_LT(turned, 0.06) << hand_hz << "/" << world_hz << " m " << mass;
        EXPECT_GT(low, 0.018) << hand_hz << "/" << world_hz << " m " << mass;
      }
    }
  }
}

TEST(WorldCoupling, DraggedOverTheTableTheCopyComesAlong) {
  for (double hand_hz : {90.0, 240.0, 1000.0}) {
    for (double mass : {0.001, 0.05, 1.0}) {
      Rig rig(hand_hz, 250, 1, mass, 0.021);
      const double k = rig.twin.grip_stiffness();
      double apart = 0, high = 0, end = 0;
      rig.run(3, [&](double t) {
        const double s = smooth((t - 1) / 1.5), v = slope((t - 1) / 1.5) / 1.5, into = smooth(t / 0.5);
        return TwinTarget{{Vector3(0.1 * s, 0.021 - 0.001 * into + (mass * 9.81 - 3 * into) / k, 0), Quaternion::Identity()}, {{0.1 * v, 0, 0}, Vector3::Zero()}};
      }, [&](double t, const ObjectState& state) {
        if (t < 0.8) return;
        apart = std::max(apart, std::abs(state.position[0] - rig.twin.pose.position.x()));
        high = std::max(high, std::abs(state.position[1] - 0.02));
        end = std::abs(state.position[0] - rig.twin.pose.position.x());
      });
      EXPECT_GT(rig.twin.pose.position.x(), 0.05);
      EXPECT_LT(apart, 5e-3) << hand_hz << " m " << mass;
      EXPECT_LT(high, 2e-3) << hand_hz << " m " << mass;
      EXPECT_LT(end, 5e-4) << hand_hz << " m " << mass;
    }
  }
}

TEST(WorldCoupling, TurnedBySixtyDegreesAndCarried) {
  for (double hand_hz : {60.0, 90.0, 1000.0}) {
    for (double mass : {0.001, 0.05, 10.0}) {
      Rig rig(hand_hz, 250, 1, mass, 0.2);
      const double k = rig.twin.grip_stiffness();
      const Vector3 axis = Vector3(1, 2, 0.5).normalized();
      const double angle = M_PI / 3;
      double error = 0, apart = 0;
      rig.run(2, [&](double t) {
        const double s = smooth(t / 0.8), v = slope(t / 0.8) / 0.8;
        return TwinTarget{{Vector3(0, 0.2 + 0.15 * s + mass * 9.81 / k, 0), rotation_exp(angle * s * axis)}, {{0, 0.15 * v, 0}, angle * v * axis}};
      }, [&](double t, const ObjectState& state) {
        if (t < 1.5) return;
        error = std::max(error, rotation_log(to_quaternion(state.orientation) * rotation_exp(-angle * axis)).norm());
        apart = std::max(apart, (position(state) - Vector3(0, 0.35, 0)).norm());
      });
      EXPECT_LT(error, 1e-3) << hand_hz << " " << mass;
      EXPECT_LT(apart, 2e-4) << hand_hz << " " << mass;
    }
  }
}

TEST(WorldCoupling, PutDownAndReleasedItRests) {
  for (double hand_hz : {90.0, 240.0, 1000.0}) {
    for (double mass : {0.001, 0.05, 1.0}) {
      Rig rig(hand_hz, 250, 1, mass, 0.05);
      const double k = rig.twin.grip_stiffness();
      rig.run(1.5, [&](double t) {
        const double s = smooth(t / 1.0), v = slope(t / 1.0);
        return TwinTarget{{Vector3(0, 0.05 - 0.03 * s + mass * 9.81 / k, 0), Quaternion::Identity()}, {{0, -0.03 * v, 0}, Vector3::Zero()}};
      }, nothing);
      rig.owned = false;
      double off = 0, speed = 0;
      bool let_go = false;
      rig.run(3, [&](double) { return still({0, 0.02, 0}); }, [&](double t, const ObjectState& state) {
        if (t < 2) return;
        let_go = state.owned == 0;
        off = std::max(off, (position(state) - Vector3(0, 0.02, 0)).norm());
        speed = std::max(speed, to_vector(state.linear_velocity).norm());
      });
      EXPECT_TRUE(let_go);
      EXPECT_LT(off, 1e-4) << hand_hz << " " << mass;
      EXPECT_LT(speed, 1e-3) << hand_hz << " " << mass;
    }
  }
}

TEST(WorldCoupling, AStalledHandHoldsStillAndThenLetsGo) {
  Rig rig(90, 250, 0, 0.05, 0.3);
  const double lift = 0.05 * 9.81 / rig.twin.grip_stiffness();
  const auto target = [&](double t) { return TwinTarget{{Vector3(0.5 * t, 0.3 + lift, 0), Quaternion::Identity()}, {{0.5, 0, 0}, Vector3::Zero()}}; };
  rig.run(0.5, target, nothing);
  rig.hand_runs = false;
  double at_100 = 0, at_450 = 0, low = 1, fast = 0;
  bool gone = false;
  rig.run(1.5, target, [&](double t, const ObjectState& state) {
    const double since = t - 0.5;
    if (since < 0.1) at_100 = state.position[0];
    if (since < 0.45) at_450 = state.position[0], low = std::min(low, state.position[1]);
    if (since > 0.56) gone = state.owned == 0;
    fast = std::max(fast, to_vector(state.linear_velocity).norm());
  });
  EXPECT_LT(std::abs(at_450 - at_100), 0.05);
  EXPECT_GT(low, 0.29);
  EXPECT_TRUE(gone);
  EXPECT_LT(fast, 5);
  EXPECT_GE(rig.world.counters().stalls, 1u);
  EXPECT_EQ(rig.world.counters().vanished, 1u);
}

TEST(WorldCoupling, AStalledWorldRecovers) {
  Rig rig(90, 250, 1, 0.05, 0.3);
  const auto target = [&](double t) { return still({0.25 * smooth(t / 3), 0.3 + 0.05 * 9.81 / rig.twin.grip_stiffness(), 0}); };
  rig.run(0.5, target, nothing);
  rig.world_runs = false;
  rig.run(2.5, target, nothing);
  rig.world_runs = true;
  double fast = 0, off = 0;
  rig.run(4.5, target, [&](double t, const ObjectState& state) {
    fast = std::max(fast, to_vector(state.linear_velocity).norm());
    if (t > 3.6) off = std::max(off, (position(state) - Vector3(0.25, 0.3, 0)).norm());
  });
  EXPECT_LT(fast, 5);
  EXPECT_LT(off, 1e-4);
}

TEST(WorldCoupling, ATeleportedTwinIsFollowedBelowFiveMetresASecond) {
  Rig rig(90, 250, 1, 0.05, 0.3);
  double fast = 0;
  rig.run(0.5, [&](double) { return still({0, 0.31, 0}); }, nothing);
  rig.twin.pose.position.x() += 10;
  rig.run(3, [&](double) { return still({10, 0.31, 0}); }, [&](double, const ObjectState& state) {
    fast = std::max(fast, to_vector(state.linear_velocity).norm());
  });
  EXPECT_GT(fast, 0.5);
  EXPECT_LT(fast, 5);
}

TEST(WorldCoupling, NoFiniteTwinIsBelievedAndTheFirstOwnerKeeps) {
  WorldLoop world({}, {table(), cube(0.05, 0.3)});
  std::array<ObjectCoupling, 2> couplings;
  for (std::uint32_t side : {0u, 1u}) {
    ObjectCoupling& c = couplings[side];
    c.hand = {0, side};
    c.step_period = 1.0 / 90;
    ObjectTwin twin;
    twin.object = 2;
    twin.owned = side;  // first the right hand only
    twin.position = {side ? 0.01 : -0.01, 0.3, 0};
    twin.contact_force = {0, 0.05 * 9.81, 0};
    c.twins.push_back(twin);
  }
  Nanoseconds now = 0;
  const auto step = [&] {
    now += 4000000;
    for (auto& c : couplings) c.stamp.sample_time = now;
    return object(world.step(now, {couplings}), 2);
  };
  EXPECT_EQ(step().owner_side, 1u);
  couplings[0].twins[0].owned = 1;
  EXPECT_EQ(step().owner_side, 1u);
  couplings[1].twins[0].owned = 0;
  EXPECT_EQ(step().owner_side, 0u);
  couplings[0].twins[0].position[1] = std::nan("");
  const ObjectState last = step();
  EXPECT_EQ(last.owned, 0u);
  EXPECT_TRUE(std::isfinite(last.position[1]));
  EXPECT_EQ(world.counters().refused_nonfinite, 1u);
}

TEST(WorldCoupling, OfTwoHandsThatHoldOneVanishesAndTheOtherTakesOver) {
  WorldLoop world({}, {table(), cube(0.05, 0.2)});
  std::array<ObjectCoupling, 2> hands;
  for (std::uint32_t side : {0u, 1u}) {
    hands[side].hand = {0, side};
    hands[side].step_period = 1.0 / 90;
    ObjectTwin twin;
    twin.object = 2;
    twin.owned = 1;
    twin.position = {0, 0.2, 0};
    hands[side].twins.push_back(twin);
  }
  const auto run = [&](int from, int to, bool both) {
    ObjectState state;
    for (int i = from; i < to; ++i) {
      const Nanoseconds now = i * 4000000LL;
      hands[1].stamp.sample_time = now;
      if (both) hands[0].stamp.sample_time = now;
      state = object(world.step(now, {hands}), 2);
    }
    return state;
  };
  EXPECT_EQ(run(1, 50, true).owner_side, 0u);
  EXPECT_EQ(run(50, 150, false).owner_side, 0u) << "0.4 s: it may come back";
  EXPECT_EQ(world.counters().stalls, 1u);
  const ObjectState taken = run(150, 250, false);
  EXPECT_EQ(taken.owned, 1u);
  EXPECT_EQ(taken.owner_side, 1u);
  EXPECT_NEAR(taken.position[1], 0.2, 2e-3);
  EXPECT_EQ(world.counters().vanished, 1u);
  EXPECT_EQ(world.counters().stalls, 1u);
}

TEST(WorldCoupling, AFloatingObjectFallsOnlyAfterItWasTouched) {
  ObjectOptions o = cube(0.05, 0.5);
  o.floating = true;
  WorldLoop world({}, {table(), o});
  Nanoseconds now = 0;
  for (int i = 0; i < 250; ++i) EXPECT_NEAR(object(world.step(now += 4000000, {}), 2).position[1], 0.5, 1e-6);
  ObjectCoupling c;
  c.step_period = 1.0 / 90;
  ObjectTwin twin;
  twin.object = 2;
  twin.owned = 1;
  twin.position = {0, 0.5, 0};
  twin.contact_force = {0, 0.05 * 9.81, 0};
  c.twins.push_back(twin);
  c.stamp.sample_time = now;
  EXPECT_NEAR(object(world.step(now += 4000000, {{&c, 1}}), 2).position[1], 0.5, 1e-4);
  double y = 1;
  for (int i = 0; i < 250; ++i) y = object(world.step(now += 4000000, {}), 2).position[1];
  EXPECT_NEAR(y, 0.02, 1e-3);
}

TEST(WorldCoupling, SymmetricModeHoldsABoxAgainstGravityThroughTheSpring) {
  WorldOptions options;
  options.mode = "symmetric";
  options.stiffness = 100;
  options.angular_stiffness = 0.01;
  WorldLoop world(options, {cube(0.05, 0.3)});
  ObjectCoupling c;
  c.mode = 1;
  c.step_period = 1.0 / 90;
  ObjectTwin twin;
  twin.object = 1;
  twin.position = {0, 0.3, 0};
  c.twins.push_back(twin);
  Nanoseconds now = 0;
  double y = 0;
  for (int i = 0; i < 500; ++i) {
    now += 4000000;
    c.stamp.sample_time = now;
    y = object(world.step(now, {{&c, 1}}), 1).position[1];
  }
  EXPECT_NEAR(y, 0.3 - 0.05 * 9.81 / 100, 2e-5);  // offset F/k
}

// --- what is refused -----------------------------------------------------------------------------------------------------------------------------------

TEST(WorldOptions, RefusesWhatCannotBeRunAndOffersWhatCan) {
  EXPECT_TRUE(check_world({}, {table(), cube(0.05, 0.02)}).empty());
  const auto refused = [](const std::function<void(WorldOptions&, ObjectOptions&)>& spoil, const std::string& word) {
    WorldOptions w;
    ObjectOptions o = cube(0.05, 0.02);
    spoil(w, o);
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

// Rounded to the hull's grid, such vertices enclose some cubic millimetres.
TEST(WorldOptions, AHullOfVerticesInOnePlaneIsRefusedHoweverThePlaneLies) {
  std::mt19937_64 generator(1);
  std::uniform_real_distribution<double> uniform(-0.05, 0.05);
  for (int plane = 0; plane < 200; ++plane) {
    const Quaternion turn = rotation_exp(Vector3(60 * uniform(generator), 60 * uniform(generator), 60 * uniform(generator)));
    const Vector3 shift(uniform(generator), uniform(generator), uniform(generator));
    ObjectOptions flat = cube(0.05, 0.1);
    flat.shape = "convex_hull";
    for (int i = 0; i < 4 + plane % 9; ++i) flat.vertices.push_back({to_wire(Vector3(shift + turn * Vector3(uniform(generator), 0, uniform(generator))))});
    const auto wrong = check_world({}, {table(), flat});
    ASSERT_FALSE(wrong.empty()) << plane;
    EXPECT_NE(wrong[0].find("span no volume"), std::string::npos) << wrong[0];
    for (VertexOptions& vertex : std::vector(flat.vertices)) flat.vertices.push_back({to_wire(Vector3(to_vector(vertex.at) + turn * Vector3(0, 5e-4, 0)))});
    EXPECT_TRUE(check_world({}, {table(), flat}).empty()) << plane << ": a plate of half a millimetre";
  }
}

TEST(WorldOptions, SymmetricGrowthIsTheKnownOne) {
  // Undamped, states two periods old: unstable at every stiffness, 1.035 at kappa = 0.1.
  const double step = 1.0 / 60;
  EXPECT_NEAR(symmetric_growth(0.1 / (step * step), 0, step, step), 1.035, 5e-4);
  for (double kappa : {0.01, 0.1, 1.0}) EXPECT_GT(symmetric_growth(kappa / (step * step), 0, step, step), 1.001) << kappa;
  // Refusals offer values that pass themselves.
  WorldOptions w;
  w.mode = "symmetric";
  w.damping_ratio = 0;
  w.stiffness = 5000;
  const auto wrong = check_world(w, {cube(0.05, 0.02)});
  ASSERT_FALSE(wrong.empty());
  const auto at = wrong[0].find("nearest value that works: ");
  if (at != std::string::npos) {
    w.stiffness = std::stod(wrong[0].substr(at + 26));
    for (const auto& text : check_world(w, {cube(0.05, 0.02)})) EXPECT_EQ(text.find("world.stiffness"), std::string::npos) << text;
  } else {
    EXPECT_NE(wrong[0].find("use mode owner"), std::string::npos) << wrong[0];
  }
}

TEST(WorldMessages, ANameWithBlanksIsAName) {
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
  EXPECT_NE(get_text(unknown.text).find("object.reset"), std::string_view::npos) << "the answer names the keys that are known";
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
  // A hand lets go of what is described anew, so that is only what was put back.
  const auto reset = world.descriptions_version();
  EXPECT_EQ(send("object.reset", "cube").result, kReplyApplied);
  EXPECT_LE(world.descriptions()[0].stamp.sequence, reset);
  EXPECT_GT(world.descriptions()[1].stamp.sequence, reset);
}

// The centre of mass of a hull need not be where its vertices are told from.
TEST(WorldMessages, ATeleportGoesToAPlaceAsTheSceneTellsIt) {
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
  for (const auto& [place, moved] : {std::pair{"cube 0 0.2 0", Vector3(0, 0, 0)}, std::pair{"cube 1 0.2 0", Vector3(1, 0, 0)}}) {
    set_text(message.value, place);
    ASSERT_EQ(world.answer(message).result, kReplyApplied);
    EXPECT_LT((position(object(world.step(8000000, {}), 1)) - before - moved).norm(), 1e-6) << place;
  }
}

}  // namespace
}  // namespace softhand
