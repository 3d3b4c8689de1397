// The known answers as data: JSON, CSV and a table for docs/report.md.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "verification/verification.hpp"

namespace softhand::verification {

/// One object a row: case, quantity, parameters, value, reference, tolerance, unit, order (observed) with
/// order_expected and order_tolerance where there is one, status "pass" or "fail", statement, seconds, and where it
/// applies error and known_failure. Numbers that are not finite are null.
nlohmann::ordered_json to_json(const std::vector<Row>& rows);
/// The same without statement and times; parameters as "key=value key=value".
std::string to_csv(const std::vector<Row>& rows);
/// A section "## Known answers" with the machine, compiler and commit, how many rows passed, and a table.
std::string to_markdown(const std::vector<Row>& rows, const std::string& command);

/// `softhand report verify`: runs, prints and writes. Empty paths: not written. `which`: names of cases, empty = all.
/// `settings`: "key=value" for the parameters of every row of a case that has the key; std::invalid_argument where none
/// has it. Returns 0 when every row passed, else 1.
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
