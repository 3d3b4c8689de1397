// The cases of each source file for `all_cases`, and helpers that these files share.
#pragma once

#include <fmt/format.h>

#include <string>
#include <utility>
#include <vector>

#include "stress/stress.hpp"

namespace softhand::stress {

std::vector<Case> material_cases();
std::vector<Case> solver_cases();
std::vector<Case> tracker_cases();
std::vector<Case> contact_cases();
std::vector<Case> shape_cases();
std::vector<Case> joint_cases();
std::vector<Case> bone_cases();
std::vector<Case> two_hands_cases();
std::vector<Case> soft_cases();
std::vector<Case> world_cases();
std::vector<Case> process_cases();

/// Collects the cases of one section of the table, in their order.
class CaseList {
 public:
  explicit CaseList(std::string section) : section_(std::move(section)) {}
  /// Starts a case. The result takes its rows, and is valid until the next call.
  std::vector<Setting>& add(const char* name, const char* statement) {
    cases_.push_back({name, section_, statement, {}});
    return cases_.back().rows;
  }
  std::vector<Case> take() { return std::move(cases_); }

 private:
  std::string section_;
  std::vector<Case> cases_;
};

inline constexpr double kDegree = 3.14159265358979323846 / 180;

inline std::string named(const char* name, double value, const char* unit = "") {
  return fmt::format("{} = {:g}{}{}", name, value, *unit ? " " : "", unit);
}

}  // namespace softhand::stress
