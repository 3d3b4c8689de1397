// A pinch through all real loops on the virtual clock (tracker, tracking, hand, world, glove), with faults on the way.
//
// Two fingers of the shipped hand reach a 50 g cube on a table and close. They lift the cube by 50 mm within 1.2 s and
// then hold it.
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "cli/virtual_rig.hpp"
#include "stress/stress.hpp"
#include "stress/watch.hpp"

namespace softhand::stress {

inline constexpr double kHoldBegins = 1.2;  ///< s
inline constexpr double kEvent = 1.5;       ///< s, time of the event; the cube is held then
inline constexpr std::uint32_t kCube = 2;   ///< id of the cube

struct Grasp {
  double seconds = 2;
  std::vector<std::string> overrides;    ///< of scene keys; a wrong override is refused at load
  std::function<void(HandModel&)> hand;  ///< changes the simulated hand; the motion stays that of the shipped hand
  /// Changes the samples that the tracker delivers at a time. `out` starts as {sample}.
  std::function<void(double time, std::deque<Skeleton>& out)> tracker;
  std::function<bool(RigLoop, double)> runs;         ///< like RigWitness::runs, with seconds from the start
  std::function<double(RigLoop, double)> delay;      ///< additional delay, s; negative: the message is lost
  std::function<void(VirtualRig&, double)> at_step;  ///< after each step of the hand
  /// The event itself makes the hand and an object overlap. G2 then counts the overlap as work put in, and G5 ignores
  /// penetrations.
  bool overlaps = false;
  bool held = true;  ///< demands that the cube is lifted and still held at the end
};

struct ObjectSample {
  double time = 0;
  Pose pose;
  double speed = 0;  ///< m/s
};

struct Grasped {
  /// Demands of the invariants and of holding. If the configuration was refused, only the refusal is set.
  Findings findings;
  std::vector<ObjectSample> twin;   ///< the hand's copy of the cube, one sample per step
  std::vector<ObjectSample> world;  ///< the world's cube, one sample per world step
  /// poses of the last bones of thumb and index finger, one entry per entry of `twin`
  std::vector<std::array<Pose, 2>> pads;
  std::vector<double> pad_forces;  ///< N, largest force of a finger, one entry per entry of `twin`
  /// Time at which the tracking loop first reported its tracker as stale, s. Negative: never.
  double first_stale = -1;
  double largest_command = 0;  ///< largest command to the glove, N
  TrackedInputCounters tracking;
  std::uint64_t unconverged = 0;  ///< steps that did not converge
  std::string hash;               ///< hash over every state of every loop
  State state;                    ///< state of the hand at the end

  /// Largest movement of the cube relative to the last bone of thumb or index finger between two times, m.
  double slip(double from, double to) const;
  /// RMS distance of the cube from its mean position between two times, m.
  double jitter(double from, double to) const;
  /// Speed of a straight line fitted to the cube's positions between two times, m/s.
  double drift(double from, double to) const;
  /// Largest speed of the cube in the world from a time on, m/s.
  double fastest(double from) const;
  /// Adds the demand that the speed of the cube in the world stayed below 5 m/s.
  void demand_slow_cube();
};

Grasped grasp(const Grasp& setting);

/// Runs the grasp and returns only its findings.
inline Findings grasp_findings(const Grasp& setting) { return grasp(setting).findings; }

/// Findings of a configuration that must be refused at load.
Findings refused(const Grasp& setting);

/// Sends a message to the world as `softhand send` does.
void tell_world(VirtualRig& rig, const char* key, const char* value);

}  // namespace softhand::stress
