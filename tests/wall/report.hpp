// `softhand report wall`: how stiff a wall may be with and without the local model.
#pragma once

#include <string>

namespace softhand::wall {

struct WallArguments {
  std::string markdown;  ///< file for the same tables; empty: none
};
/// Prints two tables. Returns 0 if, for every device with the normal delay, the wall of five times the stiffness that
/// is stable with held forces is stable and passive, else 1.
int run_wall(const WallArguments& arguments);

}  // namespace softhand::wall
