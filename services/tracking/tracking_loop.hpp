// The loop that owns the intermediate skeleton (figure 2A): tracked skeleton --U_crb-- intermediate --U_crb-- copy of
// the simulated skeleton.
//
// Each step minimises the incremental potential (eqs. 10-11) bone by bone. It has the inertia of the intermediate bone,
// its absolute damping and two couplings of eq. 18. The unknowns of a bone are the position and orientation of its
// joint frame. The mass of the bone is lumped at the joint with an isotropic inertia. This inertia is our regulariser,
// not anatomy. It has no lever arm, so translation and rotation separate. Translation has a closed form, and rotation
// takes a few Newton iterations. The coupling to the tracker is capped like the hand's own coupling, with caps that are
// `stiffness_ratio` times higher.
#pragma once

#include <array>
#include <limits>
#include <string>

#include "device/bone_contacts.hpp"
#include "device/tracked_input.hpp"
#include "energies/energy_ledger.hpp"
#include "messages/messages.hpp"
#include "model/hand_model.hpp"
#include "tracking/tracking_options.hpp"

namespace softhand {

/// Input since the last step. A null pointer means nothing new. The pointers must be valid during the call only.
struct TrackingInput {
  const Skeleton* tracked = nullptr;
  const Skeleton* simulated = nullptr;
  const HeadPose* head = nullptr;
  const Contacts* contacts = nullptr;
  bool wrench_requested = true;  ///< false without a subscriber of bone_wrench: it is not updated
  bool ledger_requested = true;  ///< false without a subscriber of the status: no energies are computed
};

struct TrackingOutput {
  Skeleton intermediate;
  BoneWrench wrench;
  bool valid = false;  ///< false before the first tracked sample: nothing must be published
};

/// Growth per hand period of small deviations, for the worst bone. It is computed by running the linear chain of
/// intermediate and simulated bone. The copied states are up to one hand period, 1/hand_rate_hz, old. Stable if below
/// 1.
double chain_growth(const TrackingOptions& options, double hand_rate_hz, const HandModel& hand);

/// Throws std::invalid_argument with the growth and the nearest stable values unless `chain_growth` is below 1.
void check_stability(const TrackingOptions& options, double hand_rate_hz, const HandModel& hand);

class TrackingLoop {
 public:
  /// Checks the stability with a hand simulation of `hand_rate_hz`. Uses only the skeleton of `hand`: rest joints,
  /// masses, couplings.
  TrackingLoop(const TrackingOptions& options, double hand_rate_hz, const HandModel& hand, HandKey key);

  /// Makes one step of 1/rate_hz that ends at `now`. The result is valid until the next call.
  const TrackingOutput& step(Nanoseconds now, const TrackingInput& input);
  /// Returns to the initial state, with the feedback ratio that a message set. Nothing is valid until a tracker sample
  /// arrives that was taken after `time`.
  void reset(Nanoseconds time);
  /// Answers `reposition` (any value: the intermediate skeleton jumps to the tracked one) and `feedback_ratio` (0 to
  /// the configured value).
  MessageReply answer(const Message& message, const std::string& module);

  const TrackedInput& input() const { return input_; }
  /// Energy ledger of the intermediate skeleton. The energy is stored in its springs and its motion. The two skeletons
  /// that pull at it do work on it, and its damping against the world dissipates energy.
  const EnergyLedger& ledger() const { return ledger_; }
  /// For writing and reading all that steps and messages have changed (messages/plain_bytes.hpp). A loop of the same
  /// options that reads what another one has written continues alike.
  template <typename Self, typename Visit>
  static void visit_members(Self& self, Visit&& visit) {
    visit(self.bones_);
    visit(self.input_);
    visit(self.output_);
    visit(self.feedback_ratio_);
    visit(self.bone_contacts_);
    visit(self.simulated_arrival_);
    visit(self.contacts_arrival_);
    visit(self.contacts_time_);
    visit(self.simulated_stamp_);
    visit(self.simulated_any_);
    visit(self.reposition_asked_);
    visit(self.ledger_);
    visit(self.coupling_stretch_);
    visit(self.reset_time_);
    visit(self.sequence_);
    visit(self.simulated_refused_);
    visit(self.refused_future_);
    visit(self.refused_late_);
  }
  /// Calls visit(name, value) for all parts of the state after a step.
  template <typename Visit>
  void for_each_part(Visit&& visit) const {
    visit("bones", bones_);
    visit("skeleton", output_.intermediate.joints);
    visit("input_counters", input_.counters());
    visit("ledger", ledger_);
    visit("sequence", sequence_);
  }
  /// Of the last step.
  const TrackingOutput& output() const { return output_; }
  double coupling_stretch() const { return coupling_stretch_; }
  /// Adds the input age, the longest stretch to the tracked skeleton and the counters.
  void fill_status(LoopStatus& status, Nanoseconds now) const;

 private:
  struct Bone {
    double mass = 0;              // kg
    double inertia = 0;           // kg m^2
    double coupling_linear = 0;   // k_l of the hand file, N/m
    double coupling_angular = 0;  // k_a, N m/rad
    double force_cap = 0;         // N, of the hand file
    double torque_cap = 0;        // N m
    double tracked_linear = 0;    // k_l to the tracked skeleton
    double tracked_angular = 0;
    double damping_linear = 0;   // N s/m
    double damping_angular = 0;  // N m s/rad
    double confidence = 1;       // of the joint: multiplies both springs, and the coupling to the simulated bone
    Pose pose;                   // joint frame in the world
    Twist velocity;
    Pose simulated;  // copy, at its own sample time
    Twist simulated_velocity;
    bool placed = false;
    bool simulated_seen = false;
    // For the energy ledger: values after the last step.
    bool entered = false;
    Pose tracked_end, copy_end;  // other ends of the springs
    bool had_feedback = false;
    double kinetic = 0;          // J
    double tracked_energy = 0;   // J, spring to the tracked skeleton
    double feedback_energy = 0;  // J, spring to the copy of the simulated skeleton
  };

  bool is_timely(Nanoseconds sample_time, Nanoseconds now);
  void take_simulated(const Skeleton& simulated, Nanoseconds now);
  Pose simulated_at(const Bone& bone, double age) const;
  struct Spring {
    double stiffness, angular_stiffness, cap, torque_cap;
    double energy(const Vector3& stretch, const Vector3& turn) const;
  };
  Spring tracked_spring(const Bone& bone) const;
  Spring feedback_spring(const Bone& bone) const;
  Spring coupling_of(const Bone& bone) const;
  void move(Bone& bone, const BodyTarget& target, double simulated_age, bool simulated_fresh, EnergyFlow* flow) const;
  static void release(Bone& bone, EnergyFlow& flow);
  void publish_skeleton(Nanoseconds now);
  void publish_wrench(Nanoseconds now, const std::array<BodyTarget, kBodyCount>& targets, double simulated_age,
                      bool simulated_fresh);

  TrackingOptions options_;
  double time_step_;
  double feedback_ratio_;
  HandKey key_;
  TrackedInput input_;
  std::array<Bone, kBodyCount> bones_{};
  std::array<Pose, kJointCount> joint_in_body_{};  // constant pose of each joint in its body's joint frame
  std::array<double, kJointCount> radii_{};
  BoneContacts bone_contacts_{};
  Nanoseconds simulated_arrival_ = 0;
  Nanoseconds contacts_arrival_ = 0;
  Nanoseconds contacts_time_ = 0;  // sample time
  Stamp simulated_stamp_;
  bool simulated_any_ = false;
  bool reposition_asked_ = false;
  EnergyLedger ledger_;
  double coupling_stretch_ = 0;                                       // m, largest stretch to the tracked skeleton now
  Nanoseconds reset_time_ = std::numeric_limits<Nanoseconds>::min();  // samples up to this time are ignored
  std::uint64_t sequence_ = 0;
  std::uint64_t simulated_refused_ = 0;  // joints of the simulated skeleton with non-finite or absurd values
  std::uint64_t refused_future_ = 0;     // simulated skeletons and contacts from the future
  std::uint64_t refused_late_ = 0;       // the same, older than `simulated_stale_after` at their arrival
  TrackingOutput output_;
};

}  // namespace softhand
