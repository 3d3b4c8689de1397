#include "stress/stress.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <exception>
#include <iterator>
#include <limits>

#include "stress/cases.hpp"

namespace softhand::stress {

std::string_view name_of(Class which) {
  constexpr std::array<std::string_view, 8> names{"Pass",       "Violated",    "Diverged", "Inverted",
                                                  "Over force", "Over budget", "Refused",  "Not built"};
  return names[static_cast<std::size_t>(which)];
}

void classify(const Findings& findings, Row& row) {
  row.which = Class::pass;
  row.counts_as_good = true;
  row.refusal = findings.refusal;
  const auto broken = std::find_if(findings.demands.begin(), findings.demands.end(),
                                   [](const Demand& demand) { return !demand.met(); });
  if (broken != findings.demands.end()) {
    row.which = broken->otherwise;
    row.figure = *broken;
    row.invariant = broken->invariant;
    row.counts_as_good = false;
  } else if (!findings.demands.empty()) {
    row.figure = findings.demands.back();
  }
  if (findings.refusal.empty()) return;
  // A refusal is right if its own demands are met: the values that it offers must pass.
  row.which = Class::refused;
  row.counts_as_good = row.counts_as_good && findings.refusal_is_right;
}

Row blank_row(const Case& which, const Setting& setting) {
  Row row;
  row.name = which.name;
  row.section = which.section;
  row.parameter = setting.parameter;
  row.known = setting.known;
  row.timed = setting.timed;
  row.mode = setting.mode;
  if (!setting.run) row.which = Class::not_built;
  return row;
}

Row run(const Case& which, const Setting& setting) {
  Row row = blank_row(which, setting);
  if (!setting.run) return row;
  const auto started = std::chrono::steady_clock::now();
  try {
    classify(setting.run(), row);
  } catch (const std::exception& error) {
    row.which = Class::diverged;
    row.invariant = std::string("threw: ") + error.what();
    row.figure.value = std::numeric_limits<double>::quiet_NaN();
  }
  row.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return row;
}

const std::vector<Case>& all_cases() {
  static const std::vector<Case> cases = [] {
    std::vector<Case> all;
    for (auto part : {material_cases, solver_cases, tracker_cases, contact_cases, shape_cases, joint_cases, bone_cases,
                      two_hands_cases, soft_cases, world_cases, process_cases}) {
      std::vector<Case> more = part();
      all.insert(all.end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
    }
    return all;
  }();
  return cases;
}

}  // namespace softhand::stress
