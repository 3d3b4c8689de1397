#include "energies/body_coupling.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "math/rotation.hpp"

namespace softhand {
namespace {

/// Rotation of a target in one step beyond which it counts as a jump, rad. A finger flick at 90 Hz reaches half of
/// this.
constexpr double kJump = 1.0;

// A spring of stiffness k whose force is capped; d is the length of its stretch.
struct CappedSpring {
  double energy;
  double secant;  // force = secant * stretch
  bool capped;
};

CappedSpring capped_spring(double k, double cap, double d) {
  if (k * d <= cap) return {0.5 * k * d * d, k, false};
  return {cap * d - 0.5 * cap * cap / k, cap / d, true};
}

// Second derivative with respect to the stretch. Beyond the cap, only the directions across the stretch have stiffness.
Matrix3 exact_stiffness(const CappedSpring& spring, const Vector3& stretch) {
  Matrix3 result = spring.secant * Matrix3::Identity();
  if (spring.capped) result -= spring.secant / stretch.squaredNorm() * stretch * stretch.transpose();
  return result;
}

CouplingGains scaled(const CouplingGains& gains, double strength) {
  return {strength * gains.linear_stiffness, strength * gains.angular_stiffness, strength * gains.linear_damping,
          strength * gains.angular_damping,  strength * gains.force_cap,         strength * gains.torque_cap};
}

void check_gains(const std::string& name, const CouplingGains& gains) {
  const auto refuse = [&name](const char* field, double value, const char* expected) {
    throw std::invalid_argument(name + ": " + field + " is " + std::to_string(value) + ", expected " + expected);
  };
  const auto not_negative = [&refuse](const char* field, double value) {
    if (!(value >= 0) || !(value < std::numeric_limits<double>::infinity()))
      refuse(field, value, "a finite number >= 0");
  };
  not_negative("linear_stiffness", gains.linear_stiffness);
  not_negative("angular_stiffness", gains.angular_stiffness);
  not_negative("linear_damping", gains.linear_damping);
  not_negative("angular_damping", gains.angular_damping);
  if (!(gains.force_cap > 0)) refuse("force_cap", gains.force_cap, "a number > 0");
  if (!(gains.torque_cap > 0)) refuse("torque_cap", gains.torque_cap, "a number > 0");
}

}  // namespace

BodyCoupling::BodyCoupling(std::string name, std::vector<CouplingSite> sites, DofLayout layout)
    : name_(std::move(name)) {
  sites_.reserve(sites.size());
  for (const CouplingSite& given : sites) {
    check_gains(name_, given.gains);
    Site site;
    site.body = given.body;
    site.body_from_frame = given.body_from_frame;
    site.gains = given.gains;
    site.blocks = Clique<2>({layout.body_translation_block(given.body), layout.body_rotation_block(given.body)});
    sites_.push_back(site);
  }
  saved_.sites.reserve(sites_.size());
}

void BodyCoupling::set_target(int site, const Pose& target, const Twist& velocity, double strength) {
  Site& s = at(site);
  s.strength = strength;
  s.active = true;
  s.target = target;
  s.target_velocity = velocity;
}

void BodyCoupling::set_gains(int site, const CouplingGains& gains) { at(site).gains = gains; }

const BodyCoupling::Memory& BodyCoupling::save() const {
  saved_.sites.assign(sites_.begin(), sites_.end());
  return saved_;
}

void BodyCoupling::load(const Memory& memory) {
  if (memory.sites.size() != sites_.size())
    throw std::invalid_argument(name_ + ": the memory has " + std::to_string(memory.sites.size()) +
                                " sites, expected " + std::to_string(sites_.size()));
  for (const Memory::Site& from : memory.sites) check_gains(name_, from.gains);
  for (std::size_t i = 0; i < sites_.size(); ++i) static_cast<Memory::Site&>(sites_[i]) = memory.sites[i];
}

void BodyCoupling::reset() {
  for (Site& s : sites_) s.pulled = false;
}

void BodyCoupling::add_pattern(BlockPattern& pattern) const {
  for (const Site& site : sites_) site.blocks.add_pattern(pattern);
}

void BodyCoupling::bind(const BlockMatrix& matrix) {
  for (Site& site : sites_) site.blocks.bind(matrix);
}

double BodyCoupling::spring_energy(const Site& site, const Pose& body, const Pose& target) {
  const Pose frame = body * site.body_from_frame;
  const double turn = rotation_log(frame.orientation * target.orientation.conjugate()).norm();
  return capped_spring(site.acting.linear_stiffness, site.acting.force_cap, (frame.position - target.position).norm())
             .energy +
         capped_spring(site.acting.angular_stiffness, site.acting.torque_cap, turn).energy;
}

void BodyCoupling::begin_step(const State& state, double time_step) {
  time_step_ = time_step;
  for (Site& s : sites_) {
    s.pulls = s.active;
    if (!s.pulls) continue;
    s.acting = scaled(s.gains, s.strength);
    s.start = state.body_poses[static_cast<std::size_t>(s.body)];
    // If the body is not where the last step left it, body and target were repositioned. A target that jumped (kJump)
    // has no unique path either. In both cases no work is computed along the path. The change of the springs' energy
    // counts as work.
    s.continues = s.pulled && s.start.position == s.end.position &&
                  s.start.orientation.coeffs() == s.end.orientation.coeffs() &&
                  rotation_log(s.target.orientation * s.end_target.orientation.conjugate()).norm() < kJump;
    s.start_target = s.continues ? s.end_target : s.target;
    s.start_energy = spring_energy(s, s.start, s.start_target);
    const Pose start = s.start * s.body_from_frame;
    const double damping = s.acting.linear_damping / time_step;
    const double angular_damping = s.acting.angular_damping / time_step;
    s.stiffness = s.acting.linear_stiffness + damping;
    s.angular_stiffness = s.acting.angular_stiffness + angular_damping;
    s.position_target = s.target.position;
    if (damping > 0) {
      s.position_target +=
          damping / s.stiffness * (start.position + time_step * s.target_velocity.linear - s.target.position);
    }
    s.orientation_target = s.target.orientation;
    if (angular_damping > 0) {
      const Quaternion advanced = rotation_exp(time_step * s.target_velocity.angular) * start.orientation;
      const Vector3 arc = rotation_log(s.target.orientation * advanced.conjugate());
      s.orientation_target =
          (rotation_exp(s.acting.angular_stiffness / s.angular_stiffness * arc) * advanced).normalized();
    }
  }
}

std::optional<Pose> BodyCoupling::followed(int site) const {
  const Site& s = at(site);
  if (!s.pulls || !s.continues) return std::nullopt;
  const Pose frame = s.start * s.body_from_frame;
  const Pose end = {
      frame.position + s.position_target - s.end_spring_target.position,
      (s.orientation_target * s.end_spring_target.orientation.conjugate() * frame.orientation).normalized()};
  return end * s.body_from_frame.inverse();
}

double BodyCoupling::stretch(int site, const State& state) const {
  const Site& s = at(site);
  if (!s.active) return 0;
  return ((state.body_poses[static_cast<std::size_t>(s.body)] * s.body_from_frame).position - s.target.position).norm();
}

BodyCoupling::Pull BodyCoupling::pull_of(const Site& s, const State& state) {
  const Pose frame = state.body_poses[static_cast<std::size_t>(s.body)] * s.body_from_frame;
  const Vector3 stretch = frame.position - s.position_target;
  const Vector3 turn = rotation_log(frame.orientation * s.orientation_target.conjugate());
  const CappedSpring linear = capped_spring(s.stiffness, s.acting.force_cap, stretch.norm());
  const CappedSpring angular = capped_spring(s.angular_stiffness, s.acting.torque_cap, turn.norm());
  return {linear.energy + angular.energy, {-linear.secant * stretch, -angular.secant * turn}};
}

Wrench BodyCoupling::wrench(int site, const State& state) const {
  const Site& s = at(site);
  return s.pulls ? pull_of(s, state).wrench : Wrench{};
}

double BodyCoupling::value(const State& state) const {
  double energy = 0;
  for (const Site& s : sites_) {
    if (s.pulls) energy += pull_of(s, state).energy;
  }
  return energy;
}

double BodyCoupling::add_gradient(const State& state, VectorX& gradient) const {
  double energy = 0;
  for (const Site& s : sites_) {
    if (!s.pulls) continue;
    const Pull pull = pull_of(s, state);
    energy += pull.energy;
    // The Jacobian of the logarithm does not change the rotation vector itself, J^-T phi = phi. So the gradient of the
    // angular part is the torque.
    const Vector3 arm = state.body_poses[static_cast<std::size_t>(s.body)].orientation * s.body_from_frame.position;
    Clique<2>::Gradient local;
    local << -pull.wrench.force, -(pull.wrench.torque + arm.cross(pull.wrench.force));
    s.blocks.add(gradient, local);
  }
  return energy;
}

void BodyCoupling::end_step(State& state) {
  flow_ = {};
  for (int site = 0; site < site_count(); ++site) {
    Site& s = at(site);
    flow_.work -= s.stored;  // added back below as start_energy; the two differ if a spring was switched
    s.stored = 0;
    s.pulled = s.pulls;
    if (!s.pulls) continue;
    s.end = state.body_poses[static_cast<std::size_t>(s.body)];
    s.stored = spring_energy(s, s.end, s.target);
    // The motion of the frame as the solver sees it: the derivative at the step's end times the body's increment dq.
    const Pose frame = s.end * s.body_from_frame;
    const Vector3 turned = rotation_log(s.end.orientation * s.start.orientation.conjugate());
    const Vector3 moved = s.end.position - s.start.position + turned.cross(frame.position - s.end.position);
    const Vector3 target_moved = s.target.position - s.start_target.position;
    const Vector3 target_turned = rotation_log(s.target.orientation * s.start_target.orientation.conjugate());
    s.end_target = s.target;
    s.end_spring_target = {s.position_target, s.orientation_target};
    const Vector3 stretch = frame.position - s.target.position;
    const Vector3 turn = rotation_log(frame.orientation * s.target.orientation.conjugate());
    const Vector3 spring =
        capped_spring(s.acting.linear_stiffness, s.acting.force_cap, stretch.norm()).secant * stretch;
    const Vector3 angular_spring =
        capped_spring(s.acting.angular_stiffness, s.acting.torque_cap, turn.norm()).secant * turn;
    const Wrench whole = wrench(site, state);
    const Vector3 damper = -whole.force - spring;
    const Vector3 angular_damper = -whole.torque - angular_spring;
    const Vector3 target_drift = time_step_ * s.target_velocity.linear;
    const Vector3 target_turn = time_step_ * s.target_velocity.angular;
    flow_.stored += s.stored;
    flow_.work += s.start_energy - spring.dot(target_moved) - angular_spring.dot(target_turned) -
                  damper.dot(target_drift) - angular_damper.dot(target_turn);
    flow_.damping += damper.dot(moved - target_drift) + angular_damper.dot(turned - target_turn);
    flow_.integrator +=
        s.start_energy - s.stored + spring.dot(moved - target_moved) + angular_spring.dot(turned - target_turned);
  }
}

void BodyCoupling::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  for (const Site& s : sites_) {
    if (!s.pulls) continue;
    const Pose& body = state.body_poses[static_cast<std::size_t>(s.body)];
    const Pose frame = body * s.body_from_frame;
    const Vector3 arm = body.orientation * s.body_from_frame.position;
    const Vector3 stretch = frame.position - s.position_target;
    const Vector3 turn = rotation_log(frame.orientation * s.orientation_target.conjugate());
    const CappedSpring linear = capped_spring(s.stiffness, s.acting.force_cap, stretch.norm());
    const CappedSpring angular = capped_spring(s.angular_stiffness, s.acting.torque_cap, turn.norm());
    const Matrix3 lever = -skew(arm);  // d(frame position)/d(rotation)

    Matrix3 translation = linear.secant * Matrix3::Identity();
    Matrix3 rotation = angular.secant * Matrix3::Identity();
    if (curvature == Curvature::exact) {
      translation = exact_stiffness(linear, stretch);
      const Matrix3 jacobian = left_jacobian_inverse(turn);
      rotation = jacobian.transpose() * exact_stiffness(angular, turn) * jacobian +
                 log_second_derivative(turn, angular.secant * turn) +
                 rotated_arm_second_derivative(arm, linear.secant * stretch);
    }
    Clique<2>::Hessian local;
    local.topLeftCorner<3, 3>() = translation;
    local.bottomLeftCorner<3, 3>() = lever.transpose() * translation;
    local.bottomRightCorner<3, 3>() = lever.transpose() * translation * lever + rotation;
    s.blocks.add(hessian, local);
  }
}

}  // namespace softhand
