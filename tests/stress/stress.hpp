// Stress cases: extreme inputs through the real loops and the shipped hand. Each row is classified by the invariants G1
// to G8. One library serves the tests and `softhand report stress`. docs/stress.md defines invariants and classes.
//
// A case is a list of rows. A row is one value of the case's parameter. A row runs and returns its demands and
// findings. This library does not know how rows are printed. All quantities are in SI units unless `unit` says
// otherwise.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace softhand::stress {

/// Work of a step in the mode "live budget", fast steps: the least with which hand.model = "auto" takes a hand.
inline constexpr double kLiveBudget = 2;

enum class Class { pass, violated, diverged, inverted, over_force, over_budget, refused, not_built };
std::string_view name_of(Class which);

/// A condition that must hold, and the value that was found.
struct Demand {
  std::string invariant;  ///< G1 to G8, or the name of a demand that belongs to this case only
  std::string quantity;
  double value = 0;
  double limit = 0;  ///< largest allowed `value`, or the smallest allowed one with `at_least`
  std::string unit;
  bool at_least = false;
  Class otherwise = Class::violated;  ///< class of the row if this demand is not met

  /// NaN meets no demand.
  bool met() const { return at_least ? value >= limit : value <= limit; }
};

/// Result of one run. The demands are ordered by severity, most severe first. The last demand is the case's own figure,
/// and the row shows this figure if all demands are met.
struct Findings {
  std::vector<Demand> demands;
  /// Reason why the configuration was refused at load. Empty if the run took place.
  std::string refusal;
  /// True in two cases. The case demands the refusal, or the refusal names a growth factor above one and the values
  /// that it offers passed.
  bool refusal_is_right = false;

  void demand(std::string invariant, std::string quantity, double value, double limit, std::string unit,
              Class otherwise = Class::violated) {
    demands.push_back({std::move(invariant), std::move(quantity), value, limit, std::move(unit), false, otherwise});
  }
  void demand_at_least(std::string invariant, std::string quantity, double value, double limit, std::string unit,
                       Class otherwise = Class::violated) {
    demands.push_back({std::move(invariant), std::move(quantity), value, limit, std::move(unit), true, otherwise});
  }
};

/// A row that is known to fail today, and the cause. The report still shows its class.
struct Known {
  Class which = Class::pass;
  std::string cause;
};

struct Setting {
  std::string parameter;          ///< "name = value"; unique within the case
  std::function<Findings()> run;  ///< null: not built
  Known known{};
  bool quick = false;            ///< run by `--quick` and by the tests
  bool timed = false;            ///< the figure is a time on this machine, so it differs from run to run
  std::string mode = "default";  ///< solver mode; only rows in default mode are counted
};

struct Case {
  std::string name;  ///< unique
  std::string
      section;  ///< Material, Solver, Tracker, Contact, Shapes, Joints, Bones, Two hands, Flexible objects, World
  std::string statement;  ///< meaning of Pass in one line; empty if the invariants say it all
  std::vector<Setting> rows;
};

struct Row {
  std::string name;
  std::string section;
  std::string parameter;
  Class which = Class::pass;
  Demand figure;          ///< the first demand that was not met, else the last demand
  std::string invariant;  ///< the broken invariant; empty if all hold
  std::string refusal;
  Known known;
  bool counts_as_good = false;  ///< passes, or was rightly refused
  bool timed = false;
  std::string mode;
  double seconds = 0;  ///< computing time
};

/// The row as it is known before it runs.
Row blank_row(const Case& which, const Setting& setting);

/// All cases in the order of the report.
const std::vector<Case>& all_cases();

/// Runs one row. A run that throws gives a row of class `diverged`, because a loop must not throw after it was loaded.
Row run(const Case& which, const Setting& setting);

/// Sets the class of the row from the findings, and with it the row's figure and invariant.
void classify(const Findings& findings, Row& row);

}  // namespace softhand::stress
