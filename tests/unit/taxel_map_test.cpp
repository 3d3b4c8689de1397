// Taxels of tactile devices: what they feel of the skin.
#include "device/taxel_map.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "messages/convert.hpp"
#include "support/count_allocations.hpp"
#include "support/press.hpp"

namespace softhand::taxel_map_test {
namespace {

const HandModel& right() {
  static const HandModel hand = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  return hand;
}

// Presses the skin at a taxel with `newton`. `shear`: N along its axes. `slip`: m/s along its axes.
SkinRegion at(const Taxel& taxel, double newton, const std::array<double, 2>& shear = {},
              const std::array<double, 2>& slip = {}) {
  const Vector3 second = taxel.normal.cross(taxel.tangent);
  SkinRegion region;
  region.body = static_cast<std::uint32_t>(index_of(taxel.body));
  region.object = 7;
  region.place = to_floats(taxel.place);
  region.normal = to_floats(taxel.normal);
  region.area = 1e-5f;
  region.pressure = static_cast<float>(newton / 1e-5);
  region.shear = to_floats((shear[0] * taxel.tangent + shear[1] * second) / 1e-5);
  region.slip_velocity = to_floats(slip[0] * taxel.tangent + slip[1] * second);
  return region;
}

SkinTraction of(const std::vector<SkinRegion>& regions) {
  SkinTraction traction;
  for (const SkinRegion& region : regions) traction.regions.push_back(region);
  return traction;
}

std::vector<Taxel> joined(std::vector<Taxel> all, const std::vector<Taxel>& more) {
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

TEST(TaxelMap, ForcesSumToThoseOfTheSkin) {
  const HandModel& hand = right();
  const std::vector<Taxel> taxels =
      joined(joined(fingertip_grid(hand, Finger::index, 4, 4, 0.003), fingertip_ring(hand, Finger::thumb, 6)),
             palm_grid(hand, 3, 3, 0.025));
  TaxelMap map(hand, taxels);
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> newton(0, 1), across(-0.5, 0.5), away(-0.2, 0.2);
  std::vector<SkinRegion> regions;
  Vector3 force = Vector3::Zero();
  double press = 0, area = 0;
  for (int i = 0; i < 300; ++i) {
    const Taxel& taxel = taxels[static_cast<std::size_t>(i) % taxels.size()];
    SkinRegion region = at(taxel, newton(random), {across(random), across(random)});
    for (float& x : region.place) x += static_cast<float>(taxel.reach * away(random));
    regions.push_back(region);
    const Pose& joint = hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(taxel.body)))];
    const auto vector = [](const std::array<float, 3>& v) {
      return Eigen::Vector3f(v[0], v[1], v[2]).cast<double>().eval();
    };
    force +=
        joint.orientation * Vector3(region.area * (vector(region.shear) - region.pressure * vector(region.normal)));
    press += static_cast<double>(region.area) * region.pressure;
    area += region.area;
  }
  const auto touches = map.feel(of(regions));
  for (std::size_t i = 0; i < taxels.size(); ++i) {
    const Quaternion& turn = hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(taxels[i].body)))].orientation;
    const Vector3 second = taxels[i].normal.cross(taxels[i].tangent);
    const auto& f = touches[i].force;
    force -= turn * Vector3(f[0] * taxels[i].tangent + f[1] * second + f[2] * taxels[i].normal);
    press -= touches[i].press;
    area -= touches[i].area;
  }
  EXPECT_LE(force.norm(), 1e-9) << "N";
  EXPECT_LE(std::abs(press), 1e-9) << "N";
  EXPECT_LE(std::abs(area), 1e-12) << "m^2";
  EXPECT_EQ(map.refused(), 0u);
}

TEST(TaxelMap, AGridFeelsPlaceDirectionAndSlip) {
  const auto taxels = fingertip_grid(right(), Finger::index, 3, 3, 0.004);
  TaxelMap map(right(), taxels);
  for (std::size_t i = 0; i < taxels.size(); ++i) {
    const auto touches = map.feel(of({at(taxels[i], 1, {0.3, -0.2}, {0.05, 0.02})}));
    const auto best = std::max_element(touches.begin(), touches.end(),
                                       [](const TaxelTouch& a, const TaxelTouch& b) { return a.press < b.press; });
    EXPECT_EQ(best - touches.begin(), static_cast<std::ptrdiff_t>(i));
    EXPECT_GT(best->press, 0.3) << "N";
    EXPECT_NEAR(best->force[0] / best->press, 0.3, 1e-5);
    EXPECT_NEAR(best->force[1] / best->press, -0.2, 1e-5);
    EXPECT_NEAR(best->force[2] / best->press, -1, 1e-5);
    EXPECT_NEAR(best->slip[0], 0.05, 1e-6);
    EXPECT_NEAR(best->slip[1], 0.02, 1e-6);
    EXPECT_NEAR(best->pressure(), 1 / 1e-5, 1);
    EXPECT_EQ(best->object, 7u);
    // Neighbours share, the far corner feels nothing.
    if (i == 0) {
      EXPECT_GT(touches[1].press, 0.05);
      EXPECT_EQ(touches[8].press, 0);
    }
  }
}

// The second row is nearer to the tip than the first one, the second column is on the side of +X.
TEST(TaxelMap, LayoutsLieOnTheSkinInTheirOrder) {
  for (const HandModel& hand : {right(), mirrored(right())}) {
    const auto grid = fingertip_grid(hand, Finger::middle, 2, 2, 0.004);
    EXPECT_NEAR(grid[2].place.z() - grid[0].place.z(), -0.004, 1e-12);
    EXPECT_GT(grid[1].place.x() - grid[0].place.x(), 0.0035);
    const auto ring = fingertip_ring(hand, Finger::middle, 4);
    EXPECT_LE((ring[0].normal + Vector3::UnitY()).norm(), 1e-12);
    EXPECT_LE((ring[1].normal - Vector3::UnitX()).norm(), 1e-12);
    const auto palm = palm_grid(hand, 2, 2, 0.02);
    EXPECT_NEAR((palm[2].place - palm[0].place).norm(), 0.02, 1e-12);
    EXPECT_LT(palm[2].place.z(), palm[0].place.z());
    EXPECT_GT(palm[1].place.x(), palm[0].place.x());
    const auto check = [&hand](const std::vector<Taxel>& taxels, double within) {
      for (const Taxel& taxel : taxels) {
        const Vector3 place = hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(taxel.body)))] * taxel.place;
        double nearest = 1;
        for (const SkinVertex& vertex : hand.skin_vertices)
          nearest = std::min(nearest, (hand.position_of(vertex) - place).norm());
        EXPECT_LT(nearest, within) << "m from the skin";
      }
    };
    check(grid, 0.004);
    check(ring, 0.004);
    check(palm, 0.012);
    check(digit_taxels(hand, 5), 0.004);
  }
}

TEST(TaxelMap, ADigitTaxelTakesAllOfItsDigitAndNothingElse) {
  TaxelMap map(right(), digit_taxels(right(), 6));
  SkinTraction traction;
  for (int f = 0; f < 6; ++f) {
    testing::press(traction, static_cast<Finger>(f), f + 1, 0.1);
    const auto touches = map.feel(traction);
    for (int g = 0; g < 6; ++g)
      EXPECT_NEAR(touches[static_cast<std::size_t>(g)].press, g <= f ? g + 1 : 0, 1e-6) << f << " " << g;
    EXPECT_NEAR(touches[static_cast<std::size_t>(f)].slip_speed(), 0.1, 1e-4);
  }
  // Metacarpals belong to the palm. Skin that is squeezed from two sides is pressed.
  Taxel place;
  place.body = Body::index_metacarpal;
  EXPECT_NEAR(map.feel(of({at(place, 2)}))[5].press, 2, 1e-6);
  place.body = Body::index_proximal;
  Taxel opposite = place;
  opposite.normal = -place.normal;
  const TaxelTouch index = map.feel(of({at(place, 2), at(opposite, 2)}))[1];
  EXPECT_NEAR(index.press, 4, 1e-6);
  EXPECT_NEAR(index.force[2], 0, 1e-6);
}

TEST(TaxelMap, RefusesAndCountsWhatItCannotUse) {
  const auto taxels = digit_taxels(right(), 1);
  TaxelMap map(right(), taxels);
  const SkinRegion good = at(taxels[0], 1);
  std::vector<SkinRegion> regions(6, good);
  regions[0].body = kBodyCount;
  regions[1].pressure = std::numeric_limits<float>::quiet_NaN();
  regions[2].place[1] = std::numeric_limits<float>::infinity();
  regions[3].area_rate = std::numeric_limits<float>::quiet_NaN();
  regions[4].slip_velocity[2] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_NEAR(map.feel(of(regions))[0].press, 1, 1e-6);
  EXPECT_EQ(map.refused(), 5u);

  Taxel wrong = taxels[0];
  wrong.reach = 0;
  EXPECT_THROW(TaxelMap(right(), {wrong}), std::invalid_argument);
  wrong = taxels[0];
  wrong.tangent = wrong.normal;
  EXPECT_THROW(TaxelMap(right(), {wrong}), std::invalid_argument);
  wrong.tangent.setConstant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_THROW(TaxelMap(right(), {wrong}), std::invalid_argument);
}

TEST(TaxelMap, DoesNotAllocate) {
  TaxelMap map(right(), palm_grid(right(), 3, 3, 0.025));
  SkinTraction traction;
  testing::press(traction, Finger::palm, 1);
  counting = true;
  map.feel(traction);
  counting = false;
  EXPECT_EQ(allocations, 0);
}

}  // namespace
}  // namespace softhand::taxel_map_test
