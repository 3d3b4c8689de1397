#include "flight/flight_header.hpp"

#include <nlohmann/json.hpp>
#include <stdexcept>

namespace softhand {
namespace {

using Json = nlohmann::ordered_json;
constexpr int kVersion = 4;

// One list of the fields serves writing and reading.
template <typename Header, typename Visit>
void for_each_field(Header& header, Visit&& visit) {
  visit("loop", header.loop);
  visit("module", header.module);
  visit("scene", header.scene);
  visit("scene_text", header.scene_text);
  visit("overrides", header.overrides);
  visit("calibrations", header.calibrations);
  visit("hands", header.hands);
  visit("build", header.build);
  visit("instruction_set", header.instruction_set);
  visit("reason", header.reason);
}

}  // namespace

std::string to_json(const FlightHeader& header) {
  Json json{{"version", kVersion}};
  for_each_field(header, [&json](const char* name, const auto& value) { json[name] = value; });
  // A path may be any bytes.
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

FlightHeader flight_header_from_json(const std::string& text) {
  try {
    const Json json = Json::parse(text);
    if (json.at("version") != kVersion)
      throw std::runtime_error("the flight file has version " + json.at("version").dump() + ", expected " +
                               std::to_string(kVersion));
    FlightHeader header;
    for_each_field(header, [&json](const char* name, auto& value) { json.at(name).get_to(value); });
    if (header.calibrations.size() != header.hands.size())
      throw std::runtime_error("the header of the flight file is broken: expected a calibration for each hand");
    return header;
  } catch (const Json::exception& error) {
    throw std::runtime_error(std::string("the header of the flight file is broken: ") + error.what());
  }
}

}  // namespace softhand
