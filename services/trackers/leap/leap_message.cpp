#include "trackers/leap/leap_message.hpp"

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "messages/convert.hpp"

namespace softhand {
namespace {

using Json = nlohmann::json;

constexpr double kMetresPerMillimetre = 1e-3;
constexpr std::int64_t kLatest = 4'000'000'000'000'000;  // us, more than a century

bool read_vector(const Json& json, Vec3& out) {
  if (!json.is_array() || json.size() != out.size()) return false;
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (!json[i].is_number()) return false;
    out[i] = json[i].get<double>();
  }
  return true;
}
bool read_vector(const Json& object, const char* key, Vec3& out) {
  const auto found = object.find(key);
  return found != object.end() && read_vector(*found, out);
}
bool read_point(const Json& object, const char* key, Vec3& out) {
  if (!read_vector(object, key, out)) return false;
  for (double& value : out) value *= kMetresPerMillimetre;
  return true;
}

struct NumberedHand {
  std::int64_t id = 0;
  LeapHand hand;
  std::array<bool, kFingerCount> has_finger{};
};

bool read_hand(const Json& json, NumberedHand& out) {
  if (!json.is_object()) return false;
  const auto id = json.find("id"), type = json.find("type");
  if (id == json.end() || !id->is_number_integer() || type == json.end()) return false;
  if (*type != "left" && *type != "right") return false;
  out.id = id->get<std::int64_t>();
  out.hand.side = *type == "left" ? 0 : 1;
  if (const auto confidence = json.find("confidence"); confidence != json.end()) {
    if (!confidence->is_number()) return false;
    out.hand.confidence = confidence->get<double>();
  }
  out.hand.has_bones = read_point(json, "wrist", out.hand.wrist);
  return read_point(json, "palmPosition", out.hand.palm) && read_vector(json, "direction", out.hand.direction) &&
         read_vector(json, "palmNormal", out.hand.normal);
}

bool read_finger(const Json& json, std::array<NumberedHand, 2>& hands, std::size_t count) {
  if (!json.is_object()) return false;
  if (const auto tool = json.find("tool"); tool != json.end() && *tool == true) return true;
  const auto id = json.find("handId"), type = json.find("type");
  if (id == json.end() || !id->is_number_integer() || type == json.end() || !type->is_number_integer()) return false;
  const auto finger = type->get<std::int64_t>();
  if (finger < 0 || finger >= kFingerCount) return false;
  for (std::size_t i = 0; i < count; ++i) {
    NumberedHand& hand = hands[i];
    if (hand.id != id->get<std::int64_t>()) continue;
    const auto index = static_cast<std::size_t>(finger);
    auto& bones = hand.hand.bones[index];
    if (hand.has_finger[index]) return false;
    hand.has_finger[index] = true;
    Vec3 mcp, pip, dip, tip, carp{};
    if (!read_point(json, "mcpPosition", mcp) || !read_point(json, "pipPosition", pip) ||
        !read_point(json, "dipPosition", dip) || !read_point(json, "tipPosition", tip))
      return false;
    // The tip of the bone is not that of the skin.
    if (json.contains("btipPosition") && !read_point(json, "btipPosition", tip)) return false;
    const bool has_carp = read_point(json, "carpPosition", carp);
    const std::array<Vec3, 5> joints{has_carp ? carp : mcp, mcp, pip, dip, tip};
    for (std::size_t k = 0; k < bones.size(); ++k) bones[k].from = joints[k], bones[k].to = joints[k + 1];
    const auto bases = json.find("bases");
    if (!has_carp || bases == json.end()) {
      hand.hand.has_bones = false;
      return true;
    }
    if (!bases->is_array() || bases->size() != bones.size()) return false;
    // Rows are axes. The second one is dorsal on both hands; the first one of a left hand has either sign.
    for (std::size_t k = 0; k < bones.size(); ++k) {
      const Json& basis = (*bases)[k];
      if (!basis.is_array() || basis.size() != 3 || !read_vector(basis[1], bones[k].dorsal)) return false;
    }
    return true;
  }
  return true;  // of a hand that the frame lacks
}

LeapRefusal read_frame(const Json& json, LeapFrame& out) {
  const auto timestamp = json.find("timestamp"), hands = json.find("hands"), fingers = json.find("pointables");
  if (timestamp == json.end() || !timestamp->is_number_integer() || !hands->is_array() || fingers == json.end() ||
      !fingers->is_array())
    return LeapRefusal::content;
  const auto microseconds = timestamp->get<std::int64_t>();
  if (microseconds < 0 || microseconds > kLatest) return LeapRefusal::content;
  out.time = microseconds * 1000;
  std::array<NumberedHand, 2> seen;
  std::size_t count = 0;
  for (const Json& each : *hands) {
    NumberedHand hand;
    if (!read_hand(each, hand)) return LeapRefusal::content;
    if (count < seen.size()) seen[count++] = hand;
  }
  for (const Json& each : *fingers)
    if (!read_finger(each, seen, count)) return LeapRefusal::content;
  for (std::size_t i = 0; i < count; ++i) {
    for (const bool has : seen[i].has_finger)
      if (!has) return LeapRefusal::content;
    if (!is_plausible(seen[i].hand)) return LeapRefusal::content;
    add_hand(out, seen[i].hand);
  }
  return LeapRefusal::none;
}

}  // namespace

std::vector<std::string> leap_greeting(bool is_on_headset) {
  return {R"({"background":true})", R"({"focused":true})",
          is_on_headset ? R"({"optimizeHMD":true})" : R"({"optimizeHMD":false})"};
}

bool read_leap_message(std::string_view text, LeapFrame& out) {
  out = LeapFrame{};
  const Json json = Json::parse(text, nullptr, false);
  if (json.is_discarded() || !json.is_object()) {
    out.refusal = LeapRefusal::json;
    return true;
  }
  if (!json.contains("hands")) {
    // The greeting of the service and its events.
    if (json.contains("version") || json.contains("serviceVersion") || json.contains("event")) return false;
    out.refusal = LeapRefusal::content;
    return true;
  }
  const LeapRefusal refusal = read_frame(json, out);
  if (refusal != LeapRefusal::none) {
    out = LeapFrame{};
    out.refusal = refusal;
  }
  return true;
}

Translate translate_leap_messages() {
  return [frame = std::make_shared<LeapFrame>()](const Arrival& message) {
    return read_leap_message(message.bytes, *frame) ? frame->bytes() : std::string_view{};
  };
}

}  // namespace softhand
