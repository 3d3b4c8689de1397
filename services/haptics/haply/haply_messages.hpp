// The JSON messages of the Haply Inverse Service (README.md). Vectors are in the frame of the device that
// GroundedPoint uses: x right, y up, z to the user. The service counts x right, y away from the user and z up.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "device/refusals.hpp"
#include "math/types.hpp"
#include "messages/messages.hpp"

namespace softhand {

/// Bytes of a message of the service. The first one lists all devices with their settings, about 2 kB each.
inline constexpr std::size_t kLargestHaplyMessage = 65536;

enum class HaplyRefusal : std::uint8_t { none, json, content, range };
inline constexpr std::array<std::string_view, 4> kHaplyRefusalNames{"none", "json", "content", "range"};

using HaplyId = std::array<char, 32>;  ///< zero-terminated

/// What a message says about one Inverse3. Trivially copyable: it goes through a queue.
struct HaplyReport {
  HaplyRefusal refusal = HaplyRefusal::none;
  /// The first message of a connection, with the settings of the devices.
  bool is_inventory = false;
  bool has_list = false;  ///< it lists the devices, perhaps none
  /// It has a session id, which services from 3.5 on send. They call a force `vector`.
  bool has_session = false;
  bool has_device = false;  ///< the rest is valid
  bool has_velocity = false, has_force = false;
  HaplyId device_id{};
  Vec3 position{};  ///< of the cursor, m, from the base
  Vec3 velocity{};  ///< m/s
  Vec3 force{};     ///< that the service applies now, N
};
/// `device_id`: of the wanted device; empty = the first. Numbers that are not finite or absurd are refused.
HaplyReport decode_haply_report(std::string_view text, std::string_view device_id);

enum class HaplyEventKind : std::uint8_t { other, stop, brake, release };
struct HaplyEvent {
  HaplyRefusal refusal = HaplyRefusal::none;
  /// stop: the device had to protect itself or is gone. brake: it is locked, until `release`.
  HaplyEventKind kind = HaplyEventKind::other;
  HaplyId device_id{};  ///< empty: of no device
};
HaplyEvent decode_haply_event(std::string_view text);

enum class HaplyForceKey : std::uint8_t { vector, values };

/// The message that asks for a report and sets the force, N, for one tick. Does not allocate.
class HaplyCommand {
 public:
  HaplyCommand(const HaplyId& device_id, HaplyForceKey key, const Vector3& force);
  std::string_view text() const { return {text_.data(), size_}; }

 private:
  std::array<char, 256> text_;
  std::size_t size_ = 0;
};
/// Asks for a report while no device is known.
inline constexpr std::string_view kHaplyProbe = R"({"inverse3":[]})";

}  // namespace softhand
