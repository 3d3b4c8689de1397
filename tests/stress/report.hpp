// The stress map as data and pages: JSON, CSV, a section for docs/report.md, and pictures.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "stress/stress.hpp"

namespace softhand::stress {

/// One object a row: case, parameter, class, figure, invariant (empty where none is broken), then section, quantity,
/// limit, unit, good, timed, cause and refusal where there are, and seconds. Numbers that are not finite are null.
nlohmann::ordered_json to_json(const std::vector<Row>& rows);
/// The same without refusals and times.
std::string to_csv(const std::vector<Row>& rows);
/// A section "## Stress map": rows by class, how they count, and everything that did not pass with its cause. The sweep
/// is counted apart.
std::string to_markdown(const std::vector<Row>& rows, const std::string& command);

/// `softhand report stress`: runs, prints and writes. Empty paths: not written. `which`: names of cases, empty = all;
/// the sweep's are sweep, sweep_one_step and sweep_live.
struct StressArguments {
  bool quick = false;  ///< marked rows and a small sweep
  std::vector<std::string> which;
  std::string json;
  std::string csv;
  std::string markdown;
  std::string plot;   ///< a folder for the pictures (needs python3 with matplotlib)
  std::string cache;  ///< folder of rows that were computed before by the same programs; empty: none is kept
};
/// Returns 0 where G1 holds in every row and at least 95 % of the built rows (the sweep apart) pass or were rightly
/// refused, else 1.
int run_stress(const StressArguments& arguments);

}  // namespace softhand::stress
