#include "human/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "human/fingertip.hpp"
#include "human/posture.hpp"
#include "report/report.hpp"
#include "scene/simulation_options.hpp"

namespace softhand::human {
namespace {

// The compared indentations, and further ones without measurements.
constexpr double kShown[] = {0.25e-3, 0.5e-3, 0.75e-3, 1e-3, 1.25e-3, 1.5e-3, 1.75e-3, 2e-3, 2.25e-3, 2.5e-3};

struct Row {
  std::string hand;
  Press press;
  bool compared = false;
  double force_error() const { return std::abs(std::log(press.force / measured_force(press.indentation))); }
  const char* status() const { return !compared ? "not compared" : passed() ? "pass" : "fail"; }
  bool passed() const { return !compared || force_error() <= std::log(kForceSpread); }
};

struct HandResult {
  std::string name;
  PulpMaterial pulp;
  double residual = 0;
};

std::string text_of(const PulpMaterial& pulp) {
  return fmt::format("youngs_modulus={:.6g} limit_energy={:.6g} limit_ratio={:.4g}", pulp.youngs_modulus,
                     pulp.limit_energy, pulp.limit_ratio);
}

std::vector<std::string> chosen_hands(const std::vector<std::string>& asked) {
  if (!asked.empty()) return asked;
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(SOFTHAND_SOURCE_DIR "/config/hands")) {
    if (entry.path().filename().string().rfind("right_", 0) == 0) files.push_back(entry.path().string());
  }
  // Sorts by size: the shorter number comes first.
  std::sort(files.begin(), files.end(),
            [](const std::string& a, const std::string& b) { return std::pair(a.size(), a) < std::pair(b.size(), b); });
  return files;
}

void set_pulp(PulpMaterial& pulp, const std::string& setting) {
  const std::size_t equals = setting.find('=');
  const std::string key = setting.substr(0, equals);
  double* value = key == "youngs_modulus" ? &pulp.youngs_modulus
                  : key == "limit_energy" ? &pulp.limit_energy
                  : key == "limit_ratio"  ? &pulp.limit_ratio
                                          : nullptr;
  char* end = nullptr;
  const double number = equals == std::string::npos ? 0 : std::strtod(setting.c_str() + equals + 1, &end);
  if (value == nullptr || end == nullptr || *end != '\0' || !(number > 0)) {
    throw std::invalid_argument(
        "'" + setting + "': expected KEY=NUMBER, KEY one of youngs_modulus, limit_energy, limit_ratio, NUMBER > 0");
  }
  *value = number;
}

nlohmann::ordered_json to_json(const std::vector<Row>& rows) {
  auto list = nlohmann::ordered_json::array();
  for (const Row& row : rows) {
    const double force = measured_force(row.press.indentation), area = measured_area(row.press.force);
    list.push_back({{"hand", row.hand},
                    {"indentation", row.press.indentation},
                    {"force", row.press.force},
                    {"force_reference", force},
                    {"force_spread", kForceSpread},
                    {"area", row.press.area},
                    {"area_reference", area},
                    {"area_spread", kAreaSpread},
                    {"compared", row.compared},
                    {"status", row.status()}});
  }
  return list;
}

std::string to_csv(const std::vector<Row>& rows) {
  std::string text = "hand,indentation_m,force_n,force_reference_n,area_m2,area_reference_m2,compared,status\n";
  for (const Row& row : rows) {
    text += fmt::format("{},{:.6g},{:.9g},{:.9g},{:.9g},{:.9g},{},{}\n", report::in_quotes(row.hand),
                        row.press.indentation, row.press.force, measured_force(row.press.indentation), row.press.area,
                        measured_area(row.press.force), row.compared, row.status());
  }
  return text;
}

std::string to_markdown(const std::vector<Row>& rows, const std::vector<HandResult>& hands,
                        const std::string& command) {
  const report::Provenance from = report::provenance();
  std::string text = fmt::format("## Simulated and human fingertips\n\n`{}` on {}, {}, commit {}.\n\n", command,
                                 from.processor, from.compiler, from.commit);
  text += "![Force over indentation and contact area over force](images/human.png)\n\n";
  text +=
      "The table shows the force in N at an indentation, and in brackets the contact area in mm^2. The area in the row "
      "`people`\nbelongs to the force of that row. `residual` is the RMS of log(force / human force).\n\n"
      "docs/human-data.md describes the accuracy of the human data and the fit of the pulp. It also describes the "
      "effects that\nneither elastic tissue nor a constant coefficient of friction can show.\n\n| hand |";
  for (const double d : kShown) text += fmt::format(" {:.2f} mm |", d * 1e3);
  text += " residual |\n| --- |";
  for (std::size_t i = 0; i <= std::size(kShown); ++i) text += " --- |";
  text += "\n| people |";
  for (const double d : kShown) {
    const double force = measured_force(d);
    text += d <= kCompared[std::size(kCompared) - 1]
                ? fmt::format(" {:.2f} ({:.0f}) |", force, measured_area(force) * 1e6)
                : " |";
  }
  text += " |\n";
  for (const HandResult& hand : hands) {
    text += "| " + hand.name + " |";
    for (const Row& row : rows) {
      if (row.hand != hand.name) continue;
      text +=
          fmt::format(" {}{:.2f} ({:.0f}) |", row.passed() ? "" : "**fail** ", row.press.force, row.press.area * 1e6);
    }
    text += fmt::format(" {:.3f} |\n", hand.residual);
  }
  return text;
}

}  // namespace

int run_human(const HumanArguments& arguments) {
  std::vector<HandModel> hands;
  std::vector<Fingertip> tips;
  for (const std::string& file : chosen_hands(arguments.hands)) {
    hands.push_back(load_hand(file));
    tips.emplace_back(hands.back(), SimulationOptions{}.contact_stiffness);
  }
  std::optional<PulpMaterial> tried;  // replaces each hand's own material
  if (arguments.fit || !arguments.pulp.empty()) {
    tried = pulp_of(hands.front());
    for (const std::string& setting : arguments.pulp) set_pulp(*tried, setting);
  }
  if (arguments.fit) {
    const PulpFit fit = fit_pulp(tips, *tried);
    fmt::print("one pulp for all, fitted from {} (residual {:.4f}) in {} evaluations: {}, residual {:.4f}\n\n",
               text_of(*tried), residual(tips, *tried), fit.evaluations, text_of(fit.pulp), fit.residual);
    tried = fit.pulp;
  }
  std::vector<Row> rows;
  std::vector<HandResult> results;
  for (std::size_t h = 0; h < hands.size(); ++h) {
    const PulpMaterial pulp = tried ? *tried : pulp_of(hands[h]);
    results.push_back({hands[h].name, pulp, residual({&tips[h], 1}, pulp)});
    fmt::print("{}: {}, residual {:.3f}\n", hands[h].name, text_of(pulp), results.back().residual);
    for (const Press& press : tips[h].press(pulp, kShown)) {
      rows.push_back({hands[h].name, press, press.indentation <= kCompared[std::size(kCompared) - 1]});
      const Row& row = rows.back();
      fmt::print("{:4}  {:12} {:5.2f} mm  {:7.3f} N ({})  {:6.1f} mm^2 (people {:.1f})\n",
                 row.compared ? (row.passed() ? "pass" : "fail") : "", row.hand, press.indentation * 1e3, press.force,
                 row.compared ? fmt::format("people {:.3f}, allowed factor {:.1f}", measured_force(press.indentation),
                                            kForceSpread)
                              : "not measured",
                 press.area * 1e6, measured_area(press.force) * 1e6);
    }
    std::fflush(stdout);
  }
  const std::string json = to_json(rows).dump(2) + "\n";
  report::write_file(arguments.json, json);
  report::write_file(arguments.csv, to_csv(rows));
  report::write_file(
      arguments.markdown,
      to_markdown(rows, results, arguments.fit ? "softhand report human --fit" : "softhand report human"));
  report::draw("human", json, arguments.plot);
  return std::all_of(rows.begin(), rows.end(), [](const Row& row) { return row.passed(); }) ? 0 : 1;
}

int run_postures(const PostureArguments& arguments) {
  constexpr double kMostSkinStrain = 0.6;
  std::string text =
      "| hand | posture | skin max (p95) | tissue max (p95) | beyond limit | inverted | iterations p50 (most) | missed "
      "|\n"
      "| --- | --- | --- | --- | --- | --- | --- | --- |\n";
  fmt::print("{}", text);
  bool good = true;
  for (const std::string& file : chosen_hands(arguments.hands)) {
    const HandModel hand = load_hand(file);
    for (const PostureResult& r : hold_postures(hand)) {
      const std::string row =
          fmt::format("| {} | {} | {:.2f} ({:.2f}) | {:.2f} ({:.2f}) | {:.0f} % | {} | {:.0f} ({}) | {:.1f} deg |\n",
                      hand.name, r.posture, r.skin_max, r.skin_p95, r.tissue_max, r.tissue_p95, r.beyond_limit * 100,
                      r.inverted_most, r.iterations_p50, r.iterations_most, r.missed * 180 / M_PI);
      fmt::print("{}", row);
      std::fflush(stdout);
      text += row;
      good = good && r.skin_max <= kMostSkinStrain && r.inverted_most == 0;
    }
  }
  report::write_file(arguments.markdown, text);
  return good ? 0 : 1;
}

}  // namespace softhand::human
