// How processes reach each other over DDS: the section [network] of the file that the environment variable
// SOFTHAND_NETWORK names. All processes of a host read the same file. Without the variable they use the loopback
// interface. Programs on Cyclone DDS get the same settings from `cyclone_settings`.
#pragma once

#include <string>
#include <vector>

#include "runtime/options.hpp"

namespace softhand::bus {

struct NetworkOptions {
  std::string interfaces = "lo";
  std::string peers;
  bool multicast = true;
  std::string discovery_server;
  std::string security;
  std::string profile;
  std::string clock = "estimated";
};

/// Options that were checked on this host.
struct Network {
  NetworkOptions options;
  std::vector<std::string> addresses{"127.0.0.1"};  ///< IPv4, of `interfaces`
  std::vector<std::string> peers;                   ///< IPv4
  std::string security;                             ///< folder with one folder for each role; empty: not secured
  std::string profile;                              ///< path; empty: none
  /// True if processes of other hosts can be reached.
  bool leaves_host() const;
  /// True if each message fits into one packet of Ethernet.
  bool has_small_messages() const;
};

/// What a process may write in a secured domain. deploy/security makes one identity for each.
inline constexpr const char* kRoles[] = {"tracker", "tracking", "hand",   "world", "haptic",
                                         "tactile", "glove",    "viewer", "client"};

/// Throws ConfigError with file, line and key.
Network read_network(const std::string& path);
/// The file in SOFTHAND_NETWORK, or the loopback interface.
Network network_from_environment();

/// The same settings for a program on Cyclone DDS, for CYCLONEDDS_URI. `role` matters in a secured domain. Throws
/// ConfigError if Cyclone DDS cannot have these settings.
std::string cyclone_settings(const Network& network, const std::string& role);

/// The options as a Markdown table.
std::string network_reference();

}  // namespace softhand::bus
