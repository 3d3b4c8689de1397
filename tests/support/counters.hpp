// Counters of a status, by name.
#pragma once

#include <string_view>

#include "messages/messages.hpp"

namespace softhand::testing {

/// -1 if the status has no counter of this name.
inline double counter_of(const LoopStatus& status, std::string_view name) {
  for (const NamedValue& counter : status.counters) {
    if (get_text(counter.name) == name) return counter.value;
  }
  return -1;
}

}  // namespace softhand::testing
