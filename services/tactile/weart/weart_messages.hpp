// The messages of the WEART middleware (README.md): text between ~, either values joined by colons or JSON.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "device/curl_lifter.hpp"
#include "device/refusals.hpp"

namespace softhand {

inline constexpr char kWeartEnd = '~';
inline constexpr std::size_t kLargestWeartMessage = 8192;  ///< bytes, in both directions

enum class WeartRefusal : std::uint8_t { none, syntax, json, content, range };
inline constexpr std::array<std::string_view, 5> kWeartRefusalNames{"none", "syntax", "json", "content", "range"};

enum class WeartKind : std::uint8_t { other, tracking, calibration, calibration_result, middleware, devices };

/// What a message says about the device of one hand. Trivially copyable: it goes through a queue.
struct WeartReport {
  WeartRefusal refusal = WeartRefusal::none;
  WeartKind kind = WeartKind::other;
  /// tracking: of the fingers that the device measures. The splay is the abduction, from -1 to 1.
  std::array<FingerCurl, kFingerCount> fingers;
  /// calibration: 0 idle, 1 calibrating, 2 running. calibration_result: 0 good. middleware: status code, 0 = good.
  /// devices: number of devices of this hand.
  int value = 0;
};
/// Messages of the other hand are of kind `other`.
WeartReport decode_weart(std::string_view text, Side side);
/// The version of the middleware in its status message. Empty if the message has none.
std::string weart_version(std::string_view text);
/// The messages that ask for the states of the middleware and of its devices. Nothing starts.
std::string weart_questions();

/// The points on which a device acts, in the order of the fingers and the palm.
inline constexpr std::array<std::string_view, 6> kWeartPoints{"THUMB", "INDEX", "MIDDLE", "ANNULAR", "PINKY", "PALM"};

/// Effects on one point. Zero stops the effect.
struct WeartEffects {
  double force = 0;        ///< 0 to 1
  double temperature = 0;  ///< -1 cold to 1 warm
  double slip = 0;         ///< speed over the texture, 0 to 1
};

/// The messages that set or stop all effects of all points. Does not allocate.
class WeartCommand {
 public:
  WeartCommand(Side side, std::span<const WeartEffects> points, int texture, double volume);
  std::string_view text() const { return {text_.data(), size_}; }

 private:
  std::array<char, 2048> text_;
  std::size_t size_ = 0;
};

}  // namespace softhand
