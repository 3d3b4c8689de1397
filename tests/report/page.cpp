#include "report/page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "error_runtime/report.hpp"
#include "human/report.hpp"
#include "report/report.hpp"
#include "stress/report.hpp"
#include "verification/report.hpp"

namespace softhand::report {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

std::string read_file(const fs::path& path) {
  std::ifstream in(path);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

// Splits `markdown` before each line that begins with "## ".
std::vector<std::string> sections_of(const std::string& markdown) {
  std::vector<std::string> sections;
  std::stringstream lines(markdown);
  for (std::string line; std::getline(lines, line);) {
    if (sections.empty() || line.rfind("## ", 0) == 0) sections.emplace_back();
    sections.back() += line + "\n";
  }
  return sections;
}

// Counts the values of a key over the rows, for example "3 Pass, 1 Diverged".
std::string counted(const Json& rows, const char* key) {
  std::map<std::string, int> counts;
  for (const Json& row : rows) ++counts[row.at(key).get<std::string>()];
  std::string text;
  for (const auto& [value, count] : counts) text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count, value);
  return text;
}

std::string known_answers_in_a_line(const Json& rows) {
  std::string failed;
  for (const Json& row : rows) {
    const std::string name = row.at("case");
    if (row.at("status") == "fail" && failed.find(name) == std::string::npos)
      failed += (failed.empty() ? "; failing cases: " : ", ") + name;
  }
  return fmt::format("{} of {} rows{}", counted(rows, "status"), rows.size(), failed);
}

std::string error_runtime_in_a_line(const Json& rows) {
  double largest = -1;  // mm
  std::string scene, failed;
  for (const Json& row : rows) {
    if (!row.value("default", false)) continue;
    const std::string name = row.at("scene");
    if (row.at("class") != "Pass") {
      failed += fmt::format(". {}: {}", name, row.at("class").get<std::string>());
    } else if (const double error = row.at("tissue_rms_mm"); error > largest) {  // finite, because the row passes
      largest = error;
      scene = name;
    }
  }
  return fmt::format("Largest solver error of the default: {:.2g} mm in {}{}. {} runs: {}", largest, scene, failed,
                     rows.size(), counted(rows, "class"));
}

}  // namespace

std::string assemble(const std::vector<Part>& parts, const std::vector<std::string>& long_sections,
                     std::optional<double> minutes) {
  const Provenance from = provenance();
  const std::string took = minutes ? fmt::format(" in {:.0f} minutes", *minutes) : "";
  std::string page = fmt::format(
      "# Report\n\nThis page shows results of `softhand report`: error against run time, stress map, known answers and "
      "fingertips.\n\nMade{} on {}, {}, commit {}. If a part was run again alone, its section says so.\n\n"
      "| part | result |\n| --- | --- |\n",
      took, from.processor, from.compiler, from.commit);
  for (const Part& part : parts) page += fmt::format("| `{}` | {} |\n", part.command, part.result);
  std::string tables;
  for (const Part& part : parts) {
    for (const std::string& section : sections_of(part.markdown)) {
      const bool is_long =
          std::any_of(long_sections.begin(), long_sections.end(),
                      [&section](const std::string& heading) { return section.rfind("## " + heading + "\n", 0) == 0; });
      (is_long ? tables : page) += "\n" + section;
    }
  }
  return page + tables;
}

int run_report(const ReportArguments& arguments) {
  const auto begin = std::chrono::steady_clock::now();
  const fs::path out = arguments.out, data = out / "report_data", images = out / "images";
  fs::create_directories(data);
  bool good = true;
  std::vector<Part> parts;
  const auto add = [&](const std::string& command, auto part, const auto& run, std::string (*in_a_line)(const Json&)) {
    std::string name = command;
    std::replace(name.begin(), name.end(), '-', '_');
    const fs::path file = data / name;
    part.json = file.string() + ".json";
    part.csv = file.string() + ".csv";
    part.markdown = file.string() + ".md";
    std::string line = "softhand report " + command;
    // Some parts have no quick form, and some parts draw no pictures.
    if constexpr (requires { part.quick; }) {
      part.quick = arguments.quick;
      if (arguments.quick) line += " --quick";
    }
    if constexpr (requires { part.plot; }) part.plot = images.string();
    if (!arguments.resume || !fs::exists(part.json) || !fs::exists(part.markdown)) good = run(part) == 0 && good;
    parts.push_back({line, in_a_line(Json::parse(read_file(part.json))), read_file(part.markdown)});
  };
  error_runtime::ErrorRuntimeArguments error_runtime;
  error_runtime.motion = arguments.motion;
  add("error-runtime", error_runtime, error_runtime::run_error_runtime, error_runtime_in_a_line);
  add("stress", stress::StressArguments{}, stress::run_stress, [](const Json& rows) {
    return fmt::format("{} rows, including the sweep: {}", rows.size(), counted(rows, "class"));
  });
  add("verify", verification::VerifyArguments{}, verification::run_verify, known_answers_in_a_line);
  add("human", human::HumanArguments{}, human::run_human,
      [](const Json& rows) { return fmt::format("{} of {} rows", counted(rows, "status"), rows.size()); });

  std::optional<double> minutes;
  if (!arguments.resume) minutes = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() / 60;
  write_file((out / "report.md").string(), assemble(parts,
                                                    {"Known answers", "Configurations that were rightly refused",
                                                     "All runs of error against run time"},
                                                    minutes));
  fmt::print("{}\n", (out / "report.md").string());
  return good ? 0 : 1;
}

}  // namespace softhand::report
