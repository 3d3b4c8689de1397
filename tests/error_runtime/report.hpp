// Error against run time as data, pages and pictures.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "error_runtime/study.hpp"

namespace softhand::error_runtime {

/// One object a run: scene, knob, setting, ms_p50, ms_p99, tissue_rms_mm, force_error (both of the whole run against
/// `reference`), class, and the other figures of `Row`. Scenes that are not built have a row with null figures. Numbers
/// that are not finite, or do not apply, are null.
nlohmann::ordered_json to_json(const Study& study);
/// The same as CSV.
std::string to_csv(const Study& study);
/// A section "## Error against run time": what the default costs and how far it is off, the Pareto fronts, the
/// references, the fitted slopes. `pictures`: the path of the folder with the pictures as the page shows it; empty:
/// none are shown.
std::string to_markdown(const Study& study, const std::string& command, const std::string& pictures);
/// A section "## Every run of error against run time": the long table.
std::string table_markdown(const Study& study);

/// `softhand report error-runtime`: runs, prints and writes. Empty paths: not written.
struct ErrorRuntimeArguments {
  bool quick = false;              ///< the coarse hand, fewer settings
  std::vector<std::string> which;  ///< names of scenes, and "peer"; empty = all
  std::string motion;              ///< path of the recording of recorded_grasp; empty: this scene is not played
  std::string json;
  std::string csv;
  std::string markdown;  ///< both sections
  std::string plot;      ///< a folder for the pictures (needs python3 with matplotlib)
};
/// Returns 0 where every scene is what it is called and the default is within 0.1 mm and 2 % of R0 in the grasps, else
/// 1.
int run_error_runtime(const ErrorRuntimeArguments& arguments);

/// Whether the default meets its bound in a scene where it must; empty where it does or need not, else what it is.
std::string default_misses(const SceneStudy& scene);

}  // namespace softhand::error_runtime
