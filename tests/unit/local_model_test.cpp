// The force of a haptic device between two messages, and its passivity.
#include "device/local_model.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "device/bone_contacts.hpp"
#include "device/device_loop.hpp"
#include "messages/convert.hpp"
#include "support/count_allocations.hpp"

namespace softhand::local_model_test {
namespace {

constexpr Nanoseconds kMillisecond = 1'000'000, kStart = 5'000'000'000;
constexpr std::size_t kBone = 7;

// A grounded device with three motors on one bone.
class Grounded : public HapticDriver {
 public:
  DeviceLimits limits() const override { return {3, -100, 100, 1e6, stiffness, damping, is_worn}; }
  void command(const BoneWrench& input, std::span<double> requested) override {
    for (std::size_t i = 0; i < 3; ++i) requested[i] += input.bones[kBone].coupling_force[i];
  }
  bool measure(Nanoseconds, std::span<double> positions) override {
    std::copy(position.begin(), position.end(), positions.begin());
    return measures;
  }
  void write(Nanoseconds, std::span<const double> commands) override {
    std::copy(commands.begin(), commands.end(), force.begin());
  }

  double stiffness = 5000, damping = 30;
  bool measures = true, is_worn = false;
  Vec3 position{}, force{};
};

BoneWrench touching(const Vector3& force, const Vector3& normal, double stiffness, double damping = 0) {
  BoneWrench w;
  w.simulated_valid = 1;
  w.stamp.sequence = 1;
  w.stamp.epoch = 1;
  w.stamp.sample_time = kStart;
  BoneSample& bone = w.bones[kBone];
  bone.coupling_force = to_wire(force);
  bone.contact_normal = to_wire(normal);
  bone.contact_stiffness = stiffness;
  bone.contact_damping = damping;
  return w;
}

// Commands at `position`, if the device was at 0 when the message was true, and stood still before and after.
Vector3 commands_at(const Vector3& position, const BoneWrench& wrench, Grounded& device) {
  DeviceMotion motion(3);
  LocalModel model(device.limits());
  motion.add(kStart - kMillisecond, Vec3{});
  motion.add(kStart, Vec3{});
  motion.add(kStart + 5 * kMillisecond, to_wire(position));
  motion.add(kStart + 10 * kMillisecond, to_wire(position));
  model.take(wrench, motion, device);
  ActuatorValues out{};
  model.evaluate(kStart, motion, {out.data(), 3});
  return {out[0], out[1], out[2]};
}

TEST(LocalModel, FollowsThePlaneAlongItsNormalAndHoldsTheRest) {
  Grounded device;
  const Vector3 normal = Vector3(1, 2, 2) / 3, side = Vector3(2, 1, -2) / 3;
  const BoneWrench w = touching(4 * normal + 0.7 * side, normal, 1000);
  const auto expect = [&](const Vector3& at, double along) {
    EXPECT_LT((commands_at(at, w, device) - (along * normal + 0.7 * side)).norm(), 1e-12) << at.transpose();
  };
  expect(Vector3::Zero(), 4);
  expect(-0.002 * normal, 6);
  expect(0.003 * normal, 1);
  expect(0.01 * side, 4);
  expect(0.004 * normal, 0);
  expect(0.05 * normal, 0);  // a wall does not pull
}

TEST(LocalModel, PlaneThatIsNearPushesOnceItIsReached) {
  Grounded device;
  device.stiffness = 500;
  BoneWrench w = touching({0.3, 0, 0.2}, {1, 0, 0}, 1000);
  for (const double gap : {0.004, -0.001}) {
    w.bones[kBone].contact_gap = gap;
    for (const double x : {0.01, -0.003, -0.005, -0.006}) {
      // The force of the coupling is held. The device renders half of the stiffness, and the gap stays.
      const double expected = 0.3 + std::max(0.0, 500 * (-x - gap));
      EXPECT_LT((commands_at({x, 0, 0}, w, device) - Vector3(expected, 0, 0.2)).norm(), 1e-12) << gap << ' ' << x;
    }
  }
}

TEST(LocalModel, AgeOfAMessageDoesNotMoveThePlane) {
  Grounded device;
  for (const int age : {0, 7, 15, 40}) {
    // A wall at 0, and a device that moves into it at 0.1 m/s. The message says what was true `age` ms ago.
    const auto position = [](int milliseconds) { return -0.006 - 1e-4 * milliseconds; };
    DeviceMotion motion(3);
    for (int i = -50; i <= 0; ++i) motion.add(kStart + i * kMillisecond, Vec3{position(i), 0, 0});
    BoneWrench w = touching({-1000 * position(-age), 0, 0}, {1, 0, 0}, 1000);
    w.stamp.sample_time = kStart - age * kMillisecond;
    LocalModel model(device.limits());
    model.take(w, motion, device);
    ActuatorValues out{};
    model.evaluate(kStart, motion, {out.data(), 3});
    EXPECT_NEAR(out[0], -1000 * position(0), 1e-9) << age;
  }
}

TEST(LocalModel, DampingResistsTheMeasuredMotion) {
  Grounded device;
  DeviceMotion motion(3);
  for (int i = -20; i <= 0; ++i)
    motion.add(kStart + i * kMillisecond, Vec3{-1e-4 * i, 0, 0});  // -0.1 m/s: into the wall
  LocalModel model(device.limits());
  model.take(touching({2, 0, 0}, {1, 0, 0}, 0, 8), motion, device);
  ActuatorValues out{};
  model.evaluate(kStart, motion, {out.data(), 3});
  EXPECT_NEAR(out[0], 2 + 8 * 0.1, 1e-9);
}

// A wall that moves against a device at rest, between two messages.
TEST(LocalModel, PlaneMovesWithTheTouchedSurface) {
  const Vector3 normal = Vector3(1, 2, 2) / 3, side = Vector3(2, 1, -2) / 3;
  for (const bool is_worn : {false, true}) {
    Grounded device;
    device.is_worn = is_worn;
    DeviceMotion motion(3);
    motion.add(kStart - 5 * kMillisecond, Vec3{});
    motion.add(kStart, Vec3{});
    BoneWrench w = touching(2 * normal + 0.5 * side, normal, 500, 4);
    BoneSample& bone = w.bones[kBone];
    bone.contact_velocity = to_wire(Vector3(0.3 * normal + 2 * side));
    bone.contact_point = {0.1, 0, 0};
    w.wrist_velocity = to_wire(Vector3(0.2 * normal));
    w.wrist_angular_velocity = {0, 0, -1};
    // A glove is carried by the hand, so only the motion against the hand counts.
    const double carried = (0.2 * normal + Vector3(0, 0, -1).cross(Vector3(0.1, 0, 0))).dot(normal);
    const double speed = is_worn ? 0.3 - carried : 0.3;
    LocalModel model(device.limits());
    model.take(w, motion, device);
    for (const int age : {0, 11, 25, 50, 100}) {
      ActuatorValues out{};
      model.evaluate(kStart + age * kMillisecond, motion, {out.data(), 3});
      const double along = 2 + 500 * speed * 1e-3 * std::min(age, 50) + 4 * speed;
      EXPECT_LT((Vector3(out[0], out[1], out[2]) - along * normal - 0.5 * side).norm(), 1e-12) << age;
      EXPECT_NEAR(model.power(), is_worn ? 0 : along * speed, 1e-12);
    }
  }
}

TEST(LocalModel, GainsStayWithinThoseOfTheDevice) {
  Grounded device;
  device.stiffness = 400;
  EXPECT_NEAR(commands_at({-0.002, 0, 0}, touching({1, 0, 0}, {1, 0, 0}, 1e5), device).x(), 1 + 400 * 0.002, 1e-9);
  // No direction is stiffer than the device allows, also for an oblique plane.
  const Vector3 normal = Vector3(1, 1, 0).normalized();
  const Vector3 more = commands_at(-0.002 * normal, touching(normal, normal, 1e5), device) - normal;
  EXPECT_GT(more.norm(), 0.3 * 400 * 0.002);
  EXPECT_LE(more.norm(), 400 * 0.002 + 1e-12);
  device.stiffness = 0;
  EXPECT_EQ(commands_at({-0.002, 0, 0}, touching({1, 0, 0}, {1, 0, 0}, 500), device), Vector3(1, 0, 0));
}

TEST(LocalModel, RefusesAndCountsImplausiblePlanesAndHoldsTheirForce) {
  Grounded device;
  const double nan = std::nan("");
  const std::vector<std::function<void(BoneSample&)>> faults{
      [&](BoneSample& b) { b.contact_stiffness = nan; },
      [&](BoneSample& b) { b.contact_stiffness = -1; },
      [&](BoneSample& b) { b.contact_stiffness = 2 * kMaxContactStiffness; },
      [&](BoneSample& b) { b.contact_damping = nan; },
      [&](BoneSample& b) { b.contact_damping = -1; },
      [&](BoneSample& b) { b.contact_damping = std::numeric_limits<double>::infinity(); },
      [&](BoneSample& b) { b.contact_gap = nan; },
      [&](BoneSample& b) { b.contact_gap = -2 * kMaxContactGap; },
      [&](BoneSample& b) { b.contact_normal = {}; },
      [&](BoneSample& b) {
        b.contact_velocity = {nan, 0, 0};
      },
      [&](BoneSample& b) {
        b.contact_velocity = {0, 2 * kMaxContactSpeed, 0};
      },
      [&](BoneSample& b) {
        b.contact_normal = {0.9, 0, 0};
      },
      [&](BoneSample& b) {
        b.contact_normal = {1, 0, nan};
      },
      [&](BoneSample& b) {
        b.contact_point = {0, 1.1, 0};
      },
      [&](BoneSample& b) {
        b.contact_point = {nan, 0, 0};
      },
  };
  DeviceMotion motion(3);
  motion.add(kStart, Vec3{});
  LocalModel model(device.limits());
  std::uint64_t refused = 0;
  for (const auto& fault : faults) {
    BoneWrench w = touching({3, 0, 1}, {1, 0, 0}, 500);
    fault(w.bones[kBone]);
    model.take(w, motion, device);
    EXPECT_EQ(model.refused(), ++refused);
    EXPECT_EQ(model.planes(), 0u);
    ActuatorValues out{};
    model.evaluate(kStart, motion, {out.data(), 3});
    EXPECT_EQ(out[0], 3) << refused;
    EXPECT_EQ(out[2], 1) << refused;
  }
  model.take(touching({3, 0, 1}, {1, 0, 0}, 500), motion, device);
  EXPECT_EQ(model.planes(), 1u);
  EXPECT_EQ(model.refused(), refused);
}

TEST(DeviceMotion, InterpolatesAndForgetsJumps) {
  DeviceMotion motion(1);
  for (int i = 0; i <= 100; ++i) EXPECT_TRUE(motion.add(kStart + i * kMillisecond, std::array{1e-3 * i}));
  EXPECT_NEAR(motion.at(kStart + 77'500'000)[0], 0.0775, 1e-12);
  EXPECT_NEAR(motion.at(kStart)[0], 0.037, 1e-12);  // the oldest of 64 samples
  EXPECT_NEAR(motion.at(kStart + 500 * kMillisecond)[0], 0.1, 1e-12);
  EXPECT_NEAR(motion.velocities()[0], 1, 1e-9);
  EXPECT_NEAR(motion.step()[0], 1e-3, 1e-12);
  EXPECT_FALSE(motion.add(kStart + 100 * kMillisecond, std::array{0.1}));  // not newer
  EXPECT_TRUE(motion.add(kStart + 101 * kMillisecond, std::array{0.1}));
  EXPECT_FALSE(motion.add(kStart + 102 * kMillisecond, std::array{0.3}));
  EXPECT_TRUE(motion.empty());
  EXPECT_FALSE(motion.add(kStart + 103 * kMillisecond, std::array{std::nan("")}));
  EXPECT_TRUE(motion.add(kStart + 104 * kMillisecond, std::array{0.3}));
  EXPECT_EQ(motion.step()[0], 0);
  EXPECT_EQ(motion.velocities()[0], 0);
}

// A user swings by 10 mm to each side at 2 Hz against `force(x, v)`. The device holds each force for a millisecond.
const PassivityControl& swing(DeviceLoop<BoneWrench>& loop, Grounded& device, int milliseconds,
                              const std::function<double(double, double)>& force) {
  const double w = 4 * M_PI;
  for (int i = 0; i < milliseconds; ++i) {
    const double t = 1e-3 * i, x = 0.01 * std::sin(w * t), v = 0.01 * w * std::cos(w * t);
    BoneWrench input = touching({force(x, v), 0, 0}, {0, 0, 0}, 0);
    input.stamp.sequence = static_cast<std::uint64_t>(i) + 1;
    input.stamp.sample_time = input.stamp.publish_time = kStart + i * kMillisecond;
    device.position[0] = x;
    loop.step(kStart + i * kMillisecond, &input);
  }
  return loop.feedback().passivity();
}

struct Rig {
  std::shared_ptr<Grounded> device = std::make_shared<Grounded>();
  DeviceLoop<BoneWrench> loop{DeviceLoopOptions{}, device, 1, 0};
};

TEST(Passivity, UserPutsTheDissipatedEnergyIntoADamper) {
  Rig rig;
  // b v^2 over whole periods: 5 N s/m x 1/2 x (0.1257 m/s)^2 x 2 s.
  const double expected = 5 * 0.5 * std::pow(0.04 * M_PI, 2) * 2;
  EXPECT_NEAR(swing(rig.loop, *rig.device, 2001, [](double, double v) { return -5 * v; }).energy(), expected, 1e-3);
  LoopStatus status;
  rig.loop.fill_status(status, kStart);
  EXPECT_EQ(status.passivity_energy, rig.loop.feedback().passivity().energy());
}

TEST(Passivity, ControllerStopsADelayedSpringFromGivingEnergy) {
  // f = -k x(t - age) gives back k pi X^2 sin(w age) in each period. A force that is held for a millisecond is half a
  // millisecond old on average.
  const double w = 4 * M_PI, delay = 0.02;
  Rig rig;
  const PassivityControl& passivity = swing(rig.loop, *rig.device, 2001, [&](double x, double v) {
    return -200 * (x * std::cos(w * delay) - v / w * std::sin(w * delay));
  });
  const double expected = -4 * 200 * M_PI * 1e-4 * std::sin(w * (delay + 0.5e-3));
  EXPECT_NEAR(passivity.energy_without_control(), expected, -1e-3 * expected);
  EXPECT_GE(passivity.lowest_energy(), -1e-3);
  EXPECT_GT(passivity.interventions(), 100u);
}

TEST(Passivity, ControllerLeavesAPassiveSpringAlone) {
  Rig rig;
  // The user begins in the middle, and a spring that is a little damped never gives more than it got.
  const PassivityControl& passivity =
      swing(rig.loop, *rig.device, 2001, [](double x, double v) { return -200 * x - 2 * v; });
  EXPECT_EQ(passivity.interventions(), 0u);
  EXPECT_EQ(passivity.energy(), passivity.energy_without_control());
}

TEST(Passivity, ConstantPushEndsWhereItsEnergyEnds) {
  Rig rig;
  BoneWrench input = touching({3, 0, 0}, {0, 0, 0}, 0);
  for (int i = 0; i < 500; ++i) {
    ++input.stamp.sequence;
    input.stamp.sample_time = input.stamp.publish_time = kStart + i * kMillisecond;
    rig.device->position[0] = 1e-4 * i;  // the device carries the user 50 mm away
    rig.loop.step(kStart + i * kMillisecond, &input);
  }
  EXPECT_GE(rig.loop.feedback().passivity().lowest_energy(), -1e-3);
  EXPECT_NEAR(rig.loop.feedback().passivity().energy_without_control(), -3 * 0.05, 0.01);
  EXPECT_LT(rig.device->force[0], 0.1);
}

// A conveyor carries the user at 0.2 m/s. Its energy is not that of the device.
TEST(Passivity, MovingSurfaceMayGiveEnergy) {
  for (const bool says_so : {true, false}) {
    Rig rig;
    for (int i = 0; i < 500; ++i) {
      const double wall = 2e-4 * i;
      rig.device->position[0] = wall - 0.004;
      if (i % 11 != 0) {
        rig.loop.step(kStart + i * kMillisecond, nullptr);
        continue;
      }
      BoneWrench input = touching({2, 0, 0}, {1, 0, 0}, 500);
      if (says_so) input.bones[kBone].contact_velocity = {0.2, 0, 0};
      input.stamp.sequence = static_cast<std::uint64_t>(i) + 1;
      input.stamp.sample_time = input.stamp.publish_time = kStart + i * kMillisecond;
      rig.loop.step(kStart + i * kMillisecond, &input);
      if (i < 100) continue;
      const PassivityControl& passivity = rig.loop.feedback().passivity();
      if (says_so) {
        EXPECT_NEAR(rig.device->force[0], 2, 1e-6) << i;
        EXPECT_LE(passivity.interventions(), 1u);  // in the first step, when the motion is not known yet
        EXPECT_NEAR(passivity.energy(), 0, 1e-3);
      } else {
        EXPECT_GT(passivity.interventions(), 10u);
      }
    }
  }
}

TEST(Passivity, CommandsStayWithinTheLimitsOfTheDevice) {
  struct Brake final : Grounded {
    DeviceLimits limits() const override { return {3, 0, 2, 1e6, stiffness, damping}; }
  };
  const auto device = std::make_shared<Brake>();
  DeviceLoop<BoneWrench> loop{DeviceLoopOptions{}, device, 1, 0};
  for (int i = 0; i < 300; ++i) {
    BoneWrench input = touching({50, -50, 50}, {0, 0, 0}, 0);
    input.stamp.sequence = static_cast<std::uint64_t>(i) + 1;
    input.stamp.sample_time = input.stamp.publish_time = kStart + i * kMillisecond;
    for (std::size_t k = 0; k < 3; ++k) device->position[k] = 0.02 * std::sin(0.03 * i + static_cast<double>(k));
    loop.step(kStart + i * kMillisecond, &input);
    for (const double force : device->force) {
      ASSERT_GE(force, 0);
      ASSERT_LE(force, 2);
    }
  }
  EXPECT_GE(loop.feedback().passivity().lowest_energy(), -1e-3);
}

// The controller adds damping at once. A force that jumps hurts, so its rise is limited like that of every force.
TEST(Passivity, ControlledForcesRiseNoFasterThanTheSlewLimit) {
  struct Slow final : Grounded {
    DeviceLimits limits() const override { return {3, -100, 100, 400, stiffness, damping}; }
    void write(Nanoseconds now, std::span<const double> commands) override {
      const double last = force[0];
      Grounded::write(now, commands);
      fastest = std::max(fastest, force[0] * last < 0 ? std::abs(force[0]) : std::abs(force[0]) - std::abs(last));
    }
    double fastest = 0;  // N per step, away from zero
  };
  const auto device = std::make_shared<Slow>();
  DeviceLoop<BoneWrench> loop{DeviceLoopOptions{}, device, 1, 0};
  BoneWrench input = touching({20, 0, 0}, {0, 0, 0}, 0);
  for (int i = 0; i < 250; ++i) {
    ++input.stamp.sequence;
    input.stamp.sample_time = input.stamp.publish_time = kStart + i * kMillisecond;
    device->position[0] = i < 200 ? 0 : 5e-4 * (i - 200);  // the user suddenly gives way
    loop.step(kStart + i * kMillisecond, &input);
  }
  const PassivityControl& passivity = loop.feedback().passivity();
  EXPECT_GT(passivity.interventions(), 10u);
  EXPECT_LE(device->fastest, 0.4 + 1e-9);
}

TEST(Passivity, SensorsThatJumpOrFailDoNoWork) {
  Rig rig;
  BoneWrench input = touching({3, 0, 0}, {0, 0, 0}, 0);
  int i = 0;
  const auto step = [&](double position, bool measures) {
    ++input.stamp.sequence;
    input.stamp.sample_time = input.stamp.publish_time = kStart + i * kMillisecond;
    rig.device->position[0] = position;
    rig.device->measures = measures;
    rig.loop.step(kStart + i++ * kMillisecond, &input);
  };
  step(0, true);
  step(0, true);
  step(1, true);
  step(1, true);
  step(std::nan(""), true);
  step(1.05, true);
  step(0, false);
  step(1.1, true);
  EXPECT_EQ(rig.loop.feedback().passivity().energy(), 0);
  LoopStatus status;
  rig.loop.fill_status(status, kStart);
  double refused = 0;
  for (const NamedValue& counter : status.counters)
    if (get_text(counter.name) == "refused_motion") refused = counter.value;
  EXPECT_EQ(refused, 2);
}

TEST(Passivity, StepsDoNotAllocate) {
  Rig rig;
  BoneWrench input = touching({3, 0, 0}, {1, 0, 0}, 800, 2);
  const long before = allocations;
  counting = true;
  for (int i = 0; i < 200; ++i) {
    ++input.stamp.sequence;
    input.stamp.sample_time = input.stamp.publish_time = kStart + i * kMillisecond;
    rig.device->position[0] = 1e-3 * std::sin(0.1 * i);
    rig.loop.step(kStart + i * kMillisecond, &input);
  }
  counting = false;
  EXPECT_EQ(allocations, before);
}

Contact contact(Body body, const Vector3& force, const Vector3& normal, const Vector3& point) {
  Contact c;
  c.body = static_cast<std::uint32_t>(index_of(body));
  c.force = to_wire(force);
  c.normal = to_wire(normal);
  c.point = to_wire(point);
  return c;
}

TEST(BoneContacts, MakeOnePlanePerBone) {
  const auto contacts = std::make_unique<Contacts>();
  const Vector3 up = Vector3::UnitY();
  contacts->contacts.push_back(contact(Body::index_distal, {0.2, 1, 0}, up, {0, 0, 0}));
  contacts->contacts.push_back(contact(Body::index_distal, {0, 3, 0}, up, {0.004, 0, 0}));
  contacts->contacts[0].velocity = {0, 0, 4};
  contacts->contacts.push_back(contact(Body::thumb_distal, {0, 1, 0}, up, {0, 0, 0}));
  contacts->contacts.push_back(contact(Body::thumb_distal, {0, -1, 0}, -up, {0, 0.02, 0}));  // between two walls
  contacts->contacts.push_back(contact(Body::ring_distal, {0, std::nan(""), 0}, up, {0, 0, 0}));
  NearContact near;
  near.normal = to_wire(up);
  near.gap = 0.004;
  near.velocity = {0, 0.1, 0};
  for (const Body body : {Body::middle_distal, Body::index_distal}) {
    near.body = static_cast<std::uint32_t>(index_of(body));
    contacts->near.push_back(near);
  }
  const BoneContacts sums = sum_contacts(*contacts);
  const BoneCoupling coupling{800, 5, 0.004};
  const auto model_of = [&](Body body, const Vector3& force, double stretch, const Vector3& moved = Vector3::Zero(),
                            double age = 0) {
    BoneSample bone;
    bone.coupling_force = to_wire(force);
    write_local_model(sums[static_cast<std::size_t>(index_of(body))], coupling, stretch, moved, age, bone);
    return bone;
  };
  const BoneSample index = model_of(Body::index_distal, {0, 2, 0}, 0.0025);
  EXPECT_LT((to_vector(index.contact_normal) - up).norm(), 1e-12);
  EXPECT_LT((to_vector(index.contact_point) - Vector3(0.003, 0, 0)).norm(), 1e-12);
  EXPECT_NEAR(index.contact_stiffness, 800, 1e-9);
  EXPECT_NEAR(index.contact_damping, 2 * std::sqrt(800 * 0.004), 1e-9);
  EXPECT_NEAR(model_of(Body::index_distal, {0, 5, 0}, 0.02).contact_stiffness, 5 / 0.02, 1e-9);  // at the cap
  EXPECT_EQ(model_of(Body::index_distal, {0, -2, 0}, 0.0025).contact_stiffness, 0);              // the coupling pulls
  EXPECT_EQ(model_of(Body::thumb_distal, {0, 2, 0}, 0.0025).contact_stiffness, 0);
  EXPECT_EQ(model_of(Body::ring_distal, {0, 2, 0}, 0.0025).contact_stiffness, 0);
  EXPECT_EQ(model_of(Body::little_distal, {0, 2, 0}, 0.0025).contact_normal, Vec3{});
  EXPECT_EQ(index.contact_gap, 0);
  EXPECT_LT((to_vector(index.contact_velocity) - Vector3(0, 0, 1)).norm(), 1e-12);  // weighted with 1 N and 3 N
  // Near an object: the gap shrinks while the user moves on.
  const BoneSample little = model_of(Body::middle_distal, {0, -0.1, 0}, 1e-4, {0.5, -0.003, 0});
  EXPECT_NEAR(little.contact_gap, 0.001, 1e-12);
  EXPECT_EQ(little.contact_stiffness, 800);
  EXPECT_NEAR(model_of(Body::middle_distal, Vector3::Zero(), 0, {0, -0.006, 0}).contact_gap, -0.002, 1e-12);
  EXPECT_EQ(model_of(Body::middle_distal, Vector3::Zero(), 0, {0, 0.2, 0}).contact_stiffness, 0);
  // The gap shrinks too while the object comes.
  const BoneSample coming = model_of(Body::middle_distal, Vector3::Zero(), 0, {0, -0.001, 0}, 0.02);
  EXPECT_NEAR(coming.contact_gap, 0.001, 1e-12);
  EXPECT_EQ(coming.contact_velocity, (Vec3{0, 0.1, 0}));
}

}  // namespace
}  // namespace softhand::local_model_test
