#include <fmt/format.h>

#include "cli/commands.hpp"
#include "cli/rig.hpp"
#include "runtime/config.hpp"
#include "scene_file.hpp"

namespace softhand {

std::string reference_page() {
  return "# Every option\n\n"
         "Printed by `softhand reference` from the descriptions in the code; do not edit. To write it anew: `softhand "
         "reference > docs/reference.md`.\n\n"
         "A scene is one TOML file (`config/scenes/`) that all processes of a rig read; a rig (`config/rigs/`) names "
         "the processes. Keys that a file leaves out\n"
         "have the default. Unknown keys, wrong types and values out of range are refused with file and line. Every "
         "key of a scene can be overridden on the\n"
         "command line: `--set hand.rate_hz=60`, `--set objects.cube.mass=0.1` (by the `name` of a list's element) or "
         "`--set objects.0.mass=0.1`.\n\n" +
         reference_markdown<SceneOptions>("Scene") + "\n" + reference_markdown<RigOptions>("Rig");
}

int run_reference() {
  fmt::print("{}", reference_page());
  return 0;
}

}  // namespace softhand
