// Judges how two hands held the judged object: what each carried, and how it went from one to the other.
#pragma once

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <optional>

#include "cli/outcome.hpp"
#include "messages/messages.hpp"
#include "model/state.hpp"

namespace softhand {

/// What a scene asks of its two hands. Zero = not asked for.
struct HandsGoal {
  double weight = 0;       ///< while both hold the object: the sum of their upward forces is its weight, within this
  double share = 0;        ///< the same: the share of the first hand is that of the lever arms, within this
  double handed_slip = 0;  ///< m; the object moves less than this in the palm of the hand that takes it over
  bool any() const { return weight > 0 || share > 0 || handed_slip > 0; }
};

class HandsOutcome {
 public:
  /// `frame`: of the first hand. `gravity`: magnitude, m/s^2. `one_process`: both hands have one coupling, so the force
  /// of each is that of its contacts.
  HandsOutcome(const OutcomeFrame& frame, double gravity, bool one_process = false);

  /// After each step of a hand. `hand`: 0 or 1; others are ignored. `palm`: in the world. `objects`: newest states.
  void add(Nanoseconds time, std::size_t hand, const ObjectCoupling& coupling, const Contacts& contacts,
           const Pose& palm, const WorldObjects& objects);
  /// Keys and meaning: docs/outcome.md. With a goal it has `success` and `success_because`.
  nlohmann::ordered_json summary(const HandsGoal& goal) const;

 private:
  struct Held {
    bool touches = false;
    Vector3 force = Vector3::Zero();   // of the hand on the object, N
    Vector3 centre = Vector3::Zero();  // of its upward forces, m
    Pose in_palm;                      // of the object
  };
  void add_both(const ObjectState& object);
  bool is_held(Nanoseconds time) const;

  OutcomeFrame frame_;
  std::uint32_t object_;
  double weight_;  // N
  bool one_process_;
  std::array<Held, 2> held_;
  // While both touch the object in the phase `hold`, without its first half second.
  int both_steps_ = 0;
  double carried_ = 0, lowest_carried_ = 0, highest_carried_ = 0;  // sums of upward forces, N
  double share_ = 0, lever_share_ = 0;                             // sums over these steps
  std::uint32_t owner_changes_ = 0;
  std::optional<std::uint64_t> owner_;  // user and side of the last owner
  // From the last step in which both hands touch the object.
  std::optional<std::size_t> receiver_;
  std::array<Pose, 2> at_hand_over_;
  std::optional<Nanoseconds> handed_at_;
  double handed_slip_ = 0, handed_turn_ = 0;  // m, rad
  double handed_seconds_ = 0;
};

}  // namespace softhand
