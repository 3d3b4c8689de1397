#include "haptics/opengloves/alpha_line.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

namespace softhand {
namespace {

constexpr std::uint32_t kLegacyLayout = 1u << 31;
// Bits of AlphaLine::layout: curls 0 to 4, splays 5 to 9, joints 10 to 29.
constexpr std::size_t kSplays = 5, kJoints = 10, kFingerKeys = 30, kJointsOfFinger = 4;

bool is_letter(char c) { return c >= 'A' && c <= 'Z'; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }

// The bit of a key about fingers; kFingerKeys for another one.
std::size_t bit_of(std::string_view key) {
  const auto finger = static_cast<std::size_t>(key[0] - 'A');
  if (finger >= kFingerCount) return kFingerKeys;
  if (key.size() == 1) return finger;
  if (key.size() == 2 && key[1] == 'B') return kSplays + finger;
  if (key.size() == 3 && key[1] == 'A' && key[2] >= 'A' && key[2] <= 'D')
    return kJoints + kJointsOfFinger * finger + static_cast<std::size_t>(key[2] - 'A');
  return kFingerKeys;
}

// Takes a number of at most five digits from the front of `text`.
std::optional<std::int64_t> take_number(std::string_view& text) {
  std::size_t size = 0;
  while (size < text.size() && is_digit(text[size])) ++size;
  if (size == 0 || size > 5) return std::nullopt;
  std::int64_t value = 0;
  std::from_chars(text.data(), text.data() + size, value);
  text.remove_prefix(size);
  return value;
}

// Takes `A`, `(AB)` or `(AAB)`; the key is without parentheses. Empty: malformed.
std::string_view take_key(std::string_view& text) {
  std::size_t begin = 0, size = 1;
  if (text[0] == '(') {
    begin = 1;
    size = text.find(')');
    if (size == std::string_view::npos || size < 3 || size > 4) return {};
    --size;
  }
  const std::string_view key = text.substr(begin, size);
  if (!std::all_of(key.begin(), key.end(), is_letter)) return {};
  text.remove_prefix(size + 2 * begin);
  return key;
}

AlphaRefusal decode_legacy(std::string_view line, std::int64_t maximum, AlphaLine& out) {
  constexpr std::size_t count = 13;
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = take_number(line);
    if (!value || (i + 1 < count && (line.empty() || line[0] != '&'))) return AlphaRefusal::syntax;
    if (*value > maximum) return AlphaRefusal::range;
    if (i < kFingerCount) {
      out.fingers[i].valid = true;
      out.fingers[i].curl.fill(static_cast<double>(*value) / static_cast<double>(maximum));
    }
    if (i + 1 < count) line.remove_prefix(1);
  }
  out.layout = kLegacyLayout;
  return line.empty() ? AlphaRefusal::none : AlphaRefusal::syntax;
}

}  // namespace

AlphaRefusal decode_alpha_line(std::string_view line, std::int64_t maximum, AlphaLine& out) {
  out = {};
  if (line.find('&') != std::string_view::npos) return decode_legacy(line, maximum, out);
  std::array<double, kFingerKeys> values{};
  std::uint32_t letters = 0;  // keys of one letter that are not about fingers
  while (!line.empty()) {
    const std::string_view key = take_key(line);
    if (key.empty()) return AlphaRefusal::syntax;
    const bool has_number = !line.empty() && is_digit(line[0]);
    std::int64_t number = 0;
    if (has_number) {
      const auto value = take_number(line);
      if (!value) return AlphaRefusal::range;
      number = *value;
    }
    const std::size_t bit = bit_of(key);
    const bool is_analog = bit < kFingerKeys || key == "F" || key == "G" || key == "P";
    if (is_analog && !has_number) return AlphaRefusal::syntax;
    if (is_analog && number > maximum) return AlphaRefusal::range;
    // Two lines without an end between them repeat their keys.
    std::uint32_t& seen = bit < kFingerKeys ? out.layout : letters;
    const std::uint32_t mask = bit < kFingerKeys ? 1u << bit : key.size() == 1 ? 1u << (key[0] - 'A') : 0;
    if ((seen & mask) != 0) return AlphaRefusal::repeated;
    seen |= mask;
    if (bit < kFingerKeys) values[bit] = static_cast<double>(number) / static_cast<double>(maximum);
    if (key == "ZH") {
      if (!has_number || number > 1) return AlphaRefusal::range;
      out.hand = number == 0 ? Side::left : Side::right;
    }
  }
  const auto has = [&](std::size_t bit) { return (out.layout >> bit & 1) != 0; };
  for (std::size_t f = 0; f < kFingerCount; ++f) {
    FingerCurl& finger = out.fingers[f];
    finger.valid = true;
    for (std::size_t k = 0; k < finger.curl.size(); ++k) {
      // A joint has its own value or that of the finger. Joint A of a finger is the metacarpal joint.
      const std::size_t joint = kJoints + kJointsOfFinger * f + k + (f == 0 ? 0 : 1);
      finger.valid = finger.valid && (has(joint) || has(f));
      finger.curl[k] = values[has(joint) ? joint : f];
    }
    if (has(kSplays + f)) finger.splay = 2 * values[kSplays + f] - 1;
  }
  return AlphaRefusal::none;
}

ForceLine::ForceLine(std::span<const double> shares, std::int64_t maximum) {
  char* end = text_.data();
  for (std::size_t f = 0; f < kFingerCount; ++f) {
    *end++ = static_cast<char>('A' + f);
    const double share = std::clamp(shares[f], 0.0, 1.0);
    end = std::to_chars(end, text_.data() + text_.size(), std::llround(share * static_cast<double>(maximum))).ptr;
  }
  *end++ = '\n';
  size_ = static_cast<std::size_t>(end - text_.data());
}

const std::array<FingerCurl, kFingerCount>* AlphaDecoder::take(const Arrival& packet) {
  Peer& peer = peer_of(packet.connection);
  std::string_view text = packet.bytes;
  if (!text.empty() && text.back() == '\r') text.remove_suffix(1);
  bool is_used = false;
  AlphaRefusal refusal = decode_alpha_line(text, maximum_, line_);
  if (refusal == AlphaRefusal::none) refusal = check(line_, peer, is_used);
  if (!refusals_.accepted(refusal)) return nullptr;
  const bool is_of_glove = !peer.is_other_hand && (line_.layout != 0 || line_.hand);
  const bool takes_over = is_of_glove && (packet.connection > connection_ || packet.time - heard_at_ >= kSilent);
  if (packet.connection != connection_ && !takes_over) {
    ++ignored_;
    return nullptr;
  }
  if (is_of_glove) {
    connection_ = packet.connection;
    heard_at_ = packet.time;
  }
  return is_used ? &line_.fingers : nullptr;
}

AlphaDecoder::Peer& AlphaDecoder::peer_of(std::uint64_t connection) {
  Peer* oldest = nullptr;
  for (Peer& peer : peers_) {
    if (peer.connection == connection) return peer;
    const bool is_glove = connection_ != 0 && peer.connection == connection_;
    if (!is_glove && (oldest == nullptr || peer.connection < oldest->connection)) oldest = &peer;
  }
  return *oldest = {connection, 0, false};
}

AlphaRefusal AlphaDecoder::check(const AlphaLine& line, Peer& peer, bool& is_used) const {
  if (line.hand) peer.is_other_hand = *line.hand != side_;
  if (line.layout == 0) return AlphaRefusal::none;
  if (peer.is_other_hand) return AlphaRefusal::hand;
  // The first line of a connection may be the end of one.
  const bool is_first = peer.layout == 0, is_same = peer.layout == line.layout;
  peer.layout = line.layout;
  is_used = is_same;
  return is_same || is_first ? AlphaRefusal::none : AlphaRefusal::layout;
}

}  // namespace softhand
