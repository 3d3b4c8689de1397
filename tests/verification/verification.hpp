// Known answers: cases whose exact result is known, run through the project's own code. One library for the tests and
// for `softhand report verify`.
//
// A case has a table of parameters, one run a row of it; each run measures one or more quantities and computes the
// reference of each from the formula that `statement` names. Nothing here knows how rows are printed. Everything SI.
#pragma once

#include <cmath>
#include <functional>
#include <initializer_list>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace softhand::verification {

/// By name; integers are whole doubles.
class Parameters {
 public:
  Parameters(std::initializer_list<std::pair<const std::string, double>> values) : values_(values) {}
  /// std::out_of_range, naming the key, where there is none.
  double operator[](const std::string& key) const;
  int whole(const std::string& key) const { return static_cast<int>(std::lround((*this)[key])); }
  /// std::invalid_argument, with the known keys, where there is none.
  void set(const std::string& key, double value);
  /// These and one more, or another value of one.
  Parameters with(const std::string& key, double value) const;
  const std::map<std::string, double>& values() const { return values_; }
  bool operator==(const Parameters&) const = default;
  /// Whether each of `others` is among these with its value.
  bool include(const Parameters& others) const;

 private:
  std::map<std::string, double> values_;
};

/// The observed order of convergence, where a quantity is a limit.
struct Order {
  double observed = 0;
  double expected = 1;
  double tolerance = 0.1;
};

struct Measurement {
  std::string quantity;
  double value = std::numeric_limits<double>::quiet_NaN();
  double reference = 0;
  double tolerance = 0;  ///< absolute, in `unit`
  std::string unit;
  std::optional<Order> order;
};

/// A quantity that is known to miss its reference today, in the rows whose parameters include `where`, and why. It
/// stays in the report as failed.
struct KnownFailure {
  std::string quantity;
  Parameters where;
  std::string reason;
};

inline constexpr std::size_t kAll = std::numeric_limits<std::size_t>::max();

struct Case {
  std::string name;       ///< unique
  std::string statement;  ///< the formula of the reference, or the law, in a line
  std::vector<Parameters> table;
  std::function<std::vector<Measurement>(const Parameters&)> run;
  std::size_t quick_rows = kAll;  ///< so many rows of the table are run with `quick`
  std::vector<KnownFailure> known_failures{};
};

struct Row {
  std::string name;
  std::string statement;
  Parameters parameters{};
  Measurement measurement;
  double seconds = 0;         ///< of computing the run that it belongs to
  std::string error;          ///< what the run threw, instead of a value
  std::string known_failure;  ///< the reason, of a row that is known to fail; else empty

  /// Value within tolerance of the reference and, where there is one, the order within its own.
  bool passed() const;
};

/// Every case, in the order of the report.
const std::vector<Case>& all_cases();

/// The rows of one case. A run that throws is a failed row.
std::vector<Row> run(const Case& which, bool quick);

}  // namespace softhand::verification
