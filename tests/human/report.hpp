// `softhand report human`: the index fingertip of the hands beside people's. `softhand report postures`: what their
// tissue bears.
#pragma once

#include <string>
#include <vector>

namespace softhand::human {

/// `hands`: files; empty = every right hand in config/hands. Empty paths: not written. `plot`: a directory for
/// human.png. `pulp`: youngs_modulus=, limit_energy= or limit_ratio= of another material to try. `fit`: fits one pulp
/// for all these hands, starting from it, prints it and shows it instead of the files'.
struct HumanArguments {
  std::vector<std::string> hands;
  std::vector<std::string> pulp;
  bool fit = false;
  std::string json;
  std::string csv;
  std::string markdown;
  std::string plot;
};
/// Returns 0 where every compared force lies within people's spread, else 1. std::runtime_error for a file that cannot
/// be read or written.
int run_human(const HumanArguments& arguments);

/// `hands` and `markdown` as above.
struct PostureArguments {
  std::vector<std::string> hands;
  std::string markdown;
};
/// Returns 0 where no hand has skin strained by more than 60 % or a tetrahedron inside out in any posture, else 1.
int run_postures(const PostureArguments& arguments);

}  // namespace softhand::human
