#include "energies/other_hands.hpp"

#include <algorithm>

#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand {

OtherHands::OtherHands(DofLayout layout, int first_body, int slots)
    : first_body_(first_body), slots_(static_cast<std::size_t>(slots)) {
  for (int s = 0; s < slots; ++s) {
    Slot& slot = slots_[static_cast<std::size_t>(s)];
    slot.patches.reserve(kMaxPatchesPerObject);
    slot.blocks =
        Clique<2>({layout.body_translation_block(first_body + s), layout.body_rotation_block(first_body + s)});
  }
}

void OtherHands::clear() {
  for (Slot& slot : slots_) slot.patches.clear();
}

void OtherHands::add(int slot, const ContactPatch& from, const Pose& object, double age) {
  std::vector<Patch>& patches = slots_[static_cast<std::size_t>(slot)].patches;
  const Vector3 force = to_vector(from.force), point = to_vector(from.point), torque = to_vector(from.torque);
  Patch patch;
  patch.normal = to_vector(from.normal).normalized();
  const double pressing = force.dot(patch.normal);
  if (!(pressing > 0) || !(from.stiffness > 0) || patches.size() == kMaxPatchesPerObject) return;
  patch.material = object.inverse() * point;
  patch.target = point + age * to_vector(from.linear_velocity);
  patch.orientation = (rotation_exp(age * to_vector(from.angular_velocity)) * object.orientation).normalized();
  patch.stiffness = from.stiffness;
  patch.depth = pressing / from.stiffness;
  const Vector3 tangential = force - pressing * patch.normal;
  patch.friction = {friction_stiffness(from.stiffness, from.friction),
                    std::max(from.friction * pressing, tangential.norm())};
  if (patch.friction.stiffness > 0) patch.tangential_offset = tangential / patch.friction.stiffness;
  patch.torsion = {from.stiffness * from.radius * from.radius,
                   std::max(from.friction * pressing * from.radius, torque.norm())};
  if (patch.torsion.stiffness > 0) patch.turn_offset = torque / patch.torsion.stiffness;
  patches.push_back(patch);
  ++patches_used_;
}

OtherHands::Response OtherHands::response(const Patch& patch, const Pose& body) {
  Response r;
  r.arm = body.orientation * patch.material;
  const Vector3 moved = body.position + r.arm - patch.target;
  r.compression = std::max(0.0, patch.depth - patch.normal.dot(moved));
  r.stretch = moved - patch.normal.dot(moved) * patch.normal - patch.tangential_offset;
  r.turn = rotation_log(body.orientation * patch.orientation.conjugate());
  r.twist = r.turn - patch.turn_offset;
  const double length = r.stretch.norm(), twist = r.twist.norm();
  r.energy = 0.5 * patch.stiffness * r.compression * r.compression + patch.friction.energy(length) +
             patch.torsion.energy(twist);
  r.force = patch.stiffness * r.compression * patch.normal - patch.friction.secant(length) * r.stretch;
  r.torque = -patch.torsion.secant(twist) * r.twist;
  return r;
}

void OtherHands::add_pattern(BlockPattern& pattern) const {
  for (const Slot& slot : slots_) slot.blocks.add_pattern(pattern);
}

void OtherHands::bind(const BlockMatrix& matrix) {
  for (Slot& slot : slots_) slot.blocks.bind(matrix);
}

double OtherHands::value(const State& state) const {
  double energy = 0;
  for (std::size_t s = 0; s < slots_.size(); ++s) {
    for (const Patch& patch : slots_[s].patches) energy += response(patch, body_of(s, state)).energy;
  }
  return energy;
}

double OtherHands::add_gradient(const State& state, VectorX& gradient) const {
  double energy = 0;
  for (std::size_t s = 0; s < slots_.size(); ++s) {
    for (const Patch& patch : slots_[s].patches) {
      const Response r = response(patch, body_of(s, state));
      energy += r.energy;
      Clique<2>::Gradient local;
      local << -r.force, -(r.arm.cross(r.force) + left_jacobian_inverse_transpose(r.turn, r.torque));
      slots_[s].blocks.add(gradient, local);
    }
  }
  return energy;
}

void OtherHands::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  for (std::size_t s = 0; s < slots_.size(); ++s) {
    for (const Patch& patch : slots_[s].patches) {
      const Response r = response(patch, body_of(s, state));
      Matrix3 stiffness = patch.friction.tangent(r.stretch, patch.normal);
      if (r.compression > 0) stiffness += patch.stiffness * patch.normal * patch.normal.transpose();
      // The secant bounds the exact stiffness of the torsion from above.
      const double twist = r.twist.norm();
      Matrix3 torsion = patch.torsion.secant(twist) * Matrix3::Identity();
      const Matrix3 lever = -skew(r.arm);
      if (curvature == Curvature::exact) {
        if (patch.torsion.slides(twist)) torsion -= torsion(0, 0) / (twist * twist) * r.twist * r.twist.transpose();
        const Matrix3 jacobian = left_jacobian_inverse(r.turn);
        torsion = jacobian.transpose() * torsion * jacobian + log_second_derivative(r.turn, -r.torque) +
                  rotated_arm_second_derivative(r.arm, -r.force);
      }
      Clique<2>::Hessian local;
      local.topLeftCorner<3, 3>() = stiffness;
      local.bottomLeftCorner<3, 3>() = lever.transpose() * stiffness;
      local.bottomRightCorner<3, 3>() = lever.transpose() * stiffness * lever + torsion;
      slots_[s].blocks.add(hessian, local);
    }
  }
}

void OtherHands::end_step(State& state) {
  for (std::size_t s = 0; s < slots_.size(); ++s) {
    Wrench& wrench = slots_[s].wrench;
    wrench = {};
    for (const Patch& patch : slots_[s].patches) {
      const Response r = response(patch, body_of(s, state));
      wrench.force += r.force;
      wrench.torque += r.arm.cross(r.force) + left_jacobian_inverse_transpose(r.turn, r.torque);
    }
  }
}

}  // namespace softhand
