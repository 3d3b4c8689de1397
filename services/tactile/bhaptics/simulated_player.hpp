// The bHaptics Player with two TactGloves, for the simulator and for tests.
#pragma once

#include <array>
#include <atomic>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>

#include "device/simulated_service.hpp"
#include "runtime/clock.hpp"
#include "tactile/bhaptics/player_messages.hpp"

namespace softhand {

/// Plays frames of one key after another, each for its duration, and reports after each message.
class SimulatedPlayer {
 public:
  explicit SimulatedPlayer(std::int64_t port)
      : service_(port, {[this](const std::string& target) {
                          const std::lock_guard lock(mutex_);
                          target_ = target;
                          return report();
                        },
                        [this](const std::string& message) { return answer(message); },
                        {}}) {}

  std::uint16_t port() const { return service_.port(); }
  /// Intensities of the right glove now, 0 to 100.
  std::array<int, kGloveMotors> motors() const {
    const std::lock_guard lock(mutex_);
    return playing();
  }
  std::string target() const {
    const std::lock_guard lock(mutex_);
    return target_;
  }
  int messages() const { return messages_; }
  /// Messages that the Player cannot use.
  int mistakes() const { return mistakes_; }
  int turned_all_off() const { return turned_all_off_; }
  void send(const std::string& text) { service_.send(text); }

 private:
  std::array<int, kGloveMotors> playing() const { return now() < end_ ? motors_ : std::array<int, kGloveMotors>{}; }
  std::string report() const {
    nlohmann::json status{{"GloveR", playing()}, {"GloveL", std::array<int, kGloveMotors>{}}};
    return nlohmann::json{{"ConnectedDeviceCount", 2},
                          {"ConnectedPositions", {"GloveL", "GloveR"}},
                          {"ActiveKeys", nlohmann::json::array()},
                          {"RegisteredKeys", nlohmann::json::array()},
                          {"Status", status}}
        .dump();
  }
  std::string answer(const std::string& message) {
    ++messages_;
    const auto json = nlohmann::json::parse(message, nullptr, false);
    const std::lock_guard lock(mutex_);
    if (json.is_discarded() || !json.contains("Register") || !json.contains("Submit")) {
      ++mistakes_;
      return report();
    }
    for (const auto& each : json["Submit"]) {
      const std::string type = each["Type"];
      if (type == "turnOffAll") {
        ++turned_all_off_;
        end_ = 0;
      } else if (type == "turnOff") {
        if (each["Key"] == key_) end_ = 0;
      } else if (type == "frame" && each["Frame"]["Position"] == "GloveR") {
        key_ = each["Key"];
        motors_ = {};
        for (const auto& dot : each["Frame"]["DotPoints"]) motors_.at(dot["Index"]) = dot["Intensity"];
        end_ = now() + 1'000'000 * each["Frame"]["DurationMillis"].get<Nanoseconds>();
      } else {
        ++mistakes_;
      }
    }
    return report();
  }

  mutable std::mutex mutex_;
  std::array<int, kGloveMotors> motors_{};
  Nanoseconds end_ = 0;
  std::string key_, target_;
  std::atomic<int> messages_{0}, mistakes_{0}, turned_all_off_{0};
  SimulatedService service_;
};

}  // namespace softhand
