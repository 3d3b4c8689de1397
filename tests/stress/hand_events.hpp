// Events on the hand's physics alone (HandSimulation), where a case is about it: let go from an impossible state;
// pressed on an object.
#pragma once

#include <functional>
#include <string>

#include "model/hand_model.hpp"
#include "scene/hand_simulation.hpp"
#include "stress/stress.hpp"
#include "stress/watch.hpp"

namespace softhand::stress {

inline constexpr double kStep = 1.0 / 90;  ///< s, of the default hand loop

/// The shipped hand that stress cases use: config/hands/right_400.hand.json, read once.
const HandModel& shipped_hand();

/// Of `hand` one finger's tissue with all the bones: small, and with everything that a finger's contact has.
HandModel one_finger(const HandModel& hand, Finger finger);

/// The lowest node (towards the palm) of the tissue around a finger's last bone, at rest, m.
Vector3 pad_of(const HandModel& hand, Finger finger);

/// The hand is put into the state that `disturb` makes of its rest and let go, held by its couplings: G3 and all that
/// HandWatch judges.
struct Release {
  HandModel hand = shipped_hand();
  std::function<void(State&)> disturb;
};
Findings let_go(const Release& release);

Shape box_shape(const Vector3& half_extents);
Shape round_shape(ShapeKind kind, double radius, double half_length);

/// How something moves: where it is and how fast, at a time.
struct Displacement {
  Vector3 shift = Vector3::Zero();     ///< m from where it began
  Vector3 velocity = Vector3::Zero();  ///< m/s
};

struct EventObject {
  Shape shape;
  Pose pose;
  double mass = 0;  ///< kg; 0: its motion is given
  double friction = 0.8;
  std::function<Displacement(double)> motion = [](double) { return Displacement{}; };  ///< of a given motion
  Vector3 spin = Vector3::Zero();      ///< rad/s, of a given motion; of one with mass at the start
  Vector3 velocity = Vector3::Zero();  ///< m/s, of one with mass at the start
  bool on_table = false;               ///< a static half-space carries it, under its lowest point at the start
  double table_friction = 0.8;
};

/// Bones that follow a given motion, and one object.
struct Event {
  HandModel hand = shipped_hand();
  SimulationOptions options{};
  std::function<double(int)> time_step = [](int) { return kStep; };  ///< s, of the n-th step
  double seconds = 1;
  std::function<Displacement(double)> bones = [](double) { return Displacement{}; };  ///< of all bones from rest
  EventObject object;
  bool overlapping =
      false;             ///< the hand starts inside the object: G5 does not count, and G2 takes the overlap for work in
  bool strokes = false;  ///< the object crosses centimetres in a step: G2 takes what a contact begins with for its work
};

/// What a step left, for what a case wants to know more.
struct EventStep {
  double time = 0;
  const HandSimulation& simulation;
  const StepReport& report;
  int slot = 0;  ///< of the object
};

/// Runs it; judges all that HandWatch does, `slow` as there.
Findings run(const Event& event, const std::function<void(const EventStep&)>& after_step = {}, double slow = 0.5);

/// The same, and demands that the hand's force on the object is at least `least` N at the end.
Findings run_touching(const Event& event, double least, const char* invariant = "touched",
                      const char* quantity = "force at the end");

/// All bones go towards the palm's side by `depth` m within `time` s, by minimum jerk, and stay.
std::function<Displacement(double)> press_down(double depth, double time);

/// The hand pressed on a block: its pads touch after 2 mm and are asked to go `depth` m further within 0.3 s.
Event pressed_on_block(double depth);

}  // namespace softhand::stress
