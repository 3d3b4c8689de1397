#include "cli/status_table.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "messages/convert.hpp"

namespace softhand {

std::string status_table(const std::map<std::string, LoopStatus>& modules, Nanoseconds now) {
  std::string out = fmt::format("{:<18} {:>8} {:>8} {:>8} {:>8} {:>7} {:>9} {:>10} {:>5} {:>8}  {}\n", "module", "rate Hz", "nominal", "p50 ms", "p99 ms",
                                "missed", "input ms", "residual N", "iter", "contacts", "counted");
  for (const auto& [name, status] : modules) {
    const double silent = static_cast<double>(now - status.stamp.publish_time) * 1e-9;
    std::string counted;
    for (const NamedValue& counter : status.counters) {
      if (counter.value != 0) counted += fmt::format("{}={:.10g} ", get_text(counter.name), counter.value);
    }
    if (silent > 1.0) counted = fmt::format("SILENT for {:.1f} s", silent);
    const bool solves = status.iterations > 0;
    out += fmt::format("{:<18} {:>8.1f} {:>8.1f} {:>8.3f} {:>8.3f} {:>7} {:>9} {:>10} {:>5} {:>8}  {}\n", name, status.rate_hz, status.nominal_rate_hz,
                       status.step_ms_p50, status.step_ms_p99, status.deadline_misses,
                       status.input_age_ms < 0 ? "-" : fmt::format("{:.1f}", status.input_age_ms), solves ? fmt::format("{:.2e}", status.residual) : "-",
                       solves ? fmt::format("{}", status.iterations) : "-", solves ? fmt::format("{}", status.contact_count) : "-", counted);
  }
  return out;
}

nlohmann::ordered_json status_json(const LoopStatus& status) {
  nlohmann::ordered_json json{{"rate_hz", status.rate_hz},
                              {"nominal_rate_hz", status.nominal_rate_hz},
                              {"step_ms_p50", status.step_ms_p50},
                              {"step_ms_p99", status.step_ms_p99},
                              {"steps", status.steps},
                              {"deadline_misses", status.deadline_misses},
                              {"input_age_ms", status.input_age_ms},
                              {"residual_n", status.residual},
                              {"iterations", status.iterations},
                              {"solver_status", status.solver_status},
                              {"contact_count", status.contact_count},
                              {"process_id", status.process_id}};
  for (const NamedValue& energy : status.energies) json["energies_j"][std::string(get_text(energy.name))] = energy.value;
  for (const NamedValue& counter : status.counters) json["counters"][std::string(get_text(counter.name))] = counter.value;
  return json;
}

}  // namespace softhand
