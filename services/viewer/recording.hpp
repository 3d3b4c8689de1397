// Writes a file that the page can play (button Open). The format is that of the page's button Save.
#pragma once

#include <fstream>
#include <string>

#include "viewer/frames.hpp"

namespace softhand::viewer {

class Recording {
 public:
  /// Throws std::runtime_error if the file cannot be written.
  explicit Recording(const std::string& path);
  /// `seconds` since the start of the recording, not decreasing. Null frames are skipped.
  void add(double seconds, const Frame& frame);
  /// Throws std::runtime_error if something could not be written.
  void close();

 private:
  std::string path_;
  std::ofstream out_;
};

}  // namespace softhand::viewer
