// `softhand report`: runs all parts and writes the page with their results.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace softhand::report {

/// Writes report.md, images/*.png (with matplotlib) and report_data/*.{json,csv,md} into `out`. Creates `out` if
/// needed.
struct ReportArguments {
  bool quick = false;   ///< each part runs with its own --quick: under five minutes in total
  bool resume = false;  ///< keeps parts whose files are already in report_data
  std::string motion;   ///< recording for error-runtime's recorded scenes; empty: they are not played
  std::string out = "report";
};
/// Returns 0 if every part that ran returned 0, else 1.
int run_report(const ReportArguments& arguments);

/// A part of the page. Its markdown begins with a "## " heading.
struct Part {
  std::string command;
  std::string result;    ///< one line for the summary
  std::string markdown;  ///< one or more sections
};
/// Builds the page: origin of the figures, one summary line per part, then the sections of all parts. Sections whose
/// heading is in `long_sections` come last. `minutes` is the time of all parts, if they ran together.
std::string assemble(const std::vector<Part>& parts, const std::vector<std::string>& long_sections,
                     std::optional<double> minutes);

}  // namespace softhand::report
