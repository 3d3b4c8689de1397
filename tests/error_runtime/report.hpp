// Error against run time as data, pages and pictures.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "error_runtime/study.hpp"

namespace softhand::error_runtime {

/// One object per run with the figures of `Row`. docs/command-line.md lists the keys. `tissue_rms_mm` and `force_error`
/// belong to the whole run against `reference`. Scenes that are not built have a row with null figures. Numbers that
/// are not finite, or do not apply, are null.
nlohmann::ordered_json to_json(const Study& study);
/// The same rows as CSV.
std::string to_csv(const Study& study);
/// A section "## Error against run time": cost and error of the default, the Pareto fronts, the references and the
/// fitted slopes. `pictures` is the path of the picture folder as the page refers to it. Empty: no pictures.
std::string to_markdown(const Study& study, const std::string& command, const std::string& pictures);
/// A section "## All runs of error against run time": the long table.
std::string table_markdown(const Study& study);

/// `softhand report error-runtime` runs the study, prints it and writes the files. An empty path means that the file is
/// not written.
struct ErrorRuntimeArguments {
  bool quick = false;              ///< coarse hand and fewer settings
  std::vector<std::string> which;  ///< names of scenes, and "peer"; empty: all
  std::string motion;              ///< recording for recorded_grasp and fist_recorded; empty: they are not played
  std::string json;
  std::string csv;
  std::string markdown;  ///< both sections
  std::string plot;      ///< folder for the pictures (needs python3 with matplotlib)
};
/// Returns 0 if every scene does what its name says, and the default is within 0.1 mm and 2 % of R0 in the grasps. Else
/// 1.
int run_error_runtime(const ErrorRuntimeArguments& arguments);

/// Describes how the default misses its bound. Empty if the default meets the bound, or if the scene has no bound.
std::string default_misses(const SceneStudy& scene);

}  // namespace softhand::error_runtime
