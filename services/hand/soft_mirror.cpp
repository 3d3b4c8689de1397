#include "hand/soft_mirror.hpp"

#include <algorithm>
#include <optional>
#include <utility>

#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "messages/plausible.hpp"

namespace softhand {
namespace {

constexpr double kHoldoff = 0.2;  // s; for so long the world ignores the hand after a reset (soft_copy.cpp)

}  // namespace

SoftMirror::SoftMirror(HandSimulation& simulation, const HandOptions& options, bool symmetric)
    : simulation_(simulation), options_(options), symmetric_(symmetric), time_step_(1 / options.rate_hz) {
  if (simulation.soft() != nullptr) objects_.resize(static_cast<std::size_t>(simulation.soft()->count()));
  release_all();
}

bool SoftMirror::take(Nanoseconds now, const SoftObjectState& copy) {
  const std::size_t number = copy.object - kFirstSoftObject;
  if (number >= objects_.size() || !age_of(copy.stamp.sample_time, now) ||
      !is_plausible(copy, simulation_.soft()->node_count(static_cast<int>(number))))
    return false;
  Object& object = objects_[number];
  if (copy.stamp.sample_time > object.copy.stamp.sample_time) object.copy = copy;
  return true;
}

// Whether something may begin to touch the object in this step. This is a hand, a rigid object that can move, or a
// flexible object with a higher number. Two flexible objects at rest do not begin to touch. If the world left them in
// each other, they touch already.
bool SoftMirror::may_touch(int object) const {
  constexpr double kSkinDistance = 0.03;  // m, of the skin from the joints
  constexpr double kSteps = 3;            // so far ahead
  const State& state = simulation_.state();
  const SoftObjects::Ball ball = simulation_.soft()->ball(object, state);
  const double speed = simulation_.soft()->fastest(object, state);
  const auto is_near = [&](const Vector3& place, double radius, double other_speed) {
    const double reach = options_.near_distance + kSteps * time_step_ * (speed + other_speed);
    return (place - ball.centre).norm() < ball.radius + radius + reach;
  };
  for (int hand = 0; hand < simulation_.hand_count(); ++hand) {
    for (std::size_t joint = 0; joint < kJointCount; ++joint) {
      const auto name = static_cast<Joint>(joint);
      if (is_near(simulation_.joint_pose(name, hand).position, kSkinDistance,
                  simulation_.joint_velocity(name, hand).linear.norm()))
        return true;
    }
  }
  for (int other = object + 1; other < simulation_.soft()->count(); ++other) {
    const double other_speed = simulation_.soft()->fastest(other, state);
    if (speed + other_speed == 0) continue;
    const SoftObjects::Ball other_ball = simulation_.soft()->ball(other, state);
    if (is_near(other_ball.centre, other_ball.radius, other_speed)) return true;
  }
  for (int slot = 0; slot < simulation_.slot_count(); ++slot)
    if (!simulation_.slot_is_static(slot) && simulation_.slot_mode(slot) != SlotMode::empty) return true;
  return false;
}

// Mode symmetric: the springs of the step that ends at `now`.
void SoftMirror::pull(Nanoseconds now) {
  constexpr double kStall = 0.1;  // s; an older copy does not pull
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    Object& object = objects_[i];
    const int number = static_cast<int>(i);
    if (!simulation_.soft()->object(number).is_shared) continue;
    const std::optional<double> age = age_of(object.copy.stamp.sample_time, now);
    if (!age || *age > kStall) {
      simulation_.let_go_soft_object(number);
      continue;
    }
    if (!std::exchange(object.placed, true)) simulation_.place_soft_object(number, object.copy, *age - time_step_);
    simulation_.pull_soft_object(number, object.copy);
  }
}

void SoftMirror::begin_step(Nanoseconds now, bool knows_world) {
  const Nanoseconds start = now - static_cast<Nanoseconds>(time_step_ * 1e9);
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    Object& object = objects_[i];
    if (!simulation_.soft()->object(static_cast<int>(i)).is_shared) {
      object.owned |= knows_world;
      continue;
    }
    if (object.owned || symmetric_) continue;
    const double ahead = std::clamp(static_cast<double>(start - object.copy.stamp.sample_time) * 1e-9,
                                    -options_.extrapolation_limit, options_.extrapolation_limit);
    simulation_.place_soft_object(static_cast<int>(i), object.copy, ahead);
  }
  if (symmetric_) {
    pull(now);
    return;
  }
  bool simulates = objects_.empty();
  for (std::size_t i = 0; i < objects_.size() && !simulates; ++i) {
    const int number = static_cast<int>(i);
    simulates = objects_[i].owned || may_touch(number) || simulation_.soft()->touches_soft_object(number);
  }
  simulation_.simulate_soft_objects(simulates);
}

bool SoftMirror::touches(int object) const {
  const SoftObjects& soft = *simulation_.soft();
  if (soft.touches_hand(object)) return true;
  // Until the world has put the object back, too, its copy may be beside another object.
  if (objects_[static_cast<std::size_t>(object)].since_release >= kHoldoff && soft.touches_soft_object(object))
    return true;
  if (soft.contacts() == nullptr) return false;
  return std::ranges::any_of(soft.contacts()->anchors(), [&](const ContactSet::Anchor& anchor) {
    const auto nodes = soft.contacts()->points().nodes(anchor.point);
    return !nodes.empty() && nodes.front() >= soft.first_node(object) && nodes.front() < soft.first_node(object + 1) &&
           simulation_.slot_mode(anchor.slot) == SlotMode::dynamic;
  });
}

void SoftMirror::end_step() {
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    Object& object = objects_[i];
    object.since_release = std::min(object.since_release + time_step_, kHoldoff);
    const int number = static_cast<int>(i);
    if (!simulation_.soft()->object(number).is_shared) {
      object.owned |= simulation_.simulates_soft_objects() && simulation_.soft()->touches_hand(number);
      if (!object.owned) simulation_.place_soft_object(number, object.copy, 0);
      continue;
    }
    if (symmetric_) continue;
    if (simulation_.simulates_soft_objects() && touches(number)) {
      object.owned = true;
      object.untouched = 0;
    } else if (object.owned) {
      object.untouched += time_step_;
      object.owned = object.untouched <= options_.release_time;
    }
  }
}

void SoftMirror::release(int object) {
  const SoftObjects& soft = *simulation_.soft();
  Object& released = objects_[static_cast<std::size_t>(object)];
  released.owned = false;
  released.since_release = 0;
  released.placed = false;
  SoftObjectState& copy = released.copy;
  copy = {};
  const Vector3 centre = soft.object(object).pose.position;
  copy.centre = to_wire(centre);
  for (int n = soft.first_node(object); n < soft.first_node(object + 1); ++n) {
    copy.nodes.push_back(to_floats(soft.start_positions().col(n) - centre));
    copy.velocities.push_back({});
  }
}

void SoftMirror::release_all() {
  for (std::size_t i = 0; i < objects_.size(); ++i) release(static_cast<int>(i));
}

}  // namespace softhand
