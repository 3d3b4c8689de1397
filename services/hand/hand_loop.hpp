// The loop of the hand. It takes the newest skeleton and world, makes one step, and returns the outputs for the topics.
// It uses no clock and no DDS.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <vector>

#include "device/tracked_input.hpp"
#include "hand/hand_options.hpp"
#include "messages/messages.hpp"
#include "model/hand_model.hpp"
#include "scene/hand_simulation.hpp"

namespace softhand {

/// Input since the last step. A pointer is null if there is nothing new. The pointers are read during `step` only.
struct HandInput {
  const Skeleton* skeleton = nullptr;  ///< intermediate skeleton; tracked skeleton if the layer is left out
  const HeadPose* head = nullptr;      ///< used only without the intermediate layer
  const WorldObjects* world = nullptr;
};

/// The outputs that have a subscriber. Other outputs are not computed.
struct RequestedOutputs {
  bool surface = true;
  bool contacts = true;
  bool bone_wrench = true;
  bool ledger = true;  ///< the energy ledger of the status
};

struct HandOutput {
  bool valid = false;  ///< false before the first skeleton: the pose is unknown, and nothing must be published
  Skeleton simulated;
  ObjectCoupling coupling;
  Contacts contacts;
  BoneWrench bone_wrench;  ///< written only if the intermediate layer is left out
  TissueSurface surface;
  StepReport report;
};

struct HandCounters {
  std::uint64_t refused_nonfinite = 0;  ///< joints or objects with a number that is not finite
  std::uint64_t refused_order = 0;      ///< samples that are not newer than the last one
  std::uint64_t repositioned = 0;
  std::uint64_t stale_steps = 0;   ///< steps whose newest skeleton was older than `stale_after`
  std::uint64_t failed_steps = 0;  ///< steps in which the solver failed and kept the state
  std::uint64_t budget_steps = 0;  ///< steps that reached the work budget before convergence
  std::uint64_t chord_steps = 0;   ///< chord steps (`NewtonSolver::use_linkage`)
  /// (object, step) pairs near the hand without a slot: all slots were taken, or too few were free for all objects that
  /// joints connect.
  std::uint64_t objects_without_slot = 0;
};

class HandLoop {
 public:
  /// If the spring has a stiffness, objects use mode symmetric.
  HandLoop(const HandModel& hand, const HandOptions& options, HandKey key, const ObjectSpring& object_spring = {});
  ~HandLoop();

  /// Takes an object that the world announced, removed or moved to another place. The hand releases the object. World
  /// samples from before the description are not used for it. Call between steps. A new shape is built, which
  /// allocates. Throws std::invalid_argument and keeps the previous description on a bad shape or friction outside [0,
  /// 1e9]. For an object that can move, mass (kg) and inertia (kg m^2) must be in (0, 1e9].
  /// The shape of an object file comes with the description (object_shapes.hpp). If it does not, it is loaded here (see
  /// `use_file_shapes`).
  void describe_object(const ObjectDescription& description, std::shared_ptr<const ShapeGeometry> file_shape = nullptr);

  /// Loads shapes of object files that come without a shape, when a recorded run is repeated. Without this, such
  /// descriptions are refused.
  using LoadShape = std::function<std::shared_ptr<const ShapeGeometry>(const ShapeFile&)>;
  void use_file_shapes(LoadShape load) { load_shape_ = std::move(load); }

  /// Takes a joint between two objects that the world announced or removed. The hand releases both objects. Call
  /// between steps. Throws std::invalid_argument and keeps the previous description if the joint cannot run.
  void describe_joint(const ObjectJointDescription& description);

  /// Copies the state of `other`. Both loops then continue identically, as far as their options allow it. `other` must
  /// have the same hand, the same number of slots and the same objects. Call between steps. Allocates.
  void take_state(const HandLoop& other);

  // A saved state (docs/flight-recorder.md; hand_memory.cpp). A loop of the same hand and options that loads it
  // continues with the same bits as the loop that saved it, if that one calls `forget` at the same time.
  void save(ByteWriter& out) const;
  /// Call it for a loop that has made no step and knows no objects. Throws std::runtime_error if the bytes do not fit.
  void load(ByteReader& in);
  /// Drops all that a step only reuses. Does not allocate.
  void forget() { simulation_->forget(); }
  /// Calls visit(name, value) for all parts of the state after a step.
  template <typename Visit>
  void for_each_part(Visit&& visit) const {
    simulation_->for_each_part(visit);
    visit("twins", output_.coupling.twins);
    visit("counters", counters_);
    visit("iterations", output_.report.iterations);
    visit("residual", output_.report.residual);
    visit("energy", output_.report.energy);
  }
  /// Of the last step.
  const StepReport& report() const { return output_.report; }

  /// Makes one step. The state afterwards is that at `now`. The stamps of the outputs contain the chain of the input.
  /// The caller fills in the rest of each stamp in place before the next step.
  HandOutput& step(Nanoseconds now, const HandInput& input, const RequestedOutputs& requested);

  /// Returns to the initial state: without objects, and with an unknown pose until a skeleton arrives that was sampled
  /// after `time`. World samples up to `time` are ignored.
  void reset(Nanoseconds time);

  HandDescription description() const;
  /// Answers `reposition` with any value: the hand moves to its target at once and releases what it holds.
  MessageReply answer(const Message& message, const std::string& module);
  /// Adds input age, results of the last step's solver, state figures, energies and counters.
  void fill_status(LoopStatus& status, Nanoseconds now) const;
  const HandSimulation& simulation() const { return *simulation_; }
  const HandCounters& counters() const { return counters_; }
  const HandOptions& options() const { return options_; }
  /// Milliseconds since the newest skeleton was sampled. Negative: no skeleton yet.
  double input_age_ms(Nanoseconds now) const;

 private:
  struct KnownObject {
    std::uint32_t id = 0;
    ObjectDescription description;
    std::shared_ptr<const ShapeGeometry> shape;  // shared with a loop that copied this loop's state
    MirroredObject mirrored;
    double bounding_radius = 0;
    ObjectState state;    // newest state from the world
    bool seen = false;    // `state` is valid
    bool listed = false;  // is in the newest world sample
    double distance = 0;  // m, to the hand; infinity if it is certainly out of reach
    double near = 0;      // m; the object is mirrored at or below this distance
    int slot = -1;
    std::uint32_t assembly = 0;  // id of one of the movable objects that joints connect; its own without joints
    bool jointed = false;        // the assembly has more than one object or a joint
    bool owned = false;
    bool is_free = false;  // it is a free body in this step: the hand owns it, or may touch it in this step
    Nanoseconds last_touch = 0;
  };

  struct KnownJoint {
    std::uint32_t id = 0;
    std::uint32_t parent = 0, child = 0;  // object ids
    JointLaw law;
    Pose parent_from_joint, child_from_joint;
    int place = -1;  // in the simulation; -1: does not act
  };

  void clear_slot(KnownObject& object);
  void release(std::uint32_t assembly);
  void find_assemblies();
  KnownObject* find_object(std::uint32_t id);
  bool get_slots_for_assembly(KnownObject& object, Nanoseconds now);
  void give_slot(std::size_t object, int slot, Nanoseconds now);
  void move_joints();
  void set_joint(const KnownJoint& joint, const KnownObject& parent, const KnownObject& child);
  template <typename Self, typename Visit>
  static void visit_own(Self& self, Visit&& visit);
  void take_skeleton(Nanoseconds now, const Skeleton& skeleton);
  void take_world(const WorldObjects& world);
  void set_targets(Nanoseconds now);
  void mirror_objects(Nanoseconds now);
  void follow_or_own(KnownObject& object, Nanoseconds now);
  void set_body(KnownObject& object, Nanoseconds now);
  void measure_distances();
  void give_slots(Nanoseconds now);
  void write_outputs(Nanoseconds now, const RequestedOutputs& requested);
  /// Time (s) by which the world's sample is extrapolated to `time`. Negative if the sample is newer.
  double extrapolation_of_world(Nanoseconds time) const;
  /// The same for the start of the step that ends at `now`. `moving_part` is the part of the step in which the
  /// extrapolation limit allows motion.
  struct WorldStep {
    double to_start = 0;
    double moving_part = 1;
  };
  WorldStep world_step(Nanoseconds now) const;
  void follow_world(const KnownObject& object, Nanoseconds now);

  HandOptions options_;
  LoadShape load_shape_;
  HandKey key_;
  bool symmetric_;
  double time_step_;
  std::unique_ptr<HandSimulation> simulation_;
  TrackedInput tracked_;  // used only if the intermediate layer is left out
  std::vector<KnownObject> objects_;
  std::vector<KnownJoint> joints_;
  std::vector<int> slot_object_;  // index into objects_, -1 = free
  std::vector<int> waiting_;      // indices into objects_ of near objects without a slot, nearest first
  Skeleton skeleton_;             // newest intermediate skeleton
  bool any_skeleton_ = false;
  bool reposition_asked_ = false;
  double settling_time_ = 0;  // s until the fingers have come to the targets after a reposition
  Nanoseconds world_time_ = 0;
  Nanoseconds reset_time_ = -1;
  HandCounters counters_;
  HandOutput output_;
};

}  // namespace softhand
