// The traction on the skin: its forces are those of the contacts, and slip and area are those of the motion.
#include "scene/skin_traction.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>

#include "geometry/shape.hpp"
#include "messages/convert.hpp"
#include "support/count_allocations.hpp"
#include "support/soft_bodies.hpp"
#include "trackers/replay/generator.hpp"
#include "unit/hand_simulation_rig.hpp"

namespace softhand::skin_traction_test {
namespace {

using testing::kStep;

const HandModel& model() {
  static const HandModel hand = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  return hand;
}

// A hand, its traction after each step, and sums over its regions in world axes.
struct Rig {
  explicit Rig(int slots = 1, std::vector<SoftObject> soft_objects = {})
      : simulation(model(), options(), slots, 0, {}, 0, std::move(soft_objects)), report(model()) {}
  static SimulationOptions options() {
    SimulationOptions options;
    options.skin_contact = true;
    return options;
  }

  void aim(const Vector3& place) { testing::set_rest_targets(simulation, {place, Quaternion::Identity()}); }
  void step() {
    ASSERT_TRUE(simulation.step(kStep).state_changed);
    simulation.write_traction(kStep, report, *traction);
    area_by_rate += kStep * area_rate();
  }
  void run(int steps) {
    for (int i = 0; i < steps; ++i) step();
  }
  Quaternion axes(const SkinRegion& region) const {
    return simulation.joint_pose(joint_of(static_cast<Body>(region.body))).orientation;
  }
  Vector3 force(const SkinRegion& region) const {
    return axes(region) * (region.area * (to_vector(region.shear) - region.pressure * to_vector(region.normal)));
  }
  Vector3 force() const {
    Vector3 sum = Vector3::Zero();
    for (const SkinRegion& region : traction->regions) sum += force(region);
    return sum;
  }
  double area() const {
    double sum = 0;
    for (const SkinRegion& region : traction->regions) sum += region.area;
    return sum;
  }
  double area_rate() const {
    double sum = 0;
    for (const SkinRegion& region : traction->regions) sum += region.area_rate;
    return sum;
  }

  HandSimulation simulation;
  SkinTractionReport report;
  std::unique_ptr<SkinTraction> traction = std::make_unique<SkinTraction>();
  double area_by_rate = 0;  // m^2, of the rates of all steps
};

// A plate under the fingertips of the hand, which is 7 mm above it at rest.
struct OnAPlate : Rig {
  OnAPlate() {
    simulation.set_slot(0, {.id = 7, .shape = &plate, .friction = 0.5});
    simulation.set_slot_motion(0, {{0, lowest_skin() - 0.007 - 0.02, -0.1}, Quaternion::Identity()}, {});
    aim(Vector3::Zero());
  }
  static double lowest_skin() {
    double lowest = 0;
    for (const SkinPoint& point : model().contact_points) lowest = std::min(lowest, model().position_of(point).y());
    return lowest;
  }
  void press() { aim({0, -0.012, 0}); }
  void slide(const Vector3& velocity) { simulation.set_slot_motion(0, simulation.slot_pose(0), {velocity, {0, 0, 0}}); }

  ShapeGeometry plate{testing::box_shape({0.3, 0.02, 0.3})};
};

TEST(SkinTraction, ForcesAreThoseOfTheContacts) {
  OnAPlate rig;
  const auto contacts = std::make_unique<Contacts>();
  rig.press();
  double largest = 0;
  for (int i = 0; i < 90; ++i) {
    if (i == 45) rig.slide({0.05, 0, 0.02});
    rig.step();
    rig.simulation.write_contacts(*contacts);
    ASSERT_EQ(contacts->dropped, 0u);
    std::array<Vector3, kBodyCount> missing;
    missing.fill(Vector3::Zero());
    double size = 0, area = 0;
    for (const Contact& contact : contacts->contacts) {
      missing[contact.body] += softhand::to_vector(contact.force);
      size += softhand::to_vector(contact.force).norm();
      if (contact.force != Vec3{}) area += contact.area;
    }
    for (const SkinRegion& region : rig.traction->regions) missing[region.body] -= rig.force(region);
    for (const Vector3& each : missing) ASSERT_LE(each.norm(), 1e-5 * size) << i;
    ASSERT_NEAR(rig.area(), area, 1e-5 * area) << i;
    largest = std::max(largest, size);
  }
  EXPECT_GT(largest, 1) << "the hand must press";
  for (const SkinRegion& region : rig.traction->regions) {
    const SkinPoint& point = model().contact_points[region.region];
    const Pose& joint = model().rest_joints[testing::index(joint_of(static_cast<Body>(point.body)))];
    EXPECT_EQ(region.body, point.body);
    EXPECT_LE((joint * to_vector(region.place) - model().position_of(point)).norm(), 1e-7);
    if (region.area == 0) continue;
    EXPECT_EQ(region.object, 7u);
    EXPECT_GT(region.pressure, 0);
    EXPECT_LE((rig.axes(region) * to_vector(region.normal) + Vector3::UnitY()).norm(), 1e-5) << "the plate is below";
    EXPECT_LE(std::abs(to_vector(region.shear).dot(to_vector(region.normal))), 1e-4 * region.pressure);
  }
}

TEST(SkinTraction, SlipIsTheMotionOfTheSkinOverTheObject) {
  OnAPlate rig;
  rig.press();
  rig.run(45);
  const Vector3 velocity(0.05, 0, 0);
  rig.slide(velocity);
  rig.run(45);
  Vector3 slip = Vector3::Zero(), shear = Vector3::Zero();
  double weight = 0;
  for (const SkinRegion& region : rig.traction->regions) {
    slip += region.area * region.pressure * (rig.axes(region) * to_vector(region.slip_velocity));
    shear += region.area * (rig.axes(region) * to_vector(region.shear));
    weight += region.area * region.pressure;
  }
  ASSERT_GT(weight, 1) << "N";
  EXPECT_LE((slip / weight + velocity).norm(), 0.1 * velocity.norm()) << slip / weight;
  EXPECT_NEAR(shear.x() / weight, 0.5, 0.05) << "Coulomb's friction";
}

TEST(SkinTraction, RatesAreTheChangeOfTheArea) {
  OnAPlate rig;
  rig.run(5);
  EXPECT_TRUE(rig.traction->regions.empty());
  rig.press();
  rig.run(1);
  double fastest = 0;
  for (int i = 0; i < 90; ++i) {
    rig.step();
    fastest = std::max(fastest, rig.area_rate());
  }
  ASSERT_GT(rig.area(), 2e-5);
  EXPECT_GT(fastest, rig.area()) << "m^2/s; the touch takes less than a second";
  EXPECT_NEAR(rig.area_by_rate, rig.area(), 0.1 * rig.area());
  rig.aim(Vector3::Zero());
  for (int i = 0; i < 20 && rig.area() > 0; ++i) rig.step();
  EXPECT_EQ(rig.area(), 0);
  EXPECT_LT(rig.area_rate(), 0);
  for (const SkinRegion& region : rig.traction->regions) {
    EXPECT_EQ(region.pressure, 0);
    EXPECT_EQ(region.shear, (std::array<float, 3>{}));
    EXPECT_EQ(region.normal, (std::array<float, 3>{}));
  }
  rig.run(60);
  EXPECT_TRUE(rig.traction->regions.empty()) << "the end of a contact is forgotten";
  EXPECT_LE(std::abs(rig.area_by_rate), 2e-6);
}

// Nobody listened for a while: what touches then did not begin to touch now.
TEST(SkinTraction, AFirstMessageHasNoRates) {
  OnAPlate rig;
  rig.press();
  rig.run(45);
  rig.report.forget();
  rig.step();
  EXPECT_GT(rig.area(), 2e-5);
  EXPECT_LE(std::abs(rig.area_rate()), 0.1 * rig.area());
}

// A corner of a cube enters the pad of the little finger between its contact points.
TEST(SkinTraction, ACornerPressesTheNearestRegions) {
  Rig rig;
  constexpr double kHalf = 0.006;
  const ShapeGeometry cube(testing::cube_shape(kHalf));
  rig.aim(Vector3::Zero());
  const Pose& joint = model().rest_joints[testing::index(Joint::little_distal)];
  const Vector3 in = joint.orientation * Vector3::UnitY();
  const Vector3 corner = joint * Vector3(0, -0.010, -0.009), diagonal = Vector3::Ones().normalized();
  const Quaternion turn = Quaternion::FromTwoVectors(diagonal, in);
  rig.simulation.set_slot(0, {.id = 3, .shape = &cube, .friction = 0.5});
  rig.simulation.set_slot_motion(0, {corner - std::sqrt(3) * kHalf * in, turn}, {0.02 * in, {0, 0, 0}});
  const auto contacts = std::make_unique<Contacts>();
  bool is_sharp = false;
  for (int i = 0; i < 30; ++i) {
    rig.step();
    rig.simulation.write_contacts(*contacts);
    Vector3 sum = Vector3::Zero();
    double size = 0;
    for (const Contact& contact : contacts->contacts) {
      sum += softhand::to_vector(contact.force);
      size += softhand::to_vector(contact.force).norm();
      is_sharp = is_sharp || (contact.area == ContactPoints::triangle_point_area && contact.force != Vec3{});
    }
    ASSERT_LE((rig.force() - sum).norm(), 1e-5 * size) << i;
    for (const SkinRegion& region : rig.traction->regions)
      EXPECT_EQ(region.body, static_cast<std::uint32_t>(index_of(Body::little_distal)));
  }
  EXPECT_TRUE(is_sharp) << "a sharp point must touch";
}

TEST(SkinTraction, SkinPressesSkinFromBothSides) {
  GeneratorOptions options;
  options.motion = "fist";
  options.object_position = {0, 0, 0};
  const std::unique_ptr<Motion> fist = make_motion(model(), options);
  Rig rig(0);
  for (double time = 0; time < 2; time += kStep) {
    const JointFrames frames = fist->at(time);
    for (int b = 0; b < kBodyCount; ++b) {
      const Body body = static_cast<Body>(b);
      rig.simulation.set_target(body, frames[testing::index(joint_of(body))], {});
    }
    rig.step();
  }
  double size = 0;
  std::array<double, 2> of_parts{};  // digits, palm
  for (const SkinRegion& region : rig.traction->regions) {
    const double press = region.area * region.pressure;
    size += press;
    const Body body = static_cast<Body>(region.body);
    of_parts[is_metacarpal(body) || body == Body::carpus ? 1 : 0] += press;
    EXPECT_EQ(region.object, 0u);
  }
  EXPECT_GT(of_parts[0], 0.2) << "N";
  EXPECT_GT(of_parts[1], 0.2) << "N";
  EXPECT_LE(rig.force().norm(), 1e-5 * size) << "each force has its opposite";
}

TEST(SkinTraction, AFlexibleObjectPresses) {
  const double top = OnAPlate::lowest_skin() - 0.002;
  constexpr double kEdge = 0.06;
  Rig rig(1, {{.name = "cube",
               .body = testing::soft_box({4, 4, 4}, Vector3::Constant(kEdge), testing::soft_material(3e4)),
               .pose = {.position = {-0.01, top - kEdge / 2, -0.12}}}});
  const ShapeGeometry table(testing::box_shape({0.3, 0.02, 0.3}));
  rig.simulation.set_slot(0, {.id = 1, .shape = &table, .friction = 0.8});
  rig.simulation.set_slot_motion(0, {{0, top - kEdge - 0.02, 0}, Quaternion::Identity()}, {});
  rig.aim({0, -0.008, 0});
  rig.run(60);
  const Vector3 on_object = rig.simulation.soft()->skin_force(0);
  ASSERT_LT(on_object.y(), -0.2) << "N";
  EXPECT_LE((rig.force() + on_object).norm(), 1e-4 * on_object.norm());
  for (const SkinRegion& region : rig.traction->regions)
    EXPECT_EQ(region.object, region.area > 0 ? kFirstSoftObject : 0) << region.region;
}

TEST(SkinTraction, TheLeastForcesAreLeftOutIfThereIsNoRoom) {
  const HandSimulation simulation(model(), {}, 0, 0);
  SkinTractionReport report(model());
  const auto traction = std::make_unique<SkinTraction>();
  const std::size_t count = kMaxSkinRegions + 100;
  report.begin(simulation.state());
  for (std::size_t i = 0; i < count; ++i)
    report.add(i, {Vector3(0, 1e-3 * static_cast<double>(i + 1), 0), -Vector3::UnitY(), 0, 1});
  report.write(kStep, *traction);
  ASSERT_TRUE(traction->regions.full());
  EXPECT_EQ(report.dropped(), 100u);
  for (std::size_t i = 0; i < kMaxSkinRegions; ++i) EXPECT_EQ(traction->regions[i].region, i + 100);
}

TEST(SkinTraction, ARegionWithTwoObjectsNamesTheOneThatPressesMore) {
  const HandSimulation simulation(model(), {}, 0, 0);
  SkinTractionReport report(model());
  const auto traction = std::make_unique<SkinTraction>();
  report.begin(simulation.state());
  report.add(5, {{0, 1, 0}, -Vector3::UnitY(), 0, 1});
  report.add(5, {{2, 0, 0}, -Vector3::UnitX(), 0, 2});
  report.add(5, {{0, 0.5, 0}, -Vector3::UnitY(), 0, 3});
  report.add(6, {Vector3::Zero(), -Vector3::UnitY(), 0, 4});
  report.write(kStep, *traction);
  ASSERT_EQ(traction->regions.size(), 1u);
  EXPECT_EQ(traction->regions[0].object, 2u);
}

TEST(SkinTraction, DoesNotAllocateAndRefusesTheMemoryOfAnotherHand) {
  OnAPlate rig;
  rig.press();
  rig.run(20);
  counting = true;
  for (int i = 0; i < 10; ++i) rig.simulation.write_traction(kStep, rig.report, *rig.traction);
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_GT(rig.area(), 0);
  SkinTractionReport::Memory other = rig.report.save();
  other.rates.pop_back();
  EXPECT_THROW(rig.report.load(other), std::invalid_argument);
}

}  // namespace
}  // namespace softhand::skin_traction_test
