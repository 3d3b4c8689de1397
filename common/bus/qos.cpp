#include "bus/qos.hpp"

#include <arpa/inet.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <netinet/in.h>
#include <sys/random.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <bitset>
#include <cerrno>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>

namespace softhand::bus::detail {
namespace {

namespace dds = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;

// Types up to this size use sample pools that are allocated at start. Larger types use buffers that grow when needed
// and are reused. Bytes.
constexpr std::size_t kPooledSize = 32 * 1024;
// A process without a sign of life for this time counts as dead. Fast DDS 2.9 checks each peer once in this period. It
// aborts with a failed assertion if a peer leaves at the moment of the check (PDP.cpp,
// check_remote_participant_liveliness). We saw this once in 160 tests with 2 s, so the check must be rare. Nothing
// urgent depends on this time: streams become stale earlier, and the leases of trackers are 50 ms.
constexpr int kProcessLeaseMs = 10000;
// Participant ids of our processes. They say which ports a process has. Ids 0..32 belong to Cyclone's automatic
// participants. Without multicast, announcements go to every port of every peer, so the range is small.
constexpr std::uint32_t kFirstId = 33;
constexpr std::uint32_t kIds = 80, kIdsWithoutMulticast = 24;
constexpr const char* kGroup = "239.255.0.1";  // multicast group of discovery
// Heartbeats in the life of a sample.
constexpr int kHeartbeats = 40;
// Messages to other hosts fit into one packet of Ethernet, so DDS splits larger samples and not IP. The kernel keeps
// the pieces of incomplete datagrams for 30 s. When 5 % of the packets were lost, they filled its 4 MB after seconds,
// and then it dropped all split datagrams. Fast DDS 2.9 cannot split the messages of a handshake, so the messages of a
// secured domain are larger.
constexpr std::uint32_t kMessageSize = 1400;

// Ids of this process.
std::mutex ids_mutex;
std::bitset<kIds> taken_ids;

std::uint32_t random_place() {
  std::uint32_t place = 0;
  if (getrandom(&place, sizeof place, 0) != sizeof place)
    place = static_cast<std::uint32_t>(std::chrono::steady_clock::now().time_since_epoch().count());
  return place;
}

rtps::Locator_t locator(const std::string& address, std::uint32_t port = 0) {
  rtps::Locator_t out;
  out.kind = LOCATOR_KIND_UDPv4;
  rtps::IPLocator::setIPv4(out, address);
  out.port = port;
  return out;
}

/// Throws std::runtime_error if another program has the port through which processes find each other. Participants
/// share this port. Fast DDS 2.9 only logs that it cannot open it, and the process would hear nobody.
void require_shared_port(const std::string& address, std::uint32_t port, int domain) {
  const int probe = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (probe < 0) throw std::runtime_error(std::string("DDS: cannot make a socket: ") + std::strerror(errno));
  const int yes = 1;
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(port));
  inet_pton(AF_INET, address.c_str(), &to.sin_addr);
  setsockopt(probe, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  const bool is_taken = bind(probe, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0 && errno == EADDRINUSE;
  close(probe);
  if (is_taken)
    throw std::runtime_error(
        "DDS: cannot join domain " + std::to_string(domain) + ": another program has UDP port " + std::to_string(port) +
        "; choose another SOFTHAND_DOMAIN. Those of 0..100 are best: Linux does not give out their ports by itself");
}

template <typename Qos>
void apply_row(Qos& qos, const TopicRow& row) {
  qos.reliability().kind =
      row.reliability == Reliability::reliable ? dds::RELIABLE_RELIABILITY_QOS : dds::BEST_EFFORT_RELIABILITY_QOS;
  qos.durability().kind = row.durability == Durability::transient_local ? dds::TRANSIENT_LOCAL_DURABILITY_QOS
                                                                        : dds::VOLATILE_DURABILITY_QOS;
  qos.history().kind = dds::KEEP_LAST_HISTORY_QOS;
  qos.history().depth = row.depth;
  if (row.deadline_ms > 0) qos.deadline().period = milliseconds(row.deadline_ms);
  if (row.liveliness_ms > 0) {
    qos.liveliness().kind = dds::AUTOMATIC_LIVELINESS_QOS;
    qos.liveliness().lease_duration = milliseconds(row.liveliness_ms);
    qos.liveliness().announcement_period = milliseconds(row.liveliness_ms * 2 / 5);
  }
  if (row.writers == Writers::strongest) qos.ownership().kind = dds::EXCLUSIVE_OWNERSHIP_QOS;
  qos.resource_limits().max_instances = row.max_instances;
  qos.resource_limits().max_samples_per_instance = row.depth;
  qos.resource_limits().max_samples = row.max_instances * row.depth;
  qos.resource_limits().allocated_samples = std::min(row.max_instances * row.depth, 8);
  // Data sharing is off anyway for keyed types. A killed process would leave its files in /dev/shm.
  qos.data_sharing().off();
}

}  // namespace

void apply(dds::DataWriterQos& qos, const TopicRow& row) {
  apply_row(qos, row);
  // Not on the reader: there Fast DDS compares the wall clocks of two hosts. `ReaderImpl` judges the stamp instead.
  if (row.lifespan_ms > 0) qos.lifespan().duration = milliseconds(row.lifespan_ms);
  // Writers do not apply the filters of readers. Else Fast DDS 2.9 adds 36 bytes for them to each fragment of a sample,
  // but makes the fragments only 32 bytes shorter. A fragment for a single reader then does not fit into a message: it
  // is never sent, and the writer tries again without a pause.
  qos.writer_resource_limits().reader_filters_allocation.maximum = 0;
  // A reader notices that a sample was lost when the next heartbeat comes. The default period is 3 s, longer than the
  // life of a message.
  if (row.reliability == Reliability::reliable && row.lifespan_ms > 0)
    qos.reliable_writer_qos().times.heartbeatPeriod = milliseconds(row.lifespan_ms / kHeartbeats);
}
void apply(dds::DataReaderQos& qos, const TopicRow& row) { apply_row(qos, row); }

rtps::MemoryManagementPolicy_t memory_policy(const TypeCodec& codec) {
  return codec.max_size() <= kPooledSize ? rtps::PREALLOCATED_MEMORY_MODE : rtps::DYNAMIC_REUSABLE_MEMORY_MODE;
}

ParticipantId::ParticipantId(const Network& network) {
  static std::uint32_t next = random_place();
  const std::uint32_t count = network.options.multicast ? kIds : kIdsWithoutMulticast;
  const std::lock_guard lock(ids_mutex);
  for (std::uint32_t tries = 0; tries < count; ++tries) {
    place_ = next++ % count;
    if (taken_ids[place_]) continue;
    taken_ids.set(place_);
    return;
  }
  throw std::runtime_error("DDS: this process has " + std::to_string(count) + " participants; expected no more");
}
ParticipantId::~ParticipantId() {
  const std::lock_guard lock(ids_mutex);
  taken_ids.reset(place_);
}
std::int32_t ParticipantId::value() const { return static_cast<std::int32_t>(kFirstId + place_); }

void apply_network(dds::DomainParticipantQos& qos, const Network& network, int domain, std::int32_t participant_id) {
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList = network.addresses;
  udp->sendBufferSize = udp->receiveBufferSize = 4 * 1024 * 1024;
  if (network.has_small_messages()) udp->maxMessageSize = kMessageSize;
  // No shared-memory transport. On one host it is not faster than UDP (51 against 52 us), and killed processes leave
  // segments behind. A process restarted after SIGKILL was heard after 140 ms with it (median of 30, worst 3.3 s).
  // With UDP it is heard after 20 ms (worst 0.44 s).
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports = {udp};
  auto& wire = qos.wire_protocol();
  const bool multicast = network.options.multicast;
  wire.participant_id = participant_id;
  auto& discovery = wire.builtin;
  discovery.discovery_config.leaseDuration = milliseconds(kProcessLeaseMs);
  discovery.discovery_config.leaseDuration_announcementperiod = milliseconds(500);
  if (const std::string& server = network.options.discovery_server; !server.empty()) {
    const std::size_t colon = server.find(':');
    // The server sends to participants of its own host on the loopback interface.
    udp->interfaceWhiteList.push_back("127.0.0.1");
    eprosima::fastdds::rtps::RemoteServerAttributes remote;
    remote.ReadguidPrefix("44.53.00.5f.45.50.52.4f.53.49.4d.41");  // of `fastdds discovery -i 0`
    remote.metatrafficUnicastLocatorList.push_back(
        locator(server.substr(0, colon), static_cast<std::uint32_t>(std::stoul(server.substr(colon + 1)))));
    discovery.discovery_config.discoveryProtocol = rtps::DiscoveryProtocol_t::CLIENT;
    discovery.discovery_config.m_DiscoveryServers.push_back(remote);
    return;
  }
  // A list without a multicast address makes Fast DDS listen to none.
  if (!multicast) {
    for (const std::string& address : network.addresses)
      discovery.metatrafficUnicastLocatorList.push_back(locator(address));
  }
  // The multicast group reaches all participants. The group's port must be set here. A peer without a port stands for
  // the unicast ports of the first few participants: this finds Cyclone if multicast is off.
  const auto number = static_cast<std::uint32_t>(domain);
  if (multicast) {
    const std::uint32_t port = wire.port.getMulticastPort(number);
    require_shared_port(kGroup, port, domain);
    for (const std::string& address : network.addresses) require_shared_port(address, port, domain);
    discovery.initialPeersList.push_back(locator(kGroup, port));
  }
  for (const auto* list : {&network.addresses, &network.peers}) {
    for (const std::string& address : *list) {
      discovery.initialPeersList.push_back(locator(address));
      // A range that is twice as long has room for ids that were taken.
      for (std::uint32_t id = kFirstId; !multicast && id < kFirstId + 2 * kIdsWithoutMulticast; ++id)
        discovery.initialPeersList.push_back(locator(address, wire.port.getUnicastPort(number, id)));
    }
  }
}

void apply_security(dds::DomainParticipantQos& qos, const std::string& folder, const std::string& role) {
  auto& properties = qos.properties().properties();
  const std::string all = "file://" + folder + "/", own = all + role + "/";
  const std::string identity = "dds.sec.auth.builtin.PKI-DH.", access = "dds.sec.access.builtin.Access-Permissions.";
  properties.emplace_back("dds.sec.auth.plugin", "builtin.PKI-DH");
  properties.emplace_back(identity + "identity_ca", all + "authority.pem");
  properties.emplace_back(identity + "identity_certificate", own + "certificate.pem");
  properties.emplace_back(identity + "private_key", own + "key.pem");
  properties.emplace_back("dds.sec.access.plugin", "builtin.Access-Permissions");
  properties.emplace_back(access + "permissions_ca", all + "authority.pem");
  properties.emplace_back(access + "governance", all + "governance.p7s");
  properties.emplace_back(access + "permissions", own + "permissions.p7s");
  properties.emplace_back("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
}

}  // namespace softhand::bus::detail
