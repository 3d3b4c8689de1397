// Judges from the messages how a flexible object was squeezed in a run. So `simulate` and `up` use the same rules.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "messages/messages.hpp"
#include "model/object_model.hpp"

namespace softhand {

struct OutcomeFrame;

/// What a scene asks of its first flexible object. Zero = not asked for. A width is the length of a line through the
/// centre of mass, from surface to surface. Lines that leave the object through an opening do not count.
struct SoftGoal {
  double lifted = 0;    ///< m, by which its centre of mass rises
  double kept = 0;      ///< until the phase `squeeze` its least width is at least this fraction of its first one
  double squeezed = 0;  ///< its least width falls to this fraction of its first one, or below
  double recovers = 0;  ///< at the end, least and greatest width differ from the first ones by at most this fraction
  bool any() const { return lifted > 0 || kept > 0 || squeezed > 0 || recovers > 0; }
};

/// Not for real-time threads.
class SoftOutcome {
 public:
  /// `body`: of the first flexible object of the scene.
  explicit SoftOutcome(const SoftBody& body);
  /// Refuses a state with a number that is not finite.
  void on_state(const SoftObjectState& state);
  void on_contacts(const Contacts& contacts);
  /// Keys and meaning: docs/outcome.md. With a goal it has `success` and `success_because`.
  /// Messages from more than half a second after the motion do not count, because the tracker may repeat it.
  nlohmann::ordered_json summary(const SoftGoal& goal, const OutcomeFrame& frame) const;

 private:
  struct Sample {
    Nanoseconds time = 0;
    double height = 0;                           // m, of the centre of mass
    double least_width = 0, greatest_width = 0;  // m, of the lines through the centre of mass
    std::uint32_t contacts = 0;                  // points between the hand and the object
    bool inverted = false;
  };
  struct Force {
    Nanoseconds time = 0;
    double point = 0;   // N, largest of one touching point
    double finger = 0;  // N, largest of one finger
  };
  std::uint32_t nodes_;
  std::vector<std::array<std::int32_t, 3>> surface_;
  std::vector<Sample> samples_;
  std::vector<Force> forces_;
  std::uint64_t refused_ = 0;
};

}  // namespace softhand
