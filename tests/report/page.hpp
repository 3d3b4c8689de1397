// `softhand report`: all parts, and the page that they make together.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace softhand::report {

/// Writes report.md, images/*.png (with matplotlib) and report_data/*.{json,csv,md} into `out`, which is made where it
/// is not there.
struct ReportArguments {
  bool quick = false;   ///< each part's own --quick: under five minutes together
  bool resume = false;  ///< parts whose files lie in report_data stay as they are
  std::string motion;   ///< recording for error-runtime's scene recorded_grasp; empty: this scene is left out
  std::string out = "report";
};
/// Returns 0 where every part that was computed did, else 1.
int run_report(const ReportArguments& arguments);

/// A part of the page: its markdown begins with a "## " heading.
struct Part {
  std::string command;
  std::string result;    ///< in a line, for the summary
  std::string markdown;  ///< one section or more
};
/// The page: where the figures come from, a line a part, then every part's sections; those whose heading stands in
/// `long_sections` come last. `minutes`: that all parts took, where they were computed together.
std::string assemble(const std::vector<Part>& parts, const std::vector<std::string>& long_sections,
                     std::optional<double> minutes);

}  // namespace softhand::report
