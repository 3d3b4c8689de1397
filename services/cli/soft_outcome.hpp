// Judges how a flexible object was squeezed in a run. The messages do not carry its nodes, so only `simulate` can do
// this.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "scene/hand_simulation.hpp"

namespace softhand {

/// What a scene asks of its first flexible object. Zero = not asked for. A width is the length of a line through the
/// centre of mass, from surface to surface.
struct SoftGoal {
  double squeezed = 0;  ///< its least width falls to this fraction of its first one, or below
  double recovers = 0;  ///< at the end, least and greatest width differ from the first ones by at most this fraction
  bool any() const { return squeezed > 0 || recovers > 0; }
};

class SoftOutcome {
 public:
  /// After each step.
  void add(const HandSimulation& simulation);
  /// Keys and meaning: docs/outcome.md. Null without a flexible object. With a goal it has `success` and
  /// `success_because`.
  nlohmann::ordered_json summary(const SoftGoal& goal) const;

 private:
  /// Lengths of the lines through the centre of mass, from surface to surface, m.
  struct Widths {
    double least = 0, greatest = 0;
  };
  static Widths widths_of(const SoftObjects& soft, const State& state);

  bool is_on_ = false;
  Widths first_, last_;
  double least_ = 0;               // m
  double strongest_ = 0;           // N, of one touching point
  std::size_t most_contacts_ = 0;  // touching points of the hand and of the object
  bool touched_at_end_ = false;
  std::uint64_t inverted_steps_ = 0;
};

}  // namespace softhand
