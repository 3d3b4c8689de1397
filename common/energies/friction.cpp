#include "energies/friction.hpp"

namespace softhand {

double FrictionEnergy::value(const State& state) const {
  double energy = 0;
  for (const ContactSet::Anchor& anchor : contacts_.anchors()) {
    if (anchor.friction_bound > 0)
      energy += anchor_law::friction_of(anchor).energy(contacts_.offset(anchor, state).stretch.norm());
  }
  return energy;
}

double FrictionEnergy::add_gradient(const State& state, VectorX& gradient) const {
  double energy = 0;
  for (const ContactSet::Anchor& anchor : contacts_.anchors()) {
    if (!(anchor.friction_bound > 0)) continue;
    const ContactSet::Offset o = contacts_.offset(anchor, state);
    const double length = o.stretch.norm();
    energy += anchor_law::friction_of(anchor).energy(length);
    contacts_.scatter_gradient(anchor, o.lever, anchor_law::friction_of(anchor).secant(length) * o.stretch, gradient);
  }
  return energy;
}

void FrictionEnergy::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  for (const ContactSet::Anchor& anchor : contacts_.anchors()) {
    if (!(anchor.friction_bound > 0)) continue;
    const ContactSet::Offset o = contacts_.offset(anchor, state);
    const Vector3 y = anchor_law::friction_of(anchor).secant(o.stretch.norm()) * o.stretch;
    contacts_.scatter_hessian(anchor, o.lever, y,
                              anchor_law::tangential_stiffness(anchor, o, curvature == Curvature::exact), hessian,
                              curvature);
  }
}

}  // namespace softhand
