#include "verification/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "report/report.hpp"

namespace softhand::verification {
namespace {

using report::in_quotes;
using report::write_file;

std::string text_of(const Parameters& parameters) {
  std::string text;
  for (const auto& [key, value] : parameters.values())
    text += fmt::format("{}{}={:.6g}", text.empty() ? "" : " ", key, value);
  return text;
}

std::string with_order(const Measurement& m) {
  return m.order ? fmt::format("{:.3f}", m.order->observed) : std::string();
}

const char* status_of(const Row& row) { return row.passed() ? "pass" : "fail"; }

std::vector<Case> chosen_cases(const VerifyArguments& arguments) {
  std::vector<Case> chosen;
  for (const Case& which : all_cases()) {
    if (arguments.which.empty() ||
        std::find(arguments.which.begin(), arguments.which.end(), which.name) != arguments.which.end())
      chosen.push_back(which);
  }
  for (const std::string& name : arguments.which) {
    const auto has_name = [&name](const Case& which) { return which.name == name; };
    if (std::any_of(chosen.begin(), chosen.end(), has_name)) continue;
    std::string known;
    for (const Case& which : all_cases()) known += (known.empty() ? "" : ", ") + which.name;
    throw std::invalid_argument("no case '" + name + "'; known: " + known);
  }
  for (const std::string& setting : arguments.settings) {
    const std::size_t equals = setting.find('=');
    std::size_t used = 0;
    double value = 0;
    if (equals != std::string::npos && equals + 1 < setting.size()) {
      try {
        value = std::stod(setting.substr(equals + 1), &used);
      } catch (const std::logic_error&) {
        used = 0;
      }
    }
    if (used == 0 || equals + 1 + used != setting.size())
      throw std::invalid_argument("'" + setting + "': expected key=number");
    const std::string key = setting.substr(0, equals);
    bool applied = false;
    std::string refusal;
    for (Case& which : chosen) {
      for (Parameters& row : which.table) {
        try {
          row.set(key, value);
          applied = true;
        } catch (const std::invalid_argument& error) {
          refusal = which.name + ": " + error.what();
        }
      }
      // Rows that have become equal are run once.
      std::vector<Parameters> different;
      for (const Parameters& row : which.table) {
        if (std::find(different.begin(), different.end(), row) == different.end()) different.push_back(row);
      }
      which.table = different;
    }
    if (!applied) throw std::invalid_argument(refusal);
  }
  return chosen;
}

}  // namespace

nlohmann::ordered_json to_json(const std::vector<Row>& rows) {
  auto list = nlohmann::ordered_json::array();
  for (const Row& row : rows) {
    const Measurement& m = row.measurement;
    nlohmann::ordered_json entry{
        {"case", row.name}, {"quantity", m.quantity},   {"parameters", row.parameters.values()},
        {"value", m.value}, {"reference", m.reference}, {"tolerance", m.tolerance},
        {"unit", m.unit}};
    if (m.order) {
      entry["order"] = m.order->observed;
      entry["order_expected"] = m.order->expected;
      entry["order_tolerance"] = m.order->tolerance;
    }
    entry["status"] = status_of(row);
    entry["statement"] = row.statement;
    entry["seconds"] = row.seconds;
    if (!row.error.empty()) entry["error"] = row.error;
    if (!row.known_failure.empty() && !row.passed()) entry["known_failure"] = row.known_failure;
    list.push_back(std::move(entry));
  }
  return list;
}

std::string to_csv(const std::vector<Row>& rows) {
  std::string text = "case,quantity,parameters,value,reference,tolerance,unit,order,status\n";
  for (const Row& row : rows) {
    const Measurement& m = row.measurement;
    text += fmt::format("{},{},{},{:.12g},{:.12g},{:.6g},{},{},{}\n", row.name, in_quotes(m.quantity),
                        in_quotes(text_of(row.parameters)), m.value, m.reference, m.tolerance, in_quotes(m.unit),
                        with_order(m), status_of(row));
  }
  return text;
}

std::string to_markdown(const std::vector<Row>& rows, const std::string& command) {
  const report::Provenance from = report::provenance();
  const auto passed = std::count_if(rows.begin(), rows.end(), [](const Row& row) { return row.passed(); });
  std::string text = fmt::format("## Known answers\n\n`{}` on {}, {}, commit {}: {} of {} rows pass.\n\n", command,
                                 from.processor, from.compiler, from.commit, passed, rows.size());
  text +=
      "| case | quantity | parameters | value | reference | tolerance | unit | order | status |\n| --- | --- | --- | "
      "--- | --- | --- | --- | --- | --- |\n";
  for (const Row& row : rows) {
    const Measurement& m = row.measurement;
    text += fmt::format("| {} | {} | {} | {:.7g} | {:.7g} | {:.3g} | {} | {} | {} |\n", row.name,
                        report::in_cell(m.quantity), text_of(row.parameters), m.value, m.reference, m.tolerance, m.unit,
                        with_order(m), row.passed() ? "pass" : "**fail**");
  }
  text += "\n| case | reference |\n| --- | --- |\n";
  std::string last;
  for (const Row& row : rows) {
    if (row.name != last) text += fmt::format("| {} | {} |\n", row.name, row.statement);
    last = row.name;
  }
  if (passed < static_cast<std::ptrdiff_t>(rows.size()))
    text += "\nRows that fail:\n\n| case | quantity | parameters | cause |\n| --- | --- | --- | --- |\n";
  for (const Row& row : rows) {
    if (row.passed()) continue;
    text += fmt::format("| {} | {} | {} | {} |\n", row.name, report::in_cell(row.measurement.quantity),
                        text_of(row.parameters),
                        report::in_cell(!row.error.empty()           ? row.error
                                        : !row.known_failure.empty() ? row.known_failure
                                                                     : "unknown"));
  }
  return text;
}

int run_verify(const VerifyArguments& arguments) {
  std::vector<Row> rows;
  double seconds = 0;
  for (const Case& which : chosen_cases(arguments)) {
    std::vector<Row> more = run(which, arguments.quick);
    const Parameters* last = nullptr;
    for (const Row& row : more) {
      const Measurement& m = row.measurement;
      fmt::print("{:4}  {:22} {:60} {:>16.9g} {:>16.9g} +- {:<9.3g} {:6} {}{}\n", status_of(row), row.name, m.quantity,
                 m.value, m.reference, m.tolerance, m.unit,
                 m.order ? fmt::format("order {:.3f}  ", m.order->observed) : "",
                 row.error.empty() ? text_of(row.parameters) : row.error);
      if (last == nullptr || !(*last == row.parameters)) seconds += row.seconds;
      last = &row.parameters;
    }
    std::fflush(stdout);
    rows.insert(rows.end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
  }
  const auto passed = std::count_if(rows.begin(), rows.end(), [](const Row& row) { return row.passed(); });
  fmt::print("{} of {} rows pass, {:.1f} s\n", passed, rows.size(), seconds);
  write_file(arguments.json, to_json(rows).dump(2) + "\n");
  write_file(arguments.csv, to_csv(rows));
  write_file(arguments.markdown,
             to_markdown(rows, arguments.quick ? "softhand report verify --quick" : "softhand report verify"));
  return passed == static_cast<std::ptrdiff_t>(rows.size()) ? 0 : 1;
}

}  // namespace softhand::verification
