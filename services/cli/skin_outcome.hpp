// Judges contact of the skin of hands with itself and with each other in a run. The messages do not carry it, so only
// `simulate` can do this.
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <vector>

namespace softhand {

class HandSimulation;
class SkinContact;

/// What a scene asks of contact of skin with skin. Zero = not asked for.
struct SkinGoal {
  double penetration = 0;  ///< m, of 95 % of the touching (point, step) pairs; and no finger passes another one
  double friction = 0;     ///< relative; friction of skin that slides is mu times the normal force within this
  bool parts = false;      ///< no skin touches skin at the end
  bool any() const { return penetration > 0 || friction > 0 || parts; }
};

class SkinOutcome {
 public:
  /// After each step of the motion.
  void add(const HandSimulation& simulation);
  /// After the run.
  void end(const HandSimulation& simulation);
  /// Keys and meaning: docs/outcome.md. Null if the skin does not touch itself in this scene. With a goal it has
  /// `success` and `success_because`.
  nlohmann::ordered_json summary(const SkinGoal& goal, double friction) const;

 private:
  static std::size_t count(const HandSimulation& simulation);
  void add(const HandSimulation& simulation, const SkinContact& skin);

  std::vector<double> depths_;  // m, of the touching pairs
  double deepest_ = 0;
  std::size_t most_contacts_ = 0, steps_ = 0, touching_steps_ = 0;
  double sliding_push_ = 0, sliding_drag_ = 0;  // sums over all sliding contacts, N
  double gap_ = 1, hands_gap_ = 1;              // m, least of the bones of fingers and of hands
  double heat_ = 0;                             // J
  double most_force_ = 0;                       // N, of one hand on the other
  bool is_on_ = false, has_hands_ = false, touches_at_end_ = false;
};

}  // namespace softhand
