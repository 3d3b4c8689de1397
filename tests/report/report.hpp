// What the parts of `softhand report` share.
#pragma once

#include <string>
#include <string_view>

namespace softhand::report {

/// Where figures come from.
struct Provenance {
  std::string processor;  ///< as the kernel names it
  std::string compiler;
  std::string commit;     ///< of the source tree that was built, "-modified" where it had changes; "unknown" outside a repository
};
Provenance provenance();

/// In double quotes, as RFC 4180 has it for CSV.
std::string in_quotes(std::string_view text);

/// Nothing where `path` is empty. Throws std::runtime_error where it cannot be written.
void write_file(const std::string& path, const std::string& text);

}  // namespace softhand::report
