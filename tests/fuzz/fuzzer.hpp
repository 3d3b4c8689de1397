// Helpers of the fuzzers. Each fuzzer is one file with LLVMFuzzerTestOneInput, which gets the bytes.
#pragma once

#include <unistd.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>

namespace softhand::fuzz {

/// Ends the fuzzer with a report if a law of a decoder does not hold.
inline void expect(bool holds, const char* law) {
  if (holds) return;
  std::fprintf(stderr, "broken: %s\n", law);
  std::abort();
}

/// Calls `read`, which may refuse the bytes with a std::runtime_error. Any other exception ends the fuzzer. Returns
/// true if the bytes were accepted.
template <typename Read>
bool accepts(Read&& read) {
  try {
    read();
    return true;
  } catch (const std::runtime_error& error) {
    expect(error.what()[0] != '\0', "a refusal has a text");
    return false;
  }
}

/// Kinds of mesh files, by the first byte of an input.
inline constexpr std::array kMeshSuffixes{".obj", ".stl", ".glb", ".gltf"};

/// A file with the given bytes, for readers that take a path. It is removed at the end.
class ScratchFile {
 public:
  ScratchFile(const std::uint8_t* data, std::size_t size, const std::string& suffix)
      : path_("/dev/shm/softhand_fuzz_" + std::to_string(getpid()) + suffix) {
    std::FILE* const file = std::fopen(path_.c_str(), "wb");
    expect(file != nullptr, "the scratch file can be created");
    if (size > 0) expect(std::fwrite(data, 1, size, file) == size, "the scratch file can be written");
    std::fclose(file);
  }
  ~ScratchFile() { unlink(path_.c_str()); }
  ScratchFile(const ScratchFile&) = delete;
  ScratchFile& operator=(const ScratchFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace softhand::fuzz
