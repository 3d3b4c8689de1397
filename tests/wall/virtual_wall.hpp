// A user presses, taps and holds a virtual wall with a simulated haptic device. The wall may move. The real loop of the
// driver SDK drives it. The simulation's messages are late, jitter and get lost. Deterministic.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace softhand::wall {

/// Force, stiffness and damping are usual limits at 1 kHz. The forces are those of chai3d.
struct Device {
  std::string_view name;
  double force = 0;       ///< N
  double stiffness = 0;   ///< N/m
  double damping = 0;     ///< N s/m
  double mass = 0;        ///< kg, moving
  double friction = 0;    ///< N s/m, viscous
  double resolution = 0;  ///< m, of its sensor
};
/// Mass of the Touch: apparent mass at the tip in the data sheet of 3D Systems. Masses of the others are estimates.
/// Resolutions are those of the data sheets. The friction is an estimate at the low end, and there is no dry friction:
/// both would help.
inline constexpr std::array kDevices{Device{"Touch", 3.3, 400, 4, 0.045, 0.1, 55e-6},
                                     Device{"omega.7", 12, 5000, 30, 0.2, 0.1, 10e-6},
                                     Device{"Falcon", 8, 3000, 20, 0.15, 0.1, 60e-6}};

/// The user's hand on the device: a spring and a damper to where the user wants to be, and a mass.
struct Hand {
  std::string_view name;
  double stiffness = 0;  ///< N/m
  double damping = 0;    ///< N s/m
  double mass = 0;       ///< kg
};
/// Orders of magnitude of a fingertip that presses with about 2 N and 10 N (Hajian and Howe 1997, J. Biomech. Eng.
/// 119).
inline constexpr std::array kHands{Hand{"loose", 200, 2, 0.006}, Hand{"firm", 800, 5, 0.006}};

/// The way of the motion to the simulation and of its message back.
struct Link {
  double age = 0.011;     ///< s, mean age of the motion in a message when the message arrives
  double jitter = 0.004;  ///< s, the age varies by plus or minus this, uniformly
  double loss = 0.014;    ///< share of messages that do not arrive
  double rate = 90;       ///< Hz
};

/// What stands between the loop and the motors of the device.
struct Path {
  int delay = 0;       ///< steps of the loop: age of a position in the loop, and again of a force at the motors
  double missing = 0;  ///< share of the steps in which no new position has come; the next one brings the newest
  bool measures_velocity = false;
  bool knows_commands = false;  ///< a position comes with the force that acted before it
};

/// What the device gets.
enum class Mode {
  held,     ///< it does not measure, so each force is held until the next message: no local model and no controller
  touched,  ///< local model and controller; messages have the plane of the wall only after the hand touched it
  near,     ///< local model and controller; messages have the plane while the hand is near, as those of a rig
};

/// How the wall moves: to and fro, as a sine.
struct Swing {
  double amplitude = 0;     ///< m
  double frequency = 1;     ///< Hz
  bool is_carried = false;  ///< the hand moves with the wall, as with a held object; otherwise the hand stays
  bool tells_speed = true;  ///< messages have the velocity of the wall
};

struct Trial {
  Device device;
  Hand hand;
  Link link;
  double stiffness = 0;  ///< N/m of the wall
  Mode mode = Mode::near;
  std::uint64_t seed = 1;
  Path path{};
  Swing swing{};
};
struct Result {
  /// J that the user put in minus what came back, at its lowest; by the true motion, without what the motion of the
  /// wall gives.
  double lowest_energy = 0;
  double ripple = 0;    ///< m, peak to peak in the last half second of each hold
  double rendered = 0;  ///< mean force over mean depth in the last half second of the first hold, N/m
  /// N, RMS in the first hold: the force minus that of a wall without delay, within the limits of the device.
  double force_error = 0;
  /// Stable: no ripple above 0.2 mm. Passive: never below -1 mJ.
  bool stable() const { return ripple < 2e-4; }
  bool passive() const { return lowest_energy >= -1e-3; }
};
Result run(const Trial& trial);

/// The worst of each figure over both hands and five seeds. `trial.hand` and `trial.seed` are not used.
Result worst(Trial trial);

/// The largest stiffness up to which every wall is stable, and passive too if `passive`, by `worst`. Steps of 26 % from
/// 10 to 10,000 N/m; 0: none.
double largest_stiffness(const Device& device, const Link& link, Mode mode, bool passive, const Path& path = {});

}  // namespace softhand::wall
