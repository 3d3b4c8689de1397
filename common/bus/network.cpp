#include "bus/network.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <ifaddrs.h>
#include <netinet/in.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdlib>
#include <filesystem>
#include <sstream>

#include "runtime/config.hpp"

namespace softhand::bus {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> words(const std::string& text) {
  std::istringstream in(text);
  std::vector<std::string> words;
  for (std::string word; in >> word;) words.push_back(word);
  return words;
}

bool is_address(const std::string& text) {
  in_addr address{};
  return inet_pton(AF_INET, text.c_str(), &address) == 1;
}

struct Interface {
  std::string name, address;
};

std::vector<Interface> interfaces_of_this_host() {
  std::vector<Interface> found;
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0) return found;
  for (const ifaddrs* each = list; each != nullptr; each = each->ifa_next) {
    if (each->ifa_addr == nullptr || each->ifa_addr->sa_family != AF_INET) continue;
    std::array<char, INET_ADDRSTRLEN> text{};
    const auto* address = reinterpret_cast<const sockaddr_in*>(each->ifa_addr);
    inet_ntop(AF_INET, &address->sin_addr, text.data(), text.size());
    found.push_back({each->ifa_name, text.data()});
  }
  freeifaddrs(list);
  return found;
}

// Empty if there is no such interface.
std::string address_of(const std::string& name_or_address) {
  for (const Interface& each : interfaces_of_this_host()) {
    if (each.name == name_or_address || each.address == name_or_address) return each.address;
  }
  return {};
}

std::string check_interfaces(const std::string& text) {
  const std::vector<std::string> all = words(text);
  if (!all.empty() && std::all_of(all.begin(), all.end(), [](auto& each) { return !address_of(each).empty(); }))
    return {};
  std::string known;
  for (const Interface& each : interfaces_of_this_host())
    known += fmt::format("{}{} {}", known.empty() ? "" : ", ", each.name, each.address);
  return "names or IPv4 addresses of interfaces of this host (" + known + ")";
}

std::string check_peers(const std::string& text) {
  const std::vector<std::string> all = words(text);
  return std::all_of(all.begin(), all.end(), is_address) ? "" : "IPv4 addresses, separated by spaces";
}

struct Server {
  std::string address;
  std::uint32_t port = 0;
};
// The port is 0 if the text is wrong.
Server server_of(const std::string& text) {
  const std::size_t colon = text.find(':');
  if (colon == std::string::npos || !is_address(text.substr(0, colon))) return {};
  std::uint16_t port = 0;
  const char* end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data() + colon + 1, end, port);
  return {text.substr(0, colon), error == std::errc() && rest == end ? port : 0u};
}

std::string check_security(const fs::path& folder, const std::string& text, const NetworkOptions& options) {
  if (text.empty()) return {};
  if (!options.discovery_server.empty()) return "an empty text beside discovery_server: a server takes no part in it";
  for (const char* file : {"authority.pem", "governance.p7s"}) {
    if (!fs::exists(folder / text / file)) return fmt::format("a folder of deploy/security with the file {}", file);
  }
  return {};
}

std::string check_profile(const fs::path& folder, const std::string& text, const NetworkOptions& options) {
  if (text.empty()) return {};
  const NetworkOptions none;
  if (options.interfaces != none.interfaces || !options.peers.empty() || !options.multicast ||
      !options.discovery_server.empty())
    return "an empty text beside interfaces, peers, multicast or discovery_server: the profile replaces them";
  return fs::exists(folder / text) ? "" : "an XML file of Fast DDS with a participant profile named softhand";
}

struct NetworkFile {
  fs::path folder;
  NetworkOptions network;
};

void describe(OptionVisitor& v, NetworkFile& file) {
  v.section("network", "How processes reach each other (docs/several-hosts.md).", [&file](OptionVisitor& inner) {
    NetworkOptions& o = file.network;
    inner.string("interfaces", o.interfaces, check_interfaces,
                 "Names or IPv4 addresses of the interfaces that are used, separated by spaces. lo = this host only.");
    inner.string("peers", o.peers, check_peers,
                 "IPv4 addresses of other hosts, separated by spaces. Needed without multicast.");
    inner.flag("multicast", o.multicast, "Find other processes by multicast. Data never uses it.");
    inner.string(
        "discovery_server", o.discovery_server,
        [](const std::string& text) {
          return text.empty() || server_of(text).port != 0 ? "" : "IPv4 address and port, as in 10.1.0.1:11811";
        },
        "Address and port of a discovery server of Fast DDS (`fastdds discovery`). Other processes are then found only "
        "through it. Cyclone DDS has none.");
    inner.string(
        "security", o.security, [&](const std::string& text) { return check_security(file.folder, text, o); },
        "Folder of deploy/security, relative to this file (docs/security.md). Empty = not secured.");
    inner.string(
        "profile", o.profile, [&](const std::string& text) { return check_profile(file.folder, text, o); },
        "XML file of Fast DDS, relative to this file. Its participant profile `softhand` replaces the keys above, "
        "except "
        "security. Programs on Cyclone DDS have CYCLONEDDS_URI.");
    inner.choice(
        "clock", o.clock, {"estimated", "synchronised"},
        "Clocks of other hosts. estimated: from messages. synchronised: PTP or chrony keeps the wall clocks of "
        "all hosts equal.");
  });
}

constexpr std::string_view kCyclone = R"xml(<?xml version="1.0" encoding="UTF-8"?>
<!-- For Cyclone DDS clients: CYCLONEDDS_URI=file:///path/to/this/file. With it they communicate with the services (Fast
     DDS). Written by `softhand cyclone`. -->
<CycloneDDS xmlns="https://cdds.io/config">
  <Domain Id="any">
    <General>
      <Interfaces>
{}      </Interfaces>
      <AllowMulticast>{}</AllowMulticast>
{}    </General>
    <Discovery>
      <!-- The services use participant ids from 33 on. -->
      <ParticipantIndex>auto</ParticipantIndex>
      <MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
      <LeaseDuration>2s</LeaseDuration>
      <SPDPInterval>500ms</SPDPInterval>
      <Peers>
{}      </Peers>
    </Discovery>
{}  </Domain>
</CycloneDDS>
)xml";

constexpr std::string_view kCycloneLarge = R"xml(      <MaxMessageSize>65500B</MaxMessageSize>
)xml";
// Each message fits into one packet of Ethernet (bus.cpp says why).
constexpr std::string_view kCycloneSmall = R"xml(      <MaxMessageSize>1400B</MaxMessageSize>
      <FragmentSize>1300B</FragmentSize>
)xml";

constexpr std::string_view kCycloneSecurity = R"xml(    <Security>
      <Authentication>
        <Library path="dds_security_auth" initFunction="init_authentication"
                 finalizeFunction="finalize_authentication"/>
        <IdentityCA>file:{0}/authority.pem</IdentityCA>
        <IdentityCertificate>file:{0}/{1}-cyclone/certificate.pem</IdentityCertificate>
        <PrivateKey>file:{0}/{1}-cyclone/key.pem</PrivateKey>
      </Authentication>
      <Cryptographic>
        <Library path="dds_security_crypto" initFunction="init_crypto" finalizeFunction="finalize_crypto"/>
      </Cryptographic>
      <AccessControl>
        <Library path="dds_security_ac" initFunction="init_access_control"
                 finalizeFunction="finalize_access_control"/>
        <PermissionsCA>file:{0}/authority.pem</PermissionsCA>
        <Governance>file:{0}/governance.p7s</Governance>
        <Permissions>file:{0}/{1}-cyclone/permissions.p7s</Permissions>
      </AccessControl>
    </Security>
)xml";

}  // namespace

bool Network::leaves_host() const {
  return !profile.empty() || std::any_of(addresses.begin(), addresses.end(),
                                         [](const std::string& address) { return !address.starts_with("127."); });
}

bool Network::has_small_messages() const { return leaves_host() && security.empty(); }

Network read_network(const std::string& path) {
  NetworkFile file{fs::absolute(path).parent_path(), {}};
  read_toml(file, path);
  Network network;
  network.options = file.network;
  network.addresses.clear();
  for (const std::string& each : words(file.network.interfaces)) network.addresses.push_back(address_of(each));
  network.peers = words(file.network.peers);
  const auto absolute = [&](const std::string& name) {
    return name.empty() ? name : (file.folder / name).lexically_normal().string();
  };
  network.security = absolute(file.network.security);
  network.profile = absolute(file.network.profile);
  return network;
}

Network network_from_environment() {
  const char* path = std::getenv("SOFTHAND_NETWORK");
  return path == nullptr || *path == 0 ? Network() : read_network(path);
}

std::string cyclone_settings(const Network& network, const std::string& role) {
  if (!network.profile.empty()) throw ConfigError("network.profile: is a file for Fast DDS only");
  if (!network.options.discovery_server.empty())
    throw ConfigError("network.discovery_server: Cyclone DDS has no discovery server; expected multicast or peers");
  std::string interfaces, peers, security;
  for (const std::string& address : network.addresses) {
    const std::string which =
        address == "127.0.0.1" ? "name=\"lo\" multicast=\"true\"" : fmt::format("address=\"{}\"", address);
    interfaces += fmt::format("        <NetworkInterface {}/>\n", which);
    peers += fmt::format("        <Peer Address=\"{}\"/>\n", address);
  }
  for (const std::string& address : network.peers) peers += fmt::format("        <Peer Address=\"{}\"/>\n", address);
  if (!network.security.empty()) security = fmt::format(kCycloneSecurity, network.security, role);
  return fmt::format(kCyclone, interfaces, network.options.multicast ? "spdp" : "false",
                     network.has_small_messages() ? kCycloneSmall : kCycloneLarge, peers, security);
}

std::string network_reference() { return reference_markdown<NetworkFile>("Network"); }

}  // namespace softhand::bus
