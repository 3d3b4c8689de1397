// What can be done with described options (options.hpp): read TOML, override one key, print the reference page, dump
// effective values. One description serves all four, so they cannot disagree. All of this runs before the loops start.
#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "runtime/options.hpp"

namespace softhand {

/// A configuration that cannot be used. what() names file and line or override, key, what was expected and what stood
/// there; several errors stand on a line each.
class ConfigError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// One `--set`, kept for the run's summary. Values are written as in TOML.
struct AppliedOverride {
  std::string key;
  std::string before;
  std::string after;
};

namespace config_detail {
using Description = std::function<void(OptionVisitor&)>;
void read_toml_text(const Description& description, std::string_view text, const std::string& path,
                    const std::vector<std::string_view>& foreign);
std::string read_whole_file(const std::string& path);
AppliedOverride apply_override(const Description& description, std::string_view assignment);
std::string reference_markdown(const Description& description, std::string_view title);
nlohmann::ordered_json to_json(const Description& description);
}  // namespace config_detail

/// Reads TOML `text` into `options`; `path` only names it in errors. Keys that are missing keep their values; an array
/// of tables overlays the elements that are there already, in order, and appends the rest. Unknown keys (with the
/// nearest known one), wrong types, values out of range and non-finite numbers are refused together, sorted by line.
/// Throws ConfigError, and then `options` is unchanged. `foreign` are top-level keys of a shared file (a scene) that
/// other programs read: they are passed over.
template <typename T>
void read_toml_text(T& options, std::string_view text, const std::string& path,
                    const std::vector<std::string_view>& foreign = {}) {
  T fresh = options;
  config_detail::read_toml_text([&fresh](OptionVisitor& v) { describe(v, fresh); }, text, path, foreign);
  options = std::move(fresh);
}

/// The same from the file at `path`. Throws ConfigError also when it cannot be read.
template <typename T>
void read_toml(T& options, const std::string& path, const std::vector<std::string_view>& foreign = {}) {
  read_toml_text(options, config_detail::read_whole_file(path), path, foreign);
}

/// Applies `--set dotted.path=value`, e.g. `hand.rate_hz=90`, `objects.0.mass=0.1`, or `objects.cube.mass=0.1` where an
/// element of the list has the string key `name = "cube"`. The value is written as in TOML; strings may go without
/// quotes. Throws ConfigError that names the key and what was expected, and then `options` is unchanged.
template <typename T>
AppliedOverride apply_override(T& options, std::string_view assignment) {
  T fresh = options;
  AppliedOverride applied =
      config_detail::apply_override([&fresh](OptionVisitor& v) { describe(v, fresh); }, assignment);
  options = std::move(fresh);
  return applied;
}

/// A markdown table of every key of T with default, unit, range and meaning; the same bytes for the same T.
template <typename T>
std::string reference_markdown(std::string_view title) {
  T defaults{};
  return config_detail::reference_markdown([&defaults](OptionVisitor& v) { describe(v, defaults); }, title);
}

/// Every effective value, in the order of description, for a run's summary.
template <typename T>
nlohmann::ordered_json options_to_json(const T& options) {
  T copy = options;
  return config_detail::to_json([&copy](OptionVisitor& v) { describe(v, copy); });
}

}  // namespace softhand
