// Friction of the skin on objects (ES2725128A1 eq. 33, figure 4).
//
//   U_f = sum over anchors of CoulombSpring(k_c A min(mu, 1), mu f_n)(|T e - s_0|),   T = 1 - n n^T
//
// e and n are those of contact.hpp. The degrees of freedom are those of U_n. Units: J, m, N.
//
// This term departs from the source as follows.
//
// In eq. 33, mu scales a stiffness. Here mu bounds the force by Coulomb's law (coulomb.hpp). Within a step, the bound
// uses the normal force at the step's start. So the energy is a fixed convex function.
//
// For a fresh contact the bound uses the force that stops the node alone on an unmoved object. This force is
// k u / (1 + k dt^2/m) at the predicted depth u of the node.
//
// Anchors slide at the end of the step (ContactSet), by the normal force at that time. A sticking anchor does not move
// at all: no creep.
//
// s_0 is the stretch at the start of the first step of a fresh contact, because its anchor lies ahead at the crossing.
// In later steps s_0 is zero.
//
// At the step's start, the projected Hessian is a choice at the kink between sticking and sliding. An anchor that slid
// and moves on uses the sliding Hessian. A fresh anchor uses the secant to the predicted stretch. So a step of one
// Newton iteration does not stick if the converged step slides.
#pragma once

#include "energies/contact.hpp"

namespace softhand {

class FrictionEnergy final : public Energy {
 public:
  /// Must come after the set's `ContactEnergy` in the list of terms. `name`: of the term, a literal.
  explicit FrictionEnergy(ContactSet& contacts, std::string_view name = "friction")
      : contacts_(contacts), name_(name) {}
  std::string_view name() const override { return name_; }
  bool has_kinks() const override { return true; }
  void add_pattern(BlockPattern& pattern) const override { contacts_.add_pattern(pattern); }
  void bind(const BlockMatrix& matrix) override { contacts_.bind(matrix); }
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  EnergyFlow flow(double, double, double) const override { return contacts_.friction_flow(); }

 private:
  ContactSet& contacts_;
  std::string_view name_;
};

}  // namespace softhand
