// The lines of OpenGloves ("alpha encoding", README.md): decoded to curls and splays, and encoded from forces.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "device/arrival_queue.hpp"
#include "device/curl_lifter.hpp"
#include "device/refusals.hpp"

namespace softhand {

inline constexpr std::size_t kLargestAlphaLine = 512;  ///< bytes; with all joints and buttons a line has about 330

enum class AlphaRefusal : std::uint8_t { none, syntax, range, repeated, layout, hand };
inline constexpr std::array<std::string_view, 6> kAlphaRefusalNames{"none",     "syntax", "range",
                                                                    "repeated", "layout", "hand"};

struct AlphaLine {
  std::array<FingerCurl, kFingerCount> fingers;  ///< splay in -1 to 1
  /// A bit for each key about fingers that the line has. 0: the line has buttons or information only.
  std::uint32_t layout = 0;
  std::optional<Side> hand;  ///< information about the glove
};

/// Decodes a line without its end: alpha encoding, or the older 13 numbers joined by &. Keys that are not known are
/// skipped. `maximum`: largest value of an analog input. `out` is unspecified if the line is refused. Does not
/// allocate.
AlphaRefusal decode_alpha_line(std::string_view line, std::int64_t maximum, AlphaLine& out);

/// The line that sets the brakes, with its end: A to E from 0 (free) to `maximum` (blocked). `shares`: 0 to 1.
class ForceLine {
 public:
  ForceLine(std::span<const double> shares, std::int64_t maximum);
  std::string_view text() const { return {text_.data(), size_}; }

 private:
  std::array<char, 40> text_;
  std::size_t size_ = 0;
};

/// Turns the lines of one glove into curls. It follows the newest connection that sent a line of this glove, and an
/// earlier one if that is silent for 0.5 s: anybody may connect. A line is used if it has the same keys as the line
/// before. A line that lost bytes on the way, or is the end of one, has others.
class AlphaDecoder {
 public:
  AlphaDecoder(Side side, std::int64_t maximum) : side_(side), maximum_(maximum) {}

  /// Returns the curls of the line, or null if it has none. Valid until the next call. Does not allocate.
  const std::array<FingerCurl, kFingerCount>* take(const Arrival& packet);
  /// The connection of the glove; 0 = no line of it came yet.
  std::uint64_t connection() const { return connection_; }
  /// Good lines of other connections.
  std::uint64_t ignored() const { return ignored_; }
  const Refusals<AlphaRefusal, kAlphaRefusalNames.size()>& refusals() const { return refusals_; }

 private:
  static constexpr std::size_t kPeers = 16;  // as many as an Intake keeps open
  static constexpr Nanoseconds kSilent = 500'000'000;
  struct Peer {
    std::uint64_t connection = 0;
    std::uint32_t layout = 0;  // of the line before
    bool is_other_hand = false;
  };
  Peer& peer_of(std::uint64_t connection);
  AlphaRefusal check(const AlphaLine& line, Peer& peer, bool& is_used) const;

  Side side_;
  std::int64_t maximum_;
  std::array<Peer, kPeers> peers_{};
  std::uint64_t connection_ = 0, ignored_ = 0;
  Nanoseconds heard_at_ = 0;
  AlphaLine line_;
  Refusals<AlphaRefusal, kAlphaRefusalNames.size()> refusals_{kAlphaRefusalNames};
};

}  // namespace softhand
