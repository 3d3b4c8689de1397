// Shows loop_status as a table for people, or as JSON for programs.
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "messages/messages.hpp"

namespace softhand {

/// One line per module. A second line shows the energies of a loop that computes physics. A module that has been silent
/// for more than one second is marked as SILENT. `now` is on the clock of the messages.
std::string status_table(const std::map<std::string, LoopStatus>& modules, Nanoseconds now);
/// What can be chosen in the rig, one line for each key of a message. The running choice is first.
std::string choices_text(const RigChoices& choices);
/// {WHAT: {CHOICE: whether it runs, ...}, ...}
nlohmann::ordered_json choices_json(const RigChoices& choices);
/// Every field of the status except module and stamp: rate_hz, step_ms_p50, ..., energies_j, ledger_j, counters.
nlohmann::ordered_json status_json(const LoopStatus& status);
/// `json` as indented text. DDS does not define the encoding of a string, so invalid UTF-8 in a text is replaced by
/// U+FFFD.
std::string json_text(const nlohmann::ordered_json& json);

}  // namespace softhand
