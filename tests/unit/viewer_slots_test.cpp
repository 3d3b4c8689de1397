// Numbers of modules in frames.
#include <gtest/gtest.h>

#include <set>
#include <string>

#include "viewer/gateway.hpp"

namespace softhand::viewer {
namespace {

TEST(ViewerSlots, ForgedNamesDoNotGrowThemNorTakeNumbersInUse) {
  Slots slots;
  const std::uint32_t hand = slots.of("hand"), world = slots.of("world");
  EXPECT_NE(hand, world);
  std::set<std::uint32_t> numbers;
  for (int i = 0; i < 10000; ++i) {
    numbers.insert(slots.of("forged " + std::to_string(i)));
    if (i % 50 == 0) {
      EXPECT_EQ(slots.of("hand"), hand);
      EXPECT_EQ(slots.of("world"), world);
    }
  }
  EXPECT_EQ(numbers.size(), Slots::kMost - 2);
  EXPECT_LT(*numbers.rbegin(), Slots::kMost);
}

}  // namespace
}  // namespace softhand::viewer
