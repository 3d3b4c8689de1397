// Counts of refused packets by reason.
#pragma once

#include <array>
#include <cstdint>
#include <numeric>
#include <string>
#include <string_view>

#include "messages/convert.hpp"

namespace softhand {

/// `Reason` is an enum that begins with `none`. `names` has the name of each of its values.
template <typename Reason, std::size_t count>
class Refusals {
 public:
  explicit Refusals(const std::array<std::string_view, count>& names) {
    for (std::size_t i = 0; i < count; ++i) names_[i] = "refused_" + std::string(names[i]);
  }

  /// Counts the reason unless it is `none`. Returns true if it is `none`.
  bool accepted(Reason reason) {
    if (reason == Reason::none) return true;
    ++counts_[static_cast<std::size_t>(reason)];
    return false;
  }
  std::uint64_t total() const { return std::accumulate(counts_.begin(), counts_.end(), std::uint64_t{0}); }
  /// Adds a counter refused_<name> for each reason, and refused_size. `too_large` packets were refused unread. Does not
  /// allocate.
  void fill_status(LoopStatus& status, std::uint64_t too_large) const {
    for (std::size_t i = 1; i < count; ++i) {
      if (names_[i] == "refused_size") {
        too_large += counts_[i];
      } else {
        add_counter(status, names_[i], static_cast<double>(counts_[i]));
      }
    }
    add_counter(status, "refused_size", static_cast<double>(too_large));
  }

 private:
  std::array<std::string, count> names_;
  std::array<std::uint64_t, count> counts_{};
};

/// The report that `read(Report&)` fills, or one with nothing but its refusal.
template <typename Report, typename Read>
Report report_or_refusal(Read&& read) {
  Report out;
  const auto refusal = read(out);
  if (refusal != decltype(refusal){}) out = Report{};
  out.refusal = refusal;
  return out;
}

}  // namespace softhand
