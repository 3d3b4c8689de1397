// A file that the page plays (its Open button): what Save writes there.
#pragma once

#include <fstream>
#include <string>

#include "viewer/frames.hpp"

namespace softhand::viewer {

class Recording {
 public:
  /// Throws std::runtime_error where the file cannot be written.
  explicit Recording(const std::string& path);
  /// `seconds` since the recording's start, not falling. Empty frames are passed over.
  void add(double seconds, const Frame& frame);
  /// Throws std::runtime_error where something could not be written.
  void close();

 private:
  std::string path_;
  std::ofstream out_;
};

}  // namespace softhand::viewer
