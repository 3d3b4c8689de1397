#include "viewer/frames.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <optional>

#include "device/answer.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"

namespace softhand::viewer {
namespace {

static_assert(std::endian::native == std::endian::little, "frames are written with the byte order of the memory");

constexpr std::uint32_t kMostWorlds = 65536;  // the instance of an object has 16 bits for the world

// Appends plain values after a header. Remembers whether a value was not finite.
class Packer {
 public:
  Packer(FrameType type, std::uint32_t instance, std::size_t expected_bytes) {
    bytes_.reserve(kHeaderBytes + expected_bytes + 3);
    put(kMagic);
    put(kVersion);
    put(static_cast<std::uint16_t>(type));
    put(std::uint32_t{0});
    put(instance);
  }

  template <typename T>
  void put(T value) {
    static_assert(std::is_arithmetic_v<T>);
    if constexpr (std::is_floating_point_v<T>) finite_ = finite_ && std::isfinite(value);
    const std::size_t at = bytes_.size();
    bytes_.resize(at + sizeof value);
    std::memcpy(bytes_.data() + at, &value, sizeof value);
  }
  void integer(std::uint32_t value) { put(value); }
  void real(double value) { put(static_cast<float>(value)); }
  template <typename T, std::size_t n>
  void reals(const std::array<T, n>& values) {
    for (const T value : values) real(value);
  }
  template <std::size_t n>
  void text(const std::array<char, n>& field) {
    static_assert(n % 4 == 0);
    const std::string_view used = get_text(field);
    bytes_.insert(bytes_.end(), used.begin(), used.end());
    bytes_.resize(bytes_.size() + n - used.size());
  }
  // Times are float64 seconds. The resolution is a microsecond even after 200 years of uptime.
  void stamp(const Stamp& stamp) {
    put(static_cast<double>(stamp.sample_time) * 1e-9);
    put(static_cast<double>(stamp.publish_time) * 1e-9);
    put(static_cast<double>(stamp.sequence));
  }

  Frame finish() {
    if (!finite_) return nullptr;
    bytes_.resize((bytes_.size() + 3) / 4 * 4);
    const auto payload = static_cast<std::uint32_t>(bytes_.size() - kHeaderBytes);
    std::memcpy(bytes_.data() + 8, &payload, sizeof payload);
    return std::make_shared<const std::vector<std::uint8_t>>(std::move(bytes_));
  }

 private:
  std::vector<std::uint8_t> bytes_;
  bool finite_ = true;
};

// The fields of a status by type, each with its name in the IDL. Stamp and module are not among them.
struct StatusFields {
  template <typename T>
  struct Named {
    std::array<char, 32> name;
    T value;
  };
  std::vector<Named<double>> numbers;
  std::vector<Named<std::array<char, 128>>> texts;
  std::vector<Named<std::vector<NamedValue>>> lists;

  void key(const char*, const auto&) {}
  void field(const char*, const Stamp&) {}
  template <typename T>
  requires std::is_arithmetic_v<T>
  void field(const char* name, const T& value) { add(numbers, name).value = static_cast<double>(value); }
  template <std::size_t n>
  void field(const char* name, const std::array<char, n>& value) {
    static_assert(n <= sizeof texts[0].value);
    set_text(add(texts, name).value, get_text(value));
  }
  template <std::size_t n>
  void field(const char* name, const BoundedVector<NamedValue, n>& value) {
    add(lists, name).value.assign(value.begin(), value.end());
  }

 private:
  template <typename T>
  static Named<T>& add(std::vector<Named<T>>& to, const char* name) {
    Named<T>& item = to.emplace_back();
    set_text(item.name, name);
    return item;
  }
};

// A count and a zero, and then `put` of each item after its name.
template <typename Items>
void put_named(Packer& out, const Items& items, auto put) {
  out.integer(static_cast<std::uint32_t>(items.size()));
  out.integer(0);
  for (const auto& item : items) {
    out.text(item.name);
    put(item.value);
  }
}

// Reads a value from a page's frame. Empty if the bytes end too early.
template <typename T>
std::optional<T> read(std::span<const std::uint8_t> bytes, std::size_t at) {
  if (at + sizeof(T) > bytes.size()) return std::nullopt;
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

// A text of a message: printable ASCII up to the terminating zero.
bool read_text(std::span<const std::uint8_t> bytes, ShortText& out) {
  std::memcpy(out.data(), bytes.data(), out.size());
  const std::string_view text = get_text(out);
  return text.size() < out.size() && std::all_of(text.begin(), text.end(), [](char c) { return c >= ' ' && c <= '~'; });
}

// Appends a mesh whose vertices are weighted means of nodes. Returns false if an index is out of range.
template <typename VertexNodes, typename Weights, typename Triangles>
bool put_skin(Packer& out, std::uint32_t node_count, std::span<const Vector3> rest_nodes, const Weights& vertex_weights,
              const VertexNodes& vertex_nodes, const Triangles& triangles) {
  out.integer(node_count);
  out.integer(static_cast<std::uint32_t>(vertex_nodes.size()));
  out.integer(static_cast<std::uint32_t>(triangles.size()));
  out.integer(static_cast<std::uint32_t>(rest_nodes.size()));
  for (const Vector3& node : rest_nodes) out.reals(to_wire(node));
  for (const auto& weights : vertex_weights) out.reals(weights);
  const auto put_indices = [&out](const auto& indices, std::size_t end) {
    for (const std::uint32_t index : indices) {
      if (index >= end) return false;
      out.put(static_cast<std::uint16_t>(index));
    }
    return true;
  };
  return std::all_of(vertex_nodes.begin(), vertex_nodes.end(),
                     [&](const auto& nodes) { return put_indices(nodes, node_count); }) &&
         std::all_of(triangles.begin(), triangles.end(),
                     [&](const auto& triangle) { return put_indices(triangle, vertex_nodes.size()); });
}

template <typename Nodes>
Frame encode_nodes(FrameType type, std::uint32_t instance, const Stamp& stamp, const Vec3& origin, const Nodes& nodes,
                   bool quantised) {
  float largest = 1e-6f;
  for (const auto& node : nodes) {
    for (const float x : node) {
      if (!std::isfinite(x)) return nullptr;
      largest = std::max(largest, std::abs(x));
    }
  }
  Packer out(type, instance, 64 + 12 * nodes.size());
  out.stamp(stamp);
  out.reals(origin);
  out.integer(nodes.count);
  out.integer(quantised ? 1 : 0);
  const float step = quantised ? largest / 32767.0f : 1.0f;
  out.real(step);
  for (const auto& node : nodes) {
    if (!quantised) {
      out.reals(node);
      continue;
    }
    for (const float x : node) out.put(static_cast<std::int16_t>(std::lround(x / step)));
  }
  return out.finish();
}

bool is_soft_object(std::uint32_t id) { return id >= kFirstSoftObject && id - kFirstSoftObject < kMaxSoftObjects; }

}  // namespace

Frame encode(const HandDescription& description, std::span<const Vector3> rest_nodes) {
  if (description.vertex_weights.size() != description.vertex_nodes.size()) return nullptr;
  Packer out(FrameType::hand_description, instance_of(description.hand),
             16 + 12 * rest_nodes.size() + 24 * description.vertex_nodes.size() + 6 * description.triangles.size());
  const bool fits = put_skin(out, description.node_count, rest_nodes, description.vertex_weights,
                             description.vertex_nodes, description.triangles);
  return fits ? out.finish() : nullptr;
}

Frame encode(const SoftObjectDescription& description, const SoftBody* body) {
  if (!is_soft_object(description.object)) return nullptr;
  const std::uint32_t instance = description.object - kFirstSoftObject;
  std::vector<std::array<std::uint32_t, 4>> nodes;
  std::vector<std::array<float, 4>> weights;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::span<const Vector3> rest;
  if (description.removed == 0) {
    if (body == nullptr || body->nodes.size() != description.node_count) return nullptr;
    rest = body->nodes;
    // A vertex is a node of the surface.
    constexpr std::uint32_t kNone = ~0u;
    std::vector<std::uint32_t> vertex_of(body->nodes.size(), kNone);
    for (const auto& corners : boundary(body->tetrahedra)) {
      auto& triangle = triangles.emplace_back();
      for (std::size_t k = 0; k < 3; ++k) {
        std::uint32_t& vertex = vertex_of[static_cast<std::size_t>(corners[k])];
        if (vertex == kNone) {
          vertex = static_cast<std::uint32_t>(nodes.size());
          const auto node = static_cast<std::uint32_t>(corners[k]);
          nodes.push_back({node, node, node, node});
          weights.push_back({1, 0, 0, 0});
        }
        triangle[k] = vertex;
      }
    }
  }
  Packer out(FrameType::soft_object_description, instance,
             16 + 12 * rest.size() + 24 * nodes.size() + 6 * triangles.size());
  const bool fits = put_skin(out, static_cast<std::uint32_t>(rest.size()), rest, weights, nodes, triangles);
  return fits ? out.finish() : nullptr;
}

Frame encode(const TissueSurface& surface, bool quantised) {
  return encode_nodes(FrameType::nodes, instance_of(surface.hand), surface.stamp, surface.wrist_position, surface.nodes,
                      quantised);
}

Frame encode(const SoftObjectState& state, bool quantised) {
  if (!is_soft_object(state.object)) return nullptr;
  return encode_nodes(FrameType::soft_object_nodes, state.object - kFirstSoftObject, state.stamp, state.centre,
                      state.nodes, quantised);
}

Frame encode(FrameType which, const Skeleton& skeleton) {
  Packer out(which, instance_of(skeleton.hand), 32 + 36 * skeleton.joints.size());
  out.stamp(skeleton.stamp);
  out.integer(skeleton.source);
  out.integer(skeleton.frame);
  for (const JointSample& joint : skeleton.joints) {
    // An invalid joint may have any values. The page ignores them.
    const bool valid = (joint.flags & kJointValid) != 0;
    out.reals(valid ? joint.position : Vec3{});
    out.reals(valid ? joint.orientation : Vec4{0, 0, 0, 1});
    out.real(valid ? joint.radius : 0);
    out.integer(joint.flags);
  }
  return out.finish();
}

Frame encode(const Contacts& contacts) {
  Packer out(FrameType::contacts, instance_of(contacts.hand), 416 + 64 * contacts.contacts.size());
  out.stamp(contacts.stamp);
  for (const FingerContact& finger : contacts.fingers) {
    out.reals(finger.force);
    out.reals(finger.centre);
    out.reals(finger.normal);
    out.real(finger.area);
    out.real(finger.slip_speed);
    out.integer(finger.object);
    out.integer(finger.contact_count);
  }
  out.integer(contacts.contacts.count);
  out.integer(contacts.dropped);
  for (const Contact& contact : contacts.contacts) {
    out.integer(contact.node);
    out.integer(contact.object);
    out.integer(contact.finger);
    out.integer(contact.flags);
    out.reals(contact.point);
    out.reals(contact.normal);
    out.reals(contact.force);
    out.real(contact.penetration);
    out.real(contact.area);
    out.real(contact.slip_speed);
  }
  return out.finish();
}

Frame encode(const WorldObjects& objects) {
  if (objects.world >= kMostWorlds) return nullptr;
  Packer out(FrameType::objects, objects.world, 32 + 52 * objects.objects.size());
  out.stamp(objects.stamp);
  out.integer(objects.objects.count);
  out.integer(0);
  for (const ObjectState& object : objects.objects) {
    out.integer(object.object);
    out.integer(object.owned);
    out.integer(2 * object.owner_user + object.owner_side);
    out.reals(object.position);
    out.reals(object.orientation);
    out.reals(object.linear_velocity);
  }
  return out.finish();
}

Frame encode(const ObjectDescription& description, const TriangleMesh* mesh) {
  if (description.world >= kMostWorlds || description.object >= kFirstSoftObject) return nullptr;
  const auto& files = description.shape.file;
  const bool has_mesh = !files.empty() && description.removed == 0;
  if (has_mesh && mesh == nullptr) return nullptr;
  const std::size_t vertices = has_mesh ? mesh->vertices.size() : description.shape.vertices.size();
  const std::size_t triangles = has_mesh ? mesh->triangles.size() : 0;
  Packer out(FrameType::object_description, description.world * kFirstSoftObject + description.object,
             116 + 12 * (vertices + triangles));
  out.integer(description.is_static);
  out.integer(description.removed);
  out.integer(description.shape.kind);
  out.integer(static_cast<std::uint32_t>(vertices));
  out.real(description.mass);
  out.real(description.friction);
  out.reals(description.shape.size);
  out.text(description.name);
  if (!has_mesh) {
    for (const Vec3& vertex : description.shape.vertices) out.reals(vertex);
  } else {
    const Pose to_body = to_pose(files[0].position, files[0].orientation);
    for (const Vector3& vertex : mesh->vertices) out.reals(to_wire(to_body * vertex));
    out.integer(static_cast<std::uint32_t>(triangles));
    for (const auto& triangle : mesh->triangles)
      for (const auto corner : triangle) out.integer(static_cast<std::uint32_t>(corner));
  }
  return out.finish();
}

Frame encode(const BoneWrench& wrench) {
  Packer out(FrameType::bone_wrench, instance_of(wrench.hand), 32 + 60 * wrench.bones.size());
  out.stamp(wrench.stamp);
  out.integer(wrench.simulated_valid);
  out.integer(static_cast<std::uint32_t>(wrench.bones.size()));
  for (const BoneSample& bone : wrench.bones) {
    out.reals(bone.simulated_position);
    out.reals(bone.intermediate_position);
    out.reals(bone.coupling_force);
    out.reals(bone.coupling_torque);
    out.reals(bone.contact_force);
  }
  return out.finish();
}

Frame encode(const LoopStatus& status, std::uint32_t slot) {
  StatusFields fields;
  visit_fields(fields, status);
  std::size_t values = fields.numbers.size();
  for (const auto& list : fields.lists) values += list.value.size();
  Packer out(FrameType::loop_status, slot, 112 + 160 * fields.texts.size() + 40 * (fields.lists.size() + values));
  const auto number = [&out](double value) { out.put(value); };
  out.stamp(status.stamp);
  out.text(status.module);
  put_named(out, fields.numbers, number);
  put_named(out, fields.texts, [&out](const auto& value) { out.text(value); });
  put_named(out, fields.lists, [&](const auto& values_of_list) { put_named(out, values_of_list, number); });
  return out.finish();
}

Frame encode(const MessageReply& reply, std::uint32_t slot) {
  Packer out(FrameType::message_reply, slot, 208);
  out.put(reply.id);
  out.integer(reply.result);
  out.integer(0);
  out.text(reply.module);
  out.text(reply.text);
  return out.finish();
}

Frame encode(const RigChoices& choices, std::uint32_t slot) {
  Packer out(FrameType::rig_choices, slot, 72 + 136 * choices.choices.size());
  out.text(choices.module);
  out.integer(static_cast<std::uint32_t>(choices.choices.size()));
  out.integer(0);
  for (const RigChoice& each : choices.choices) {
    out.text(each.what);
    out.text(each.choice);
    out.integer(each.running);
    out.integer(0);
  }
  return out.finish();
}

std::optional<Prompt> read_prompt(std::string_view value) {
  const std::size_t space = value.find(' ');
  const std::optional<double> seconds = parse_number(value.substr(0, space));
  if (space == std::string_view::npos || !seconds || *seconds < 0 || *seconds > 600) return std::nullopt;
  Prompt prompt;
  prompt.seconds = *seconds;
  set_text(prompt.text, value.substr(space + 1));
  return prompt;
}

Frame encode(const Prompt& prompt) {
  Packer out(FrameType::prompt, 0, 68);
  out.real(prompt.seconds);
  out.text(prompt.text);
  return out.finish();
}

Frame encode(const GatewayState& state) {
  Packer out(FrameType::gateway, 0, 56 + 8 * state.refused.size());
  out.put(static_cast<double>(state.clock) * 1e-9);
  out.put(state.epoch);
  out.integer(state.pages);
  out.integer(state.rate_hz);
  for (const std::uint64_t value :
       {state.bytes_sent, state.frames_sent, state.frames_passed_over, state.refused_content})
    out.put(static_cast<double>(value));
  for (const std::uint64_t value : state.refused) out.put(static_cast<double>(value));
  return out.finish();
}

void draw_held(WorldObjects& objects, const ObjectCoupling& coupling) {
  constexpr double kStale = 0.1;  // s
  if (objects.world != kRigWorld) return;
  const std::optional<double> age = age_of(coupling.stamp.sample_time, objects.stamp.sample_time);
  if (!age || *age > kStale) return;
  for (ObjectState& object : objects.objects) {
    if (object.owned == 0 || HandKey{object.owner_user, object.owner_side} != coupling.hand) continue;
    for (const ObjectTwin& twin : coupling.twins) {
      if (twin.object != object.object || twin.owned == 0) continue;
      object.position = twin.position;
      object.orientation = twin.orientation;
    }
  }
}

Refusal decode(std::span<const std::uint8_t> bytes, PageRequest& out) {
  if (bytes.size() < kHeaderBytes) return Refusal::size;
  if (read<std::uint32_t>(bytes, 0) != kMagic) return Refusal::magic;
  if (read<std::uint16_t>(bytes, 4) != kVersion) return Refusal::version;
  if (read<std::uint32_t>(bytes, 8) != bytes.size() - kHeaderBytes) return Refusal::size;
  const auto payload = bytes.subspan(kHeaderBytes);
  switch (static_cast<FrameType>(*read<std::uint16_t>(bytes, 6))) {
    case FrameType::show: {
      if (payload.size() != 8) return Refusal::size;
      const ShowRequest show{*read<std::uint32_t>(payload, 0), *read<float>(payload, 4)};
      if ((show.types & ~kShowable) != 0 || !std::isfinite(show.rate_hz) || show.rate_hz < 0 || show.rate_hz > 1000)
        return Refusal::content;
      out = show;
      return Refusal::none;
    }
    case FrameType::message: {
      constexpr std::size_t n = sizeof(ShortText);
      if (payload.size() != 8 + 3 * n) return Refusal::size;
      Message message;
      message.id = *read<std::uint64_t>(payload, 0);
      if (!read_text(payload.subspan(8, n), message.module) || !read_text(payload.subspan(8 + n, n), message.key) ||
          !read_text(payload.subspan(8 + 2 * n, n), message.value) || message.module[0] == '\0' ||
          message.key[0] == '\0') {
        return Refusal::content;
      }
      out = message;
      return Refusal::none;
    }
    default:
      return Refusal::type;
  }
}

}  // namespace softhand::viewer
