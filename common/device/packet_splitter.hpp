// Divides a stream of bytes into packets.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>

namespace softhand {

/// How a stream of bytes is divided into packets.
struct Framing {
  /// Size of the first packet of `bytes`. 0: it takes more bytes to know. More than the largest packet: the bytes are
  /// not of this protocol.
  using Size = std::size_t (*)(std::string_view bytes);

  Framing(char last) : end(last) {}           // NOLINT: a character says enough
  Framing(Size of_first) : size(of_first) {}  // NOLINT

  Size size = nullptr;
  char end = '\0';  ///< without `size`: ends each packet and is not part of it
};

/// How the stream comes in parts does not change its packets.
class PacketSplitter {
 public:
  /// `largest`: bytes of a packet.
  PacketSplitter(Framing framing, std::size_t largest) : framing_(framing), largest_(largest) {
    waiting_.reserve(largest);
  }

  /// The next bytes of the stream. Calls push(std::string_view) for each packet that they complete, and refuse() for
  /// each packet above the largest size. Returns false if the bytes are not of the protocol of `framing`: this stream
  /// has no more packets. Does not allocate.
  template <typename Push, typename Refuse>
  bool take(std::string_view bytes, Push&& push, Refuse&& refuse) {
    if (framing_.size != nullptr) return take_by_size(bytes, push, refuse);
    while (!bytes.empty()) {
      const std::size_t end = bytes.find(framing_.end);
      const std::string_view part = bytes.substr(0, end);
      if (!skips_ && waiting_.size() + part.size() > largest_) {
        refuse();
        skips_ = true;
        waiting_.clear();
      }
      if (!skips_) waiting_ += part;
      if (end == std::string_view::npos) return true;
      if (!skips_) push(std::string_view(waiting_));
      waiting_.clear();
      skips_ = false;
      bytes.remove_prefix(end + 1);
    }
    return true;
  }
  /// True if a packet has begun and not ended.
  bool is_within_packet() const { return !waiting_.empty(); }

 private:
  template <typename Push, typename Refuse>
  bool take_by_size(std::string_view bytes, Push&& push, Refuse&& refuse) {
    while (!bytes.empty()) {
      const std::size_t part = std::min(bytes.size(), largest_ - waiting_.size());
      waiting_ += bytes.substr(0, part);
      bytes.remove_prefix(part);
      std::string_view rest = waiting_;
      std::size_t size = framing_.size(rest);
      for (; size != 0 && size <= rest.size(); size = framing_.size(rest)) {
        push(rest.substr(0, size));
        rest.remove_prefix(size);
      }
      waiting_.erase(0, waiting_.size() - rest.size());
      if (size <= largest_ && waiting_.size() < largest_) continue;
      refuse();
      waiting_.clear();
      return false;
    }
    return true;
  }

  Framing framing_;
  std::size_t largest_;
  std::string waiting_;  // bytes of a packet without its end
  bool skips_ = false;   // to the end of a packet that is too large
};

}  // namespace softhand
