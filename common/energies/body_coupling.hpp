// The coupling of rigid bodies to copies of themselves that other processes move (ES2725128A1 eq. 18): bone to
// intermediate or tracked bone, intermediate bone to either side, mirrored object to the world's twin.
//
//   U = 1/2 k_l |x_a - x_b|^2 + 1/2 k_a |log(R_a R_b^T)|^2
//
// taken at a frame fixed to the body - a bone's joint, since poses on the wire are joint frames - with b the copy,
// constant in a step.
//
// Additions to the source, with reason:
// - Damping relative to the copy's velocity, dt/2 b |v - v_b|^2 with v = (x - x_i)/dt: spring and damper together are
//   one spring of stiffness K = k + b/dt to the target x* = (k x_b + b/dt (x_i + dt v_b))/K, plus a constant that is
//   left out. The rotation does the same along the geodesic from exp(dt w_b) R_i to R_b; this is exact for small angles
//   and has the right torque k log(R_b R_i^T) + b w_b at any.
// - A cap: U = 1/2 K d^2 while K d <= cap, beyond it cap d - cap^2/(2K), so the whole force, damping included, never
//   exceeds the cap. Its secant stiffness is K min(1, cap/(K d)).
//
// Projected Hessian: the secant stiffness times the identity, which bounds the exact curvature from above. The
// logarithm takes the shortest arc: at a turn of exactly pi the torque's direction is a choice, and finite.
//
// Degrees of freedom: six a coupled body. Units: J; m, rad; N, N m.
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "energies/clique.hpp"
#include "energies/energy.hpp"

namespace softhand {

struct CouplingGains {
  double linear_stiffness = 0;                                  ///< N/m, k_l >= 0
  double angular_stiffness = 0;                                 ///< N m/rad, k_a >= 0
  double linear_damping = 0;                                    ///< N s/m; 2 zeta sqrt(k_l m) for a damping ratio zeta
  double angular_damping = 0;                                   ///< N m s/rad
  double force_cap = std::numeric_limits<double>::infinity();   ///< N, > 0, on spring and damper together
  double torque_cap = std::numeric_limits<double>::infinity();  ///< N m, > 0
};

/// One coupled body.
struct CouplingSite {
  int body = 0;  ///< index into State::body_poses
  Pose
      body_from_frame;  ///< the coupled frame in the body (centre-of-mass) frame: `joint_from_body.inverse()` of a bone
  CouplingGains gains;
};

class BodyCoupling final : public Energy {
 public:
  /// No site has a target yet, so none pulls. std::invalid_argument on gains that are negative or not a number.
  BodyCoupling(std::string name, std::vector<CouplingSite> sites, DofLayout layout);

  int site_count() const { return static_cast<int>(sites_.size()); }
  int body(int site) const { return at(site).body; }

  // Between steps only; nothing here allocates. Takes effect at the next `begin_step`.
  /// The copy's frame and velocity, both as they should be at the END of the coming step (extrapolated by age by the
  /// caller).
  void set_target(int site, const Pose& target, const Twist& velocity);
  /// The site stops pulling: a joint that is not tracked, an empty object slot.
  void clear_target(int site) { at(site).active = false; }
  bool has_target(int site) const { return at(site).active; }
  void set_gains(int site, const CouplingGains& gains);

  /// From the site's target to its frame in `state`, metres; zero without a target.
  double stretch(int site, const State& state) const;
  /// What the coupling exerts on the body, torque about the coupled frame's origin (the joint), world axes; zero
  /// without a target. For `state` in or just after the last begun step.
  Wrench wrench(int site, const State& state) const;

  std::string_view name() const override { return name_; }
  void add_pattern(BlockPattern& pattern) const override;
  void bind(const BlockMatrix& matrix) override;
  void begin_step(const State& state, double time_step) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  void end_step(State& state) override;
  /// Stored: the springs alone, capped, as U of eq. 18. What the force on a body is more than its spring's is the
  /// damper's.
  EnergyFlow flow(double, double, double) const override { return flow_; }

 private:
  struct Site {
    int body = 0;
    Pose body_from_frame;
    CouplingGains gains;
    Clique<2> blocks;
    bool active = false;  // as set by the caller
    Pose target;
    Twist target_velocity;
    // Fixed within the step.
    bool pulls = false;
    Vector3 position_target = Vector3::Zero();
    Quaternion orientation_target = Quaternion::Identity();
    double stiffness = 0;
    double angular_stiffness = 0;
    Pose start;               // of the body
    double start_energy = 0;  // of the springs, to where the target was, J
    // As the last step left it.
    bool pulled = false;
    Pose end;  // of the body
    Pose end_target;
    double stored = 0;  // J
  };
  struct Pull {
    double energy = 0;
    Wrench wrench;  // on the body, about the coupled frame's origin
  };
  static Pull pull_of(const Site& site, const State& state);
  static double spring_energy(const Site& site, const Pose& body, const Pose& target);
  const Site& at(int site) const { return sites_[static_cast<std::size_t>(site)]; }
  Site& at(int site) { return sites_[static_cast<std::size_t>(site)]; }

  std::string name_;
  std::vector<Site> sites_;
  double time_step_ = 0;
  EnergyFlow flow_;
};

}  // namespace softhand
