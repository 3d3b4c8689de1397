// Inertia of nodes and rigid bodies as a term of the incremental potential (ES2725128A1 eqs. 10, 19).
//
//   node, body translation:  m/(2 dt^2) |x - x~|^2,  x~ = x_i + dt v_i + dt^2 g
//   body rotation:           1/(2 dt^2) (phi - phi~)^T I_mid (phi - phi~),  phi = log(R R_i^T)
//
// Here phi~ = dt I_mid^-1 L, and L = I_i w_i is the angular momentum at the start. I_mid is the body's inertia in world
// axes half way along phi~, at exp(phi~/2) R_i. This is the implicit midpoint rule for free rotation. `end_step` sets v
// = (x - x_i)/dt and w = I^-1 I_mid phi/dt. So a body without forces keeps L up to rounding, and its energy stays
// bounded, at any speed and step. With the explicit midpoint rule, a body that rotates by one radian per step tumbles
// over within 30 steps.
//
// Departures from the source: eq. 19 gives only the kinetic energy. The integration of a rotating inertia is our
// choice. The rotation per step is limited to 3 rad: beyond pi the logarithm's shortest arc would reverse the
// direction. Speeds above 3/dt are cut to this limit.
//
// Units: J; m, rad; kg, kg m^2. The Hessian is block diagonal. Projected, it is J^-T I_mid J^-1 / dt^2 with J^-1 the
// Jacobian of the logarithm.
#pragma once

#include <vector>

#include "energies/memory.hpp"

namespace softhand {

class Inertia final : public EnergyWithMemory<Inertia> {
 public:
  /// `node_masses` in kg, each > 0 (otherwise std::invalid_argument). All bodies start held. Gravity starts at zero.
  Inertia(std::vector<double> node_masses, int body_count);

  /// External acceleration of every node, m/s^2. Zero by default, as for the hand.
  void set_node_gravity(const Vector3& gravity);
  /// External acceleration of one node, m/s^2.
  void set_node_gravity(int node, const Vector3& gravity) { node_gravity_.col(node) = gravity; }

  /// Makes the body dynamic: it moves by its mass and inertia under `gravity` (m/s^2). `mass` in kg, > 0. `inertia` in
  /// kg m^2, about the centre of mass in body axes, positive definite. May be called at any time between steps. Does
  /// not allocate.
  void set_dynamic(int body, double mass, const Matrix3& inertia, const Vector3& gravity);
  /// Makes the body follow the velocity that the state has at the start of each step. Used for empty object slots and
  /// for objects that another process owns. During the solve its degrees of freedom stay at the start, held with 1e9
  /// N/m and 1e7 N m/rad. `end_step` then moves it by its velocity.
  void hold(int body);
  bool is_dynamic(int body) const { return bodies_[static_cast<std::size_t>(body)].dynamic; }

  /// 1/2 v^T M v of all nodes and dynamic bodies (eq. 19), J.
  double kinetic_energy(const State& state) const;

  /// All that a step carries to the next one, for the ledger.
  struct Memory {
    double stored = 0;  // kinetic energy after the last step, J
  };
  const Memory& save() const { return memory_; }
  void load(const Memory& memory) { memory_ = memory; }
  void reset() {}  // velocities that the caller changed count as work

  std::string_view name() const override { return "inertia"; }
  void add_pattern(BlockPattern&) const override {}  // the diagonal is always there
  void bind(const BlockMatrix& matrix) override;
  void begin_step(const State& state, double time_step) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  void end_step(State& state) override;
  /// Stored: the kinetic energy. Integrator loss of nodes and translations: 1/2 |dv|^2_M. Integrator loss of rotations:
  /// (L_end - L_start) . phi/dt minus the rise of the rotation energy.
  EnergyFlow flow(double, double, double) const override { return flow_; }

 private:
  struct BodyInertia {
    bool dynamic = false;
    double mass = 0;
    Matrix3 inertia = Matrix3::Zero();  // body axes
    Vector3 gravity = Vector3::Zero();
    // Fixed within the step. The weights include the factor 1/dt^2.
    Pose start;
    Vector3 position_target = Vector3::Zero();
    Vector3 turn_target = Vector3::Zero();
    double spin_energy = 0;  // 1/2 w^T I w at the start, J
    double translation_weight = 0;
    Matrix3 rotation_weight = Matrix3::Zero();  // world axes
  };

  std::vector<double> node_masses_;
  Eigen::Matrix3Xd node_gravity_;
  std::vector<BodyInertia> bodies_;
  std::vector<BlockSlot> diagonal_;  // per block
  double time_step_ = 0;
  Eigen::Matrix3Xd node_start_;
  Eigen::Matrix3Xd node_target_;
  double start_energy_ = 0;  // kinetic, J
  EnergyFlow flow_;
  Memory memory_;
};

}  // namespace softhand
