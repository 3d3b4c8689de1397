// The coupling of a flexible object in two processes, in small: a cube of 27 nodes. The rates are 60 to 1000 Hz, and
// the copies are 0 to 2 periods old. The tables are those of docs/soft-objects.md.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <deque>
#include <memory>
#include <vector>

#include "support/box_mesh.hpp"
#include "world/free_soft_body.hpp"
#include "world/world_options.hpp"

namespace softhand::soft_coupling_test {
namespace {

constexpr std::array<double, 4> kHandRates{60, 90, 240, 1000};  // Hz
constexpr std::array<double, 3> kWorldRates{60, 100, 250};

// 40 mm, 6.4 g.
SoftObject cube() {
  const HandModel mesh = testing::box_mesh({2, 2, 2}, Vector3::Constant(0.04), {});
  auto body = std::make_shared<SoftBody>();
  body->nodes = mesh.nodes;
  body->tetrahedra = mesh.tetrahedra;
  body->material.youngs_modulus = 2e4;
  body->material.poisson_ratio = 0.3;
  body->material.density = 100;
  body->material.strain_limit_energy = body->material.strain_limit_stiffness = 500;
  SoftObject result;
  result.body = body;
  return result;
}

struct Nodes {
  double time = 0;  // s
  Eigen::Matrix3Xd positions, velocities;
};

// The newest sample that is `stale` periods of its sender old.
const Nodes* newest(const std::deque<Nodes>& samples, double now, double stale) {
  const Nodes* found = nullptr;
  for (const Nodes& each : samples)
    if (each.time <= now - stale + 1e-9) found = &each;
  return found;
}

// A hand shakes its cube by +-50 mm at 3 Hz for a second, with a grip on each node of 25 Hz.
std::deque<Nodes> shaken(double rate) {
  constexpr double kAmplitude = 0.05, kPulse = 2 * M_PI * 3, kGrip = 2 * M_PI * 25;
  const SoftObject object = cube();
  const double mass = mass_of(*object.body);
  FreeSoftBody body(object, 0, {kGrip * kGrip * mass, 1});
  std::deque<Nodes> samples;
  const Eigen::Matrix3Xd rest = body.positions();
  for (double time = 1 / rate; time < 1.2; time += 1 / rate) {
    Eigen::Matrix3Xd target = rest, velocity = Eigen::Matrix3Xd::Zero(3, rest.cols());
    target.row(0).array() += kAmplitude * (1 - std::cos(kPulse * time));
    velocity.row(0).array() += kAmplitude * kPulse * std::sin(kPulse * time);
    body.pull_to(target, velocity);
    EXPECT_TRUE(body.step(1 / rate));
    samples.push_back({time, body.positions(), body.velocities()});
  }
  return samples;
}

struct Trail {
  double extrapolated = 0, spring = 0;  // m, largest distance of a node of the copy
};

// The copy either goes on with the velocities of the newest sample, or its nodes follow by the spring of follow.hpp.
// The spring is evaluated at the end of the copy's step.
Trail trail(const std::deque<Nodes>& hand, double hand_rate, double world_rate, int stale) {
  constexpr double kKappa = 0.25;
  const double beta = 2 * std::sqrt(kKappa), share = 1 / (1 + beta + kKappa), step = 1 / world_rate;
  const double most_ahead = 2 * (step + 1 / hand_rate);
  Trail result;
  Eigen::Matrix3Xd at, speed;
  for (double now = 0.2; now < 1.1; now += step) {
    const Nodes* sample = newest(hand, now, stale / hand_rate);
    if (sample == nullptr) continue;
    const Nodes& before = *newest(hand, now, 0);
    const Nodes& after = *std::ranges::find_if(hand, [now](const Nodes& each) { return each.time > now + 1e-9; });
    const double part = (now - before.time) / (after.time - before.time);
    const Eigen::Matrix3Xd truth = before.positions + part * (after.positions - before.positions);
    const Eigen::Matrix3Xd predicted =
        sample->positions + std::min(now - sample->time, most_ahead) * sample->velocities;
    if (at.size() == 0) {
      at = predicted;
      speed = sample->velocities;
    }
    speed += share * (kKappa / step * (predicted - at - step * speed) + beta * (sample->velocities - speed));
    at += step * speed;
    if (now < 0.4) continue;
    result.extrapolated = std::max(result.extrapolated, (predicted - truth).colwise().norm().maxCoeff());
    result.spring = std::max(result.spring, (at - truth).colwise().norm().maxCoeff());
  }
  return result;
}

TEST(SoftCoupling, ACopyThatGoesOnWithTheVelocitiesTrailsLeast) {
  std::printf("| hand Hz | world Hz | stale | extrapolated, mm | spring, mm |\n| --- | --- | --- | --- | --- |\n");
  for (const double hand_rate : kHandRates) {
    const std::deque<Nodes> hand = shaken(hand_rate);
    for (const double world_rate : kWorldRates) {
      for (const int stale : {0, 1, 2}) {
        const Trail of = trail(hand, hand_rate, world_rate, stale);
        std::printf("| %.0f | %.0f | %d | %.2f | %.2f |\n", hand_rate, world_rate, stale, 1e3 * of.extrapolated,
                    1e3 * of.spring);
        EXPECT_LT(of.extrapolated, of.spring);
        // a t^2/2 at the age t, and as much again for the velocity, which is the mean of a step.
        const double age = (stale + 1) / hand_rate, acceleration = 0.05 * std::pow(2 * M_PI * 3, 2);
        EXPECT_LT(of.extrapolated, acceleration * age * age + 5e-4);
      }
    }
  }
}

// Two free cubes pull each other by the spring of the text. Each knows a copy of the other that is `stale` periods of
// its sender old. At first they are 0.1 mm apart. Returns their largest distance in the last 40 of 120 periods over
// that, at most 1000.
double remaining(double stiffness_per_mass, double damping_ratio, double hand_rate, double world_rate, int stale) {
  constexpr double kStart = 1e-4, kMost = 1000;
  constexpr int kPeriods = 120;
  const SoftObject object = cube();
  struct Side {
    FreeSoftBody body;
    double rate, next;
    std::deque<Nodes> samples;
  };
  const NodeSpring spring{stiffness_per_mass * mass_of(*object.body), damping_ratio};
  std::array<Side, 2> sides{Side{FreeSoftBody(object, 0, spring), hand_rate, 1 / hand_rate, {}},
                            Side{FreeSoftBody(object, 0, spring), world_rate, 1 / world_rate, {}}};
  const Eigen::Matrix3Xd rest = sides[0].body.positions();
  Eigen::Matrix3Xd moved = rest;
  moved.row(0).array() += kStart;
  sides[0].body.start(moved, Eigen::Matrix3Xd::Zero(3, rest.cols()));
  for (Side& side : sides) side.samples.push_back({0, side.body.positions(), side.body.velocities()});
  const double end = kPeriods * std::max(1 / hand_rate, 1 / world_rate);
  double largest = 0;
  while (std::min(sides[0].next, sides[1].next) < end) {
    const std::size_t now = sides[0].next <= sides[1].next + 1e-9 ? 0 : 1;
    Side &own = sides[now], &other = sides[1 - now];
    const double time = own.next;
    if (const Nodes* sample = newest(other.samples, time, stale / other.rate))
      own.body.pull_to(sample->positions, sample->velocities);
    if (!own.body.step(1 / own.rate)) return kMost;
    own.samples.push_back({time, own.body.positions(), own.body.velocities()});
    if (own.samples.size() > 100) own.samples.pop_front();
    own.next += 1 / own.rate;
    const double distance = (own.body.positions() - other.body.positions()).colwise().norm().maxCoeff();
    if (distance > kMost * kStart) return kMost;
    if (time > 2 * end / 3) largest = std::max(largest, distance);
  }
  return largest / kStart;
}

// The law of a point mass (`symmetric_growth`) tells where the springs between two cubes grow.
TEST(SoftCoupling, TheSpringOnBothSidesGrowsWhereThatOfAPointMassDoes) {
  std::printf(
      "| hand Hz | world Hz | k T^2/m | damping ratio | point mass: growth per period | cube, 0 | 1 | 2 periods old |\n"
      "| --- | --- | --- | --- | --- | --- | --- | --- |\n");
  for (const auto& [hand_rate, world_rate] : {std::pair{60.0, 60.0}, {90.0, 250.0}, {240.0, 100.0}, {1000.0, 250.0}}) {
    for (const double kappa : {0.01, 0.1, 1.0}) {
      for (const double damping : {0.0, 1.0}) {
        const double period = std::max(1 / hand_rate, 1 / world_rate), per_mass = kappa / (period * period);
        const double point = symmetric_growth(per_mass, damping, 1 / world_rate, 1 / hand_rate);
        std::array<double, 3> cubes{};
        for (const int stale : {0, 1, 2})
          cubes[static_cast<std::size_t>(stale)] = remaining(per_mass, damping, hand_rate, world_rate, stale);
        std::printf("| %.0f | %.0f | %.2f | %.0f | %.3f | %.2g | %.2g | %.2g |\n", hand_rate, world_rate, kappa,
                    damping, point, cubes[0], cubes[1], cubes[2]);
        // Equal rates in phase do not excite the mode that grows most. A soft spring does not decide in 120 periods.
        if (point > 1.03 && hand_rate != world_rate) {
          EXPECT_GT(cubes[2], 2);
        }
        if (point <= 1 + 1e-5 && kappa > 0.05) {
          EXPECT_LT(cubes[2], 1);
        }
      }
    }
  }
}

}  // namespace
}  // namespace softhand::soft_coupling_test
