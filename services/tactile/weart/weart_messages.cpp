#include "tactile/weart/weart_messages.hpp"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

namespace softhand {
namespace {

using Json = nlohmann::json;

constexpr std::string_view name_of(Side side) { return side == Side::left ? "LEFT" : "RIGHT"; }

// Takes the text before the next colon.
std::string_view take_field(std::string_view& text) {
  const std::size_t end = text.find(':');
  const std::string_view field = text.substr(0, end);
  text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  return field;
}

std::optional<int> parse_integer(std::string_view text) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

void set_curl(FingerCurl& finger, double closure) {
  finger.valid = true;
  finger.curl.fill(closure);
}
double splay_of(double abduction) { return 2 * abduction - 1; }

WeartRefusal read_tracking(std::string_view values, Side side, WeartReport& out) {
  if (take_field(values) != "TrackType1") return WeartRefusal::content;  // we asked for this type
  constexpr std::size_t count = 8;
  std::array<double, count> numbers;
  for (double& number : numbers) {
    const auto value = parse_integer(take_field(values));
    if (!value) return WeartRefusal::syntax;
    if (*value < 0 || *value > 255) return WeartRefusal::range;
    number = *value / 255.0;
  }
  if (!values.empty()) return WeartRefusal::syntax;
  const double* hand = numbers.data() + (side == Side::right ? 0 : count / 2);
  set_curl(out.fingers[1], hand[0]);
  set_curl(out.fingers[0], hand[1]);
  out.fingers[0].splay = splay_of(hand[2]);
  set_curl(out.fingers[2], hand[3]);
  out.kind = WeartKind::tracking;
  return WeartRefusal::none;
}

WeartRefusal read_calibration(std::string_view values, Side side, WeartKind kind, int most, WeartReport& out) {
  const auto hand = parse_integer(take_field(values)), value = parse_integer(take_field(values));
  if (!hand || !value || !values.empty()) return WeartRefusal::syntax;
  if (*hand < 0 || *hand > 1 || *value < 0 || *value > most) return WeartRefusal::range;
  if (*hand != static_cast<int>(side)) return WeartRefusal::none;
  out.kind = kind;
  out.value = *value;
  return WeartRefusal::none;
}

const Json* member(const Json& json, const char* key) {
  if (!json.is_object()) return nullptr;
  const auto found = json.find(key);
  return found == json.end() || found->is_null() ? nullptr : &*found;
}

// A number from 0 to 1.
WeartRefusal read_share(const Json& thimble, const char* key, std::optional<double>& out) {
  const Json* value = member(thimble, key);
  if (value == nullptr) return WeartRefusal::none;
  if (!value->is_number()) return WeartRefusal::content;
  out = value->get<double>();
  return *out >= 0 && *out <= 1 ? WeartRefusal::none : WeartRefusal::range;
}

WeartRefusal read_bending(const Json& data, Side side, WeartReport& out) {
  const Json* hand = member(data, "handSide");
  if (hand == nullptr || !hand->is_string()) return WeartRefusal::content;
  if (*hand != name_of(side)) return WeartRefusal::none;
  constexpr std::array<const char*, kFingerCount> names{"thumb", "index", "middle", "annular", "pinky"};
  for (std::size_t f = 0; f < names.size(); ++f) {
    const Json* thimble = member(data, names[f]);
    if (thimble == nullptr) continue;
    std::optional<double> closure, abduction;
    for (const WeartRefusal refusal :
         {read_share(*thimble, "closure", closure), read_share(*thimble, "abduction", abduction)}) {
      if (refusal != WeartRefusal::none) return refusal;
    }
    if (!closure) return WeartRefusal::content;
    set_curl(out.fingers[f], *closure);
    // Of the fingers, the direction of the abduction is not documented.
    if (abduction && f == 0) out.fingers[f].splay = splay_of(*abduction);
  }
  out.kind = WeartKind::tracking;
  return WeartRefusal::none;
}

WeartRefusal read_json(std::string_view text, Side side, WeartReport& out) {
  const Json json = Json::parse(text, nullptr, false);
  if (json.is_discarded()) return WeartRefusal::json;
  const Json* type = member(json, "type");
  if (type == nullptr || !type->is_string()) return WeartRefusal::content;
  const Json* data = member(json, "data");
  if (*type == "TRACKING_BENDING_G2") return data == nullptr ? WeartRefusal::content : read_bending(*data, side, out);
  if (*type == "MW_STATUS" || *type == "WA_STATUS") {
    const Json* code = data == nullptr ? nullptr : member(*data, "statusCode");
    if (code == nullptr || !code->is_number_integer()) return WeartRefusal::content;
    if (*code < 0 || *code > 100000) return WeartRefusal::range;
    out.kind = WeartKind::middleware;
    out.value = code->get<int>();
  }
  if (*type == "DEVICES_STATUS") {
    const Json* devices = data == nullptr ? nullptr : member(*data, "devices");
    if (devices == nullptr || !devices->is_array()) return WeartRefusal::content;
    out.kind = WeartKind::devices;
    for (const Json& device : *devices) {
      const Json* hand = member(device, "handSide");
      if (hand == nullptr || !hand->is_string()) return WeartRefusal::content;
      out.value += *hand == name_of(side) ? 1 : 0;
    }
  }
  return WeartRefusal::none;
}

WeartRefusal read_message(std::string_view text, Side side, WeartReport& out) {
  if (text.empty()) return WeartRefusal::syntax;
  if (text[0] == '{') return read_json(text, side, out);
  const std::string_view name = take_field(text);
  if (name == "Tracking") return read_tracking(text, side, out);
  if (name == "CalibrationStatus") return read_calibration(text, side, WeartKind::calibration, 2, out);
  if (name == "CalibrationResult") return read_calibration(text, side, WeartKind::calibration_result, 1, out);
  const auto is_letter = [](char c) { return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z'); };
  return !name.empty() && std::all_of(name.begin(), name.end(), is_letter) ? WeartRefusal::none : WeartRefusal::syntax;
}

}  // namespace

WeartReport decode_weart(std::string_view text, Side side) {
  return report_or_refusal<WeartReport>([&](WeartReport& out) { return read_message(text, side, out); });
}

std::string weart_version(std::string_view text) {
  const Json json = Json::parse(text, nullptr, false);
  const Json* data = member(json, "data");
  const Json* version = data == nullptr ? nullptr : member(*data, "version");
  if (version == nullptr || !version->is_string()) return "";
  const auto& out = version->get_ref<const std::string&>();
  const bool is_plain = std::all_of(out.begin(), out.end(), [](char c) { return c > ' ' && c <= '~'; });
  return is_plain ? out : "";
}

std::string weart_questions() {
  const auto time = std::chrono::system_clock::now().time_since_epoch();
  const auto milliseconds = std::chrono::duration_cast<std::chrono::milliseconds>(time).count();
  std::string out;
  for (const char* type : {"MW_GET_STATUS", "DEVICES_GET_STATUS"})
    out += std::string(R"({"type":")") + type + R"(","ts":)" + std::to_string(milliseconds) + "}" + kWeartEnd;
  return out;
}

WeartCommand::WeartCommand(Side side, std::span<const WeartEffects> points, int texture, double volume) {
  char* end = text_.data();
  const auto add = [&end](std::string_view text) { end = std::copy(text.begin(), text.end(), end); };
  const auto add_number = [&](double value) {
    end = std::to_chars(end, text_.data() + text_.size(), value, std::chars_format::fixed, 6).ptr;
  };
  const auto finish = [&](std::size_t point) {
    add(":");
    add(name_of(side));
    add(":");
    add(kWeartPoints[point]);
    *end++ = kWeartEnd;
  };
  for (std::size_t p = 0; p < std::min(points.size(), kWeartPoints.size()); ++p) {
    const double force = std::clamp(points[p].force, 0.0, 1.0);
    add(force > 0 ? "force:" : "stopForce");
    if (force > 0) {
      add_number(force);
      add(":0.000000:0.000000");
    }
    finish(p);
    const double temperature = std::clamp(points[p].temperature, -1.0, 1.0);
    add(temperature != 0 ? "temperature:" : "stopTemperature");
    if (temperature != 0) add_number(0.5 + 0.5 * temperature);
    finish(p);
    const double slip = std::clamp(points[p].slip, 0.0, 1.0);
    add(slip > 0 ? "texture:" : "stopTexture");
    if (slip > 0) {
      end = std::to_chars(end, text_.data() + text_.size(), texture).ptr;
      add(":0.500000:0.000000:");
      add_number(0.5 * slip);
      add(":");
      add_number(volume);
    }
    finish(p);
  }
  size_ = static_cast<std::size_t>(end - text_.data());
}

}  // namespace softhand
