// What a glove with the OpenGloves protocol sends and understands. For its simulator and for tests.
#pragma once

#include <array>
#include <cstdio>
#include <string>

namespace softhand {

/// A line with its end. `curls` and `splays`: 0 to `maximum`. Without splays, if `splays` is null.
inline std::string glove_line(const std::array<int, 5>& curls, const std::array<int, 5>* splays = nullptr) {
  std::string text;
  for (std::size_t f = 0; f < curls.size(); ++f) {
    const char letter = static_cast<char>('A' + f);
    text += letter + std::to_string(curls[f]);
    if (splays != nullptr) text += std::string("(") + letter + "B)" + std::to_string((*splays)[f]);
  }
  return text + "F2047G2047P0\n";
}

/// The brakes as the firmware reads them: fingers that a line omits are free, lines under 5 characters are ignored.
inline bool read_forces(const std::string& line, std::array<int, 5>& forces) {
  if (line.size() < 5) return false;
  forces.fill(0);
  for (std::size_t f = 0; f < forces.size(); ++f) {
    const std::size_t at = line.find(static_cast<char>('A' + f));
    if (at != std::string::npos) std::sscanf(line.c_str() + at + 1, "%d", &forces[f]);
  }
  return true;
}

}  // namespace softhand
