// The coupling of rigid bodies to copies of themselves that other processes move (ES2725128A1 eq. 18). It couples a
// bone to the intermediate or tracked bone, an intermediate bone to either side, and a mirrored object to the world's
// twin.
//
//   U = 1/2 k_l |x_a - x_b|^2 + 1/2 k_a |log(R_a R_b^T)|^2
//
// The energy is taken at a frame fixed to the body. For a bone this is its joint, because poses on the wire are joint
// frames. b is the copy. It is constant during a step.
//
// Additions to the source, with reasons:
// - Damping relative to the copy's velocity, dt/2 b |v - v_b|^2 with v = (x - x_i)/dt. Spring and damper together are
//   one spring of stiffness K = k + b/dt to the target x* = (k x_b + b/dt (x_i + dt v_b))/K, plus a constant that is
//   left out. The rotation uses the same formula along the geodesic from exp(dt w_b) R_i to R_b. This is exact for
//   small angles. The torque k log(R_b R_i^T) + b w_b is right at any angle.
// - A force cap: U = 1/2 K d^2 while K d <= cap. Beyond that U = cap d - cap^2/(2K), so the whole force, including
//   damping, never exceeds the cap. The secant stiffness is K min(1, cap/(K d)).
//
// The projected Hessian is the secant stiffness times the identity. It bounds the exact curvature from above. With half
// of this stiffness along a capped stretch, steps that a budget cuts off move too far. The logarithm takes the shortest
// arc. At a rotation of exactly pi the direction of the torque is a choice, and finite.
//
// Degrees of freedom: six per coupled body. Units: J; m, rad; N, N m.
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "energies/clique.hpp"
#include "energies/memory.hpp"

namespace softhand {

struct CouplingGains {
  double linear_stiffness = 0;                                  ///< N/m, k_l >= 0
  double angular_stiffness = 0;                                 ///< N m/rad, k_a >= 0
  double linear_damping = 0;                                    ///< N s/m; 2 zeta sqrt(k_l m) for a damping ratio zeta
  double angular_damping = 0;                                   ///< N m s/rad
  double force_cap = std::numeric_limits<double>::infinity();   ///< N, > 0, limits spring and damper together
  double torque_cap = std::numeric_limits<double>::infinity();  ///< N m, > 0
};

/// One coupled body.
struct CouplingSite {
  int body = 0;  ///< index into State::body_poses
  /// The coupled frame in the body (centre-of-mass) frame. For a bone: `joint_from_body.inverse()`.
  Pose body_from_frame;
  CouplingGains gains;
};

class BodyCoupling final : public EnergyWithMemory<BodyCoupling> {
 public:
  /// Sites have no target at first and exert no force. Throws std::invalid_argument if a gain is negative or NaN.
  BodyCoupling(std::string name, std::vector<CouplingSite> sites, DofLayout layout);

  int site_count() const { return static_cast<int>(sites_.size()); }
  int body(int site) const { return at(site).body; }

  // Call these only between steps; they do not allocate. Changes take effect at the next `begin_step`.
  /// Frame and velocity of the copy, both at the END of the coming step. The caller extrapolates them by their age. All
  /// gains of the site, also the caps, are multiplied by `strength`, > 0.
  void set_target(int site, const Pose& target, const Twist& velocity, double strength = 1);
  /// The site exerts no more force. Used for a joint that is not tracked and for an empty object slot.
  void clear_target(int site) { at(site).active = false; }
  bool has_target(int site) const { return at(site).active; }
  /// As set; zero velocity without a target.
  std::pair<Pose, Twist> target(int site) const {
    return {at(site).target, at(site).active ? at(site).target_velocity : Twist{}};
  }
  void set_gains(int site, const CouplingGains& gains);

  /// All that a step carries to the next one, and what the caller set.
  struct Memory {
    struct Site {
      CouplingGains gains;
      // As set by the caller.
      bool active = false;
      Pose target;
      Twist target_velocity;
      double strength = 1;
      // At the end of the last step.
      bool pulled = false;
      Pose end;  // of the body
      Pose end_target;
      Pose end_spring_target;  // of spring and damper together
      double stored = 0;       // J
    };
    std::vector<Site> sites;
  };
  const Memory& save() const;
  /// Throws std::invalid_argument if `memory` has another number of sites.
  void load(const Memory& memory);
  /// The bodies were repositioned. Targets and gains stay.
  void reset();

  /// Pose of the body (world) if it moves from the start of this step as its target does. The target is that of spring
  /// and damper together, and its movement is the one since the last step. Call it after `begin_step`. Empty without a
  /// target, after a jump of the target by more than 1 rad, and after a reset.
  std::optional<Pose> followed(int site) const;
  /// Distance from the site's target to its frame in `state`, metres. Zero without a target.
  double stretch(int site, const State& state) const;
  /// Force and torque of the coupling on the body. The torque is about the origin of the coupled frame (the joint),
  /// world axes. Zero without a target. `state` must be in the last begun step or just after it.
  Wrench wrench(int site, const State& state) const;

  std::string_view name() const override { return name_; }
  void add_pattern(BlockPattern& pattern) const override;
  void bind(const BlockMatrix& matrix) override;
  void begin_step(const State& state, double time_step) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  void end_step(State& state) override;
  /// Stored: only the springs, capped, as U of eq. 18. The force on a body beyond its spring's force counts as damping.
  EnergyFlow flow(double, double, double) const override { return flow_; }

 private:
  struct Site : Memory::Site {
    int body = 0;
    Pose body_from_frame;
    Clique<2> blocks;
    // Fixed within the step.
    bool pulls = false;
    bool continues = false;  // the body is where the last step left it, and the target has not jumped
    CouplingGains acting;    // the gains times the strength
    Vector3 position_target = Vector3::Zero();
    Quaternion orientation_target = Quaternion::Identity();
    double stiffness = 0;
    double angular_stiffness = 0;
    Pose start;               // of the body
    Pose start_target;        // the target before it moved
    double start_energy = 0;  // of the springs, towards the previous target, J
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
  mutable Memory saved_;
  double time_step_ = 0;
  EnergyFlow flow_;
};

}  // namespace softhand
