#include "haptics/haply/haply_messages.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

namespace softhand {
namespace {

using Json = nlohmann::json;

constexpr double kFarthest = 1;    // m from the base; the workspace of an Inverse3 is 0.2 m wide
constexpr double kFastest = 10;    // m/s
constexpr double kStrongest = 50;  // N

const Json* member(const Json& json, const char* key) {
  if (!json.is_object()) return nullptr;
  const auto found = json.find(key);
  return found == json.end() ? nullptr : &*found;
}

// The vector in our axes. Returns nothing for another shape.
std::optional<Vec3> vector_in(const Json* json) {
  if (json == nullptr) return std::nullopt;
  std::array<double, 3> values;
  constexpr std::array<const char*, 3> keys{"x", "y", "z"};
  for (std::size_t i = 0; i < 3; ++i) {
    const Json* value = member(*json, keys[i]);
    if (value == nullptr || !value->is_number()) return std::nullopt;
    values[i] = value->get<double>();
  }
  return Vec3{values[0], values[2], -values[1]};
}

bool is_within(const Vec3& vector, double most) {
  return std::all_of(vector.begin(), vector.end(), [most](double value) { return std::abs(value) <= most; });
}

// An id becomes part of our messages, so it must have no quotes.
bool read_id(const Json* json, HaplyId& out) {
  if (json == nullptr || !json->is_string()) return false;
  const auto& text = json->get_ref<const std::string&>();
  const auto is_plain = [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '-' || c == '_';
  };
  if (text.empty() || text.size() >= out.size() || !std::all_of(text.begin(), text.end(), is_plain)) return false;
  out = {};
  std::copy(text.begin(), text.end(), out.begin());
  return true;
}

HaplyRefusal read_state(const Json& device, HaplyReport& out) {
  const Json* state = member(device, "state");
  const auto position = vector_in(state == nullptr ? nullptr : member(*state, "cursor_position"));
  if (!position) return HaplyRefusal::content;
  out.position = *position;
  if (!is_within(out.position, kFarthest)) return HaplyRefusal::range;
  const auto read = [&](const char* key, Vec3& to, bool& has, double most) {
    const Json* json = member(*state, key);
    if (json == nullptr) return HaplyRefusal::none;
    const auto vector = vector_in(json);
    if (!vector) return HaplyRefusal::content;
    if (!is_within(*vector, most)) return HaplyRefusal::range;
    to = *vector;
    has = true;
    return HaplyRefusal::none;
  };
  if (const auto refusal = read("cursor_velocity", out.velocity, out.has_velocity, kFastest);
      refusal != HaplyRefusal::none)
    return refusal;
  return read("current_cursor_force", out.force, out.has_force, kStrongest);
}

HaplyRefusal read_report(std::string_view text, std::string_view device_id, HaplyReport& out) {
  const Json json = Json::parse(text, nullptr, false);
  if (json.is_discarded() || !json.is_object()) return HaplyRefusal::json;
  out.has_session = member(json, "session_id") != nullptr;
  const Json* devices = member(json, "inverse3");
  if (devices == nullptr) return HaplyRefusal::none;
  if (!devices->is_array()) return HaplyRefusal::content;
  out.has_list = true;
  for (const Json& device : *devices) {
    HaplyId id;
    if (!read_id(member(device, "device_id"), id)) return HaplyRefusal::content;
    out.is_inventory = out.is_inventory || member(device, "config") != nullptr;
    if (out.has_device || (!device_id.empty() && device_id != id.data())) continue;
    out.device_id = id;
    if (const auto refusal = read_state(device, out); refusal != HaplyRefusal::none) return refusal;
    out.has_device = true;
  }
  return HaplyRefusal::none;
}

HaplyRefusal read_event(std::string_view text, HaplyEvent& out) {
  const Json json = Json::parse(text, nullptr, false);
  if (json.is_discarded() || !json.is_object()) return HaplyRefusal::json;
  const Json* name = member(json, "name");
  if (name == nullptr || !name->is_string()) return HaplyRefusal::content;
  const Json* data = member(json, "data");
  const Json* id = data == nullptr ? nullptr : member(*data, "device_id");
  if (id != nullptr && !read_id(id, out.device_id)) return HaplyRefusal::content;
  if (*name == "device-disconnected") out.kind = HaplyEventKind::stop;
  if (*name == "device-safety-triggered") {
    const Json* type = data == nullptr ? nullptr : member(*data, "safety_type");
    if (type == nullptr || !type->is_string()) return HaplyRefusal::content;
    if (*type == "ebrake_triggered") out.kind = HaplyEventKind::brake;
    if (*type == "ebrake_released") out.kind = HaplyEventKind::release;
    if (*type == "stall_detected" || *type == "stability_ceiling") out.kind = HaplyEventKind::stop;
  }
  return HaplyRefusal::none;
}

}  // namespace

HaplyReport decode_haply_report(std::string_view text, std::string_view device_id) {
  return report_or_refusal<HaplyReport>([&](HaplyReport& out) { return read_report(text, device_id, out); });
}

HaplyEvent decode_haply_event(std::string_view text) {
  return report_or_refusal<HaplyEvent>([&](HaplyEvent& out) { return read_event(text, out); });
}

HaplyCommand::HaplyCommand(const HaplyId& device_id, HaplyForceKey key, const Vector3& force) {
  char* end = text_.data();
  const auto add = [&end](std::string_view text) { end = std::copy(text.begin(), text.end(), end); };
  const auto add_number = [&](std::string_view axis, double value) {
    add(axis);
    end = std::to_chars(end, text_.data() + text_.size(), value, std::chars_format::fixed, 6).ptr;
  };
  add(R"({"inverse3":[{"device_id":")");
  add(device_id.data());
  add(R"(","commands":{"set_cursor_force":{")");
  add(key == HaplyForceKey::vector ? "vector" : "values");
  add(R"(":{)");
  // Adding 0 makes 0 of -0.
  add_number(R"("x":)", force.x() + 0);
  add_number(R"(,"y":)", -force.z() + 0);
  add_number(R"(,"z":)", force.y() + 0);
  add("}}}}]}");
  size_ = static_cast<std::size_t>(end - text_.data());
}

}  // namespace softhand
