// One hand of the hand's loop: its input, its targets, and what is published of it.
#pragma once

#include <array>
#include <vector>

#include "device/tracked_input.hpp"
#include "hand/hand_options.hpp"
#include "messages/messages.hpp"
#include "messages/plain_bytes.hpp"
#include "scene/hand_simulation.hpp"
#include "scene/skin_traction.hpp"

namespace softhand {

/// The outputs that have a subscriber. Other outputs are not computed.
struct RequestedOutputs {
  bool surface = true;
  bool contacts = true;
  bool traction = true;
  bool bone_wrench = true;
  bool soft_objects = true;
  bool ledger = true;  ///< the energy ledger of the status
};

struct HandOutput {
  bool valid = false;  ///< false before the first skeleton: the pose is unknown, and nothing must be published
  Skeleton simulated;
  Contacts contacts;
  SkinTraction traction;
  BoneWrench bone_wrench;  ///< written only if the intermediate layer is left out
  TissueSurface surface;
  // Of the process. Only the first hand's output has them.
  ObjectCoupling coupling;
  std::vector<SoftObjectState> soft_objects;  ///< one for each flexible object
  StepReport report;
};

class PlayedHand {
 public:
  /// `hand`: its number in the simulation. The simulation and the options must outlive this object.
  PlayedHand(HandSimulation& simulation, int hand, const HandOptions& options, HandKey key);

  HandKey key() const { return key_; }
  HandOutput& output() { return output_; }
  const HandOutput& output() const { return output_; }

  void take_state(const PlayedHand& other);
  void save(ByteWriter& out) const;
  /// Throws std::runtime_error if the bytes do not fit.
  void load(ByteReader& in);
  /// As `HandLoop::reset`.
  void reset(Nanoseconds time);

  /// The hand moves to its target at the next sample.
  void ask_reposition() { reposition_asked_ = true; }
  void take_head(Nanoseconds now, const HeadPose& head) { tracked_.add_head_pose(head, now); }
  /// A skeleton far from the simulated hand moves the hand there.
  void take_skeleton(Nanoseconds now, const Skeleton& skeleton);
  void set_targets(Nanoseconds now);
  /// After a step of `time_step` s that ended at `now`: writes the outputs, except those of the process.
  void end_step(Nanoseconds now, double time_step, const RequestedOutputs& requested);

  /// Whether a skeleton has told where the hand is.
  bool is_known() const { return any_skeleton_; }
  /// Whether the hand was just repositioned, so that its fingers move fast.
  bool settles() const { return settling_time_ > 0; }
  /// Milliseconds since the newest skeleton was sampled. Negative: no skeleton yet.
  double input_age_ms(Nanoseconds now) const;
  /// Number of regions of the skin that did not fit into the message.
  std::uint64_t dropped_regions() const { return traction_.dropped(); }

  struct Counters {
    std::uint64_t refused_nonfinite = 0, refused_future = 0, refused_order = 0, repositioned = 0, stale_steps = 0;
  };
  /// Without those of `tracked_counters`.
  const Counters& counters() const { return counters_; }
  const TrackedInputCounters& tracked_counters() const { return tracked_.counters(); }

 private:
  template <typename Self, typename Visit>
  static void visit_own(Self& self, Visit&& visit);
  void reposition(const Pose& wrist);
  void estimate_velocities(const Skeleton& before);
  Stamp next_stamp(Nanoseconds now) const;
  void write_skeleton();
  void write_surface();
  void write_bone_wrench(Nanoseconds now);

  HandSimulation& simulation_;
  int hand_;
  const HandOptions& options_;
  HandKey key_;
  SkinTractionReport traction_;
  TrackedInput tracked_;  // used only if the intermediate layer is left out
  Skeleton skeleton_;     // newest intermediate skeleton
  // Of the joints of `skeleton_`: mean velocity over the last samples (device/intermediate_motion.hpp).
  std::array<Twist, kJointCount> mean_velocities_{};
  bool any_skeleton_ = false;
  bool reposition_asked_ = false;
  double settling_time_ = 0;  // s until the fingers have come to the targets after a reposition
  Nanoseconds reset_time_ = -1;
  Counters counters_;
  HandOutput output_;
};

}  // namespace softhand
