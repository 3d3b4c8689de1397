// An Inverse3 and its service, for the simulator and for tests.
#pragma once

#include <array>
#include <atomic>
#include <cmath>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>

#include "device/simulated_service.hpp"
#include "runtime/clock.hpp"

namespace softhand {

/// Answers each message with one report, as the service does. Axes are those of the service: x right, y away from the
/// user, z up.
class SimulatedInverse3 {
 public:
  using Force = std::array<double, 3>;
  /// `key`: the key of forces that this version of the service knows. Services that call it vector send a session id.
  SimulatedInverse3(std::int64_t port, std::int64_t event_port, std::string key = "vector")
      : key_(std::move(key)),
        events_(event_port, {}),
        service_(port, {[this](const std::string&) { return report(true).dump(); },
                        [this](const std::string& message) { return answer(message); },
                        [this] {
                          set_force({0, 0, 0});
                        }}) {}

  std::uint16_t port() const { return service_.port(); }
  std::uint16_t event_port() const { return events_.port(); }
  void move_to(const std::array<double, 3>& position, const std::array<double, 3>& velocity = {0, 0, 0}) {
    const std::lock_guard lock(mutex_);
    position_ = position;
    velocity_ = velocity;
  }
  /// The force that acts now. It is zero while the client is silent, and after it has left.
  Force force() const {
    const std::lock_guard lock(mutex_);
    return is_silent() ? Force{} : force_;
  }
  /// The force of the last message. It is zero while the client is silent.
  Force commanded() const {
    const std::lock_guard lock(mutex_);
    return is_silent() ? Force{} : commanded_;
  }
  /// Messages that the service got.
  int messages() const { return messages_; }
  /// Messages that a service cannot use.
  int mistakes() const { return mistakes_; }
  void unplug(bool is_unplugged) { is_unplugged_ = is_unplugged; }
  /// Sends a text instead of a report, or in addition to one.
  void send(const std::string& text) { service_.send(text); }
  void send_event(const std::string& name, const std::string& safety_type) {
    nlohmann::json event{{"name", name}, {"category", "device"}, {"level", "warning"}, {"message", "simulated"}};
    event["data"] = {{"device_family", "inverse"}, {"device_id", kId}};
    if (!safety_type.empty()) event["data"]["safety_type"] = safety_type;
    events_.send(event.dump());
  }
  /// A report, or the first message of a connection.
  nlohmann::json report(bool is_inventory) const {
    const std::lock_guard lock(mutex_);
    const auto xyz = [](const std::array<double, 3>& v) {
      return nlohmann::json{{"x", v[0]}, {"y", v[1]}, {"z", v[2]}};
    };
    nlohmann::json all{{"inverse3", nlohmann::json::array()}, {"verse_grip", nlohmann::json::array()}};
    if (key_ == "vector") all["session_id"] = 7;
    if (is_unplugged_) return all;
    nlohmann::json device{{"device_id", kId}, {"status", {{"calibrated", true}}}};
    device["state"] = {{"cursor_position", xyz(position_)},
                       {"cursor_velocity", xyz(velocity_)},
                       {"current_cursor_force", xyz(is_silent() ? Force{} : force_)},
                       {"body_orientation", {{"w", 1}, {"x", 0}, {"y", 0}, {"z", 0}}},
                       {"control_mode", "force"}};
    if (is_inventory)
      device["config"] = {{"type", "inverse3"}, {"handedness", "right"}, {"basis", {{"permutation", "XYZ"}}}};
    all["inverse3"].push_back(device);
    return all;
  }

  static constexpr const char* kId = "049D";

 private:
  // A force lasts for one tick of the service. Here it lasts for longer, because a client on a busy machine is late.
  static constexpr Nanoseconds kSilent = 10'000'000;
  bool is_silent() const { return now() - answered_ > kSilent; }
  void set_force(const Force& force) {
    const std::lock_guard lock(mutex_);
    force_ = force;
  }
  std::string answer(const std::string& message) {
    ++messages_;
    const auto json = nlohmann::json::parse(message, nullptr, false);
    Force force{};
    if (json.is_discarded() || !json.contains("inverse3")) {
      ++mistakes_;
    } else {
      for (const auto& device : json["inverse3"]) {
        if (device["device_id"] != kId) {
          ++mistakes_;
          continue;
        }
        const auto& command = device["commands"]["set_cursor_force"];
        if (!command.contains(key_)) continue;  // without a word
        force = {command[key_]["x"], command[key_]["y"], command[key_]["z"]};
      }
    }
    set_force(force);
    {
      const std::lock_guard lock(mutex_);
      commanded_ = force;
      answered_ = now();
    }
    return report(false).dump();
  }

  const std::string key_;
  mutable std::mutex mutex_;
  std::array<double, 3> position_{0, -0.12, 0.15}, velocity_{};
  Force force_{}, commanded_{};
  Nanoseconds answered_ = 0;  // time of the last message
  std::atomic<int> messages_{0}, mistakes_{0};
  std::atomic<bool> is_unplugged_{false};
  SimulatedService events_;
  SimulatedService service_;
};

}  // namespace softhand
