// The world and a hand's side of the coupling: objects are shaken, pressed, dragged, released, and lost. Owners are in
// world_owner_test.cpp.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdio>
#include <deque>
#include <functional>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "unit/world_objects.hpp"
#include "unit/world_twin.hpp"
#include "world/world_loop.hpp"

namespace softhand::world_coupling_test {
namespace {

using test::cube;
using test::object;
using test::position;
using test::table;
using test::Twin;
using test::TwinTarget;

Nanoseconds nanoseconds(double s) { return std::llround(s * 1e9); }

/// A world and a twin, each at its own rate. Each reads the other's state with a delay of `staleness` steps of its
/// publisher.
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
      : hand_step(1 / hand_hz),
        world_step(1 / world_hz),
        staleness(stale),
        world(
            [&] {
              WorldOptions o;
              o.rate_hz = world_hz;
              return o;
            }(),
            {table(), cube(mass, height)}, 1 / hand_hz),
        world_next(0.37 * world_step) {
    test::accept_claims(world);
    twin.mass = mass;
    twin.pose.position = {0, height, 0};
  }

  /// Runs until `end` (s). `target(t)` is the pose that the hand wants for the object. `at_world_step(t, state)` is
  /// called after each step of the world, `at_hand_step(t)` after each step of the hand.
  void run(double end, const std::function<TwinTarget(double)>& target,
           const std::function<void(double, const ObjectState&)>& at_world_step,
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
        while (!to_world.empty() && to_world.front().first <= t)
          at_world = to_world.front().second, to_world.pop_front();
        const bool heard = at_world.twins.size() > 0;
        const WorldOutput& out = world.step(nanoseconds(t), {heard ? std::span<const ObjectCoupling>(&at_world, 1)
                                                                   : std::span<const ObjectCoupling>()});
        to_hand.emplace_back(t + staleness * world_step, out.objects);
        if (at_world_step) at_world_step(t, object(out, id));
      }
    }
  }
};

const std::function<void(double, const ObjectState&)> nothing;

TwinTarget still(const Vector3& at) { return {{at, Quaternion::Identity()}, {}}; }

/// Minimum-jerk curve from 0 to 1 over [0, 1]. `slope` is its derivative.
double smooth(double s) {
  s = std::clamp(s, 0.0, 1.0);
  return s * s * s * (10 + s * (-15 + 6 * s));
}
double slope(double s) { return s <= 0 || s >= 1 ? 0 : 30 * s * s * (1 - s) * (1 - s); }

struct Shaken {
  double in_phase = 0, magnitude = 0, trail = 0, growth = 0, turn = 0;
  bool finite = true;
};

Shaken shake(double hand_hz, double world_hz, double stale, double mass) {
  Rig rig(hand_hz, world_hz, stale, mass, 0.3);
  // The amplitude is 50 mm, or less if 50 mm takes more than 40 N. The coupling's force is capped at 100 N beyond the
  // weight.
  const double w = 2 * M_PI * 3, amplitude = std::min(0.05, 40 / (mass * w * w)), sway = 0.5;
  const Vector3 along = Vector3(1, 0.5, -0.3).normalized(), about = Vector3(0.2, 1, 0.4).normalized();
  const auto target = [&](double t) {
    const double ease = smooth(t / 0.5), ease_rate = slope(t / 0.5) / 0.5;
    const double s = std::sin(w * t), c = w * std::cos(w * t);
    const double x = ease * s, v = ease * c + ease_rate * s;
    return TwinTarget{{Vector3(0, 0.3, 0) + amplitude * x * along, rotation_exp(sway * x * about)},
                      {amplitude * v * along, sway * v * about}};
  };
  std::vector<std::pair<double, Vector3>> places;
  std::vector<double> forces;
  Shaken result;
  double middle = 0, late = 0;
  const double end = 3;
  rig.run(
      end, target,
      [&](double t, const ObjectState& state) {
        const Vector3 gap = position(state) - rig.twin.pose.position;
        const double turn =
            rotation_log(to_quaternion(state.orientation) * rig.twin.pose.orientation.conjugate()).norm();
        if (!gap.allFinite()) result.finite = false;
        if (t > 1 && t < 2) middle = std::max(middle, gap.norm());
        if (t > 2) late = std::max(late, gap.norm()), result.turn = std::max(result.turn, turn);
      },
      [&](double t) {
        places.emplace_back(t, rig.twin.pose.position);
        forces.push_back((rig.twin.hand.force + mass * rig.twin.gravity).dot(along));
      });
  // Fundamentals at 3 Hz of the force and of the acceleration (central differences). The last two seconds are whole
  // periods.
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

TEST(WorldCoupling, ObjectShakenAtThreeHertzFeelsItsMassAndStaysStable) {
  std::printf(
      "| hand Hz | world Hz | stale | worst in-phase F/(m a) | worst |F|/(m |a|) | trail mm | turn deg | growth a "
      "second |\n|---|---|---|---|---|---|---|---|\n");
  int count = 0;
  for (double hand_hz : {60.0, 90.0, 240.0, 1000.0}) {
    for (double world_hz : {60.0, 100.0, 250.0}) {
      for (double stale : {0.0, 1.0, 2.0}) {
        double in_phase = 1, magnitude = 1, trail = 0, turn = 0, growth = 0;
        for (double mass : {0.001, 0.05, 1.0, 10.0}) {
          const Shaken s = shake(hand_hz, world_hz, stale, mass);
          const auto context = [&] {
            return std::to_string(hand_hz) + "/" + std::to_string(world_hz) + " stale " + std::to_string(stale) +
                   " m " + std::to_string(mass);
          };
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
        std::printf("| %.0f | %.0f | %.0f | %.4f | %.4f | %.1f | %.1f | %.3f |\n", hand_hz, world_hz, stale, in_phase,
                    magnitude, 1e3 * trail, turn * 180 / M_PI, growth);
      }
    }
  }
  std::printf("%d runs\n", count);
}

TEST(WorldCoupling, TwinAndCopyStayTogetherUnderFiveNewtonsOnTheTable) {
  std::printf(
      "| hand Hz | world Hz | stale | twin-table mm | copy-table mm | twin-copy mm | ripple um "
      "|\n|---|---|---|---|---|---|---|\n");
  for (double hand_hz : {60.0, 90.0, 240.0, 1000.0}) {
    for (double world_hz : {60.0, 100.0, 250.0}) {
      for (double stale : {0.0, 1.0, 2.0}) {
        double twin_depth = 0, copy_depth = 0, apart = 0, ripple = 0;
        for (double mass : {0.001, 0.05, 1.0, 10.0}) {
          Rig rig(hand_hz, world_hz, stale, mass, 0.03);
          // The grip carries the weight and pushes down with 5 N more.
          const double k = rig.twin.grip_stiffness();
          const double k_plane = std::max(1e4, (mass * 9.81 + 5) / 0.5e-3);
          const Vector3 push(0, -5 / k - 5 / k_plane, 0);
          const auto target = [&](double t) {
            const double s = smooth(t / 0.5);
            const double into = smooth((t - 0.6) / 0.4);
            const Vector3 weight(0, mass * 9.81 / k, 0);
            return TwinTarget{
                {Vector3(0, 0.03 - 0.01 * s, 0) + weight + into * push, Quaternion::Identity()},
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
        std::printf("| %.0f | %.0f | %.0f | %.3f | %.3f | %.3f | %.2f |\n", hand_hz, world_hz, stale, 1e3 * twin_depth,
                    1e3 * copy_depth, 1e3 * apart, 1e6 * ripple);
      }
    }
  }
}

TEST(WorldCoupling, StaysStableWhenPressedOnAnEdge) {
  for (double hand_hz : {90.0, 240.0}) {
    for (double world_hz : {60.0, 250.0}) {
      for (double mass : {0.001, 0.05, 1.0}) {
        Rig rig(hand_hz, world_hz, 1, mass, 0.04);
        const double k = rig.twin.grip_stiffness();
        const double tilt = 10 * M_PI / 180, edge = 0.02 * (std::cos(tilt) + std::sin(tilt));
        double low = 1, high = -1, turned = 0;
        rig.run(
            3,
            [&](double t) {
              const double s = smooth(t / 0.5), into = smooth((t - 0.6) / 0.4);
              return TwinTarget{{Vector3(0, 0.04 + (edge - 0.04) * s + (mass * 9.81 - 3 * into) / k, 0),
                                 rotation_exp({0, 0, s * tilt})},
                                {}};
            },
            [&](double t, const ObjectState& state) {
              if (t < 2) return;
              low = std::min(low, state.position[1]), high = std::max(high, state.position[1]);
              turned = std::max(
                  turned,
                  rotation_log(to_quaternion(state.orientation) * rig.twin.pose.orientation.conjugate()).norm());
            });
        EXPECT_LT(high - low, 1e-4) << hand_hz << "/" << world_hz << " m " << mass;
        EXPECT_LT(turned, 0.06) << hand_hz << "/" << world_hz << " m " << mass;
        EXPECT_GT(low, 0.018) << hand_hz << "/" << world_hz << " m " << mass;
      }
    }
  }
}

TEST(WorldCoupling, CopyFollowsWhenDraggedOverTheTable) {
  for (double hand_hz : {90.0, 240.0, 1000.0}) {
    for (double mass : {0.001, 0.05, 1.0}) {
      Rig rig(hand_hz, 250, 1, mass, 0.021);
      const double k = rig.twin.grip_stiffness();
      double apart = 0, high = 0, end = 0;
      rig.run(
          3,
          [&](double t) {
            const double s = smooth((t - 1) / 1.5), v = slope((t - 1) / 1.5) / 1.5, into = smooth(t / 0.5);
            return TwinTarget{
                {Vector3(0.1 * s, 0.021 - 0.001 * into + (mass * 9.81 - 3 * into) / k, 0), Quaternion::Identity()},
                {{0.1 * v, 0, 0}, Vector3::Zero()}};
          },
          [&](double t, const ObjectState& state) {
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

TEST(WorldCoupling, CopyFollowsALiftWithATurnOfSixtyDegrees) {
  for (double hand_hz : {60.0, 90.0, 1000.0}) {
    for (double mass : {0.001, 0.05, 10.0}) {
      Rig rig(hand_hz, 250, 1, mass, 0.2);
      const double k = rig.twin.grip_stiffness();
      const Vector3 axis = Vector3(1, 2, 0.5).normalized();
      const double angle = M_PI / 3;
      double error = 0, apart = 0;
      rig.run(
          2,
          [&](double t) {
            const double s = smooth(t / 0.8), v = slope(t / 0.8) / 0.8;
            return TwinTarget{{Vector3(0, 0.2 + 0.15 * s + mass * 9.81 / k, 0), rotation_exp(angle * s * axis)},
                              {{0, 0.15 * v, 0}, angle * v * axis}};
          },
          [&](double t, const ObjectState& state) {
            if (t < 1.5) return;
            error =
                std::max(error, rotation_log(to_quaternion(state.orientation) * rotation_exp(-angle * axis)).norm());
            apart = std::max(apart, (position(state) - Vector3(0, 0.35, 0)).norm());
          });
      EXPECT_LT(error, 1e-3) << hand_hz << " " << mass;
      EXPECT_LT(apart, 2e-4) << hand_hz << " " << mass;
    }
  }
}

TEST(WorldCoupling, ReleasedObjectRestsOnTheTable) {
  for (double hand_hz : {90.0, 240.0, 1000.0}) {
    for (double mass : {0.001, 0.05, 1.0}) {
      Rig rig(hand_hz, 250, 1, mass, 0.05);
      const double k = rig.twin.grip_stiffness();
      rig.run(
          1.5,
          [&](double t) {
            const double s = smooth(t / 1.0), v = slope(t / 1.0);
            return TwinTarget{{Vector3(0, 0.05 - 0.03 * s + mass * 9.81 / k, 0), Quaternion::Identity()},
                              {{0, -0.03 * v, 0}, Vector3::Zero()}};
          },
          nothing);
      rig.owned = false;
      double off = 0, speed = 0;
      bool let_go = false;
      rig.run(
          3,
          [&](double) {
            return still({0, 0.02, 0});
          },
          [&](double t, const ObjectState& state) {
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

TEST(WorldCoupling, ObjectOfAStalledHandStopsAndIsThenReleased) {
  Rig rig(90, 250, 0, 0.05, 0.3);
  const double lift = 0.05 * 9.81 / rig.twin.grip_stiffness();
  const auto target = [&](double t) {
    return TwinTarget{{Vector3(0.5 * t, 0.3 + lift, 0), Quaternion::Identity()}, {{0.5, 0, 0}, Vector3::Zero()}};
  };
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
  const auto target = [&](double t) {
    return still({0.25 * smooth(t / 3), 0.3 + 0.05 * 9.81 / rig.twin.grip_stiffness(), 0});
  };
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

TEST(WorldCoupling, FollowsATeleportedTwinBelowFiveMetresPerSecond) {
  Rig rig(90, 250, 1, 0.05, 0.3);
  double fast = 0;
  rig.run(
      0.5,
      [&](double) {
        return still({0, 0.31, 0});
      },
      nothing);
  rig.twin.pose.position.x() += 10;
  rig.run(
      3,
      [&](double) {
        return still({10, 0.31, 0});
      },
      [&](double, const ObjectState& state) { fast = std::max(fast, to_vector(state.linear_velocity).norm()); });
  EXPECT_GT(fast, 0.5);
  EXPECT_LT(fast, 5);
}

TEST(WorldCoupling, AFloatingObjectFallsOnlyAfterItWasTouched) {
  ObjectOptions o = cube(0.05, 0.5);
  o.floating = true;
  WorldLoop world({}, {table(), o});
  Nanoseconds now = 0;
  test::accept_claims(world);
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

}  // namespace
}  // namespace softhand::world_coupling_test
