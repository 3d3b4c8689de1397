// Described options as JSON. This is apart from config.hpp, because the JSON library takes the compiler 0.8 s per unit.
#pragma once

#include <nlohmann/json.hpp>

#include "runtime/config.hpp"

namespace softhand {

namespace config_detail {
nlohmann::ordered_json to_json(const Description& description);
}

/// All effective values in the order of the description, for the summary of a run.
template <typename T>
nlohmann::ordered_json options_to_json(const T& options) {
  T copy = options;
  return config_detail::to_json([&copy](OptionVisitor& v) { describe(v, copy); });
}

}  // namespace softhand
