// Options. Each option is described once in code, with default, unit, range and text. The same description reads TOML,
// applies `--set` overrides and prints the reference page.
//
// A struct of options has plain members with their defaults. Beside it stands one overload
// `void describe(OptionVisitor&, T&)`:
//
//   struct TrackingOptions { double rate_hz = 1000; };
//   inline void describe(OptionVisitor& v, TrackingOptions& o) {
//     v.number("rate_hz", o.rate_hz, "Hz", {1, 10000}, "Rate of the tracking loop.");
//   }
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace softhand {

/// Inclusive range of a number. NaN is outside every range.
struct Range {
  double minimum = -std::numeric_limits<double>::infinity();
  double maximum = std::numeric_limits<double>::infinity();
};

class OptionVisitor {
 public:
  virtual ~OptionVisitor() = default;
  virtual void number(std::string_view key, double& value, std::string_view unit, Range range,
                      std::string_view text) = 0;
  virtual void integer(std::string_view key, std::int64_t& value, std::string_view unit, Range range,
                       std::string_view text) = 0;
  virtual void flag(std::string_view key, bool& value, std::string_view text) = 0;
  virtual void string(std::string_view key, std::string& value, std::string_view text) = 0;
  /// A string with a check. `check` returns an empty text, or what is expected instead.
  using Check = std::function<std::string(const std::string&)>;
  virtual void string(std::string_view key, std::string& value, const Check& check, std::string_view text) = 0;
  /// A string that must be one of `allowed`.
  virtual void choice(std::string_view key, std::string& value, std::vector<std::string_view> allowed,
                      std::string_view text) = 0;
  /// A fixed number of numbers, for example a vector or a quaternion xyzw.
  virtual void numbers(std::string_view key, double* values, std::size_t count, std::string_view unit, Range range,
                       std::string_view text) = 0;
  /// A table `[key]`.
  virtual void section(std::string_view key, std::string_view text,
                       const std::function<void(OptionVisitor&)>& members) = 0;
  /// An array of tables `[[key]]`: `append` adds a default element, `element(i)` describes the i-th.
  virtual void list(std::string_view key, std::string_view text, const std::function<std::size_t()>& size,
                    const std::function<void()>& append,
                    const std::function<void(OptionVisitor&, std::size_t)>& element) = 0;
};

/// Shorthands for a section in a member struct and for a list in a vector.
template <typename T>
void describe_section(OptionVisitor& v, std::string_view key, std::string_view text, T& value) {
  v.section(key, text, [&value](OptionVisitor& inner) { describe(inner, value); });
}
template <typename T>
void describe_list(OptionVisitor& v, std::string_view key, std::string_view text, std::vector<T>& values) {
  v.list(
      key, text, [&values] { return values.size(); }, [&values] { values.emplace_back(); },
      [&values](OptionVisitor& inner, std::size_t i) { describe(inner, values[i]); });
}

}  // namespace softhand
