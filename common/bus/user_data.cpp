#include "bus/user_data.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <sstream>

#include "messages/convert.hpp"
#include "runtime/clock.hpp"

namespace softhand::bus::detail {
namespace {

// First line of the user data of our participants and endpoints. Next lines of a participant: epoch, process id, host,
// name of the rig that the process holds, clock id. Next lines of an endpoint: epoch, hash of the type's definition,
// module.
constexpr std::string_view kUserData = "softhand 1\n";

// Without control characters, for logs: anybody on the domain can write user data.
std::string printable(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < 32 || c == 127; }, '?');
  return text;
}

}  // namespace

std::string user_data_of(std::uint64_t epoch, const std::string& rig) {
  std::array<char, 256> host{};
  gethostname(host.data(), host.size() - 1);
  return std::string(kUserData) + std::to_string(epoch) + "\n" + std::to_string(getpid()) + "\n" + host.data() + "\n" +
         rig + "\n" + std::to_string(clock_id());
}

std::optional<Peer> peer_of(const std::string& name, std::string_view data) {
  if (data.substr(0, kUserData.size()) != kUserData) return std::nullopt;
  std::istringstream in{std::string(data.substr(kUserData.size()))};
  Peer peer;
  if (!(in >> peer.epoch >> peer.process_id)) return std::nullopt;
  in.ignore();
  std::string host, rig;
  std::getline(in, host);
  std::getline(in, rig);
  in >> peer.clock_id;
  set_text(peer.name, printable(name));
  set_text(peer.host, printable(host));
  set_text(peer.rig, printable(rig));
  return peer;
}

std::string user_data_of(const Endpoint& endpoint) {
  char hash[17];
  std::snprintf(hash, sizeof hash, "%016llx", static_cast<unsigned long long>(endpoint.hash));
  return std::string(kUserData) + std::to_string(endpoint.epoch) + "\n" + hash + "\n" + endpoint.module;
}

std::optional<Endpoint> endpoint_of(const std::string& topic, const std::string& type, std::string_view data) {
  if (data.substr(0, kUserData.size()) != kUserData) return std::nullopt;
  std::istringstream in{std::string(data.substr(kUserData.size()))};
  Endpoint endpoint{topic, printable(type), {}};
  if (!(in >> endpoint.epoch >> std::hex >> endpoint.hash)) return std::nullopt;
  in.ignore();
  std::getline(in, endpoint.module);
  endpoint.module = printable(endpoint.module);
  return endpoint;
}

}  // namespace softhand::bus::detail
