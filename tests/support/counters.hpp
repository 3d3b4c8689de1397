// Counters of a status, by name.
#pragma once

#include <string_view>

#include "messages/convert.hpp"

namespace softhand::testing {

/// -1 if the status has no counter of this name.
inline double counter_of(const LoopStatus& status, std::string_view name) {
  return find_counter(status, name).value_or(-1);
}

}  // namespace softhand::testing
