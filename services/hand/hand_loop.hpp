// The loop of one or two hands. It takes the newest skeletons and world, makes one step, and returns the outputs for
// the topics. It uses no clock and no DDS.
//
// Hands of one loop touch each other, and hold objects together, in one implicit step (docs/two-hands.md). They own
// objects together, under the key of the first hand.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "hand/hand_options.hpp"
#include "hand/object_mirror.hpp"
#include "hand/played_hand.hpp"
#include "hand/soft_mirror.hpp"
#include "messages/messages.hpp"
#include "model/hand_model.hpp"
#include "scene/hand_simulation.hpp"

namespace softhand {

/// Input since the last step. A pointer is null if there is nothing new. The pointers are read during `step` only.
struct HandInput {
  /// Intermediate skeleton of the first hand; tracked skeleton if the layer is left out.
  const Skeleton* skeleton = nullptr;
  const HeadPose* head = nullptr;  ///< used only without the intermediate layer
  const WorldObjects* world = nullptr;
  std::span<const ObjectCoupling> other_hands{};    ///< the newest coupling of each other hand, also if it is not new
  const Skeleton* second_skeleton = nullptr;        ///< the same of the second hand
  std::span<const SoftObjectState> soft_objects{};  ///< new states of the world's copies of flexible objects
  /// Fast steps, from this step on. 0: as before. Ignored if the options have no work budget.
  double work_budget = 0;
};

struct HandCounters {
  std::uint64_t refused_nonfinite = 0;  ///< joints or objects with a number that is not finite
  std::uint64_t refused_future = 0;     ///< skeletons and worlds from the future
  std::uint64_t refused_soft = 0;       ///< states of flexible objects, as `SoftMirror::take`
  std::uint64_t refused_order = 0;      ///< samples that are not newer than the last one
  std::uint64_t repositioned = 0;
  std::uint64_t stale_steps = 0;           ///< steps whose newest skeleton was older than `stale_after`
  std::uint64_t failed_steps = 0;          ///< steps in which the solver failed and kept the state
  std::uint64_t budget_steps = 0;          ///< steps that reached the work budget before convergence
  std::uint64_t chord_steps = 0;           ///< chord steps (`NewtonSolver::use_linkage`)
  std::uint64_t objects_without_slot = 0;  ///< `ObjectMirrorCounters::without_slot`
};

/// A hand with its key on the topics.
struct KeyedHand {
  HandModel model;
  HandKey key;
};

class HandLoop {
 public:
  /// If the spring has a stiffness, objects use mode symmetric. `soft_objects`: of the scene.
  HandLoop(const HandModel& hand, const HandOptions& options, HandKey key, const ObjectSpring& object_spring = {},
           std::vector<SoftObject> soft_objects = {});
  /// The same for one or two hands of one user. Throws std::invalid_argument for two hands of the same side or of two
  /// users, and as `HandSimulation`.
  HandLoop(const std::vector<KeyedHand>& hands, const HandOptions& options, const ObjectSpring& object_spring = {},
           std::vector<SoftObject> soft_objects = {});
  ~HandLoop();

  /// Takes an object that the world announced, removed or moved to another place. The hand releases the object. World
  /// samples from before the description are not used for it. Call between steps. A new shape is built, which
  /// allocates. Throws std::invalid_argument and keeps the previous description on a bad shape or friction outside [0,
  /// 1e9]. For an object that can move, mass (kg) and inertia (kg m^2) must be in (0, 1e9].
  /// The shape of an object file comes with the description (object_shapes.hpp). If it does not, it is loaded here (see
  /// `use_file_shapes`).
  void describe_object(const ObjectDescription& description,
                       std::shared_ptr<const ShapeGeometry> file_shape = nullptr) {
    mirror_.describe_object(description, std::move(file_shape));
  }

  /// Loads shapes of object files that come without a shape, when a recorded run is repeated. Without this, such
  /// descriptions are refused.
  void use_file_shapes(ObjectMirror::LoadShape load) { mirror_.use_file_shapes(std::move(load)); }

  /// Takes a joint between two objects that the world announced or removed. The hand releases both objects. Call
  /// between steps. Throws std::invalid_argument and keeps the previous description if the joint cannot run.
  void describe_joint(const ObjectJointDescription& description) { mirror_.describe_joint(description); }

  /// Copies the state of `other`. Both loops then continue identically, as far as their options allow it. `other` must
  /// have the same hand, the same number of slots and the same objects. Call between steps. Allocates.
  void take_state(const HandLoop& other);

  // A saved state (docs/flight-recorder.md). A loop of the same hand and options can load it. It continues with the
  // same bits as the loop that saved it, if that one calls `forget` at the same time.
  void save(ByteWriter& out) const;
  /// Call it for a loop that has made no step and knows no objects. Throws std::runtime_error if the bytes do not fit.
  void load(ByteReader& in);
  /// Drops all that a step only reuses. Does not allocate.
  void forget() { simulation_->forget(); }
  /// Calls visit(name, value) for all parts of the state after a step.
  template <typename Visit>
  void for_each_part(Visit&& visit) const {
    simulation_->for_each_part(visit);
    visit("twins", output().coupling.twins);
    visit("counters", counters());
    visit("iterations", report().iterations);
    visit("residual", report().residual);
    visit("energy", report().energy);
  }
  /// Of the last step.
  const StepReport& report() const { return output().report; }

  /// Makes one step. The state afterwards is that at `now`. The stamps of the outputs contain the chain of the input.
  /// The caller fills in the rest of each stamp in place before the next step. Returns the output of the first hand. No
  /// step is made before the first skeleton.
  HandOutput& step(Nanoseconds now, const HandInput& input, const RequestedOutputs& requested);
  int hand_count() const { return static_cast<int>(hands_.size()); }
  HandKey key(int hand = 0) const { return hands_[static_cast<std::size_t>(hand)]->key(); }
  /// Of the last step.
  HandOutput& output(int hand = 0) { return hands_[static_cast<std::size_t>(hand)]->output(); }
  const HandOutput& output(int hand = 0) const { return hands_[static_cast<std::size_t>(hand)]->output(); }
  /// Whether any hand's pose is known, so that the outputs of the process are valid.
  bool plays() const;

  /// Returns to the initial state: without objects, and with an unknown pose until a skeleton arrives that was sampled
  /// after `time`. World samples up to `time` are ignored. Flexible objects are back where they started.
  void reset(Nanoseconds time);

  HandDescription description(int hand = 0) const;
  /// Of all flexible objects.
  std::vector<SoftObjectDescription> soft_object_descriptions() const;
  /// Answers messages. Keys:
  /// - `reposition` with any value moves the hands to their targets at once. They release what they hold.
  /// - `object.reset` NAME or * puts a flexible object back where it started, at rest. The world answers for the
  /// others.
  MessageReply answer(const Message& message, const std::string& module);
  /// Adds input age, results of the last step's solver, state figures, energies and counters.
  void fill_status(LoopStatus& status, Nanoseconds now) const;
  const HandSimulation& simulation() const { return *simulation_; }
  /// Real time at which the tracker's sample of the newest step was published. 0: none yet.
  Nanoseconds tracked_published() const { return output().simulated.stamp.chain.tracked_published; }
  HandCounters counters() const;
  const HandOptions& options() const { return options_; }
  /// Milliseconds since the newest skeleton was sampled, of the hand for which this is longest ago. Negative: no
  /// skeleton yet.
  double input_age_ms(Nanoseconds now) const;

 private:
  bool settles() const;
  void park_unknown();
  void take_world(Nanoseconds now, const WorldObjects& world);
  void write_outputs(Nanoseconds now, const RequestedOutputs& requested);
  MessageReply restart_soft_objects(const Message& message, const std::string& module);

  HandOptions options_;
  bool symmetric_;
  double time_step_;
  std::unique_ptr<HandSimulation> simulation_;
  std::vector<std::unique_ptr<PlayedHand>> hands_;
  ObjectMirror mirror_;
  SoftMirror soft_mirror_;
  Nanoseconds reset_time_ = -1;
  HandCounters counters_;  // of the steps and of worlds from the future
};

}  // namespace softhand
