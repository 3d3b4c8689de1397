// What a command knows about each module of a domain, by the name of the module.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include "bus/topics.hpp"

namespace softhand {

/// Anybody on the domain can invent modules. So modules that nobody expects get `kMost` places. A new one takes the
/// place of the one that was silent for the longest time, if that was at least a second. Otherwise its statuses are
/// refused and counted. An expected module always has a place.
template <typename Row>
class ModuleTable {
 public:
  static constexpr std::size_t kMost = 2 * bus::topics::loop_status.max_instances;  ///< as many as a reader follows

  /// Modules that the command started itself. Replaces the former list.
  void expect(std::set<std::string> names) { expected_ = std::move(names); }

  /// The row of the module that has just reported at `now`. Null if it gets no place.
  Row* of(std::string_view name, Nanoseconds now) {
    const std::string module(name);
    if (rows_.count(module) == 0 && expected_.count(module) == 0 && !make_room(now)) {
      ++refused_;
      return nullptr;
    }
    heard_[module] = now;
    return &rows_[module];
  }
  const std::map<std::string, Row>& rows() const { return rows_; }
  std::map<std::string, Row>& rows() { return rows_; }
  /// Number of refused statuses.
  std::uint64_t refused() const { return refused_; }
  void clear() {
    rows_.clear();
    heard_.clear();
  }

 private:
  static constexpr Nanoseconds kRest = 1'000'000'000;

  bool make_room(Nanoseconds now) {
    auto oldest = heard_.end();
    std::size_t strangers = 0;
    for (auto each = heard_.begin(); each != heard_.end(); ++each) {
      if (expected_.count(each->first) != 0) continue;
      ++strangers;
      if (oldest == heard_.end() || each->second < oldest->second) oldest = each;
    }
    if (strangers < kMost) return true;
    if (now - oldest->second < kRest) return false;
    rows_.erase(oldest->first);
    heard_.erase(oldest);
    return true;
  }

  std::map<std::string, Row> rows_;
  std::map<std::string, Nanoseconds> heard_;
  std::set<std::string> expected_;
  std::uint64_t refused_ = 0;
};

}  // namespace softhand
