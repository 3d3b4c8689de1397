// The JSON messages of the bHaptics Player, version 2 (README.md).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "device/refusals.hpp"
#include "model/skeleton.hpp"

namespace softhand {

inline constexpr std::size_t kGloveMotors = 6;  ///< thumb to little, wrist
/// Bytes of a message of the Player: with all its devices and 20 motors each it has about 3 kB.
inline constexpr std::size_t kLargestPlayerMessage = 16384;

enum class PlayerRefusal : std::uint8_t { none, json, content, range };
inline constexpr std::array<std::string_view, 4> kPlayerRefusalNames{"none", "json", "content", "range"};

/// The path and query of the Player's messages of version 2. `application`: the name of this client.
std::string player_target(const std::string& application);

/// What a message says about the glove of one hand. Trivially copyable: it goes through a queue.
struct PlayerReport {
  PlayerRefusal refusal = PlayerRefusal::none;
  bool has_positions = false;  ///< the message lists the connected devices
  bool is_connected = false;   ///< the glove is in the list
  bool has_motors = false;
  std::array<std::uint8_t, kGloveMotors> motors{};  ///< intensities that the Player plays now, 0 to 100
};
/// Members may begin with a small letter, and positions may be names or numbers: clients differ.
PlayerReport decode_player_report(std::string_view text, Side side);

/// A frame for the glove, with its intensities from 0 to 1. Does not allocate.
class PlayerFrame {
 public:
  PlayerFrame(Side side, std::span<const double> intensities, int milliseconds);
  std::string_view text() const { return {text_.data(), size_}; }

 private:
  std::array<char, 512> text_;
  std::size_t size_ = 0;
};
/// Ends the frame of the glove of this hand.
std::string_view player_turn_off(Side side);
/// Ends everything that the Player plays.
inline constexpr std::string_view kPlayerTurnOffAll = R"({"Register":[],"Submit":[{"Type":"turnOffAll","Key":""}]})";

}  // namespace softhand
