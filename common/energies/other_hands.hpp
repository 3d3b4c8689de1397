// Contacts of other hands with an object that this simulation owns (docs/two-hands.md). Another process simulates such
// a hand. It publishes its contacts as patches, one per bone and object (ContactPatch). The owner of the object adds
// them as one implicit term. This is not in the source, where one hand touches an object.
//
//   U   = sum over patches of U_n + U_t + U_m
//   U_n = 1/2 k max(0, f_n/k - n . d)^2
//   U_t = C(|d_t - f_t/k_t|) with the stiffness k_t = k min(mu, 1) and the bound max(mu f_n, |f_t|)
//   U_m = C(|phi - m/k_m|) with the stiffness k_m = k r^2 and the bound max(mu f_n r, |m|)
//
// C(s) is the energy of a CoulombSpring at the stretch s (contact/coulomb.hpp).
//
// Motion since the sample: d is the displacement of the object's material point relative to the patch. d_t is its
// tangential part. The rotation vector phi is the rotation of the object relative to the patch. The patch moves with
// the velocity of its bone.
//
// The patch publishes its normal n, its friction coefficient mu and its radius r. The normal part of its force is f_n,
// the tangential part is f_t. Its torque about its point is m.
//
// At d = 0 and phi = 0 the term has exactly the published wrench. It never pulls.
//
// k is the stiffness of contact and tissue in front of the other hand's bone. The bone gives way too, so k is an upper
// bound. With an upper bound, wrench and object converge for any delay of the messages. With less than half of the true
// stiffness they would not (docs/two-hands.md).
//
// Degrees of freedom: translation and rotation of the object's body. Units: J, m, rad, N, N m.
#pragma once

#include <span>
#include <vector>

#include "contact/coulomb.hpp"
#include "energies/clique.hpp"
#include "energies/energy.hpp"
#include "messages/messages.hpp"

namespace softhand {

class OtherHands final : public Energy {
 public:
  static constexpr std::size_t kMaxPatchesPerObject = 32;

  /// Objects are the bodies `first_body` ... `first_body + slots - 1`.
  OtherHands(DofLayout layout, int first_body, int slots);

  /// Removes the patches of all objects. Call it, and `add`, before each step: a step keeps no patch for the next one.
  void clear();
  /// Adds a patch for the next step. `object`: the pose at which the other hand touched the object. `age`: time (s)
  /// from the patch to the end of the coming step, >= 0. Ignores patches beyond kMaxPatchesPerObject, and those without
  /// a force into the object.
  void add(int slot, const ContactPatch& patch, const Pose& object, double age);

  /// Wrench of all patches on the object in the last step, about its centre of mass, world axes.
  const Wrench& wrench(int slot) const { return slots_[static_cast<std::size_t>(slot)].wrench; }
  /// Number of patches since construction. 0: no other hand touches an object.
  std::uint64_t patches_used() const { return patches_used_; }

  std::string_view name() const override { return "other_hands"; }
  bool has_kinks() const override { return true; }
  void add_pattern(BlockPattern& pattern) const override;
  void bind(const BlockMatrix& matrix) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  void end_step(State& state) override;
  /// Stores nothing: all of its energy is the work of the other hands.
  EnergyFlow flow(double, double, double taken) const override { return {.work = -taken}; }

 private:
  struct Patch {
    Vector3 material = Vector3::Zero();  // its point, body axes, relative to the centre of mass
    Vector3 target = Vector3::Zero();    // the place of this point at the step's end if the object moves with the patch
    Quaternion orientation = Quaternion::Identity();  // the same for the body
    Vector3 normal = Vector3::UnitY();                // into the object, world
    double stiffness = 0;                             // k
    double depth = 0;                                 // f_n / k
    Vector3 tangential_offset = Vector3::Zero();      // f_t / k_t
    Vector3 turn_offset = Vector3::Zero();            // m / (k r^2)
    CoulombSpring friction, torsion;
  };
  struct Slot {
    std::vector<Patch> patches;
    Clique<2> blocks;
    Wrench wrench;
  };
  // Energy and its derivatives with respect to the material point and the rotation at a state.
  struct Response {
    double energy = 0;
    Vector3 arm;             // from the centre of mass to the point
    double compression = 0;  // m, >= 0
    Vector3 stretch;         // of the friction's spring
    Vector3 turn;            // phi
    Vector3 twist;           // stretch of the torsion's spring
    Vector3 force;           // on the object
    Vector3 torque;          // of the torsion's spring, as derivative with respect to phi
  };
  static Response response(const Patch& patch, const Pose& body);
  const Pose& body_of(std::size_t slot, const State& state) const {
    return state.body_poses[static_cast<std::size_t>(first_body_) + slot];
  }

  int first_body_;
  std::vector<Slot> slots_;
  std::uint64_t patches_used_ = 0;
};

}  // namespace softhand
