// What a command remembers about the modules of a domain.
#include <gtest/gtest.h>

#include <string>

#include "cli/module_table.hpp"
#include "cli/terminal_text.hpp"

namespace softhand::cli_modules_test {
namespace {

constexpr Nanoseconds kMillisecond = 1'000'000;
using Table = ModuleTable<int>;

std::string forged(int i) { return "forged " + std::to_string(i); }

TEST(ModuleTable, ForgedNamesNeitherGrowItNorTakePlacesInUse) {
  Table table;
  Nanoseconds now = 0;
  *table.of("world", now) = 7;
  for (int i = 0; i < 10000; ++i, now += kMillisecond) {
    table.of(forged(i), now);
    if (i % 100 == 0) {
      EXPECT_EQ(*table.of("world", now), 7);
    }
    ASSERT_LE(table.rows().size(), Table::kMost);
  }
  EXPECT_GT(table.refused(), 8000u);
}

TEST(TerminalText, HasNoControlCharacters) {
  EXPECT_EQ(terminal_text("hand  applied\nworld"), "hand  applied\nworld");
  EXPECT_EQ(terminal_text("\x1b[2J\a\x7f\t"), "?[2J???");
  EXPECT_EQ(terminal_text("\xc2\x9bmred"), "?mred") << "U+009B begins a command too";
  EXPECT_EQ(terminal_text("3 \xc2\xb5m, Andr\xc3\xa9 \xc2"), "3 \xc2\xb5m, Andr\xc3\xa9 \xc2");
}

TEST(ModuleTable, AnExpectedModuleAlwaysHasAPlace) {
  Table table;
  table.expect({"hand", "world"});
  for (int i = 0; i < 1000; ++i) table.of(forged(i), 0);
  EXPECT_EQ(table.rows().size(), Table::kMost);
  EXPECT_EQ(table.refused(), 1000 - Table::kMost);
  for (const char* own : {"hand", "world"}) {
    int* const row = table.of(own, 0);
    ASSERT_NE(row, nullptr);
    *row = 3;
  }
  // It keeps its place while it is silent, for example because it hangs.
  for (int i = 0; i < 1000; ++i) table.of(forged(i), 10'000 * kMillisecond + i);
  EXPECT_EQ(table.rows().at("hand"), 3);
  EXPECT_EQ(table.rows().size(), Table::kMost + 2);
  // Another rig does not expect it.
  table.expect({"world"});
  EXPECT_NE(table.of("tracker", 10'500 * kMillisecond), nullptr);
  EXPECT_EQ(table.rows().count("hand"), 0u);
  EXPECT_EQ(table.rows().count("world"), 1u);
}

TEST(ModuleTable, ANewModuleTakesThePlaceOfTheOneThatWasSilentForTheLongestTime) {
  Table table;
  for (std::size_t i = 0; i < Table::kMost; ++i)
    table.of(forged(static_cast<int>(i)), static_cast<Nanoseconds>(i) * kMillisecond);
  EXPECT_EQ(table.of("late", 999 * kMillisecond), nullptr);
  EXPECT_EQ(table.refused(), 1u);
  ASSERT_NE(table.of("late", 1000 * kMillisecond), nullptr);
  EXPECT_EQ(table.rows().count(forged(0)), 0u);
  EXPECT_EQ(table.rows().count(forged(1)), 1u);
  EXPECT_EQ(table.rows().size(), Table::kMost);
}

}  // namespace
}  // namespace softhand::cli_modules_test
