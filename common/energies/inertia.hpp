// Inertia of nodes and rigid bodies as a term of the incremental potential (ES2725128A1 eqs. 10, 19).
//
//   node, body translation:  m/(2 dt^2) |x - x~|^2,  x~ = x_i + dt v_i + dt^2 g
//   body rotation:           1/(2 dt^2) (phi - phi~)^T I_mid (phi - phi~),  phi = log(R R_i^T)
//
// with phi~ = dt I_mid^-1 L, L = I_i w_i the angular momentum at the start, and I_mid the body's inertia in world axes
// half way along phi~, at exp(phi~/2) R_i: the implicit midpoint rule for free rotation. `end_step` sets v = (x -
// x_i)/dt and w = I^-1 I_mid phi/dt, so that a body on which nothing acts keeps L but for rounding, and with it a
// bounded energy, at any speed and step. (With the explicit midpoint a body that spins by a radian a step topples
// within 30 steps.)
//
// Departures from the source: eq. 19 states the kinetic energy only; how a rotating inertia is integrated is ours. The
// turn of a step is limited to 3 rad, beyond which the logarithm's shortest arc would run backwards: speeds above 3/dt
// are cut to it.
//
// Units: J; m, rad; kg, kg m^2. The Hessian is block diagonal; projected: J^-T I_mid J^-1 / dt^2 with J^-1 the log's
// Jacobian.
#pragma once

#include <vector>

#include "energies/energy.hpp"

namespace softhand {

class Inertia final : public Energy {
 public:
  /// `node_masses` in kg, > 0 (std::invalid_argument). All bodies start held; gravity starts at zero.
  Inertia(std::vector<double> node_masses, int body_count);

  /// External acceleration of every node, m/s^2. Off (zero) by default, as for the hand.
  void set_node_gravity(const Vector3& gravity);
  /// Of one node only.
  void set_node_gravity(int node, const Vector3& gravity) { node_gravity_.col(node) = gravity; }

  /// The body moves by its mass (kg, > 0) and its inertia (kg m^2, about the centre of mass in body axes, positive
  /// definite) under `gravity` (m/s^2). At any time between steps; allocates nothing.
  void set_dynamic(int body, double mass, const Matrix3& inertia, const Vector3& gravity);
  /// The body has the motion that the state gives it at the start of each step: an empty object slot, an object that
  /// another process owns. Within the step its degrees of freedom stay at the start, held with 1e9 N/m and
  /// 1e7 N m/rad. `end_step` puts it where its velocity takes it.
  void hold(int body);
  bool is_dynamic(int body) const { return bodies_[static_cast<std::size_t>(body)].dynamic; }

  /// 1/2 v^T M v of all nodes and dynamic bodies (eq. 19), J.
  double kinetic_energy(const State& state) const;

  std::string_view name() const override { return "inertia"; }
  void add_pattern(BlockPattern&) const override {}  // the diagonal is always there
  void bind(const BlockMatrix& matrix) override;
  void begin_step(const State& state, double time_step) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  void end_step(State& state) override;
  /// Stored: the kinetic energy. Loss: 1/2 |dv|^2_M of nodes and translations; of a turn L_end - L_start paired with
  /// it, less what its energy rose.
  EnergyFlow flow(double, double, double) const override { return flow_; }

 private:
  struct BodyInertia {
    bool dynamic = false;
    double mass = 0;
    Matrix3 inertia = Matrix3::Zero();  // body axes
    Vector3 gravity = Vector3::Zero();
    // Fixed within the step. Weights already hold 1/dt^2.
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
  std::vector<BlockSlot> diagonal_;  // by block
  double time_step_ = 0;
  Eigen::Matrix3Xd node_start_;
  Eigen::Matrix3Xd node_target_;
  double start_energy_ = 0;  // kinetic, J
  EnergyFlow flow_;
};

}  // namespace softhand
