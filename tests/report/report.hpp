// What the parts of `softhand report` share.
#pragma once

#include <string>
#include <string_view>

namespace softhand::report {

/// Where figures come from.
struct Provenance {
  std::string processor;  ///< as the kernel names it
  std::string compiler;
  std::string
      commit;  ///< of the source tree that was built, "-modified" where it had changes; "unknown" outside a repository
};
Provenance provenance();

/// In double quotes, as RFC 4180 has it for CSV.
std::string in_quotes(std::string_view text);

/// For a cell of a Markdown table: what stands for a column or ends a row elsewhere does not here.
std::string in_cell(std::string text);

/// Nothing where `path` is empty. Throws std::runtime_error where it cannot be written.
void write_file(const std::string& path, const std::string& text);

/// Has tests/PART/plot.py draw `rows` (JSON) into `folder`, which is made where it is not there; nothing where `folder`
/// is empty. Throws std::runtime_error where that fails: it needs python3-matplotlib.
void draw(const std::string& part, const std::string& rows, const std::string& folder);

}  // namespace softhand::report
