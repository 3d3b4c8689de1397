// The header of a flight file: JSON text.
#pragma once

#include <string>
#include <vector>

namespace softhand {

/// Everything that is needed to make the loop of a file again.
struct FlightHeader {
  std::string loop;                    ///< hand, tracking or world
  std::string module;                  ///< name of the process
  std::string scene;                   ///< absolute path; files that the scene names are searched beside it
  std::string scene_text;              ///< TOML
  std::vector<std::string> overrides;  ///< of the command line, and what the process chose at its start
  // By hand of the process. A loop without a hand has none.
  std::vector<std::string> calibrations;  ///< text of the user's file, to which the hand was fitted; empty: none
  std::vector<std::string> hands;         ///< hash of the hand model
  std::string build;                      ///< hash of the libraries that compute bits
  std::string instruction_set;            ///< the widest one of this machine's processor
  std::string reason;                     ///< of the file
  bool operator==(const FlightHeader&) const = default;
};
std::string to_json(const FlightHeader& header);
/// Throws std::runtime_error if the text is not a header.
FlightHeader flight_header_from_json(const std::string& text);

}  // namespace softhand
