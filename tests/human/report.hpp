// `softhand report human` compares the index fingertips of the hands with human fingertips. `softhand report postures`
// reports the strain of the hands' tissue.
#pragma once

#include <string>
#include <vector>

namespace softhand::human {

/// An empty path means that the file is not written.
/// - `hands`: Files. Empty means every right hand in config/hands.
/// - `pulp`: Another material to try, as youngs_modulus=, limit_energy= or limit_ratio=.
/// - `fit`: Fits one pulp for all these hands, prints it and uses it instead of the pulp in the files. The fit starts
///   from `pulp`.
/// - `plot`: Folder for human.png.
struct HumanArguments {
  std::vector<std::string> hands;
  std::vector<std::string> pulp;
  bool fit = false;
  std::string json;
  std::string csv;
  std::string markdown;
  std::string plot;
};
/// Returns 0 if every compared force lies within the spread of people, else 1. Throws std::runtime_error if a file
/// cannot be read or written.
int run_human(const HumanArguments& arguments);

/// `hands` and `markdown` are as in HumanArguments.
struct PostureArguments {
  std::vector<std::string> hands;
  std::string markdown;
};
/// Returns 0 if no posture of any hand strains the skin by more than 60 % or inverts a tetrahedron, else 1.
int run_postures(const PostureArguments& arguments);

}  // namespace softhand::human
