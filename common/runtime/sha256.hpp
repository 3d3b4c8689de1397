// SHA-256 of a stream of bytes (FIPS 180-4, implemented by OpenSSL).
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>

namespace softhand {

class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;

  void add(std::span<const std::byte> bytes);
  /// Digest of all bytes so far as 64 lower-case hexadecimal digits. More bytes may be added afterwards.
  std::string hex() const;

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

}  // namespace softhand
