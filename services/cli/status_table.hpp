// How loop_status is shown: to people as a table, to programs as JSON.
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "messages/messages.hpp"

namespace softhand {

/// A line a module, and below it what a loop of physics knows of its energies; one that has been silent for more than a
/// second says so. `now` on the messages' clock.
std::string status_table(const std::map<std::string, LoopStatus>& modules, Nanoseconds now);
/// rate_hz, step_ms_p50, step_ms_p99, deadline_misses, ..., energies_j, ledger_j, counters.
nlohmann::ordered_json status_json(const LoopStatus& status);
/// `json` indented, whatever its texts hold: DDS says nothing of a string's encoding, and a name that is not UTF-8 gets
/// U+FFFD where it is none.
std::string json_text(const nlohmann::ordered_json& json);

}  // namespace softhand
