// Repeats the steps of a flight file (docs/flight-recorder.md).
#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace softhand {

struct RepeatOptions {
  std::string path;
  bool force = false;  ///< repeat a file of another build or instruction set, and compare within a tolerance
  bool brief = false;  ///< print only steps that differ or failed
};

struct RepeatResult {
  std::uint64_t steps = 0;
  std::uint64_t compared = 0;   ///< steps with a recorded result
  std::uint64_t different = 0;  ///< steps whose state differs from the recorded one
  std::uint64_t snapshots = 0;
  std::uint64_t different_snapshots = 0;  ///< snapshots that differ from the state of the repeated run
  std::string reason;                     ///< why the file was written

  bool is_equal() const { return compared > 0 && different == 0 && different_snapshots == 0; }
};

/// Calls `print` for each line of the report. Throws std::runtime_error if the file cannot be read, was cut off before
/// its first step, is of another build or instruction set without `force`, or if the hand is another one.
RepeatResult repeat_flight(const RepeatOptions& options, const std::function<void(const std::string&)>& print);

}  // namespace softhand
