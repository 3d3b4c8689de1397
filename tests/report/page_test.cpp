// The page that `softhand report` writes.
#include "report/page.hpp"

#include <gtest/gtest.h>

namespace softhand::report {
namespace {

TEST(Page, BeginsWithWhatCameAndEndsWithLongTables) {
  const std::vector<Part> parts{{"softhand report a", "3 of 4", "## Rows of a\n\n| x |\n\n### Below\n\nmore\n\n## Figures of a\n\nshort\n"}, {"softhand report b", "all", "## Of b\n\ntext\n"}};
  const std::string page = assemble(parts, {"Rows of a"}, 2.2);
  ASSERT_EQ(page.rfind("# Report\n", 0), 0u);
  std::size_t at = 0;
  for (const char* piece : {"2 minutes", "commit ", "| `softhand report a` | 3 of 4 |", "| `softhand report b` | all |", "## Figures of a", "short", "## Of b", "## Rows of a", "### Below", "more"}) {
    const std::size_t found = page.find(piece);
    ASSERT_NE(found, std::string::npos) << piece;
    EXPECT_GE(found, at) << piece << " stands too early";
    at = found;
  }
}

}  // namespace
}  // namespace softhand::report
