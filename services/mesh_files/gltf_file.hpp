// Access to a glTF 2.0 file: its JSON document and the numbers of its accessors.
#pragma once

#include <iosfwd>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace softhand {

/// The part of glTF 2.0 that readers of meshes and skins need. Every access is checked against the size of the data.
/// All members throw std::runtime_error with file, field and what was expected.
class GltfFile {
 public:
  /// Reads a binary file (GLB). With a `folder`, also a text file (.gltf), and buffers in files relative to `folder` or
  /// in the document as base64. Without it all data must be in the binary chunk of the file. `name` is the file's name
  /// in error messages.
  GltfFile(std::istream& in, std::string name, const std::string* folder = nullptr);

  void check(bool good, const std::string& field, const std::string& expected) const;
  const nlohmann::json& document() const { return document_; }
  const nlohmann::json& element(const char* list, std::size_t index) const;
  /// A whole number from 0. Without the key it is `absent`, or an error if `absent` is empty.
  std::size_t index(const nlohmann::json& object, const char* key, const std::string& where,
                    std::optional<std::size_t> absent = {}) const;
  /// The numbers of an accessor, row by row. `type` is SCALAR, VEC3, VEC4 or MAT4. Normalised integers are returned as
  /// fractions.
  std::vector<double> numbers(std::size_t accessor_index, const std::string& type, const std::string& what) const;
  /// The same for whole numbers below `limit`.
  std::vector<std::size_t> indices(std::size_t accessor_index, const std::string& type, const std::string& what,
                                   std::size_t limit) const;

 private:
  std::string load_buffer(const std::string& uri, const std::string& folder, const std::string& where) const;

  std::string name_;
  nlohmann::json document_;
  std::vector<std::string> buffers_;
};

}  // namespace softhand
