// The hand of a user: bone lengths, thickness and range of motion, as `softhand calibrate` measures them
// (hand_measurement.hpp). It is kept in a file (docs/calibration.md).
#pragma once

#include <array>
#include <filesystem>
#include <string>

#include "messages/messages.hpp"
#include "model/hand_model.hpp"
#include "runtime/options.hpp"

namespace softhand {

/// A joint in the frame of its parent (`parent_of(Joint)`), in the axes of the user's tracker.
struct UserJoint {
  std::array<double, 3> offset{};                 ///< m
  std::array<double, 4> orientation{0, 0, 0, 1};  ///< xyzw, the median of the measurement; not of tips and palm
  // The range of motion, as rotations from this orientation, rad: about X (negative = flexed) and about Y.
  std::array<double, 2> flexion{};
  std::array<double, 2> abduction{};
  double radius = 0;  ///< m, to the skin; 0 = unknown
};

struct UserHand {
  std::string side = "right";
  std::array<UserJoint, kJointCount> joints{};  ///< that of the wrist is not used
};
void describe(OptionVisitor& v, UserHand& o);

/// Reads a file of this hand. `path` is used only in error messages. Throws ConfigError if a joint is missing, or if
/// its numbers are not those of a hand.
UserHand read_user_hand(const std::string& text, const std::string& path);
/// The text of a file that `read_user_hand` reads.
std::string user_hand_text(const UserHand& user);

/// The hand fitted to the user's bone lengths, thickness and range of motion. Ranges grow to include those of the user.
/// The flexed ends of the four fingers become those of the user's fist, so that a closed glove closes the hand as the
/// user does. Throws std::invalid_argument as `fitted` of a measured skeleton does, and for a hand of the other side.
HandModel fitted(const HandModel& hand, const UserHand& user);

/// Where the hand of this user is kept: softhand/users/USER-SIDE.toml in $XDG_DATA_HOME, or in $HOME/.local/share if
/// that is not an absolute path. Empty if HOME is none either.
std::filesystem::path user_hand_path(const HandKey& hand);

}  // namespace softhand
