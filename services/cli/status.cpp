#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "bus/bus.hpp"
#include "cli/commands.hpp"
#include "cli/module_table.hpp"
#include "cli/status_table.hpp"
#include "cli/terminal_text.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "runtime/signals.hpp"

namespace softhand {
namespace {

// One line for each other host.
std::string clock_lines(const bus::Participant& participant) {
  std::string out;
  const std::vector<bus::Peer> peers = participant.peers();
  for (const HostClock& clock : participant.clocks()) {
    const auto is_there = [&clock](const bus::Peer& peer) { return peer.clock_id == clock.clock_id; };
    const auto peer = std::find_if(peers.begin(), peers.end(), is_there);
    out += fmt::format("clock of {} ({:08x}): ", peer == peers.end() ? "a host" : get_text(peer->host), clock.clock_id);
    out += is_known(clock)
               ? fmt::format("offset {:+.6f} s +- {:.3f} ms, drift {:+.1f} ppm\n",
                             1e-9 * static_cast<double>(clock.offset), 1e3 * clock.uncertainty, 1e6 * clock.drift)
               : "unknown\n";
  }
  return out;
}

}  // namespace

int run_status(const StatusArguments& arguments) {
  const StopSignal stop;
  const bus::Participant participant("softhand status");
  bus::Reader reader(participant, bus::topics::loop_status);
  bus::Reader choices_reader(participant, bus::topics::rig_choices);
  ModuleTable<LoopStatus> table;
  ModuleTable<RigChoices> rigs;
  const auto& modules = table.rows();
  const bool terminal = isatty(STDOUT_FILENO) != 0;
  // A snapshot waits long enough to discover every writer and to receive one message of each. A handshake with each of
  // them takes longer.
  const std::chrono::milliseconds discovery(bus::network_from_environment().security.empty() ? 1500 : 4000);
  const auto started = std::chrono::steady_clock::now();
  while (!stop.requested()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(250));
    reader.take_all([&table, at = now()](const LoopStatus& status) {
      if (LoopStatus* const known = table.of(get_text(status.module), at)) *known = status;
    });
    choices_reader.take_all([&rigs, at = now()](const RigChoices& choices) {
      if (RigChoices* const known = rigs.of(get_text(choices.module), at)) *known = choices;
    });
    const bool snapshot = arguments.once || arguments.json;
    if (snapshot && std::chrono::steady_clock::now() - started < discovery) continue;
    if (arguments.json) {
      nlohmann::ordered_json json = nlohmann::ordered_json::object();
      for (const auto& [name, status] : modules) {
        json[name] = status_json(status);
        if (const auto rig = rigs.rows().find(name); rig != rigs.rows().end())
          json[name]["choices"] = choices_json(rig->second);
      }
      fmt::print("{}\n", json_text(json));
    } else {
      if (terminal && !snapshot) fmt::print("\x1b[H\x1b[2J");
      std::string text = status_table(modules, now()) + clock_lines(participant);
      if (modules.empty()) text += "no module found on this domain\n";
      for (const auto& [name, choices] : rigs.rows()) text += choices_text(choices);
      fmt::print("{}", terminal_text(text));
    }
    if (table.refused() > 0)
      fmt::print(arguments.json ? stderr : stdout, "{} statuses of further modules refused: only {} modules fit\n",
                 table.refused(), table.kMost);
    if (std::fflush(stdout) != 0) return 1;  // nobody reads: SIGPIPE is ignored
    if (snapshot) return modules.empty() ? 1 : 0;
  }
  return 0;
}

}  // namespace softhand
