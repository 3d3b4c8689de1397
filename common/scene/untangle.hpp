// Repairs tissue that would otherwise stay tangled: tissue that is inverted, wound around its bones or hooked behind an
// object.
//
// The energy of inverted tetrahedra pushes them back (corotational.hpp), but a tangle of them can be a local minimum.
// Examples: a tracker that turned the hand by 180 degrees in one sample, or bones that passed through each other. The
// tissue would stay in this minimum for ever. Contact adds more such minima, because it stops tissue that comes back
// from the far side of an object. Tangled nodes are moved in one step to their rest place relative to the nearest bone.
// If an object is in the way, they move towards it only as far as the path from the bone is free.
//
// Pressed tissue is not tangled and must not be moved. The energy distinguishes the two: nodes are put back only if
// tissue, attachments and contact then have less energy than before. In a closed fist the rigidly moved rest shape has
// hundreds of times the energy of the pressed tissue. The reason is that it is cut at every joint. Not in the source.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "energies/contact.hpp"
#include "energies/tissue.hpp"
#include "model/hand_model.hpp"
#include "model/state.hpp"

namespace softhand {

class Untangler {
 public:
  /// `full_check_period`: s between two full checks (`full_check`). Tissue that is tangled in both is put back. 0:
  /// never. Node n of the hand is node `first_node` + n of the state, and bone b is body `first_body` + b.
  Untangler(const HandModel& hand, double full_check_period, int first_node = 0, int first_body = 0);

  /// All that a step carries to the next one.
  struct Memory {
    double waited = 0;                  // s, since the last full check
    bool quick_check_done = false;      // since the last full check
    bool twisted = false;               // in the last full check
    std::vector<std::uint8_t> tangled;  // per tetrahedron, in the last full check: folded, or hooked behind an object
    std::vector<std::uint8_t> wait;     // per tetrahedron: full checks until it is tried again
  };
  const Memory& save() const { return memory_; }
  /// Throws std::invalid_argument if `memory` is that of another hand.
  void load(const Memory& memory);
  /// The next check starts without the marks of the last one.
  void reset();

  enum class Due : std::uint8_t { nothing, quick_check, full_check };
  /// Counts a step of `time_step` seconds after which tissue and attachments have `energy` J. Returns which check is
  /// due.
  Due due(double time_step, double energy);
  /// Quick check, for a state from outside and when due. Puts tissue back at once under two conditions. The tissue has
  /// so much energy that it would throw bones and objects. It has less at its rest place relative to the bones. Only
  /// the tissue that stores this energy is put back, if that releases nearly as much as putting all of it back.
  /// Returns the number of nodes that were put back. Their contacts have ended, all others persist. Does not allocate.
  /// As in `full_check`, `contacts` may be null, and `energies` are what holds the hand's tissue: tissue and
  /// attachments. Between two steps, their value is what they store.
  int quick_check(State& state, ContactSet* contacts, const Tissue& tissue, std::span<const Energy* const> energies);
  /// Full check. Puts back what was tangled in the last full check too, or does the same as `quick_check`.
  /// `kinetic_energy`: of the hand, J.
  int full_check(State& state, ContactSet* contacts, double kinetic_energy, const Tissue& tissue,
                 std::span<const Energy* const> energies);

 private:
  // The parts of the simulation that a check uses.
  struct View {
    State& state;
    ContactSet* contacts;
    const Tissue& tissue;
    std::span<const Energy* const> energies;
  };
  // The columns of the hand's nodes. Before and behind them come those of another hand and of flexible objects.
  auto own(Eigen::Matrix3Xd& of_nodes) const {
    return of_nodes.middleCols(static_cast<Eigen::Index>(first_node_),
                               static_cast<Eigen::Index>(node_body_.size() - first_node_));
  }
  double stored(const View& view) const;
  double released_energy(const View& view, double before) const;
  void put_back(const View& view, std::size_t node) const;
  void move_all_back(const View& view);
  void place_bones(const State& state);
  int put_all_back(const View& view, double kinetic_energy, bool tests_twist);
  bool put_worst_back(const View& view, double before, double released_by_all);
  int untangle_cluster(const View& view, std::size_t seed);
  int grow();
  int accept_move(const View& view);

  double full_check_period_;
  // Vectors by node have the numbers of the state. The entries before `first_node_` are not used.
  std::size_t first_node_;
  std::vector<double> mirrored_energies_;  // J, per tetrahedron: its energy if it were mirrored
  double mirrored_energy_ = 0;             // J, their sum
  std::vector<std::array<std::int32_t, 4>> tetrahedra_;
  std::vector<std::uint8_t> node_body_;  // per node, body of the state
  std::vector<Vector3> rest_in_body_;    // per node, in the nearest bone's body frame
  std::vector<Vector3> bone_in_body_;    // per node: the nearest point of the bone's axis at rest
  Memory memory_;
  std::vector<std::uint8_t> persistent_;  // per tetrahedron: tangled in both checks, and not in a cluster yet
  std::vector<std::uint8_t> hooked_, move_, more_, best_;  // per node
  Eigen::Matrix3Xd positions_, velocities_;                // before a try
  Eigen::Matrix3Xd bones_;                                 // per node, world: the point of the bone's axis
};

}  // namespace softhand
