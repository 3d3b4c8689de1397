// The contacts of a hand simulation: which objects are touched, and what is published of the contacts.
#include <algorithm>

#include "energies/contact.hpp"
#include "energies/skin_contact.hpp"
#include "messages/convert.hpp"
#include "scene/contact_patches.hpp"
#include "scene/hand_simulation.hpp"
#include "scene/skin_traction.hpp"

namespace softhand {

Wrench HandSimulation::contact_wrench(int slot) const {
  Wrench sum;
  for_each_contacts([&](const ContactSet& contacts) {
    sum.force += contacts.wrench(slot).force;
    sum.torque += contacts.wrench(slot).torque;
  });
  return sum;
}

int HandSimulation::contact_count() const {
  int count = 0;
  for (const auto& hand : hands_) count += hand->contacts() == nullptr ? 0 : hand->contacts()->count();
  return count;
}

int HandSimulation::skin_contact_count() const {
  std::size_t count = 0;
  for_each_skin([&count](const SkinContact& skin) { count += skin.anchors().size(); });
  return static_cast<int>(count);
}

void HandSimulation::look_ahead(double time_step) {
  for_each_contacts([&](ContactSet& contacts) { contacts.look_ahead(state_, time_step); });
}

bool HandSimulation::may_touch(int slot) {
  bool may = false;
  for_each_contacts([&](ContactSet& contacts) { may = may || contacts.may_touch(slot, state_); });
  return may;
}

// A light object may leave again in the step in which it is hit.
bool HandSimulation::touched(int slot) const {
  bool touches = false;
  for_each_contacts([&](const ContactSet& contacts) {
    touches = touches || contacts.count(slot) > 0 || !contacts.wrench(slot).force.isZero(0);
  });
  return touches;
}

void HandSimulation::write_contacts(Contacts& out, int hand) const {
  const SimulatedHand& of = at(hand);
  report_.begin(out);
  out.near.clear();
  if (of.contacts() != nullptr) of.contacts()->write(state_, report_, out);
  if (soft_) soft_->write_contacts(state_, hand, slot_count(), report_, out);
  for (Contact& contact : out.contacts) contact.node -= static_cast<std::uint32_t>(of.first_node());
  report_.finish(
      [this](int place) {
        return place < slot_count() ? objects_[static_cast<std::size_t>(place)].id
                                    : SoftObjects::id(place - slot_count());
      },
      out);
  if (of.contacts() != nullptr) of.contacts()->write_near(state_, out);
}

void HandSimulation::write_patches(int slot, BoundedVector<ContactPatch, kMaxPatches>& patches) const {
  if (at(0).contacts() == nullptr) return;
  const std::size_t first = patches.size();
  softhand::write_patches(hand(), *at(0).contacts(), state_, slot, objects_[static_cast<std::size_t>(slot)].id,
                          patches);
  for (std::size_t p = first; p < patches.size(); ++p) {
    const Twist velocity = carrying_velocity(to_vector(patches.items[p].point));
    patches.items[p].linear_velocity = to_wire(velocity.linear);
    patches.items[p].angular_velocity = to_wire(velocity.angular);
  }
}

void HandSimulation::write_traction(double time_step, SkinTractionReport& report, SkinTraction& out, int hand) const {
  const SimulatedHand& of = at(hand);
  report.begin(state_);
  const std::size_t hand_points = of.model().contact_points.size(), hand_triangles = of.model().surface.size();
  if (of.contacts() != nullptr) {
    for (const ContactSet::Anchor& anchor : of.contacts()->anchors()) {
      const SkinForce force{anchor.force, -of.contacts()->offset(anchor, state_).normal, anchor.slip_speed,
                            objects_[static_cast<std::size_t>(anchor.slot)].id};
      const auto point = static_cast<std::size_t>(anchor.point);
      if (point < hand_points) {
        report.add(point, force);
      } else {  // a sharp point of the object
        report.add(point - hand_points, of.contacts()->position(anchor, state_), force);
      }
    }
  }
  const auto object_of = [](int part) { return part < kFirstSoftPart ? 0u : SoftObjects::id(part - kFirstSoftPart); };
  // Points and triangles of the hand begin at `first_point` and `first_triangle` of the contact's model.
  const auto add_skin = [&](const SkinContact& skin, std::size_t first_point, std::size_t first_triangle) {
    for (const SkinAnchor& anchor : skin.anchors()) {
      const Vector3 normal = skin.offset(anchor, state_).normal;  // of the triangle
      // What lies before the first one wraps around to a large number.
      const std::size_t point = static_cast<std::size_t>(anchor.point) - first_point;
      const std::size_t triangle = static_cast<std::size_t>(anchor.triangle) - first_triangle;
      if (point < hand_points) report.add(point, {anchor.force, -normal, anchor.slip_speed, object_of(anchor.slot)});
      if (triangle < hand_triangles)
        report.add(triangle, skin.points().at(anchor.point, state_.node_positions),
                   {-anchor.force, normal, anchor.slip_speed, object_of(skin_part(skin.points()[anchor.point].body))});
    }
  };
  if (of.skin() != nullptr) add_skin(*of.skin(), 0, 0);
  if (between_ != nullptr) {
    std::size_t first_point = 0, first_triangle = 0;
    for (int before = 0; before < hand; ++before) {
      first_point += at(before).model().contact_points.size();
      first_triangle += at(before).model().surface.size();
    }
    add_skin(*between_, first_point, first_triangle);
  }
  report.write(time_step, out);
}

void HandSimulation::collect_bone_contacts() {
  std::fill(bone_contact_forces_.begin(), bone_contact_forces_.end(), Vector3::Zero());
  const auto add_node = [this](std::int32_t node, const Vector3& force) {
    const std::int32_t bone = node_bones_[static_cast<std::size_t>(node)];
    if (bone >= 0) bone_contact_forces_[static_cast<std::size_t>(bone)] += force;
  };
  const auto add_point = [&](const ContactPoint& point, const Vector3& force) {
    for (std::size_t k = 0; k < static_cast<std::size_t>(point.node_count); ++k)
      add_node(point.nodes[k], point.weights[k] * force);
  };
  for (const auto& hand : hands_) {
    if (hand->contacts() == nullptr) continue;
    for (const ContactSet::Anchor& anchor : hand->contacts()->anchors())
      add_point(hand->contacts()->points()[anchor.point], anchor.force);
  }
  for_each_skin([&](const SkinContact& skin) {
    for (const SkinAnchor& anchor : skin.anchors()) {
      add_point(skin.points()[anchor.point], anchor.force);
      for (const std::int32_t node : skin.search().corners(anchor.triangle)) add_node(node, -anchor.force / 3);
    }
  });
}

double HandSimulation::deepest_penetration() const {
  double deepest = 0;
  for (const auto& hand : hands_)
    if (hand->contacts() != nullptr) deepest = std::max(deepest, hand->contacts()->penetration_quantile(state_, 1));
  return deepest;
}

}  // namespace softhand
