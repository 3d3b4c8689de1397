#include "stress/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>

#include "report/report.hpp"
#include "runtime/sha256.hpp"
#include "stress/sweep.hpp"

namespace softhand::stress {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using report::in_cell;

constexpr std::size_t kSweepPoints = 256, kQuickSweepPoints = 16;
constexpr double kGoodShare = 0.95;

bool is_sweep(const Row& row) { return row.section == "Sweep"; }

std::string figure_text(const Row& row) {
  if (row.figure.quantity.empty()) return {};
  return fmt::format("{:.4g} {} ({} {:.4g})", row.figure.value, row.figure.unit,
                     row.figure.at_least ? ">=" : "<=", row.figure.limit);
}

Json to_json(const Row& row) {
  Json json{{"case", row.name},
            {"parameter", row.parameter},
            {"class", name_of(row.which)},
            {"figure", row.figure.value},
            {"invariant", row.invariant},
            {"section", row.section},
            {"quantity", row.figure.quantity},
            {"limit", row.figure.limit},
            {"at_least", row.figure.at_least},
            {"unit", row.figure.unit},
            {"good", row.counts_as_good},
            {"timed", row.timed},
            {"mode", row.mode}};
  if (!row.known.cause.empty()) json["cause"] = row.known.cause;
  if (!row.refusal.empty()) json["refusal"] = row.refusal;
  json["seconds"] = row.seconds;
  return json;
}

// Fills in the computed values. Name, known class and cause come from the table, not from the cache.
void take(const Json& json, Row& row) {
  for (int c = 0; c <= static_cast<int>(Class::not_built); ++c) {
    if (json.at("class") == name_of(static_cast<Class>(c))) row.which = static_cast<Class>(c);
  }
  const auto number = [&json](const char* key) {
    return json.at(key).is_number() ? json.at(key).get<double>() : std::nan("");
  };
  row.figure = {json.at("invariant"), json.at("quantity"), number("figure"), number("limit"),
                json.at("unit"),      json.at("at_least"), Class::violated};
  row.invariant = json.at("invariant");
  row.counts_as_good = json.at("good");
  row.refusal = json.value("refusal", "");
  row.seconds = number("seconds");
}

void add_file(Sha256& hash, const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::vector<char> block(1 << 20);
  while (in) {
    in.read(block.data(), static_cast<std::streamsize>(block.size()));
    hash.add(std::as_bytes(std::span(block.data(), static_cast<std::size_t>(in.gcount()))));
  }
}

void add_text(Sha256& hash, const std::string& text) {
  hash.add(std::as_bytes(std::span(text.data(), text.size() + 1)));
}

/// Cache of computed rows. The key is a hash over all softhand programs in this folder, the hand file, the scene file,
/// the case and the parameter.
class Cache {
 public:
  explicit Cache(std::string folder) : folder_(std::move(folder)) {
    if (folder_.empty()) return;
    Sha256 hash;
    std::set<fs::path> programs;
    for (const auto& entry : fs::directory_iterator(fs::read_symlink("/proc/self/exe").parent_path())) {
      if (entry.path().filename().string().rfind("softhand", 0) == 0) programs.insert(entry.path());
    }
    for (const fs::path& program : programs) add_file(hash, program);
    for (const char* const nodes : {"400", "750", "3000", "6000"})
      add_file(hash, std::string(SOFTHAND_SOURCE_DIR "/config/hands/right_") + nodes + ".hand.json");
    add_file(hash, SOFTHAND_SOURCE_DIR "/config/scenes/pinch_lift.toml");
    inputs_ = hash.hex();
    fs::create_directories(folder_);
  }
  bool find(Row& row) const {
    std::ifstream in(path_of(row));
    const Json json = in ? Json::parse(in, nullptr, false) : Json();
    if (!json.is_object()) return false;
    take(json, row);
    return true;
  }
  void store(const Row& row) const {
    if (!folder_.empty()) report::write_file(path_of(row), to_json(row).dump() + "\n");
  }

 private:
  std::string path_of(const Row& row) const {
    Sha256 hash;
    for (const std::string& text : {inputs_, row.name, row.parameter}) add_text(hash, text);
    return folder_ + "/" + hash.hex().substr(0, 32) + ".json";
  }
  std::string folder_, inputs_;
};

std::vector<Case> chosen_cases(const StressArguments& arguments) {
  std::vector<Case> all = all_cases();
  for (Case& which : sweep_cases(arguments.quick ? kQuickSweepPoints : kSweepPoints)) {
    if (arguments.quick) {
      for (Setting& row : which.rows) row.quick = true;
    }
    all.push_back(std::move(which));
  }
  for (const std::string& name : arguments.which) {
    if (std::any_of(all.begin(), all.end(), [&name](const Case& which) { return which.name == name; })) continue;
    std::string known;
    for (const Case& which : all) known += (known.empty() ? "" : ", ") + which.name;
    throw std::invalid_argument("no case '" + name + "'; known: " + known);
  }
  std::vector<Case> chosen;
  for (Case& which : all) {
    if (!arguments.which.empty() &&
        std::find(arguments.which.begin(), arguments.which.end(), which.name) == arguments.which.end())
      continue;
    if (arguments.quick) std::erase_if(which.rows, [](const Setting& row) { return row.run && !row.quick; });
    chosen.push_back(std::move(which));
  }
  return chosen;
}

struct Count {
  std::size_t built = 0, good = 0, nonfinite = 0;
  double share() const { return built == 0 ? 1 : static_cast<double>(good) / static_cast<double>(built); }
};

Count count_of(const std::vector<Row>& rows) {
  Count count;
  for (const Row& row : rows) {
    if (row.invariant == "G1") ++count.nonfinite;
    if (is_sweep(row) || row.mode != "default" || row.which == Class::not_built) continue;
    ++count.built;
    if (row.counts_as_good) ++count.good;
  }
  return count;
}

}  // namespace

Json to_json(const std::vector<Row>& rows) {
  Json list = Json::array();
  for (const Row& row : rows) list.push_back(to_json(row));
  return list;
}

std::string to_csv(const std::vector<Row>& rows) {
  std::string text = "section,case,parameter,class,figure,limit,unit,quantity,invariant,good\n";
  for (const Row& row : rows) {
    text += fmt::format("{},{},{},{},{:.9g},{:.6g},{},{},{},{}\n", row.section, row.name,
                        report::in_quotes(row.parameter), name_of(row.which), row.figure.value, row.figure.limit,
                        report::in_quotes(row.figure.unit), report::in_quotes(row.figure.quantity),
                        report::in_quotes(row.invariant), row.counts_as_good ? 1 : 0);
  }
  return text;
}

std::string to_markdown(const std::vector<Row>& rows, const std::string& command) {
  const report::Provenance from = report::provenance();
  const Count count = count_of(rows);
  std::string text = fmt::format(
      "## Stress map\n\n`{}` on {}, {}, commit {}; hand right_400.\ndocs/stress.md defines the classes and the "
      "invariants.\n\n- {} of {} built rows in default mode pass or were rightly refused ({:.1f} %).\n"
      "- {} rows published a number that is not finite.\n\n"
      "![All values of all cases, coloured by class](images/stress_map.png)\n\n"
      "![Points of the sweep, coloured by class](images/stress_sweep.png)\n\n"
      "![Points of the sweep with the live budget, coloured by class](images/stress_sweep_live.png)\n\nNumber of rows "
      "in each class:\n\n",
      command, from.processor, from.compiler, from.commit, count.good, count.built, 100 * count.share(),
      count.nonfinite);
  std::map<std::string, std::map<Class, int>> classes;
  std::vector<std::string> sections;
  for (const Row& row : rows) {
    const std::string key = is_sweep(row) ? row.name : row.section;
    if (classes.find(key) == classes.end()) sections.push_back(key);
    ++classes[key][row.which];
  }
  text +=
      "| | Pass | Refused | Violated | Diverged | Inverted | Over force | Over budget | Not built |\n| --- | --- | --- "
      "| --- | --- | --- | --- | --- | --- |\n";
  for (const std::string& section : sections) {
    text += "| " + section + " |";
    for (const Class c : {Class::pass, Class::refused, Class::violated, Class::diverged, Class::inverted,
                          Class::over_force, Class::over_budget, Class::not_built}) {
      const int number = classes[section][c];
      text += number == 0 ? " |" : fmt::format(" {} |", number);
    }
    text += "\n";
  }
  text +=
      "\nRows that do not pass, without the sweep:\n\n| case | value | class | broken invariant | figure | cause |\n"
      "| --- | --- | --- | --- | --- | --- |\n";
  for (const Row& row : rows) {
    if (is_sweep(row) || row.which == Class::pass || (row.which == Class::refused && row.counts_as_good)) continue;
    const bool built = row.which != Class::not_built;
    text += fmt::format("| {} | {} | {} | {} | {} | {} |\n", row.name, in_cell(row.parameter), name_of(row.which),
                        in_cell(row.invariant), built ? in_cell(row.figure.quantity + ": " + figure_text(row)) : "",
                        in_cell(row.known.cause.empty() && built ? "not known" : row.known.cause));
  }
  text += "\n## Configurations that were rightly refused\n\n| case | value | reason |\n| --- | --- | --- |\n";
  for (const Row& row : rows) {
    if (row.which == Class::refused && row.counts_as_good)
      text += fmt::format("| {} | {} | {} |\n", row.name, in_cell(row.parameter), in_cell(row.refusal));
  }
  return text;
}

int run_stress(const StressArguments& arguments) {
  const Cache cache(arguments.cache);
  std::vector<Row> rows;
  double seconds = 0;
  for (const Case& which : chosen_cases(arguments)) {
    for (const Setting& setting : which.rows) {
      Row row = blank_row(which, setting);
      if (!setting.run || arguments.cache.empty() || !cache.find(row)) {
        row = run(which, setting);
        seconds += row.seconds;
        if (setting.run) cache.store(row);
      }
      fmt::print("{:11} {:22} {:34} {:6.1f} s  {:34} {}\n", name_of(row.which), row.name, row.parameter, row.seconds,
                 figure_text(row),
                 row.invariant.empty() ? row.figure.quantity : row.invariant + ": " + row.figure.quantity);
      std::fflush(stdout);
      rows.push_back(std::move(row));
    }
  }
  const Count count = count_of(rows);
  fmt::print(
      "{} of {} built rows pass or were rightly refused ({:.1f} %), {} rows published a number that is not finite, "
      "{:.1f} s\n",
      count.good, count.built, 100 * count.share(), count.nonfinite, seconds);
  const std::string json = to_json(rows).dump(2) + "\n";
  report::write_file(arguments.json, json);
  report::write_file(arguments.csv, to_csv(rows));
  report::write_file(arguments.markdown,
                     to_markdown(rows, arguments.quick ? "softhand report stress --quick" : "softhand report stress"));
  report::draw("stress", json, arguments.plot);
  return count.nonfinite == 0 && count.share() >= kGoodShare ? 0 : 1;
}

}  // namespace softhand::stress
