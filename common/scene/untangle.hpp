// Puts tissue back that has turned inside out, or twisted, for good.
//
// The energy of inverted tetrahedra pushes them back (corotational.hpp), but a tangle of them can be a minimum of its own: after a tracker that turned the hand by
// 180 degrees in one sample, or bones that passed through each other, the tissue would stay so for ever. Such nodes go to where the nearest bone carries them at
// rest, at one stroke, as a repositioned hand does. So does tissue that was wound round its bones, which no inverted tetrahedron gives away, but its energy. What is
// pressed a little beyond flat, as between the fingers of a fist, is no tangle and stays. Not in the source.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "energies/tissue.hpp"
#include "model/hand_model.hpp"
#include "model/state.hpp"

namespace softhand {

class Untangler {
 public:
  /// `patience`: s between two looks; a tetrahedron that is folded in both (`Tissue::is_folded`) is put back. 0: never.
  Untangler(const HandModel& hand, double patience);

  /// Counts a step of `time_step` seconds. Whether it is time to look; then the next wait begins.
  bool due(double time_step);
  /// When it is due. Tetrahedra with a node that touches something stay: what is pressed flat is not tangled. Where what was put back is folded
  /// again at the next look, more of its surroundings are put back with it, three times at most. Where nothing touches and nothing is folded all of the tissue is put back that
  /// rests (`kinetic_energy` of the hand, J) in two looks and holds more energy, with its attachments, than it would there. `tissue` and `attachments`: of the same hand. Returns how
  /// many nodes were moved. Allocates nothing.
  int look(State& state, std::span<const std::uint8_t> touching, double kinetic_energy, const Tissue& tissue, const Energy& attachments);

 private:
  void put_back(State& state, std::size_t node) const;
  int untwist(State& state, double kinetic_energy, const Tissue& tissue, const Energy& attachments);

  double patience_;
  bool twisted_ = false;  // at the last look
  State carried_;         // its nodes: put back
  double waited_ = 0;
  int attempts_ = 0;
  std::vector<std::array<std::int32_t, 4>> tetrahedra_;
  std::vector<std::uint8_t> node_body_;
  std::vector<Vector3> rest_in_body_;    // by node, in the nearest bone's body frame
  std::vector<std::uint8_t> folded_;     // by tetrahedron, at the last look
  std::vector<std::uint8_t> move_, more_;  // by node
};

}  // namespace softhand
