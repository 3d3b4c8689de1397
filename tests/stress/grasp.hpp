// A pinch through all real loops on the virtual clock (tracker, tracking, hand, world, glove), with faults on the way.
//
// Two fingers of the shipped hand come to a 50 g cube on a table, close, and lift it by 50 mm within 1.2 s; then it is
// held.
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
inline constexpr double kEvent = 1.5;       ///< s, when something happens: the cube is held
inline constexpr std::uint32_t kCube = 2;   ///< its id

struct Grasp {
  double seconds = 2;
  std::vector<std::string> overrides;    ///< of scene keys; what they get wrong is refused at load
  std::function<void(HandModel&)> hand;  ///< changes the simulated hand; the motion stays the shipped hand's
  /// Changes what the tracker delivers at a time: `out` starts as {sample}.
  std::function<void(double time, std::deque<Skeleton>& out)> tracker;
  std::function<bool(RigLoop, double)> runs;         ///< as RigWitness, in seconds from the start
  std::function<double(RigLoop, double)> delay;      ///< s more than usual; negative: lost
  std::function<void(VirtualRig&, double)> at_step;  ///< after each step of the hand
  bool overlaps =
      false;  ///< the event itself makes the hand and an object overlap: G2 takes it for work in, G5 does not count
  bool held = true;  ///< demand that the cube is lifted and still held at the end
};

struct ObjectSample {
  double time = 0;
  Pose pose;
  double speed = 0;  ///< m/s
};

struct Grasped {
  Findings findings;               ///< of the invariants and of holding; empty but for the refusal where it was refused
  std::vector<ObjectSample> twin;  ///< the hand's copy of the cube, a step
  std::vector<ObjectSample> world;        ///< the world's, a world step
  std::vector<std::array<Pose, 2>> pads;  ///< last bones of thumb and index, with `twin`
  std::vector<double> pad_forces;         ///< N, largest of the fingers, with `twin`
  double first_stale = -1;     ///< s, when the tracking loop first said that its tracker is stale; negative: never
  double largest_command = 0;  ///< N, of the glove
  TrackedInputCounters tracking;
  std::uint64_t unconverged = 0;  ///< steps
  std::string hash;               ///< over every state of every loop
  State state;                    ///< of the hand at the end

  /// m, the largest movement of the cube in the frame of either last bone between two times.
  double slip(double from, double to) const;
  /// m, RMS of the cube's place about its mean between two times.
  double jitter(double from, double to) const;
  /// m/s, of a line through the cube's places between two times.
  double drift(double from, double to) const;
  /// m/s, the largest of the cube in the world since a time.
  double fastest(double from) const;
  /// Adds the demand that the cube in the world stayed below 5 m/s.
  void demand_slow_cube();
};

Grasped grasp(const Grasp& setting);

/// All of `grasp`'s findings.
inline Findings grasp_findings(const Grasp& setting) { return grasp(setting).findings; }

/// Of a configuration that must be refused at load.
Findings refused(const Grasp& setting);

/// A message to the world, as `softhand send` sends it.
void tell_world(VirtualRig& rig, const char* key, const char* value);

}  // namespace softhand::stress
