// What `softhand trackers` knows about the trackers of a domain.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>

#include "cli/module_table.hpp"
#include "device/health.hpp"
#include "messages/messages.hpp"

namespace softhand {

struct TrackerRow {
  std::uint64_t epoch = 0;  ///< of its process
  std::uint32_t user = 0;
  int strength = 0;
  Health health = Health::opening;
  double rate_hz = 0;  ///< published hands per second
  double age_ms = -1;  ///< of its newest sample; negative: none
  double confidence = 0;
  std::array<bool, 2> owns{};  ///< left, right
  Nanoseconds heard = 0;       ///< publish time of its newest status
  // For the rate: number of published hands at a time.
  double published = 0;
  Nanoseconds counted = 0;
};

/// Start of the motion that a tracker plays, on its clock. Empty if the status tells none.
std::optional<Nanoseconds> motion_start_of(const LoopStatus& status);

class TrackerTable {
 public:
  /// Statuses of other modules than trackers are ignored, and those with numbers that no tracker has. `now`: time of
  /// reception.
  void add(const LoopStatus& status, Nanoseconds now);
  /// A sample that readers get: its writer owns the hand.
  void add(const Skeleton& hand);

  const std::map<std::string, TrackerRow>& trackers() const { return table_.rows(); }
  bool owns(const std::string& module) const;
  /// "the right hand of user 0"
  std::string hands_of(const std::string& module) const;
  /// The least strength with which the tracker is stronger than all other live ones of its user; its present one if it
  /// already is. Empty if there is no such live tracker.
  std::optional<int> strength_to_own(const std::string& module, Nanoseconds now) const;
  std::string text(Nanoseconds now) const;

 private:
  ModuleTable<TrackerRow> table_;
};

}  // namespace softhand
