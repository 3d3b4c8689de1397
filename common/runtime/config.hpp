// Uses of described options (options.hpp): read TOML, override one key, print the reference page, and in
// config_json.hpp dump effective values. One description serves all four uses, so they cannot disagree. All of this
// runs before the loops start.
#pragma once

#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "runtime/options.hpp"

namespace softhand {

/// An invalid configuration. what() names the file and line or the override, the key, the expected value and the value
/// found. Several errors have one line each.
class ConfigError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// One `--set`, kept for the summary of the run. Values are written as in TOML.
struct AppliedOverride {
  std::string key;
  std::string before;
  std::string after;
};

/// Says whether a top-level key of a shared file belongs to another program.
using ForeignKey = std::function<bool(std::string_view)>;

/// A top-level array of tables in which each table has a `name` and keys of the whole file. One of the tables is
/// chosen. Its keys replace those of the file.
struct Variants {
  std::string list;                ///< key of the array
  std::string chosen;              ///< name; empty: the first
  std::vector<std::string> names;  ///< of all, as read
};

namespace config_detail {
using Description = std::function<void(OptionVisitor&)>;
void read_toml_text(const Description& description, std::string_view text, const std::string& path,
                    const ForeignKey& foreign, Variants* variants);
std::string read_whole_file(const std::string& path);
AppliedOverride apply_override(const Description& description, std::string_view assignment);
std::string reference_markdown(const Description& description, std::string_view title);
}  // namespace config_detail

/// Reads TOML `text` into `options`. `path` is used only in error messages.
///
/// Missing keys keep their values. An array of tables overwrites the existing elements in order and appends the rest.
/// Top-level keys that `foreign` accepts and `options` does not have are ignored. Null accepts none. If `variants` is
/// not null, the chosen one is read after the file. An unknown name is an error.
///
/// Unknown keys, wrong types, values out of range and non-finite numbers are errors. They are reported together, sorted
/// by line. For an unknown key the message suggests the nearest known key. On errors, throws ConfigError and does not
/// change `options`.
template <typename T>
void read_toml_text(T& options, std::string_view text, const std::string& path, const ForeignKey& foreign = nullptr,
                    Variants* variants = nullptr) {
  T fresh = options;
  config_detail::read_toml_text([&fresh](OptionVisitor& v) { describe(v, fresh); }, text, path, foreign, variants);
  options = std::move(fresh);
}

/// The same for the file at `path`. Also throws ConfigError if the file cannot be read.
template <typename T>
void read_toml(T& options, const std::string& path, const ForeignKey& foreign = nullptr) {
  read_toml_text(options, config_detail::read_whole_file(path), path, foreign);
}

/// Applies `--set dotted.path=value`, for example `hand.rate_hz=90` or `objects.0.mass=0.1`. If an element of a list
/// has the string key `name = "cube"`, `objects.cube.mass=0.1` also works. The value is written as in TOML; strings may
/// be without quotes. On errors, throws ConfigError, which names the key and what was expected, and does not change
/// `options`.
template <typename T>
AppliedOverride apply_override(T& options, std::string_view assignment) {
  T fresh = options;
  AppliedOverride applied =
      config_detail::apply_override([&fresh](OptionVisitor& v) { describe(v, fresh); }, assignment);
  options = std::move(fresh);
  return applied;
}

/// A Markdown table of every key of T with default, unit, range and meaning. The output is deterministic.
template <typename T>
std::string reference_markdown(std::string_view title, T defaults = {}) {
  return config_detail::reference_markdown([&defaults](OptionVisitor& v) { describe(v, defaults); }, title);
}

}  // namespace softhand
