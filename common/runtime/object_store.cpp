#include "runtime/object_store.hpp"

#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "runtime/sha256.hpp"

namespace softhand {
namespace {

std::string read(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in || std::filesystem::is_directory(path)) throw std::runtime_error(path + ": cannot be opened");
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

std::string hash_of(const std::string& bytes) {
  Sha256 hash;
  hash.add(std::as_bytes(std::span(bytes)));
  return hash.hex();
}

}  // namespace

LoadedObject load_object(const std::string& path) {
  const std::string bytes = read(path);
  return {parse_object(bytes, path), hash_of(bytes), path};
}

std::optional<LoadedObject> find_object(const std::string& name, const std::string& sha256,
                                        const std::vector<std::string>& folders) {
  // The name comes from the wire: it must not lead out of the folders.
  if (name.empty() || name.find_first_of("/\\") != std::string::npos || name.front() == '.')
    throw std::runtime_error("object '" + name + "': expected a name without folders");
  std::string other;
  for (const std::string& folder : folders) {
    const std::string path = (std::filesystem::path(folder) / name).string() + std::string(kObjectSuffix);
    if (!std::filesystem::is_regular_file(path)) continue;
    const std::string bytes = read(path);
    const std::string hash = hash_of(bytes);
    if (sha256.empty() || hash == sha256) return LoadedObject{parse_object(bytes, path), hash, path};
    if (other.empty()) other = path + ": has the SHA-256 " + hash + ", expected " + sha256;
  }
  if (!other.empty()) throw std::runtime_error(other + ". Use the same object file on every host.");
  return std::nullopt;
}

}  // namespace softhand
