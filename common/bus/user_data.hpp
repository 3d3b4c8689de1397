// What our participants and endpoints say about themselves in their user data.
#pragma once

#include <compare>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "bus/bus.hpp"

namespace softhand::bus::detail {

/// Of a participant with this epoch. `rig`: the name of the rig that the process holds.
std::string user_data_of(std::uint64_t epoch, const std::string& rig);
/// Empty unless the data is that of a participant of ours.
std::optional<Peer> peer_of(const std::string& name, std::string_view data);

/// What an endpoint of ours says about itself.
struct Endpoint {
  std::string topic, type, module;
  std::uint64_t hash = 0;  ///< of the definition of the type
  std::uint64_t epoch = 0;
  auto operator<=>(const Endpoint&) const = default;
};
std::string user_data_of(const Endpoint& endpoint);
/// Empty unless the data is that of an endpoint of ours.
std::optional<Endpoint> endpoint_of(const std::string& topic, const std::string& type, std::string_view data);

}  // namespace softhand::bus::detail
