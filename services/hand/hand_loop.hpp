// The hand's loop: takes the newest skeleton and world, makes one step, gives everything that others may want to know.
// No clock, no DDS.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "device/tracked_input.hpp"
#include "hand/hand_options.hpp"
#include "messages/messages.hpp"
#include "model/hand_model.hpp"
#include "scene/hand_simulation.hpp"

namespace softhand {

/// What came since the last step; null where nothing new did. The pointers are read during `step` only.
struct HandInput {
  const Skeleton* skeleton = nullptr;  ///< intermediate; tracked when the layer is left out
  const HeadPose* head = nullptr;      ///< only used without the intermediate layer
  const WorldObjects* world = nullptr;
};

/// Which outputs somebody reads: the others are not computed.
struct HandWants {
  bool surface = true;
  bool contacts = true;
  bool bone_wrench = true;
  bool ledger = true;  ///< the energy ledger of the status
};

struct HandOutput {
  bool valid = false;  ///< false before the first skeleton: the hand is nowhere yet, and nothing is to be published
  Skeleton simulated;
  ObjectCoupling coupling;
  Contacts contacts;
  BoneWrench bone_wrench;  ///< written only when the intermediate layer is left out
  TissueSurface surface;
  StepReport report;
};

struct HandCounters {
  std::uint64_t refused_nonfinite = 0;  ///< joints or objects with a number that is not finite
  std::uint64_t refused_order = 0;      ///< samples that are not newer than the last
  std::uint64_t repositioned = 0;
  std::uint64_t stale_steps = 0;           ///< steps whose newest skeleton was older than `stale_after`
  std::uint64_t failed_steps = 0;          ///< steps that the solver gave up, keeping the state
  std::uint64_t budget_steps = 0;          ///< steps that ended for want of time before they had converged
  std::uint64_t chord_steps = 0;           ///< chord steps (`NewtonSolver::allow_chord_steps`)
  std::uint64_t objects_without_slot = 0;  ///< (object, step) pairs that were near the hand while all slots were taken
};

class HandLoop {
 public:
  /// A spring with stiffness selects mode symmetric for objects.
  HandLoop(const HandModel& hand, const HandOptions& options, HandKey key, const ObjectSpring& object_spring = {});
  ~HandLoop();

  /// An object that the world announced, or removed, or put elsewhere: it is let go, and states sampled before the
  /// description are not used. Between steps; builds a shape that it does not know, which allocates. Throws
  /// std::invalid_argument on a bad shape, friction out of [0, 1e9], and, of what moves, mass (kg) or inertia (kg m^2)
  /// out of (0, 1e9]; it is then described as before.
  void describe_object(const ObjectDescription& description);

  /// Becomes what `other` is: both then go on alike where their options allow it. `other` was made of the same hand
  /// with as many slots, and heard of the same objects. Between steps; allocates.
  void take_state(const HandLoop& other);

  /// One step, after which the state is that at `now`. Stamps of the outputs carry the input's chain; the rest of them
  /// is the caller's to fill in, in place, before the next step.
  HandOutput& step(Nanoseconds now, const HandInput& input, const HandWants& wants);

  /// As at the start: empty-handed, and nowhere until a skeleton comes that was sampled after `time`. What the world
  /// said until then is not used.
  void reset(Nanoseconds time);

  HandDescription description() const;
  /// Answers `reposition` (any value: the hand goes to its target at once, and lets go of what it holds).
  MessageReply answer(const Message& message, const std::string& module);
  /// Adds input age, what the last step's solver and state show, energies and counters.
  void fill_status(LoopStatus& status, Nanoseconds now) const;
  const HandSimulation& simulation() const { return *simulation_; }
  const HandCounters& counters() const { return counters_; }
  const HandOptions& options() const { return options_; }
  /// Milliseconds since the newest skeleton was sampled; negative = none yet.
  double input_age_ms(Nanoseconds now) const;

 private:
  struct KnownObject {
    std::uint32_t id = 0;
    ObjectDescription description;
    std::shared_ptr<const ShapeGeometry> shape;  // shared with a loop that took this one's state
    MirroredObject mirrored;
    double bounding_radius = 0;
    ObjectState state;    // newest from the world
    bool seen = false;    // `state` holds something
    bool listed = false;  // in the newest sample
    double distance = 0;  // to the hand, m; infinity where it is surely beyond all reach
    double near = 0;      // m; mirrored from this distance on
    int slot = -1;
    bool owned = false;
    Nanoseconds last_touch = 0;
  };

  void clear_slot(KnownObject& object);
  void take_skeleton(Nanoseconds now, const Skeleton& skeleton);
  void take_world(const WorldObjects& world);
  void set_targets(Nanoseconds now);
  void mirror_objects(Nanoseconds now);
  void mirror(KnownObject& object, Nanoseconds now);
  void measure_distances();
  void give_slots(Nanoseconds now);
  void write_outputs(Nanoseconds now, const HandWants& wants);
  /// By how much the world's sample is extrapolated to this time, s; negative where the sample is newer.
  double extrapolation_of_world(Nanoseconds time) const;
  /// The same to the start of the step that ends at `now`, and the part of the step in which the limit lets it go on.
  struct WorldStep {
    double to_start = 0;
    double moving_part = 1;
  };
  WorldStep world_step(Nanoseconds now) const;
  void follow_world(const KnownObject& object, Nanoseconds now);

  HandOptions options_;
  HandKey key_;
  bool symmetric_;
  double time_step_;
  std::unique_ptr<HandSimulation> simulation_;
  TrackedInput tracked_;  // used when the intermediate layer is left out
  std::vector<KnownObject> objects_;
  std::vector<int> slot_object_;  // index into objects_, -1 = free
  std::vector<int> waiting_;      // of them, those near the hand without a slot, nearest first
  Skeleton skeleton_;             // newest intermediate
  bool any_skeleton_ = false;
  bool reposition_asked_ = false;
  Nanoseconds world_time_ = 0;
  Nanoseconds reset_time_ = -1;
  HandCounters counters_;
  HandOutput output_;
};

}  // namespace softhand
