// Helpers that the parts of `softhand report` share.
#pragma once

#include <string>
#include <string_view>

namespace softhand::report {

/// Origin of figures.
struct Provenance {
  std::string processor;  ///< name from the kernel
  std::string compiler;
  /// Commit of the built source tree, with "-modified" if the tree had changes. "unknown" outside a repository.
  std::string commit;
};
Provenance provenance();

/// The text in double quotes, as RFC 4180 requires for CSV.
std::string in_quotes(std::string_view text);

/// The text for a cell of a Markdown table: pipes are escaped, and line breaks become "; ".
std::string in_cell(std::string text);

/// Writes a file, or nothing if `path` is empty. Throws std::runtime_error if the file cannot be written.
void write_file(const std::string& path, const std::string& text);

/// Runs tests/PART/plot.py, which draws `rows` (JSON) into `folder`. Creates `folder` if needed. Does nothing if
/// `folder` is empty. Throws std::runtime_error if drawing fails. Needs python3-matplotlib.
void draw(const std::string& part, const std::string& rows, const std::string& folder);

}  // namespace softhand::report
