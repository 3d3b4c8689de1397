// Tests the page that `softhand report` writes.
#include "report/page.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <stdexcept>

#include "report/report.hpp"

namespace softhand::report {
namespace {

TEST(Page, BeginsWithResultsAndEndsWithLongTables) {
  const std::vector<Part> parts{
      {"softhand report a", "3 of 4", "## Rows of a\n\n| x |\n\n### Below\n\nmore\n\n## Figures of a\n\nshort\n"},
      {"softhand report b", "all", "## Of b\n\ntext\n"}};
  const std::string page = assemble(parts, {"Rows of a"}, 2.2);
  ASSERT_EQ(page.rfind("# Report\n", 0), 0u);
  std::size_t at = 0;
  for (const char* piece : {"2 minutes", "commit ", "| `softhand report a` | 3 of 4 |", "| `softhand report b` | all |",
                            "## Figures of a", "short", "## Of b", "## Rows of a", "### Below", "more"}) {
    const std::size_t found = page.find(piece);
    ASSERT_NE(found, std::string::npos) << piece;
    EXPECT_GE(found, at) << piece << " stands too early";
    at = found;
  }
  EXPECT_EQ(assemble(parts, {}, std::nullopt).find("minutes"), std::string::npos)
      << "parts that ran at different times have no common run time";
}

TEST(Cell, EscapesPipesAndReplacesLineBreaks) { EXPECT_EQ(in_cell("|x| < 1\nor not"), "\\|x\\| < 1; or not"); }

TEST(Pictures, FailedDrawingThrowsKeepsFilesAndLeavesNoTemporaryFile) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::path(testing::TempDir()) / ("softhand_pictures_" + std::to_string(getpid()));
  fs::create_directories(folder);
  write_file((folder / "human.json").string(), "[]\n");
  EXPECT_THROW(draw("human", "no rows", folder.string()), std::runtime_error);
  EXPECT_TRUE(fs::exists(folder / "human.json"));
  fs::remove_all(folder);
  const std::string own = std::to_string(getpid()) + ".json";
  EXPECT_TRUE(std::none_of(fs::directory_iterator(fs::temp_directory_path()), fs::directory_iterator(),
                           [&own](const auto& entry) { return entry.path().string().ends_with(own); }));
  EXPECT_NO_THROW(draw("human", "no rows", ""));
}

}  // namespace
}  // namespace softhand::report
