// Stress cases: extreme inputs through the real loops and the shipped hand, each row classified by the invariants G1 to
// G8. One library for the tests and for `softhand report stress`; docs/stress.md says what the invariants and classes
// mean.
//
// A case is a list of rows, a row one value of its parameter: it runs and returns what it demanded and found. Nothing
// here knows how rows are printed. Everything SI unless a quantity's unit says otherwise.
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

/// One thing that must hold, and what was found.
struct Demand {
  std::string invariant;  ///< G1 to G8, or the words of a demand of the case's own
  std::string quantity;
  double value = 0;
  double limit = 0;  ///< the most that `value` may be; the least where `at_least`
  std::string unit;
  bool at_least = false;
  Class otherwise = Class::violated;  ///< what the row is where this is not met

  /// Not-a-number does not meet anything.
  bool met() const { return at_least ? value >= limit : value <= limit; }
};

/// What a run found, its demands from the gravest on; the last one, the case's own figure, is shown where all are met.
struct Findings {
  std::vector<Demand> demands;
  std::string refusal;            ///< the reason with which the configuration was refused at load; empty: it ran
  bool refusal_is_right = false;  ///< the case demands the refusal, or its reason (a growth factor above one) was shown
                                  ///< and the offered values passed

  void demand(std::string invariant, std::string quantity, double value, double limit, std::string unit,
              Class otherwise = Class::violated) {
    demands.push_back({std::move(invariant), std::move(quantity), value, limit, std::move(unit), false, otherwise});
  }
  void demand_at_least(std::string invariant, std::string quantity, double value, double limit, std::string unit,
                       Class otherwise = Class::violated) {
    demands.push_back({std::move(invariant), std::move(quantity), value, limit, std::move(unit), true, otherwise});
  }
};

/// A row that is known not to pass today, and why. It stays in the report as what it is.
struct Known {
  Class which = Class::pass;
  std::string cause;
};

struct Setting {
  std::string parameter;          ///< as "name = value"; unique within the case
  std::function<Findings()> run;  ///< null: not built
  Known known{};
  bool quick = false;            ///< run by `--quick` and by the tests
  bool timed = false;            ///< its figure is a time of this machine: it differs from run to run
  std::string mode = "default";  ///< of the solver; "live budget" or another; only rows of the default mode are counted
};

struct Case {
  std::string name;       ///< unique
  std::string section;    ///< Material, Solver, Tracker, Contact, Bones, World
  std::string statement;  ///< what passing means, in a line, where it is more than the invariants
  std::vector<Setting> rows;
};

struct Row {
  std::string name;
  std::string section;
  std::string parameter;
  Class which = Class::pass;
  Demand figure;          ///< the first demand that was not met, else the last one
  std::string invariant;  ///< broken; empty where none is
  std::string refusal;
  Known known;
  bool counts_as_good = false;  ///< passes, or was rightly refused
  bool timed = false;
  std::string mode;
  double seconds = 0;  ///< of computing
};

/// What is known of a row before it is run.
Row blank_row(const Case& which, const Setting& setting);

/// Every case, in the order of the report.
const std::vector<Case>& all_cases();

/// Runs one row. A run that throws is a row that diverged: nothing that a loop does may throw once it was loaded.
Row run(const Case& which, const Setting& setting);

/// The class of what was found, and the row's figure and invariant with it.
void classify(const Findings& findings, Row& row);

}  // namespace softhand::stress
