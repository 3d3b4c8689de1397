// Object files on disk. On the wire an object is identified by its name and the SHA-256 of its file.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "model/object_model.hpp"

namespace softhand {

/// File name of an object: its name and this.
inline constexpr std::string_view kObjectSuffix = ".object.json";

struct LoadedObject {
  ObjectModel model;
  std::string sha256;  ///< of the file's bytes, 64 lower-case hexadecimal digits
  std::string path;
};

/// Reads and validates an object file. Throws std::runtime_error with file, field and what was expected.
LoadedObject load_object(const std::string& path);

/// Looks for `name`.object.json with this SHA-256 in the folders, in their order. An empty `sha256` accepts any
/// content. Returns nothing if no folder has the file. Throws std::runtime_error if the only files with this name have
/// another SHA-256, or if the file is not valid.
std::optional<LoadedObject> find_object(const std::string& name, const std::string& sha256,
                                        const std::vector<std::string>& folders);

}  // namespace softhand
