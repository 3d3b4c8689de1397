#include "flight/flight.hpp"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <stdexcept>

#include "math/instruction_set.hpp"

namespace softhand {

std::string hash_text(const HandModel& hand) {
  struct Bases : HandAnatomy, TissueModel {};
  static_assert(sizeof(HandModel) == sizeof(Bases), "the hash must contain every member");
  const std::array<std::uint64_t, 2> parts{plain_hash(static_cast<const HandAnatomy&>(hand)),
                                           plain_hash(static_cast<const TissueModel&>(hand))};
  std::array<char, 20> text{};
  std::snprintf(text.data(), text.size(), "%016llx", static_cast<unsigned long long>(plain_hash(parts)));
  return text.data();
}

FlightHeader flight_header(std::string loop, std::string module, std::span<const Scene> scenes,
                           std::vector<std::string> overrides, std::span<const HandModel> hands) {
  const std::string& path = scenes.front().path;
  FlightHeader header;
  header.loop = std::move(loop);
  header.module = std::move(module);
  header.scene = std::filesystem::absolute(path).lexically_normal().string();
  header.scene_text = config_detail::read_whole_file(path);
  header.overrides = std::move(overrides);
  for (std::size_t h = 0; h < hands.size(); ++h) {
    header.calibrations.push_back(scenes[h].calibration ? scenes[h].calibration->text : "");
    header.hands.push_back(hash_text(hands[h]));
  }
  header.build = kFlightBuild;
  header.instruction_set = to_string(widest_instruction_set());
  return header;
}

std::vector<Scene> scenes_of(const FlightHeader& header) {
  std::vector<std::string> overrides = header.overrides;
  overrides.emplace_back("calibration=none");
  std::vector<Scene> scenes{read_scene_text(header.scene, header.scene_text, overrides)};
  if (header.hands.size() > std::max<std::size_t>(scenes[0].hands.size(), 1))
    throw std::runtime_error("the flight file has more hands than its scene");
  for (std::size_t h = 1; h < header.hands.size(); ++h) {
    overrides.push_back("plays=" + scenes[0].hands[h]);
    scenes.push_back(read_scene_text(header.scene, header.scene_text, overrides));
  }
  for (std::size_t h = 0; h < header.hands.size(); ++h) {
    const std::string &text = header.calibrations[h], path = "the calibration in the flight file";
    if (!text.empty()) scenes[h].calibration = Calibration{path, text, read_user_hand(text, path)};
  }
  return scenes;
}

std::unique_ptr<FlightRecorder> make_flight_recorder(const FlightOptions& options, const FlightHeader& header,
                                                     const std::string& folder) {
  if (options.seconds == 0) return nullptr;
  return std::make_unique<FlightRecorder>(options, FlightRecorder::Place{header.module, folder}, to_json(header));
}

}  // namespace softhand
