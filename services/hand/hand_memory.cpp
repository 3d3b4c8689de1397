// The saved state of the hand's loop.
#include <stdexcept>

#include "hand/hand_loop.hpp"
#include "messages/convert.hpp"

namespace softhand {

template <typename Self, typename Visit>
void HandLoop::visit_own(Self& self, Visit&& visit) {
  visit(self.tracked_);
  visit(self.slot_object_);
  visit(self.skeleton_);
  visit(self.any_skeleton_);
  visit(self.reposition_asked_);
  visit(self.settling_time_);
  visit(self.world_time_);
  visit(self.reset_time_);
  visit(self.counters_);
  visit(self.output_.simulated.stamp.sequence);
  visit(self.output_.coupling.twins);
}

void HandLoop::save(ByteWriter& out) const {
  out.write(static_cast<std::uint32_t>(objects_.size()));
  for (const KnownObject& object : objects_) {
    out.write(object.description);
    out.write(object.state);
    out.write(object.seen);
    out.write(object.listed);
    out.write(object.distance);
    out.write(object.near);
    out.write(object.slot);
    out.write(object.owned);
    out.write(object.is_free);
    out.write(object.last_touch);
  }
  out.write(joints_);
  visit_own(*this, [&out](const auto& value) { out.write(value); });
  simulation_->save(out);
}

void HandLoop::load(ByteReader& in) {
  if (!objects_.empty() || !joints_.empty()) throw std::logic_error("HandLoop: `load` is for a new loop");
  const auto count = in.take<std::uint32_t>();
  for (std::uint32_t n = 0; n < count; ++n) {
    auto description = in.take<ObjectDescription>();
    describe_object(description);
    KnownObject& object = objects_.back();
    in.read(object.state);
    in.read(object.seen);
    in.read(object.listed);
    in.read(object.distance);
    in.read(object.near);
    in.read(object.slot);
    in.read(object.owned);
    in.read(object.is_free);
    in.read(object.last_touch);
    if (object.slot >= simulation_->slot_count()) throw std::runtime_error("the saved state has more slots");
  }
  in.read(joints_);
  find_assemblies();
  visit_own(*this, [&in](auto& value) { in.read(value); });
  for (const KnownObject& object : objects_) {
    if (object.slot < 0) continue;
    simulation_->set_slot(object.slot, object.mirrored);
    if (object.is_free || (symmetric_ && object.description.is_static == 0))
      simulation_->make_dynamic(object.slot, symmetric_ ? Vector3(Vector3::Zero()) : to_vector(object.state.gravity));
  }
  for (const KnownJoint& joint : joints_) {
    const KnownObject* parent = find_object(joint.parent);
    const KnownObject* child = find_object(joint.child);
    if (joint.place >= 0 && parent != nullptr && child != nullptr) set_joint(joint, *parent, *child);
  }
  simulation_->load(in);
}

}  // namespace softhand
