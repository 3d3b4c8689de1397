// Who moves the flexible objects (docs/soft-objects.md): the hand, or the world that shares them (`world.soft` =
// "world"). Objects that are the hand's alone wait at their start until the world is known. Otherwise they would fall
// through a table that the world has not announced yet.
#pragma once

#include <vector>

#include "hand/hand_options.hpp"
#include "messages/messages.hpp"
#include "messages/plain_bytes.hpp"
#include "scene/hand_simulation.hpp"

namespace softhand {

class SoftMirror {
 public:
  /// `symmetric`: springs couple shared objects with the world's copies, and nobody owns them. The arguments must
  /// outlive this object.
  SoftMirror(HandSimulation& simulation, const HandOptions& options, bool symmetric);

  /// Takes a state of a world's copy, if it is newer than the last one. Returns false if it is from the future, of an
  /// unknown object, or not plausible (messages/plausible.hpp).
  bool take(Nanoseconds now, const SoftObjectState& copy);
  /// Before a step that ends at `now`: shared objects that the hand does not own are where the world has them. If
  /// something that moves may touch one, the step moves them as if the hand owned them. So the first touch is that of a
  /// free object. `knows_world`: `ObjectMirror::knows_world`.
  void begin_step(Nanoseconds now, bool knows_world);
  /// After the step: the hand owns the shared objects that were touched within the release time. A hand, another
  /// flexible object, or a rigid object that the hand owns can touch. An object that waits is owned once a hand touches
  /// it.
  void end_step();
  bool owns(int object) const { return objects_[static_cast<std::size_t>(object)].owned; }
  /// The hand owns none. They are where the scene has them, until a state of the world comes.
  void release_all();
  void release(int object);
  /// Copies the state of a mirror with the same objects.
  void take_state(const SoftMirror& other) { objects_ = other.objects_; }

  template <typename Self, typename Visit>
  static void visit_members(Self& self, Visit&& visit) {
    for (auto& object : self.objects_) {
      visit(object.owned);
      visit(object.untouched);
      visit(object.since_release);
      visit(object.placed);
      visit(object.copy);
    }
  }

 private:
  struct Object {
    bool owned = false;
    double untouched = 0;      // s since the last touch of an owned object
    double since_release = 0;  // s since `release`, up to kHoldoff
    bool placed = false;       // mode symmetric: the nodes began where the world had them
    SoftObjectState copy;      // the world's newest one; with the time 0 it is that of the scene
  };
  bool touches(int object) const;
  bool may_touch(int object) const;
  void pull(Nanoseconds now);

  HandSimulation& simulation_;
  const HandOptions& options_;
  bool symmetric_;
  double time_step_;
  std::vector<Object> objects_;
};

}  // namespace softhand
