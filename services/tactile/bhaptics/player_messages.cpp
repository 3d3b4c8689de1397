#include "tactile/bhaptics/player_messages.hpp"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>

namespace softhand {
namespace {

using Json = nlohmann::json;

std::string_view position_of(Side side) { return side == Side::left ? "GloveL" : "GloveR"; }
int number_of(Side side) { return side == Side::left ? 203 : 204; }

// The member, whose name may begin with a small letter.
const Json* member(const Json& json, std::string name) {
  auto found = json.find(name);
  name[0] = static_cast<char>(std::tolower(static_cast<unsigned char>(name[0])));
  if (found == json.end()) found = json.find(name);
  return found == json.end() ? nullptr : &*found;
}

PlayerRefusal read_report(std::string_view text, Side side, PlayerReport& out) {
  const Json json = Json::parse(text, nullptr, false);
  if (json.is_discarded() || !json.is_object()) return PlayerRefusal::json;
  if (const Json* positions = member(json, "ConnectedPositions")) {
    if (!positions->is_array()) return PlayerRefusal::content;
    for (const Json& position : *positions) {
      if (!position.is_string() && !position.is_number_integer()) return PlayerRefusal::content;
      out.is_connected = out.is_connected || position == position_of(side) || position == number_of(side);
    }
    out.has_positions = true;
  }
  const Json* status = member(json, "Status");
  if (status == nullptr) return PlayerRefusal::none;
  if (!status->is_object()) return PlayerRefusal::content;
  const auto motors = status->find(std::string(position_of(side)));
  if (motors == status->end()) return PlayerRefusal::none;
  if (!motors->is_array() || motors->size() < out.motors.size()) return PlayerRefusal::content;
  for (std::size_t i = 0; i < out.motors.size(); ++i) {
    const Json& value = (*motors)[i];
    if (!value.is_number_integer()) return PlayerRefusal::content;
    const bool is_intensity = value >= 0 && value <= 100;
    if (!is_intensity) return PlayerRefusal::range;
    out.motors[i] = value.get<std::uint8_t>();
  }
  out.has_motors = true;
  return PlayerRefusal::none;
}

}  // namespace

std::string player_target(const std::string& application) {
  return "/v2/feedbacks?app_id=" + application + "&app_name=" + application;
}

PlayerReport decode_player_report(std::string_view text, Side side) {
  return report_or_refusal<PlayerReport>([&](PlayerReport& out) { return read_report(text, side, out); });
}

PlayerFrame::PlayerFrame(Side side, std::span<const double> intensities, int milliseconds) {
  char* end = text_.data();
  const auto add = [&end](std::string_view text) { end = std::copy(text.begin(), text.end(), end); };
  const auto add_number = [&](long number) { end = std::to_chars(end, text_.data() + text_.size(), number).ptr; };
  const std::string_view position = position_of(side);
  add(R"({"Register":[],"Submit":[{"Type":"frame","Key":"softhand)");
  add(position);
  add(R"(","Frame":{"DurationMillis":)");
  add_number(milliseconds);
  add(R"(,"Position":")");
  add(position);
  add(R"(","Texture":0,"DotPoints":[)");
  bool is_first = true;
  for (std::size_t i = 0; i < std::min(intensities.size(), kGloveMotors); ++i) {
    const long intensity = std::lround(100 * std::clamp(intensities[i], 0.0, 1.0));
    if (intensity == 0) continue;
    add(is_first ? R"({"Index":)" : R"(,{"Index":)");
    add_number(static_cast<long>(i));
    add(R"(,"Intensity":)");
    add_number(intensity);
    add("}");
    is_first = false;
  }
  add(R"(],"PathPoints":[]}}]})");
  size_ = static_cast<std::size_t>(end - text_.data());
}

std::string_view player_turn_off(Side side) {
  return side == Side::left ? R"({"Register":[],"Submit":[{"Type":"turnOff","Key":"softhandGloveL"}]})"
                            : R"({"Register":[],"Submit":[{"Type":"turnOff","Key":"softhandGloveR"}]})";
}

}  // namespace softhand
