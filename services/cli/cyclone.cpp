#include <fmt/format.h>

#include "bus/network.hpp"
#include "cli/commands.hpp"

namespace softhand {

int run_cyclone(const std::string& role) {
  fmt::print("{}", bus::cyclone_settings(bus::network_from_environment(), role));
  return 0;
}

}  // namespace softhand
