// The known answers as data: JSON, CSV and a table for docs/report.md.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "verification/verification.hpp"

namespace softhand::verification {

/// One object per row with these keys: case, quantity, parameters, value, reference, tolerance, unit, status ("pass" or
/// "fail"), statement, seconds. Some rows also have:
/// - order (observed), order_expected and order_tolerance, if the quantity is a limit
/// - error, known_failure
///
/// Numbers that are not finite are null.
nlohmann::ordered_json to_json(const std::vector<Row>& rows);
/// The same rows without statement and times. Parameters are written as "key=value key=value".
std::string to_csv(const std::vector<Row>& rows);
/// A section "## Known answers" with machine, compiler, commit, the number of rows that passed, and tables.
std::string to_markdown(const std::vector<Row>& rows, const std::string& command);

/// `softhand report verify` runs the cases, prints the rows and writes the files. An empty path means that the file is
/// not written.
/// - `which`: names of cases; empty means all
/// - `settings`: "key=value" for every row of the cases that have the key. Throws std::invalid_argument if no case has
///   it.
///
/// Returns 0 if every row passed, else 1.
struct VerifyArguments {
  bool quick = false;
  std::vector<std::string> which;
  std::vector<std::string> settings;
  std::string json;
  std::string csv;
  std::string markdown;
};
int run_verify(const VerifyArguments& arguments);

}  // namespace softhand::verification
