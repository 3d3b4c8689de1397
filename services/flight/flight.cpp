#include "flight/flight.hpp"

#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "math/instruction_set.hpp"

namespace softhand {
namespace {

using Json = nlohmann::ordered_json;
constexpr int kVersion = 3;

// One list of the fields serves writing and reading.
template <typename Header, typename Visit>
void for_each_field(Header& header, Visit&& visit) {
  visit("loop", header.loop);
  visit("module", header.module);
  visit("scene", header.scene);
  visit("scene_text", header.scene_text);
  visit("overrides", header.overrides);
  visit("calibration", header.calibration);
  visit("hand", header.hand);
  visit("build", header.build);
  visit("instruction_set", header.instruction_set);
  visit("reason", header.reason);
}

}  // namespace

std::string hash_text(const HandModel& hand) {
  struct Bases : HandAnatomy, TissueModel {};
  static_assert(sizeof(HandModel) == sizeof(Bases), "the hash must contain every member");
  const std::array<std::uint64_t, 2> parts{plain_hash(static_cast<const HandAnatomy&>(hand)),
                                           plain_hash(static_cast<const TissueModel&>(hand))};
  std::array<char, 20> text{};
  std::snprintf(text.data(), text.size(), "%016llx", static_cast<unsigned long long>(plain_hash(parts)));
  return text.data();
}

FlightHeader flight_header(std::string loop, std::string module, const Scene& scene, std::vector<std::string> overrides,
                           const HandModel* hand) {
  FlightHeader header;
  header.loop = std::move(loop);
  header.module = std::move(module);
  header.scene = std::filesystem::absolute(scene.path).lexically_normal().string();
  header.scene_text = config_detail::read_whole_file(scene.path);
  header.overrides = std::move(overrides);
  if (hand != nullptr && scene.calibration) header.calibration = scene.calibration->text;
  if (hand != nullptr) header.hand = hash_text(*hand);
  header.instruction_set = to_string(widest_instruction_set());
  return header;
}

Scene scene_of(const FlightHeader& header) {
  std::vector<std::string> overrides = header.overrides;
  overrides.emplace_back("calibration=none");
  Scene scene = read_scene_text(header.scene, header.scene_text, overrides);
  if (header.calibration.empty()) return scene;
  const std::string path = "the calibration in the flight file";
  scene.calibration = Calibration{path, header.calibration, read_user_hand(header.calibration, path)};
  return scene;
}

std::string to_json(const FlightHeader& header) {
  Json json{{"version", kVersion}};
  for_each_field(header, [&json](const char* name, const auto& value) { json[name] = value; });
  return json.dump();
}

FlightHeader flight_header_from_json(const std::string& text) {
  try {
    const Json json = Json::parse(text);
    if (json.at("version").get<int>() != kVersion)
      throw std::runtime_error("the flight file has version " + json.at("version").dump() + ", expected " +
                               std::to_string(kVersion));
    FlightHeader header;
    for_each_field(header, [&json](const char* name, auto& value) { json.at(name).get_to(value); });
    return header;
  } catch (const Json::exception& error) {
    throw std::runtime_error(std::string("the header of the flight file is broken: ") + error.what());
  }
}

std::unique_ptr<FlightRecorder> make_flight_recorder(const FlightOptions& options, const FlightHeader& header,
                                                     const std::string& folder) {
  if (options.seconds == 0) return nullptr;
  const std::string place =
      folder.empty() ? (std::filesystem::temp_directory_path() / "softhand-flight").string() : folder;
  return std::make_unique<FlightRecorder>(options, FlightRecorder::Place{header.module, place}, to_json(header));
}

}  // namespace softhand
