// The saved state of the world's loop. An engine keeps impulses of contacts, pairs and an order of bodies that cannot
// be read. So at a snapshot the engine of the live run forgets them, and the repeated run makes a new engine.
#include <stdexcept>

#include "world/world_loop.hpp"

namespace softhand {

template <typename Self, typename Visit>
void WorldLoop::visit_own(Self& self, Visit&& visit) {
  for (auto& object : self.objects_) {
    visit(object.present);
    visit(object.weightless);
    visit(object.near_hand);
    visit(object.owned);
    visit(object.stalled);
    visit(object.put);
    visit(object.put_at);
    visit(object.restarted);
    visit(object.handed_at);
    visit(object.owner);
    visit(object.owner_step);
    visit(object.pose);
    visit(object.velocity);
    visit(object.previous_velocity);
    visit(object.planes);
  }
  for (auto& joint : self.joints_) {
    visit(joint.present);
    visit(joint.engine.reaction);
    visit(joint.engine.coordinate);
  }
  for (auto& description : self.descriptions_) {
    visit(description.removed);
    visit(description.stamp.sequence);
  }
  for (auto& description : self.joint_descriptions_) {
    visit(description.removed);
    visit(description.stamp.sequence);
  }
  for (auto& copy : self.copies_) visit(copy);
  visit(self.hands_);
  visit(self.descriptions_version_);
  visit(self.counters_);
  visit(self.newest_input_);
  visit(self.reset_time_);
  visit(self.output_->objects);
}

void WorldLoop::save(ByteWriter& out) const {
  out.write(static_cast<std::uint32_t>(objects_.size()));
  visit_own(*this, [&out](const auto& value) { out.write(value); });
  for (std::size_t slot = 0; slot < objects_.size(); ++slot)
    out.write(objects_[slot].present && objects_[slot].dynamic && engine_->asleep(slot));
}

void WorldLoop::load(ByteReader& in) {
  if (in.take<std::uint32_t>() != objects_.size())
    throw std::runtime_error("the saved state has another number of objects");
  visit_own(*this, [&in](auto& value) { in.read(value); });
  for (const Joint& joint : joints_) {
    if (joint.present && !(objects_[joint.engine.parent].present && objects_[joint.engine.child].present))
      throw std::runtime_error("the saved state has a joint without its objects");
  }
  find_assemblies();
  std::array<bool, kMaxObjects> was_asleep{};
  for (std::size_t slot = 0; slot < objects_.size(); ++slot) was_asleep[slot] = in.take<bool>();
  engine_ = make_physics_engine(options_.engine);
  for (std::size_t slot = 0; slot < objects_.size(); ++slot)
    if (objects_[slot].present) add_to_engine(slot);
  for (std::size_t j = 0; j < joints_.size(); ++j)
    if (joints_[j].present) engine_->add_joint(j, joints_[j].engine);
  for (std::size_t number = 0; number < copies_.size(); ++number)
    engine_->add_copy(number, copies_[number].engine_copy());
  set_engine(was_asleep);
}

void WorldLoop::forget() {
  std::array<bool, kMaxObjects> was_asleep{};
  for (std::size_t slot = 0; slot < objects_.size(); ++slot)
    was_asleep[slot] = objects_[slot].present && objects_[slot].dynamic && engine_->asleep(slot);
  // The order is that of `load`: an engine begins with bodies at their poses, and then gets their velocities.
  place_objects();
  engine_->forget();
  set_engine(was_asleep);
}

void WorldLoop::place_objects() {
  for (std::size_t slot = 0; slot < objects_.size(); ++slot) {
    const Object& object = objects_[slot];
    if (object.present && object.dynamic) engine_->place(slot, object.pose, object.velocity);
  }
}

void WorldLoop::set_engine(const std::array<bool, kMaxObjects>& asleep) {
  place_objects();
  for (std::size_t number = 0; number < copies_.size(); ++number) copies_[number].put_into(*engine_, number);
  for (std::size_t slot = 0; slot < objects_.size(); ++slot)
    if (asleep[slot]) engine_->put_to_sleep(slot);
}

}  // namespace softhand
