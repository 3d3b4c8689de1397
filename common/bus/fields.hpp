// The fields of every message, with the order and names of idl/*.idl. Only this file connects messages.hpp to the wire.
// The build writes the fields of LoopStatus beside its struct (idl/loop_status.cmake). Visitors of these fields
// implement reading, writing, measuring, keys and the field map of the tests. A test compares the fields with the IDL
// text and with the generated code of both vendors.
#pragma once

#include <concepts>
#include <type_traits>

#include "messages/messages.hpp"

namespace softhand::bus {

template <typename M, typename T>
concept Is = std::same_as<std::remove_const_t<M>, T>;

// visit_fields(visitor, message) calls visitor.key(name, field) for key fields and visitor.field(name, field) for all
// other fields.

template <typename V, Is<HandKey> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("user", m.user);
  v.key("side", m.side);
}

template <typename V, Is<Chain> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("tracker_sample", m.tracker_sample);
  v.field("tracked_published", m.tracked_published);
  v.field("intermediate_published", m.intermediate_published);
  v.field("simulated_published", m.simulated_published);
  v.field("wrench_published", m.wrench_published);
}

template <typename V, Is<Stamp> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("sequence_number", m.sequence);
  v.field("epoch", m.epoch);
  v.field("clock_id", m.clock_id);
  v.field("sample_time", m.sample_time);
  v.field("publish_time", m.publish_time);
  v.field("chain", m.chain);
}

template <typename V, Is<JointSample> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("position", m.position);
  v.field("orientation", m.orientation);
  v.field("linear_velocity", m.linear_velocity);
  v.field("angular_velocity", m.angular_velocity);
  v.field("radius", m.radius);
  v.field("flags", m.flags);
  v.field("velocity_valid", m.velocity_valid);
  v.field("confidence", m.confidence);
}

template <typename V, Is<Skeleton> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("hand", m.hand);
  v.field("stamp", m.stamp);
  v.field("source", m.source);
  v.field("frame", m.frame);
  v.field("confidence", m.confidence);
  v.field("joints", m.joints);
}

template <typename V, Is<HeadPose> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("user", m.user);
  v.field("stamp", m.stamp);
  v.field("position", m.position);
  v.field("orientation", m.orientation);
  v.field("valid", m.valid);
}

template <typename V, Is<TissueSurface> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("hand", m.hand);
  v.field("stamp", m.stamp);
  v.field("wrist_position", m.wrist_position);
  v.field("nodes", m.nodes);
}

template <typename V, Is<Contact> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("node", m.node);
  v.field("body", m.body);
  v.field("finger", m.finger);
  v.field("object_id", m.object);
  v.field("flags", m.flags);
  v.field("point", m.point);
  v.field("normal", m.normal);
  v.field("force", m.force);
  v.field("penetration", m.penetration);
  v.field("area", m.area);
  v.field("slip_speed", m.slip_speed);
  v.field("velocity", m.velocity);
}

template <typename V, Is<FingerContact> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("force", m.force);
  v.field("centre", m.centre);
  v.field("normal", m.normal);
  v.field("area", m.area);
  v.field("slip_speed", m.slip_speed);
  v.field("object_id", m.object);
  v.field("contact_count", m.contact_count);
}

template <typename V, Is<NearContact> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("body", m.body);
  v.field("object_id", m.object);
  v.field("point", m.point);
  v.field("normal", m.normal);
  v.field("gap", m.gap);
  v.field("velocity", m.velocity);
}

template <typename V, Is<Contacts> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("hand", m.hand);
  v.field("stamp", m.stamp);
  v.field("fingers", m.fingers);
  v.field("dropped", m.dropped);
  v.field("contacts", m.contacts);
  v.field("near", m.near);
}

template <typename V, Is<SkinRegion> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("region", m.region);
  v.field("body", m.body);
  v.field("object_id", m.object);
  v.field("place", m.place);
  v.field("normal", m.normal);
  v.field("pressure", m.pressure);
  v.field("shear", m.shear);
  v.field("slip_velocity", m.slip_velocity);
  v.field("area", m.area);
  v.field("area_rate", m.area_rate);
}

template <typename V, Is<SkinTraction> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("hand", m.hand);
  v.field("stamp", m.stamp);
  v.field("regions", m.regions);
}

template <typename V, Is<ShapeFile> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("name", m.name);
  v.field("sha256", m.sha256);
  v.field("link", m.link);
  v.field("position", m.position);
  v.field("orientation", m.orientation);
}

template <typename V, Is<Shape> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("kind", m.kind);
  v.field("size", m.size);
  v.field("vertices", m.vertices);
  v.field("file", m.file);
}

template <typename V, Is<ObjectDescription> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("world", m.world);
  v.key("object_id", m.object);
  v.field("stamp", m.stamp);
  v.field("name", m.name);
  v.field("is_static", m.is_static);
  v.field("mass", m.mass);
  v.field("inertia", m.inertia);
  v.field("friction", m.friction);
  v.field("removed", m.removed);
  v.field("shape", m.shape);
}

template <typename V, Is<JointDetent> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("at", m.at);
  v.field("depth", m.depth);
  v.field("width", m.width);
  v.field("period", m.period);
}

template <typename V, Is<ObjectJointDescription> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("world", m.world);
  v.key("joint_id", m.joint);
  v.field("stamp", m.stamp);
  v.field("name", m.name);
  v.field("removed", m.removed);
  v.field("kind", m.kind);
  v.field("parent", m.parent);
  v.field("child", m.child);
  v.field("parent_position", m.parent_position);
  v.field("parent_orientation", m.parent_orientation);
  v.field("child_position", m.child_position);
  v.field("child_orientation", m.child_orientation);
  v.field("pitch", m.pitch);
  v.field("limited", m.limited);
  v.field("lower_limit", m.lower_limit);
  v.field("upper_limit", m.upper_limit);
  v.field("friction", m.friction);
  v.field("load_friction", m.load_friction);
  v.field("damping", m.damping);
  v.field("stiffness", m.stiffness);
  v.field("rest", m.rest);
  v.field("detents", m.detents);
}

template <typename V, Is<NeighbourPlane> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("neighbour", m.neighbour);
  v.field("kind", m.kind);
  v.field("point", m.point);
  v.field("normal", m.normal);
  v.field("velocity", m.velocity);
  v.field("gap", m.gap);
  v.field("friction", m.friction);
  v.field("stiffness", m.stiffness);
  v.field("mass", m.mass);
}

template <typename V, Is<ObjectState> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("object_id", m.object);
  v.field("owner_user", m.owner_user);
  v.field("owner_side", m.owner_side);
  v.field("owned", m.owned);
  v.field("position", m.position);
  v.field("orientation", m.orientation);
  v.field("linear_velocity", m.linear_velocity);
  v.field("angular_velocity", m.angular_velocity);
  v.field("linear_acceleration", m.linear_acceleration);
  v.field("angular_acceleration", m.angular_acceleration);
  v.field("gravity", m.gravity);
  v.field("planes", m.planes);
}

template <typename V, Is<WorldObjects> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("world", m.world);
  v.field("stamp", m.stamp);
  v.field("step_period", m.step_period);
  v.field("objects", m.objects);
}

template <typename V, Is<ObjectTwin> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("object_id", m.object);
  v.field("owned", m.owned);
  v.field("position", m.position);
  v.field("orientation", m.orientation);
  v.field("linear_velocity", m.linear_velocity);
  v.field("angular_velocity", m.angular_velocity);
  v.field("contact_force", m.contact_force);
  v.field("contact_torque", m.contact_torque);
  v.field("coupling_force", m.coupling_force);
  v.field("coupling_torque", m.coupling_torque);
}

template <typename V, Is<ContactPatch> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("object_id", m.object);
  v.field("body", m.body);
  v.field("point", m.point);
  v.field("normal", m.normal);
  v.field("force", m.force);
  v.field("torque", m.torque);
  v.field("linear_velocity", m.linear_velocity);
  v.field("angular_velocity", m.angular_velocity);
  v.field("stiffness", m.stiffness);
  v.field("radius", m.radius);
  v.field("friction", m.friction);
}

template <typename V, Is<ObjectCoupling> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("hand", m.hand);
  v.field("stamp", m.stamp);
  v.field("mode", m.mode);
  v.field("step_period", m.step_period);
  v.field("twins", m.twins);
  v.field("patches", m.patches);
}

template <typename V, Is<BoneSample> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("tracked_position", m.tracked_position);
  v.field("tracked_orientation", m.tracked_orientation);
  v.field("intermediate_position", m.intermediate_position);
  v.field("intermediate_orientation", m.intermediate_orientation);
  v.field("simulated_position", m.simulated_position);
  v.field("simulated_orientation", m.simulated_orientation);
  v.field("coupling_force", m.coupling_force);
  v.field("coupling_torque", m.coupling_torque);
  v.field("contact_force", m.contact_force);
  v.field("contact_point", m.contact_point);
  v.field("contact_normal", m.contact_normal);
  v.field("contact_stiffness", m.contact_stiffness);
  v.field("contact_damping", m.contact_damping);
  v.field("contact_gap", m.contact_gap);
  v.field("contact_velocity", m.contact_velocity);
}

template <typename V, Is<BoneWrench> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("hand", m.hand);
  v.field("stamp", m.stamp);
  v.field("simulated_valid", m.simulated_valid);
  v.field("wrist_velocity", m.wrist_velocity);
  v.field("wrist_angular_velocity", m.wrist_angular_velocity);
  v.field("bones", m.bones);
}

template <typename V, Is<DeviceState> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("device", m.device);
  v.field("hand", m.hand);
  v.field("stamp", m.stamp);
  v.field("kind", m.kind);
  v.field("live", m.live);
  v.field("clamped", m.clamped);
  v.field("slewed", m.slewed);
  v.field("stale", m.stale);
  v.field("commands", m.commands);
}

template <typename V, Is<Message> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("stamp", m.stamp);
  v.field("id", m.id);
  v.field("module_name", m.module);
  v.field("name", m.key);
  v.field("value", m.value);
}

template <typename V, Is<MessageReply> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("stamp", m.stamp);
  v.field("id", m.id);
  v.field("module_name", m.module);
  v.field("result", m.result);
  v.field("text", m.text);
}

template <typename V, Is<NamedValue> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("name", m.name);
  v.field("value", m.value);
}

template <typename V, Is<RigChoice> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("what", m.what);
  v.field("choice", m.choice);
  v.field("running", m.running);
}

template <typename V, Is<RigChoices> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("module_name", m.module);
  v.field("stamp", m.stamp);
  v.field("choices", m.choices);
}

template <typename V, Is<SoftObjectDescription> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("object_id", m.object);
  v.field("stamp", m.stamp);
  v.field("owner", m.owner);
  v.field("name", m.name);
  v.field("file", m.file);
  v.field("node_count", m.node_count);
  v.field("mass", m.mass);
  v.field("removed", m.removed);
}

template <typename V, Is<SoftObjectState> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("object_id", m.object);
  v.field("stamp", m.stamp);
  v.field("owner", m.owner);
  v.field("owned", m.owned);
  v.field("centre", m.centre);
  v.field("linear_velocity", m.linear_velocity);
  v.field("hand_force", m.hand_force);
  v.field("contact_count", m.contact_count);
  v.field("inverted_elements", m.inverted_elements);
  v.field("nodes", m.nodes);
  v.field("velocities", m.velocities);
}

template <typename V, Is<HostClock> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("clock_id", m.clock_id);
  v.field("sent", m.sent);
  v.field("received", m.received);
  v.field("offset", m.offset);
  v.field("uncertainty", m.uncertainty);
  v.field("drift", m.drift);
}

template <typename V, Is<ClockBeacon> M>
constexpr void visit_fields(V&& v, M& m) {
  v.field("stamp", m.stamp);
  v.field("wall_offset", m.wall_offset);
  v.field("wall_uncertainty", m.wall_uncertainty);
  v.field("hosts", m.hosts);
}

template <typename V, Is<HandDescription> M>
constexpr void visit_fields(V&& v, M& m) {
  v.key("hand", m.hand);
  v.field("stamp", m.stamp);
  v.field("node_count", m.node_count);
  v.field("vertex_nodes", m.vertex_nodes);
  v.field("vertex_weights", m.vertex_weights);
  v.field("triangles", m.triangles);
}

}  // namespace softhand::bus
