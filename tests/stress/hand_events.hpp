// Events on the hand's physics alone (HandSimulation). The hand is released from an impossible state, or pressed on an
// object.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "geometry/shape.hpp"
#include "model/hand_model.hpp"
#include "scene/hand_simulation.hpp"
#include "stress/stress.hpp"
#include "stress/watch.hpp"

namespace softhand::stress {

inline constexpr double kStep = 1.0 / 90;  ///< s, step of the default hand loop

/// The shipped hand of the stress cases, config/hands/right_400.hand.json. It is read once.
const HandModel& shipped_hand();

/// All bones of `hand` with the tissue of one finger. This hand is small, and its contacts are those of a whole finger.
HandModel one_finger(const HandModel& hand, Finger finger);

/// The lowest node (towards the palm) of the tissue around a finger's last bone at rest, m.
Vector3 pad_of(const HandModel& hand, Finger finger);

/// Displacement and velocity of a body at a time.
struct Displacement {
  Vector3 shift = Vector3::Zero();     ///< m from the start
  Vector3 velocity = Vector3::Zero();  ///< m/s
};

/// Pulls all bones to their rest poses, moved by `motion`.
void hold_bones(HandSimulation& simulation, const Displacement& motion);

/// Puts the hand into the state that `disturb` makes from the rest state, then releases it. The couplings hold the
/// bones. The findings are G3 and all demands of HandWatch.
struct Release {
  HandModel hand = shipped_hand();
  SimulationOptions options{};
  std::function<void(State&)> disturb;
  bool overlapping = false;  ///< skin starts inside other skin; G2 counts the overlap as work put in
  std::function<void(const HandSimulation&)> after_step = [](const HandSimulation&) {};
};
Findings let_go(const Release& release);

Shape box_shape(const Vector3& half_extents);
Shape round_shape(ShapeKind kind, double radius, double half_length);

struct EventObject {
  Shape shape;
  std::shared_ptr<const ShapeGeometry> geometry;  ///< instead of `shape`, for example a distance grid
  Pose pose;
  double mass = 0;  ///< kg; 0: the motion is given
  double friction = 0.8;
  std::function<Displacement(double)> motion = [](double) { return Displacement{}; };  ///< if the motion is given
  /// rad/s. With mass 0: during the whole motion; else at the start.
  Vector3 spin = Vector3::Zero();
  Vector3 velocity = Vector3::Zero();  ///< m/s, at the start, for an object with mass
  bool on_table = false;               ///< a static half-space under the lowest point at the start carries the object
  double table_friction = 0.8;
};

/// Bones that follow a given motion, and one object.
struct Event {
  HandModel hand = shipped_hand();
  SimulationOptions options{};
  std::function<double(int)> time_step = [](int) { return kStep; };  ///< s, of the n-th step
  double seconds = 1;
  /// displacement of all bones from rest
  std::function<Displacement(double)> bones = [](double) { return Displacement{}; };
  EventObject object;
  /// The hand starts inside the object. G5 ignores penetrations, and G2 counts the overlap as work put in.
  bool overlapping = false;
  /// The object moves centimetres in a step. G2 counts the energy at the start of a contact as the object's work.
  bool strokes = false;
};

/// State after a step, for further measurements of a case.
struct EventStep {
  double time = 0;
  const HandSimulation& simulation;
  const StepReport& report;
  int slot = 0;  ///< slot of the object
};

/// Runs the event and adds all demands of HandWatch. `slow` is passed to HandWatch::judge.
Findings run(const Event& event, const std::function<void(const EventStep&)>& after_step = {}, double slow = 0.5);

/// Runs the event. Adds the demand that the hand's force on the object is at least `least` N at the end.
Findings run_touching(const Event& event, double least, const char* invariant = "touched",
                      const char* quantity = "force at the end");

/// The index fingertip starts in the middle of an object, which is moved there and stays. The nodes must leave it, at
/// less than 1 m/s.
Findings start_inside(const EventObject& object);

/// The force with which a finger slides over a horizontal surface. `add` takes the wrench of contact of a step.
class SlidingForce {
 public:
  void add(const Wrench& contact);
  /// Demands that the mean drag is `friction` times the normal force within 2 %, and steady within 5 % of its mean.
  void judge(double friction, Findings& findings) const;

 private:
  double count_ = 0;
  double drag_ = 0, drag_squared_ = 0, normal_ = 0;  // sums, N and N^2
};

/// All bones move by `depth` m towards the palm's side within `time` s, with minimum jerk. Then they stay there.
std::function<Displacement(double)> press_down(double depth, double time);

/// The hand pressed on a block. Its pads touch after 2 mm, and their targets go `depth` m further within 0.3 s.
Event pressed_on_block(double depth);

}  // namespace softhand::stress
