// The stress map as JSON, as CSV, as a section of docs/report.md and as pictures.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "stress/stress.hpp"

namespace softhand::stress {

/// One object per row with these keys: case, parameter, class, figure, invariant (empty if all hold), section,
/// quantity, limit, at_least, unit, good, timed, mode, seconds. `cause` and `refusal` are present if the row has them.
/// Numbers that are not finite are null.
nlohmann::ordered_json to_json(const std::vector<Row>& rows);
/// The rows as CSV, without refusals, causes and times.
std::string to_csv(const std::vector<Row>& rows);
/// A section "## Stress map": number of rows in each class, share of good rows, and every row that did not pass with
/// its cause. The sweep is counted separately.
std::string to_markdown(const std::vector<Row>& rows, const std::string& command);

/// `softhand report stress` runs the rows, prints them and writes the files. An empty path means that the file is not
/// written. `which` holds names of cases; empty means all cases. The sweep's cases are
/// sweep, sweep_one_step and sweep_live.
struct StressArguments {
  bool quick = false;  ///< marked rows and a small sweep
  std::vector<std::string> which;
  std::string json;
  std::string csv;
  std::string markdown;
  std::string plot;   ///< folder for the pictures (needs python3 with matplotlib)
  std::string cache;  ///< folder with rows that the same programs computed before; empty: no cache
};
/// Returns 0 if G1 holds in every row and at least 95 % of the built rows pass or were rightly refused, else 1. The
/// rows of the sweep do not count for the 95 %.
int run_stress(const StressArguments& arguments);

}  // namespace softhand::stress
