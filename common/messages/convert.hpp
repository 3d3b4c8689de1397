// Conversion between the wire structs and mathematical types. Every loop checks `all_finite` before it uses or
// publishes a message.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <string_view>

#include "math/types.hpp"
#include "messages/messages.hpp"

namespace softhand {

inline Vector3 to_vector(const Vec3& v) { return {v[0], v[1], v[2]}; }
inline Vec3 to_wire(const Vector3& v) { return {v.x(), v.y(), v.z()}; }
inline Vector3 to_vector(const std::array<float, 3>& v) { return {v[0], v[1], v[2]}; }
inline std::array<float, 3> to_floats(const Vector3& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}
inline Quaternion to_quaternion(const Vec4& q) { return {q[3], q[0], q[1], q[2]}; }
inline Vec4 to_wire(const Quaternion& q) { return {q.x(), q.y(), q.z(), q.w()}; }
inline Pose to_pose(const Vec3& position, const Vec4& orientation) {
  return {to_vector(position), to_quaternion(orientation)};
}

/// The law that a description states. It is not checked (`check_joint_law`).
inline JointLaw to_law(const ObjectJointDescription& joint) {
  JointLaw law;
  law.kind = static_cast<ObjectJointKind>(joint.kind);
  law.pitch = joint.pitch;
  if (joint.limited != 0) {
    law.minimum = joint.lower_limit;
    law.maximum = joint.upper_limit;
  }
  law.friction = joint.friction;
  law.load_friction = joint.load_friction;
  law.damping = joint.damping;
  law.stiffness = joint.stiffness;
  law.rest = joint.rest;
  for (const JointDetent& detent : joint.detents)
    law.detents[law.detent_count++] = {detent.at, detent.depth, detent.width, detent.period};
  return law;
}
/// Writes the law into a description.
inline void set_law(ObjectJointDescription& joint, const JointLaw& law) {
  joint.kind = static_cast<std::uint32_t>(law.kind);
  joint.pitch = law.pitch;
  joint.limited = law.limited() ? 1 : 0;
  joint.lower_limit = law.limited() ? law.minimum : 0;
  joint.upper_limit = law.limited() ? law.maximum : 0;
  joint.friction = law.friction;
  joint.load_friction = law.load_friction;
  joint.damping = law.damping;
  joint.stiffness = law.stiffness;
  joint.rest = law.rest;
  joint.detents.clear();
  for (const Detent& well : law.wells()) joint.detents.push_back({well.at, well.depth, well.width, well.period});
}

template <std::size_t n>
bool all_finite(const std::array<double, n>& values) {
  return std::all_of(values.begin(), values.end(), [](double x) { return std::isfinite(x); });
}

/// Pose of a joint sample. The caller must check the flags first.
inline Pose to_pose(const JointSample& joint) { return to_pose(joint.position, joint.orientation); }

/// Copies `text` into a zero-terminated field and truncates it to the field's size.
template <std::size_t n>
void set_text(std::array<char, n>& field, std::string_view text) {
  const std::size_t length = std::min(text.size(), n - 1);
  std::memcpy(field.data(), text.data(), length);
  std::fill(field.begin() + static_cast<std::ptrdiff_t>(length), field.end(), '\0');
}
/// The text up to its terminating zero, or the whole field if there is no zero.
template <std::size_t n>
std::string_view get_text(const std::array<char, n>& field) {
  return {field.data(), static_cast<std::size_t>(std::find(field.begin(), field.end(), '\0') - field.begin())};
}

/// Appends a named value to a list of a status. If the list is full, the value is dropped.
template <std::size_t capacity>
void add_named(BoundedVector<NamedValue, capacity>& list, std::string_view name, double value) {
  NamedValue item;
  set_text(item.name, name);
  item.value = value;
  list.push_back(item);
}
/// Empty if the status has no counter of this name.
inline std::optional<double> find_counter(const LoopStatus& status, std::string_view name) {
  for (const NamedValue& counter : status.counters)
    if (get_text(counter.name) == name) return counter.value;
  return std::nullopt;
}

inline void add_counter(LoopStatus& status, std::string_view name, double value) {
  add_named(status.counters, name, value);
}
/// Adds to a value that is in the list, or appends it.
inline void add_to_counter(LoopStatus& status, std::string_view name, double value) {
  for (NamedValue& counter : status.counters) {
    if (get_text(counter.name) != name) continue;
    counter.value += value;
    return;
  }
  add_counter(status, name, value);
}

/// The same numbers and the same file.
inline bool is_same(const Shape& a, const Shape& b) {
  const auto is_same_file = [](const ShapeFile& x, const ShapeFile& y) {
    return get_text(x.name) == get_text(y.name) && get_text(x.sha256) == get_text(y.sha256) && x.link == y.link &&
           x.position == y.position && x.orientation == y.orientation;
  };
  return a.kind == b.kind && a.size == b.size &&
         std::equal(a.vertices.begin(), a.vertices.end(), b.vertices.begin(), b.vertices.end()) &&
         std::equal(a.file.begin(), a.file.end(), b.file.begin(), b.file.end(), is_same_file);
}

}  // namespace softhand
