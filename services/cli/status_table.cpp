#include "cli/status_table.hpp"

#include <fmt/format.h>

#include <map>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "device/health.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"

namespace softhand {

namespace {

template <typename Items>
void append_named(std::string& line, std::string_view title, const Items& items) {
  if (items.empty()) return;
  line += fmt::format("  {}", title);
  for (const NamedValue& item : items) line += fmt::format(" {}={:.3g}", get_text(item.name), item.value);
}

// The quantities of a loop that computes physics. Empty for other loops.
std::string physics_line(const LoopStatus& status) {
  std::string line;
  if (status.iterations > 0)
    line += fmt::format("  inverted={} penetration={:.3f} mm", status.inverted_elements, status.penetration * 1e3);
  if (status.coupling_stretch > 0) line += fmt::format("  coupling stretch={:.2f} mm", status.coupling_stretch * 1e3);
  if (status.passivity_energy != 0) line += fmt::format("  passivity={:.3g} J", status.passivity_energy);
  if (status.second_writer[0] != '\0') line += fmt::format("  second writer of {}", get_text(status.second_writer));
  append_named(line, "energy J:", status.energies);
  append_named(line, "ledger J:", status.ledger);
  return line.empty() ? line : line + "\n";
}

// The fields of a status, except its module and its stamp. Empty lists are left out.
struct ToJson {
  nlohmann::ordered_json json = nlohmann::ordered_json::object();

  template <typename T>
  void field(std::string_view name, const T& value) {
    const std::string_view unit = unit_of_status(name);
    const std::string key = fmt::format("{}{}{}", name, unit.empty() ? "" : "_", unit);
    if constexpr (std::is_arithmetic_v<T>) {
      json[key] = value;
    } else if constexpr (requires { value.items; }) {
      for (const NamedValue& item : value) json[key][std::string(get_text(item.name))] = item.value;
    } else {
      json[key] = std::string(get_text(value));
    }
  }
  void field(std::string_view, const Stamp&) {}
  void key(std::string_view, const auto&) {}
};

}  // namespace

std::string status_table(const std::map<std::string, LoopStatus>& modules, Nanoseconds now) {
  std::string out = fmt::format("{:<18} {:>8} {:>8} {:>8} {:>8} {:>8} {:>7} {:>9} {:>6} {:>10} {:>5} {:>8}  {}\n",
                                "module", "rate Hz", "nominal", "p50 ms", "p99 ms", "p99.9 ms", "missed", "input ms",
                                "drops", "residual N", "iter", "contacts", "counters");
  for (const auto& [name, status] : modules) {
    const std::optional<double> silent = age_of(status.stamp.publish_time, now);
    std::string counted;
    for (const NamedValue& counter : status.counters) {
      if (get_text(counter.name) == "health" && counter.value >= 0 && counter.value < kHealthNames.size()) {
        counted += fmt::format("health={} ", kHealthNames[static_cast<std::size_t>(counter.value)]);
        continue;
      }
      const bool is_default = get_text(counter.name) == "pace" ? counter.value == 1 : counter.value == 0;
      if (!is_default) counted += fmt::format("{}={:.10g} ", get_text(counter.name), counter.value);
    }
    if (!silent) counted = "ITS CLOCK IS AHEAD";
    if (silent > 1.0) counted = fmt::format("SILENT for {:.1f} s", *silent);
    const bool solves = status.iterations > 0;
    out += fmt::format("{:<18} {:>8.1f} {:>8.1f} {:>8.3f} {:>8.3f} {:>8.3f} {:>7} {:>9} {:>6} {:>10} {:>5} {:>8}  {}\n",
                       name, status.rate_hz, status.nominal_rate_hz, status.step_ms_p50, status.step_ms_p99,
                       status.step_ms_p999, status.deadline_misses,
                       status.input_age_ms < 0 ? "-" : fmt::format("{:.1f}", status.input_age_ms), status.input_drops,
                       solves ? fmt::format("{:.2e}", status.residual) : "-",
                       solves ? fmt::format("{}", status.iterations) : "-",
                       solves ? fmt::format("{}", status.contact_count) : "-", counted);
    if (!(silent > 1.0)) out += physics_line(status);
  }
  return out;
}

std::string choices_text(const RigChoices& choices) {
  std::map<std::string_view, std::pair<std::string, std::string>> texts;  // running, others
  for (const RigChoice& each : choices.choices) {
    auto& [running, others] = texts[get_text(each.what)];
    std::string& list = each.running != 0 ? running : others;
    list += fmt::format("{}{}", list.empty() ? " " : ", ", get_text(each.choice));
  }
  std::string out;
  for (const auto& [what, text] : texts)
    out += fmt::format("{} {}:{}{}{}\n", get_text(choices.module), what, text.first.empty() ? " -" : text.first,
                       text.second.empty() ? "" : "; others:", text.second);
  return out;
}

nlohmann::ordered_json choices_json(const RigChoices& choices) {
  nlohmann::ordered_json json = nlohmann::ordered_json::object();
  for (const RigChoice& each : choices.choices)
    json[std::string(get_text(each.what))][std::string(get_text(each.choice))] = each.running != 0;
  return json;
}

nlohmann::ordered_json status_json(const LoopStatus& status) {
  ToJson out;
  visit_fields(out, status);
  return out.json;
}

std::string json_text(const nlohmann::ordered_json& json) {
  return json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace softhand
