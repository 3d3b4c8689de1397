// The world's copies of flexible objects: their states, their owners and what they touch.
#include <algorithm>
#include <stdexcept>
#include <string>

#include "messages/age.hpp"
#include "world/world_loop.hpp"

namespace softhand {

void WorldLoop::add_copies(const std::vector<SoftObject>& soft_objects) {
  if (soft_objects.size() > kMaxSoftObjects)
    throw std::invalid_argument(std::to_string(soft_objects.size()) + " flexible objects, expected at most " +
                                std::to_string(kMaxSoftObjects));
  if (std::ranges::any_of(soft_objects, &SoftObject::is_shared)) find_obstacles();
  NodeSpring spring;
  if (options_.mode == "symmetric") spring = {options_.stiffness, options_.damping_ratio};
  copies_.reserve(soft_objects.size());
  for (const SoftObject& object : soft_objects) {
    copies_.emplace_back(object, static_cast<int>(obstacles_.size()), object.is_shared ? spring : NodeSpring{});
    engine_->add_copy(copies_.size() - 1, copies_.back().engine_copy());
  }
  output_->soft_objects.resize(copies_.size());
}

void WorldLoop::restart_copy(std::size_t number) {
  SoftCopy& copy = copies_[number];
  if (copy.is_shared()) {
    copy.restart();
  } else {
    copy.leave();
    engine_->hide_copy(number);
  }
}

void WorldLoop::describe_soft_object(const SoftObjectDescription& description) {
  const std::size_t number = description.object - kFirstSoftObject;
  if (description.removed == 0 || number >= copies_.size()) return;
  copies_[number].leave();
  if (!copies_[number].is_there()) engine_->hide_copy(number);
}

/// The convex pieces of all static objects.
void WorldLoop::find_obstacles() {
  for (std::size_t slot = 0; slot < objects_.size(); ++slot) {
    const Object& object = objects_[slot];
    for (std::size_t piece = 0; !object.dynamic && piece < object.solid.piece_count(); ++piece) {
      obstacle_shapes_.emplace_back(slot, std::make_unique<ShapeGeometry>(object.solid.piece(piece)));
      obstacles_.emplace_back();
    }
  }
}

/// The flexible objects to where they are at the end of this step. The hand that owns an object has their contact with
/// it. In mode symmetric each hand that has a twin of the object does.
void WorldLoop::move_copies(Nanoseconds now, const WorldInput& input) {
  for (const SoftObjectState& state : input.soft_objects) {
    if (state.stamp.sample_time <= reset_time_) continue;
    const std::size_t number = state.object - kFirstSoftObject;
    if (number >= copies_.size() || !age_of(state.stamp.sample_time, now) || !copies_[number].take(state))
      ++counters_.refused_soft;
  }
  for (std::size_t k = 0; k < obstacles_.size(); ++k) {
    const auto& [slot, shape] = obstacle_shapes_[k];
    const Object& object = objects_[slot];
    obstacles_[k] = {object.present ? shape.get() : nullptr, object.pose, object.options.friction};
  }
  const double most_ahead = (1 + options_.staleness) * (step_ + hand_step_);
  bool any_there = false;
  for (std::size_t number = 0; number < copies_.size(); ++number) {
    SoftCopy& copy = copies_[number];
    if (!copy.simulate(now, step_, kVanished, kMotionStall, obstacles_)) ++counters_.repaired;
    if (!copy.is_there()) continue;
    any_there = true;
    if (copy.move(now, most_ahead, kMotionStall) != SoftCopy::Change::none) copy.place(*engine_, number);
  }
  if (!any_there) return;
  const bool symmetric = options_.mode == "symmetric";
  for (std::size_t slot = 0; slot < objects_.size(); ++slot) {
    const Object& object = objects_[slot];
    if (object.present) engine_->set_passing(slot, object.owned || (symmetric && object.near_hand));
  }
}

void WorldLoop::publish_copies(Nanoseconds now) {
  output_->soft_count = 0;
  for (std::size_t number = 0; number < copies_.size(); ++number) {
    SoftObjectState& state = output_->soft_objects[output_->soft_count];
    if (!copies_[number].write_state(now, state)) continue;
    state.object = kFirstSoftObject + static_cast<std::uint32_t>(number);
    ++output_->soft_count;
  }
}

}  // namespace softhand
