// Known answers: cases with a known exact result, run through the project's own code. One library serves the tests and
// `softhand report verify`.
//
// A case has a table of parameters, with one run per row. Each run measures one or more quantities. It computes each
// reference from the formula in `statement`. This library does not know how rows are printed. All quantities are in SI
// units.
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

/// Values by name. Integers are stored as whole doubles.
class Parameters {
 public:
  Parameters(std::initializer_list<std::pair<const std::string, double>> values) : values_(values) {}
  /// Throws std::out_of_range with the key if the key is missing.
  double operator[](const std::string& key) const;
  int whole(const std::string& key) const { return static_cast<int>(std::lround((*this)[key])); }
  /// Throws std::invalid_argument with the known keys if the key is missing.
  void set(const std::string& key, double value);
  /// A copy with one parameter added or changed.
  Parameters with(const std::string& key, double value) const;
  const std::map<std::string, double>& values() const { return values_; }
  bool operator==(const Parameters&) const = default;
  /// True if each of `others` is among these parameters with the same value.
  bool include(const Parameters& others) const;

 private:
  std::map<std::string, double> values_;
};

/// The observed order of convergence of a quantity that is a limit.
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

/// A quantity that is known to miss its reference today, and the reason. It applies to rows whose parameters include
/// `where`. The report still shows the row as failed.
struct KnownFailure {
  std::string quantity;
  Parameters where;
  std::string reason;
};

inline constexpr std::size_t kAll = std::numeric_limits<std::size_t>::max();

struct Case {
  std::string name;       ///< unique
  std::string statement;  ///< the formula of the reference, or the law, in one line
  std::vector<Parameters> table;
  std::function<std::vector<Measurement>(const Parameters&)> run;
  std::size_t quick_rows = kAll;  ///< number of rows that run with `quick`
  std::vector<KnownFailure> known_failures{};
};

struct Row {
  std::string name;
  std::string statement;
  Parameters parameters{};
  Measurement measurement;
  double seconds = 0;         ///< computing time of the run that the row belongs to
  std::string error;          ///< message of an exception that the run threw
  std::string known_failure;  ///< reason of a known failure; else empty

  /// True if the value is within tolerance of the reference and the order, if there is one, is within its own
  /// tolerance.
  bool passed() const;
};

/// All cases in the order of the report.
const std::vector<Case>& all_cases();

/// Runs the rows of one case. A run that throws gives a failed row.
std::vector<Row> run(const Case& which, bool quick);

}  // namespace softhand::verification
