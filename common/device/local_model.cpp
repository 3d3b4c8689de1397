#include "device/local_model.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "device/device_loop.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

// A contact point farther from the joint of its bone is absurd, m.
constexpr double kReach = 1;
// The surface of an older message stands still from then on, s. Commands are zero soon after (DeviceLoopOptions).
constexpr double kLongestTravel = 0.05;

bool has_plane(const BoneSample& bone) { return bone.contact_normal != Vec3{} || bone.contact_stiffness != 0; }

// Comparisons with NaN are false.
bool is_plausible(const BoneSample& bone) {
  const auto within = [](double value, double most) { return value >= 0 && value <= most; };
  return std::abs(to_vector(bone.contact_normal).norm() - 1) <= 0.01 &&
         within(bone.contact_stiffness, kMaxContactStiffness) && within(bone.contact_damping, kMaxContactDamping) &&
         std::abs(bone.contact_gap) <= kMaxContactGap && to_vector(bone.contact_velocity).norm() <= kMaxContactSpeed &&
         (to_vector(bone.contact_point) - to_vector(bone.tracked_position)).norm() <= kReach;
}

// Velocity of a point that moves rigidly with the wrist, m/s. Like that of the objects, it is of the simulation, so the
// noise of a tracker does not become a relative velocity.
Vector3 carrying_velocity(const BoneWrench& input, const Vector3& point) {
  const Vector3 wrist = to_vector(input.bones[static_cast<std::size_t>(index_of(Body::carpus))].simulated_position);
  return to_vector(input.wrist_velocity) + to_vector(input.wrist_angular_velocity).cross(point - wrist);
}

}  // namespace

bool DeviceMotion::add(Nanoseconds now, std::span<const double> positions) {
  bool is_motion = true;
  has_velocities_ = false;
  for (std::size_t i = 0; i < actuators_; ++i) {
    is_motion = is_motion && std::isfinite(positions[i]);
    if (count_ > 0) is_motion = is_motion && std::abs(positions[i] - sample(0).positions[i]) <= kJump;
  }
  if (count_ > 0 && now <= sample(0).time) is_motion = false;
  if (!is_motion) {
    count_ = 0;
    return false;
  }
  newest_ = (newest_ + 1) % kHistory;
  ring_[newest_].time = now;
  std::copy_n(positions.begin(), actuators_, ring_[newest_].positions.begin());
  count_ = std::min(count_ + 1, kHistory);
  return true;
}

bool DeviceMotion::set_velocities(std::span<const double> velocities) {
  has_velocities_ = std::all_of(velocities.begin(), velocities.begin() + static_cast<std::ptrdiff_t>(actuators_),
                                [](double velocity) { return std::abs(velocity) <= kFastest; });
  if (has_velocities_) std::copy_n(velocities.begin(), actuators_, velocities_.begin());
  return has_velocities_;
}

ActuatorValues DeviceMotion::step(std::size_t steps_ago) const {
  ActuatorValues change{};
  if (count_ < steps_ago + 2) return change;
  for (std::size_t i = 0; i < actuators_; ++i)
    change[i] = sample(steps_ago).positions[i] - sample(steps_ago + 1).positions[i];
  return change;
}

ActuatorValues DeviceMotion::at(Nanoseconds time) const {
  std::size_t ago = 0;
  while (ago + 1 < count_ && sample(ago).time > time) ++ago;
  const Sample& before = sample(ago);
  if (ago == 0 || before.time >= time) return before.positions;
  const Sample& after = sample(ago - 1);
  const double share = static_cast<double>(time - before.time) / static_cast<double>(after.time - before.time);
  ActuatorValues out{};
  for (std::size_t i = 0; i < actuators_; ++i)
    out[i] = before.positions[i] + share * (after.positions[i] - before.positions[i]);
  return out;
}

ActuatorValues DeviceMotion::velocities() const {
  if (has_velocities_) return velocities_;
  ActuatorValues out{};
  if (count_ < 2) return out;
  std::size_t ago = 1;
  while (ago + 1 < count_ && sample(0).time - sample(ago).time < kVelocityTime) ++ago;
  const double elapsed = static_cast<double>(sample(0).time - sample(ago).time) * kSecondsPerNanosecond;
  for (std::size_t i = 0; i < actuators_; ++i) out[i] = (sample(0).positions[i] - sample(ago).positions[i]) / elapsed;
  return out;
}

LocalModel::LocalModel(const DeviceLimits& limits)
    : actuators_(limits.actuators),
      largest_stiffness_(limits.stiffness),
      largest_damping_(limits.damping),
      is_worn_(limits.is_worn) {}

void LocalModel::take(const BoneWrench& input, const DeviceMotion& motion, HapticDriver& driver) {
  count_ = 0;
  held_.fill(0);
  power_ = 0;
  input_ = input;
  sample_time_ = input.stamp.sample_time;
  if (!motion.empty() && largest_stiffness_ > 0) {
    origin_ = motion.at(input.stamp.sample_time);
    for (BoneSample& bone : input_.bones) bone.coupling_force = bone.coupling_torque = {};
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const BoneSample& bone = input.bones[b];
      if (!has_plane(bone)) continue;
      const Vector3 normal = to_vector(bone.contact_normal);
      Plane plane;
      const bool touches = bone.contact_gap == 0;
      plane.held = touches ? to_vector(bone.coupling_force).dot(normal) : 0;
      plane.force = touches ? plane.held : -bone.contact_stiffness * bone.contact_gap;
      plane.stiffness = bone.contact_stiffness;
      plane.damping = bone.contact_damping;
      Vector3 velocity = to_vector(bone.contact_velocity);
      if (is_worn_) velocity -= carrying_velocity(input, to_vector(bone.contact_point));
      plane.speed = velocity.dot(normal);
      input_.bones[b].coupling_force = bone.contact_normal;
      driver.command(input_, {plane.row.data(), actuators_});
      input_.bones[b].coupling_force = {};
      const double size = std::inner_product(plane.row.begin(), plane.row.end(), plane.row.begin(), 0.0);
      if (!is_plausible(bone) || !std::isfinite(plane.force) || !std::isfinite(size) ||
          !(std::abs(plane.speed) <= kMaxContactSpeed)) {
        ++refused_;
        continue;
      }
      if (plane.force > 0 || !touches) planes_[count_++] = plane;
    }
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      input_.bones[b].coupling_force = input.bones[b].coupling_force;
      input_.bones[b].coupling_torque = input.bones[b].coupling_torque;
    }
    limit_gains();
  }
  driver.command(input_, {held_.data(), actuators_});
  for (std::size_t p = 0; p < count_; ++p) {
    for (std::size_t i = 0; i < actuators_; ++i) held_[i] -= planes_[p].row[i] * planes_[p].held;
  }
}

// Several bones may push at one actuator. The norm of the sum of their matrices k r r^T is at most its largest sum over
// a row.
void LocalModel::limit_gains() {
  ActuatorValues stiffness{}, damping{};
  for (std::size_t p = 0; p < count_; ++p) {
    const Plane& plane = planes_[p];
    double sum = 0;
    for (std::size_t i = 0; i < actuators_; ++i) sum += std::abs(plane.row[i]);
    for (std::size_t i = 0; i < actuators_; ++i) {
      stiffness[i] += plane.stiffness * std::abs(plane.row[i]) * sum;
      damping[i] += plane.damping * std::abs(plane.row[i]) * sum;
    }
  }
  const auto share = [](const ActuatorValues& sums, double most) {
    const double largest = *std::max_element(sums.begin(), sums.end());
    return largest > most ? most / largest : 1.0;
  };
  const double softer = share(stiffness, largest_stiffness_), lighter = share(damping, largest_damping_);
  for (std::size_t p = 0; p < count_; ++p) {
    planes_[p].stiffness *= softer;
    if (planes_[p].held == 0) planes_[p].force *= softer;  // the gap stays
    planes_[p].damping *= lighter;
  }
}

void LocalModel::evaluate(Nanoseconds now, const DeviceMotion& motion, std::span<double> requested) {
  std::copy_n(held_.begin(), actuators_, requested.begin());
  power_ = 0;
  if (count_ == 0) return;
  const bool measures = !motion.empty();
  const ActuatorValues velocities = motion.velocities();
  const double elapsed =
      std::clamp(static_cast<double>(now - sample_time_) * kSecondsPerNanosecond, 0.0, kLongestTravel);
  for (std::size_t p = 0; p < count_; ++p) {
    const Plane& plane = planes_[p];
    double force = plane.force;
    if (measures) force += plane.speed * (plane.stiffness * elapsed + plane.damping);
    for (std::size_t i = 0; i < actuators_ && measures; ++i) {
      force -= plane.row[i] * (plane.stiffness * (motion.positions()[i] - origin_[i]) + plane.damping * velocities[i]);
    }
    force = std::max(0.0, force);
    if (!is_worn_) power_ += force * plane.speed;
    for (std::size_t i = 0; i < actuators_; ++i) requested[i] += plane.row[i] * force;
  }
}

}  // namespace softhand
