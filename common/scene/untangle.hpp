// Puts tissue back that has turned inside out, was wound round its bones, or hooks behind an object, for good.
//
// The energy of inverted tetrahedra pushes them back (corotational.hpp), but a tangle of them can be a minimum of its
// own: after a tracker that turned the hand by 180 degrees in one sample, or bones that passed through each other, the
// tissue would stay so for ever. Contact makes more such minima: tissue that comes back from the far side of an object
// is stopped there. Such nodes go at one stroke to where the nearest bone carries them at rest, or as far towards it as
// the way from the bone is free of objects.
//
// What is pressed is no tangle and stays. Energy tells the two apart: nodes are put back only where tissue, attachments
// and contact then hold less than before. In a closed fist the carried rest shape holds hundreds of times what the
// pressed tissue holds, because it is cut at every joint. Not in the source.
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
  /// `patience`: s between two looks; what is tangled in both is put back. 0: never.
  Untangler(const HandModel& hand, double patience);

  enum class Due : std::uint8_t { nothing, glance, look };
  /// Counts a step of `time_step` seconds that left `energy` J in tissue and attachments, and says what it is time for.
  Due due(double time_step, double energy);
  /// Puts all of the tissue back at once if it holds so much that it would throw bones and objects, and less where the
  /// bones carry it. For a state from outside, and when due. Like `look`: `contacts` may be null; `tissue` and
  /// `attachments` are of the same hand. Returns how many nodes were put back; their contacts have ended, all others go
  /// on. Allocates nothing.
  int glance(State& state, ContactSet* contacts, const Tissue& tissue, const Energy& attachments);
  /// Puts back what was tangled at the last look too, or does what `glance` does. `kinetic_energy`: of the hand, J.
  int look(State& state, ContactSet* contacts, double kinetic_energy, const Tissue& tissue, const Energy& attachments);

 private:
  // One look's view of the simulation.
  struct View {
    State& state;
    ContactSet* contacts;
    const Tissue& tissue;
    const Energy& attachments;
  };
  double stored(const View& view) const;
  double fall(const View& view, double before) const;
  void put_back(const View& view, std::size_t node) const;
  void place_bones(const State& state);
  int put_all_back(const View& view, double kinetic_energy, bool patient);
  int untangle_cluster(const View& view, std::size_t seed);
  int grow();
  int keep(const View& view);

  double patience_;
  double violent_ = 0;  // J, of the whole hand's tissue mirrored
  double waited_ = 0;
  bool glanced_ = false;  // since the last look
  bool twisted_ = false;  // at the last look
  std::vector<std::array<std::int32_t, 4>> tetrahedra_;
  std::vector<std::uint8_t> node_body_;
  std::vector<Vector3> rest_in_body_;  // by node, in the nearest bone's body frame
  std::vector<Vector3> bone_in_body_;  // by node: the point of the bone's axis that is nearest at rest
  std::vector<std::uint8_t>
      tangled_;  // by tetrahedron, at the last look: folded, or with a node that hooks behind an object
  std::vector<std::uint8_t> wait_;   // by tetrahedron: looks until it is tried again
  std::vector<std::uint8_t> stays_;  // by tetrahedron: tangled in both looks, and not in a cluster yet
  std::vector<std::uint8_t> hooked_, move_, more_, best_;  // by node
  Eigen::Matrix3Xd positions_, velocities_;                // before a try
  Eigen::Matrix3Xd bones_;                                 // by node, world: the bone's point
};

}  // namespace softhand
