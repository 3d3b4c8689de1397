#include "bus/bus.hpp"

#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <fastrtps/utils/md5.h>
#include <fastrtps/xmlparser/XMLProfileManager.h>
#include <sys/random.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <charconv>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <cstring>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/ContentFilteredTopic.hpp>
#include <fastdds/dds/topic/IContentFilter.hpp>
#include <fastdds/dds/topic/IContentFilterFactory.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <mutex>
#include <optional>
#include <random>
#include <set>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "bus/host_clocks.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "messages/followed_writer.hpp"
#include "runtime/clock.hpp"

namespace softhand::bus {
namespace {

namespace dds = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using eprosima::fastrtps::Duration_t;

/// Above this domain, the ports of the participants with ids above 33 would exceed 65535.
constexpr int kMaxDomain = 230;
/// Types up to this size use sample pools that are allocated at start. Larger types use buffers that grow when needed
/// and are reused. Bytes.
constexpr std::size_t kPooledSize = 32 * 1024;
/// A writer lives at least this long after a last sample that matters. 20 ms were once too short on a machine with six
/// busy threads per core.
constexpr std::chrono::milliseconds kLastSampleTime{100};
constexpr int kOwnersDepth = 4;  ///< history depth of readers of exclusive topics
/// A process without a sign of life for this time counts as dead. Fast DDS 2.9 checks each peer once in this period. It
/// aborts with a failed assertion if a peer leaves at the moment of the check (PDP.cpp,
/// check_remote_participant_liveliness). We saw this once in 160 tests with 2 s, so the check must be rare. Nothing
/// urgent depends on this time: streams become stale earlier, and the leases of trackers are 50 ms.
constexpr int kProcessLeaseMs = 10000;
/// First line of the user data of our participants and endpoints. Next lines of a participant: epoch, process id, host,
/// name of the rig that the process holds, clock id. Next lines of an endpoint: epoch, hash of the type's definition,
/// module.
constexpr std::string_view kUserData = "softhand 1\n";
constexpr std::size_t kMostPeers = 256;  ///< anybody on the domain can invent participants
constexpr std::size_t kMostEndpoints = 4096;
/// Participant ids of our processes. They say which ports a process has. Ids 0..32 belong to Cyclone's automatic
/// participants. Without multicast, announcements go to every port of every peer, so the range is small.
constexpr std::uint32_t kFirstId = 33;
constexpr std::uint32_t kIds = 80, kIdsWithoutMulticast = 24;
constexpr std::chrono::milliseconds kBeaconPeriod{100};
/// Messages to other hosts fit into one packet of Ethernet, so DDS splits larger samples and not IP. The kernel keeps
/// the pieces of incomplete datagrams for 30 s. When 5 % of the packets were lost, they filled its 4 MB after seconds,
/// and then it dropped all split datagrams. Fast DDS 2.9 cannot split the messages of a handshake, so the messages of a
/// secured domain are larger.
constexpr std::uint32_t kMessageSize = 1400;

/// Largest number of instances in the history of a keyed reader. Fast DDS 2.9 never forgets an instance whose writer is
/// alive, not even one without samples, and refuses every new one when it has reached its limit. So this limit must be
/// out of reach. `AdmissionFilter` bounds what comes in.
constexpr int kHistoryInstances = 100000;
/// An instance without a sample for this time makes room for another.
constexpr double kInstanceRest = 1;  // s

Duration_t milliseconds(int ms) { return {ms / 1000, static_cast<std::uint32_t>(ms % 1000) * 1000000u}; }

[[noreturn]] void fail(const std::string& what) { throw std::runtime_error("DDS: " + what); }

/// Returns a participant id, and with it a port number, that a just-killed process with the same name most likely did
/// not have. Otherwise peers take the new process for the old one until its lease ends, and do not answer for seconds.
/// If another process has the id, Fast DDS takes the next free one.
std::int32_t fresh_participant_id(std::uint32_t count) {
  static std::atomic<std::uint32_t> next = [] {
    std::uint32_t seed = 0;
    if (getrandom(&seed, sizeof seed, 0) != sizeof seed)
      seed = static_cast<std::uint32_t>(std::chrono::steady_clock::now().time_since_epoch().count());
    return seed;
  }();
  return static_cast<std::int32_t>(kFirstId + next.fetch_add(1) % count);
}

/// Lets Fast DDS send and receive our plain structs.
class PlainType final : public dds::TopicDataType {
 public:
  explicit PlainType(const TypeCodec& codec) : codec_(codec) {
    const std::size_t size = codec.max_size();
    m_typeSize = static_cast<std::uint32_t>(size + 3);  // the payload may be padded to a multiple of 4
    m_isGetKeyDefined = codec.max_key_size() > 0;
    setName(codec.name);
    // Cyclone and Fast disagree about type information. Without it, types match by name.
    auto_fill_type_information(false);
    auto_fill_type_object(false);
  }

  bool serialize(void* message, rtps::SerializedPayload_t* payload) override {
    const std::size_t size = codec_.encode(message, {reinterpret_cast<std::byte*>(payload->data), payload->max_size});
    payload->length = static_cast<std::uint32_t>(size);
    payload->encapsulation = CDR_LE;
    return size > 0;
  }
  bool deserialize(rtps::SerializedPayload_t* payload, void* received) override {
    codec_.decode({reinterpret_cast<const std::byte*>(payload->data), payload->length}, received);
    return true;  // `well_formed` in the sample reports errors; with false the sample would stay in the history
  }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* message) override {
    return [this, message] { return static_cast<std::uint32_t>(codec_.size(message)); };
  }
  void* createData() override { return codec_.create_received(); }
  void deleteData(void* received) override { codec_.destroy_received(received); }
  bool getKey(void* message, rtps::InstanceHandle_t* handle, bool force_md5) override {
    if (!m_isGetKeyDefined) return false;
    std::array<std::byte, 80> key{};
    const std::size_t size = codec_.key(message, key);
    std::array<std::uint8_t, 16> hash{};
    if (force_md5 || codec_.max_key_size() > 16) {
      MD5 md5;
      md5.init();
      md5.update(reinterpret_cast<unsigned char*>(key.data()), static_cast<unsigned int>(size));
      md5.finalize();
      std::memcpy(hash.data(), md5.digest, hash.size());
    } else {
      std::memcpy(hash.data(), key.data(), size);
    }
    for (std::size_t i = 0; i < hash.size(); ++i) handle->value[i] = hash[i];
    return true;
  }
  bool is_bounded() const override { return false; }  // with true, the readers' buffers could not grow, see ReaderImpl
  bool is_plain() const override { return false; }

 private:
  const TypeCodec& codec_;
};

// The interfaces of Fast DDS have no virtual destructors. Nobody deletes through them.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wnon-virtual-dtor"

/// Decides which samples enter a reader, in the receiving threads and before the sample is stored. Samples about other
/// hands stay outside if the reader is about one hand. Anybody on the domain can invent instances (users, module
/// names). So a single writer gets at most `TopicRow::max_instances` of them, and the reader has room for twice as
/// many. A new instance takes the place of one that rests. The filter refuses streams of hosts whose clock is not
/// known. On topics with one writer it follows one writer of each instance, and refuses stamps that are not usable.
/// Fast DDS 2.9 does not tell a filter who wrote a sample. So the epoch in the sample stands for the writer.
class AdmissionFilter final : public dds::IContentFilter {
 public:
  AdmissionFilter(const TypeCodec& codec, const TopicRow& row, const std::optional<HandKey>& only,
                  const HostClocks& clocks)
      : codec_(codec),
        received_(codec.create_received()),
        share_(static_cast<std::size_t>(row.max_instances)),
        has_one_writer_(row.writers == Writers::one),
        is_stream_(row.writers != Writers::any),
        clocks_(clocks),
        clock_id_(clock_id()) {
    admitted_.reserve(2 * share_);
    if (only) {
      EncodeKey key;
      key(*only);
      only_ = hash_of(std::span(key.bytes).first(key.size));
    }
  }
  ~AdmissionFilter() { codec_.destroy_received(received_); }
  AdmissionFilter(const AdmissionFilter&) = delete;
  AdmissionFilter& operator=(const AdmissionFilter&) = delete;

  /// DDS calls it under the lock of the reader.
  bool evaluate(const SerializedPayload& payload, const FilterSampleInfo&, const GUID_t&) const override {
    codec_.decode({reinterpret_cast<const std::byte*>(payload.data), payload.length}, received_);
    if (!codec_.is_well_formed(received_)) return true;  // `take_next` counts it
    std::array<std::byte, 80> bytes{};
    const std::size_t size = codec_.key(received_, bytes);
    const Key key = hash_of(std::span(bytes).first(size));
    if (only_ && key != *only_) return false;
    Stamp& stamp = codec_.stamp(received_);
    const Nanoseconds time = now();
    const bool is_local = clocks_.to_local(stamp);
    if ((is_stream_ && !is_local) || (has_one_writer_ && !is_usable(stamp, time, clock_id_))) {
      refused_stamp_.fetch_add(1, std::memory_order_relaxed);
      return false;
    }
    Admitted* place = place_of(key, stamp.epoch, time);
    if (place == nullptr) {
      crowded_.fetch_add(1, std::memory_order_relaxed);
      return false;
    }
    if (has_one_writer_ && !place->followed.accept(stamp, time)) {
      second_epoch_.store(stamp.epoch, std::memory_order_relaxed);
      second_writer_.fetch_add(1, std::memory_order_relaxed);
      return false;
    }
    place->writer = stamp.epoch;
    place->last = time;
    return true;
  }
  void count(ReaderCounters& out) const {
    out.crowded = crowded_.load(std::memory_order_relaxed);
    out.refused_stamp = refused_stamp_.load(std::memory_order_relaxed);
    out.second_writer = second_writer_.load(std::memory_order_relaxed);
    out.second_epoch = second_epoch_.load(std::memory_order_relaxed);
  }

 private:
  using EncodeKey = detail::EncodeKey;
  using Key = std::array<std::uint8_t, 16>;  // the key itself, or its MD5 if it is longer
  struct Admitted {
    Key key;
    std::uint64_t writer;
    Nanoseconds last;
    FollowedWriter followed{};
  };

  static Key hash_of(std::span<const std::byte> bytes) {
    Key key{};
    if (bytes.size() <= key.size()) {
      std::memcpy(key.data(), bytes.data(), bytes.size());
      return key;
    }
    std::array<std::byte, 80> copy{};
    std::memcpy(copy.data(), bytes.data(), bytes.size());
    MD5 md5;
    md5.init();
    md5.update(reinterpret_cast<unsigned char*>(copy.data()), static_cast<unsigned int>(bytes.size()));
    md5.finalize();
    std::memcpy(key.data(), md5.digest, key.size());
    return key;
  }

  // The place of the instance. Null if there is none.
  Admitted* place_of(const Key& key, std::uint64_t writer, Nanoseconds time) const {
    std::size_t of_writer = 0;
    Admitted* oldest = nullptr;
    Admitted* oldest_of_writer = nullptr;
    for (Admitted& entry : admitted_) {
      if (entry.key == key) return &entry;
      if (oldest == nullptr || entry.last < oldest->last) oldest = &entry;
      if (entry.writer != writer) continue;
      ++of_writer;
      if (oldest_of_writer == nullptr || entry.last < oldest_of_writer->last) oldest_of_writer = &entry;
    }
    const Admitted entry{key, writer, time};
    Admitted* place = of_writer >= share_ ? oldest_of_writer : admitted_.size() >= 2 * share_ ? oldest : nullptr;
    if (place == nullptr) return &admitted_.emplace_back(entry);
    if (age_of(place->last, time).value_or(0) <= kInstanceRest) return nullptr;
    *place = entry;
    return place;
  }

  const TypeCodec& codec_;
  void* received_;
  std::size_t share_;
  bool has_one_writer_;
  bool is_stream_;
  const HostClocks& clocks_;
  std::uint32_t clock_id_;  // of this host
  std::optional<Key> only_;
  mutable std::vector<Admitted> admitted_;
  mutable std::atomic<std::uint64_t> crowded_ = 0;
  mutable std::atomic<std::uint64_t> refused_stamp_ = 0;
  mutable std::atomic<std::uint64_t> second_writer_ = 0;
  mutable std::atomic<std::uint64_t> second_epoch_ = 0;
};

/// Makes the filters of a participant known to Fast DDS.
class AdmissionFilters final : public dds::IContentFilterFactory {
 public:
  /// Other participants would use a filter of a name that they know already when they send.
  AdmissionFilters() : name_("softhand-filter-" + std::to_string(std::random_device()())) {}
  const char* name() const { return name_.c_str(); }

  dds::ContentFilteredTopic* topic(dds::DomainParticipant& participant, dds::Topic* topic, AdmissionFilter& filter) {
    const std::lock_guard lock(mutex_);
    requested_ = &filter;
    requesting_thread_ = std::this_thread::get_id();
    auto* filtered = participant.create_contentfilteredtopic(topic->get_name() + "#" + std::to_string(++count_), topic,
                                                             "filter", {}, name());
    requesting_thread_ = std::thread::id();
    return filtered;
  }
  /// A writer of the same participant asks for a filter, too. It sends everything.
  ReturnCode_t create_content_filter(const char*, const char*, const dds::TopicDataType*, const char*,
                                     const ParameterSeq&, dds::IContentFilter*& filter) override {
    filter = requesting_thread_.load() == std::this_thread::get_id() ? static_cast<dds::IContentFilter*>(requested_)
                                                                     : &everything_;
    return ReturnCode_t::RETCODE_OK;
  }
  ReturnCode_t delete_content_filter(const char*, dds::IContentFilter*) override { return ReturnCode_t::RETCODE_OK; }

 private:
  struct Everything final : dds::IContentFilter {
    bool evaluate(const SerializedPayload&, const FilterSampleInfo&, const GUID_t&) const override { return true; }
  };
  std::string name_;
  std::mutex mutex_;
  AdmissionFilter* requested_ = nullptr;
  std::atomic<std::thread::id> requesting_thread_{};
  std::uint64_t count_ = 0;
  Everything everything_;
};

#pragma GCC diagnostic pop

template <typename Qos>
void apply(Qos& qos, const TopicRow& row) {
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
  if (row.lifespan_ms > 0) qos.lifespan().duration = milliseconds(row.lifespan_ms);
  if (row.writers == Writers::strongest) qos.ownership().kind = dds::EXCLUSIVE_OWNERSHIP_QOS;
  qos.resource_limits().max_instances = row.max_instances;
  qos.resource_limits().max_samples_per_instance = row.depth;
  qos.resource_limits().max_samples = row.max_instances * row.depth;
  qos.resource_limits().allocated_samples = std::min(row.max_instances * row.depth, 8);
  // Data sharing is off anyway for keyed types. A killed process would leave its files in /dev/shm.
  qos.data_sharing().off();
}

rtps::MemoryManagementPolicy memory_policy(const TypeCodec& codec) {
  return codec.max_size() <= kPooledSize ? rtps::PREALLOCATED_MEMORY_MODE : rtps::DYNAMIC_REUSABLE_MEMORY_MODE;
}

}  // namespace

int domain_from_environment() {
  const char* text = std::getenv("SOFTHAND_DOMAIN");
  if (text == nullptr || *text == 0) return 0;
  int domain = -1;
  const char* end = text + std::strlen(text);
  const auto [rest, error] = std::from_chars(text, end, domain);
  if (error != std::errc() || rest != end || domain < 0 || domain > kMaxDomain)
    throw std::runtime_error("SOFTHAND_DOMAIN=\"" + std::string(text) + "\": expected a whole number in 0.." +
                             std::to_string(kMaxDomain) + "; if it is not set, the domain is 0");
  return domain;
}

namespace detail {

/// What a participant of ours says about itself in its user data.
std::string user_data_of(std::uint64_t epoch, const std::string& rig) {
  std::array<char, 256> host{};
  gethostname(host.data(), host.size() - 1);
  return std::string(kUserData) + std::to_string(epoch) + "\n" + std::to_string(getpid()) + "\n" + host.data() + "\n" +
         rig + "\n" + std::to_string(clock_id());
}

/// Without control characters, for logs: anybody on the domain can write user data.
std::string printable(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < 32 || c == 127; }, '?');
  return text;
}

/// Empty unless the data is that of a participant of ours.
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

/// What an endpoint of ours says about itself in its user data.
struct Endpoint {
  std::string topic, type, module;
  std::uint64_t hash = 0;  ///< of the definition of the type
  std::uint64_t epoch = 0;
  bool operator==(const Endpoint&) const = default;
};

std::string user_data_of(const Endpoint& endpoint) {
  char hash[17];
  std::snprintf(hash, sizeof hash, "%016llx", static_cast<unsigned long long>(endpoint.hash));
  return std::string(kUserData) + std::to_string(endpoint.epoch) + "\n" + hash + "\n" + endpoint.module;
}

/// Empty unless the data is that of an endpoint of ours.
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

/// Exchanges beacons with other hosts, from which `clocks` computes offsets. The reader takes the time of arrival in
/// the thread that receives the beacon.
class ClockExchange final : public dds::DataReaderListener {
 public:
  ClockExchange(HostClocks& clocks, std::uint64_t epoch, dds::DataWriter* writer) : clocks_(clocks), writer_(writer) {
    beacon_.stamp.epoch = epoch;
    beacon_.stamp.clock_id = clock_id();
    thread_ = std::thread([this] { run(); });
  }
  ~ClockExchange() override {
    {
      const std::lock_guard lock(mutex_);
      stops_ = true;
    }
    wake_.notify_all();
    thread_.join();
  }
  void on_data_available(dds::DataReader* reader) override {
    dds::SampleInfo info;
    while (reader->take_next_sample(&received_, &info) == eprosima::fastrtps::types::ReturnCode_t::RETCODE_OK) {
      if (info.valid_data && received_.well_formed) clocks_.heard(received_.value, now(), wall_clock());
    }
  }

 private:
  void run() {
    std::unique_lock lock(mutex_);
    while (!stops_) {
      const WallClock wall = wall_clock();
      beacon_.wall_offset = wall.offset;
      beacon_.wall_uncertainty = wall.uncertainty;
      clocks_.update(now(), beacon_.hosts);
      ++beacon_.stamp.sequence;
      beacon_.stamp.sample_time = beacon_.stamp.publish_time = now();
      writer_->write(&beacon_);
      wake_.wait_for(lock, kBeaconPeriod, [this] { return stops_; });
    }
  }

  HostClocks& clocks_;
  dds::DataWriter* writer_;
  ClockBeacon beacon_;
  Received<ClockBeacon> received_;  // of the receiving thread
  std::mutex mutex_;
  std::condition_variable wake_;
  bool stops_ = false;
  std::thread thread_;
};

rtps::Locator_t locator(const std::string& address, std::uint32_t port = 0) {
  rtps::Locator_t out;
  out.kind = LOCATOR_KIND_UDPv4;
  rtps::IPLocator::setIPv4(out, address);
  out.port = port;
  return out;
}

/// Sets transport and discovery of a participant.
void apply_network(dds::DomainParticipantQos& qos, const Network& network, int domain) {
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
  wire.participant_id = fresh_participant_id(multicast ? kIds : kIdsWithoutMulticast);
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
  if (multicast) discovery.initialPeersList.push_back(locator("239.255.0.1", wire.port.getMulticastPort(number)));
  for (const auto* list : {&network.addresses, &network.peers}) {
    for (const std::string& address : *list) {
      discovery.initialPeersList.push_back(locator(address));
      // A range that is twice as long has room for ids that were taken.
      for (std::uint32_t id = kFirstId; !multicast && id < kFirstId + 2 * kIdsWithoutMulticast; ++id)
        discovery.initialPeersList.push_back(locator(address, wire.port.getUnicastPort(number, id)));
    }
  }
}

/// Gives a participant the identity of a role.
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

class ParticipantImpl final : public dds::DomainParticipantListener {
 public:
  ParticipantImpl(const std::string& name, int domain, const std::string& rig, const std::string& role,
                  const Network& network)
      : clocks_(clock_id(), network.options.clock == "synchronised"),
        name_(name),
        role_(network.security.empty() ? "" : role),
        epoch_(make_epoch()) {
    peers_.reserve(kMostPeers);
    // The factory is never destroyed. Its destructor has nothing to do when our participants are gone, but sleeps 100
    // ms. When a rig stops, that would be 100 ms for each process in turn.
    static auto* const factory = (new auto(dds::DomainParticipantFactory::get_shared_instance()))->get();

    dds::DomainParticipantQos qos = dds::PARTICIPANT_QOS_DEFAULT;
    if (network.profile.empty()) {
      apply_network(qos, network, domain);
    } else {
      constexpr auto kOk = eprosima::fastrtps::types::ReturnCode_t::RETCODE_OK;
      if (factory->load_XML_profiles_file(network.profile) != kOk ||
          factory->get_participant_qos_from_profile("softhand", qos) != kOk)
        fail(network.profile + ": expected an XML file of Fast DDS with the participant profile softhand");
    }
    if (!network.security.empty()) apply_security(qos, network.security, role);
    // Readers in the writer's own process receive samples like all other readers: in the receiving threads, not inside
    // write().
    auto library = eprosima::fastrtps::xmlparser::XMLProfileManager::library_settings();
    if (library.intraprocess_delivery != eprosima::fastrtps::INTRAPROCESS_OFF) {
      library.intraprocess_delivery = eprosima::fastrtps::INTRAPROCESS_OFF;
      eprosima::fastrtps::xmlparser::XMLProfileManager::library_settings(library);
    }
    qos.name(name.c_str());
    const std::string user_data = user_data_of(epoch_, rig);
    qos.user_data().data_vec({user_data.begin(), user_data.end()});

    participant_ = factory->create_participant(static_cast<std::uint32_t>(domain), qos, this, dds::StatusMask::none());
    if (participant_ == nullptr) {
      fail("cannot join domain " + std::to_string(domain) + " on " + network.addresses.front() +
           (network.security.empty()
                ? " (is the interface up?)"
                : " as " + role + " (is the interface up, and are the files in " + network.security + " valid?)"));
    }
    participant_->register_content_filter_factory(filters_.name(), &filters_);
    publisher_ = participant_->create_publisher(dds::PUBLISHER_QOS_DEFAULT);
    subscriber_ = participant_->create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT);
    if (publisher_ == nullptr || subscriber_ == nullptr) {
      close();
      fail("cannot create a publisher and a subscriber");
    }
    if (network.leaves_host()) exchange_clocks();
  }
  ~ParticipantImpl() { close(); }
  ParticipantImpl(const ParticipantImpl&) = delete;
  ParticipantImpl& operator=(const ParticipantImpl&) = delete;

  dds::Topic* topic(const TopicRow& row, const TypeCodec& codec) {
    const std::lock_guard lock(mutex_);
    const std::string name(row.name);
    if (auto* known = dynamic_cast<dds::Topic*>(participant_->lookup_topicdescription(name))) return known;
    dds::TypeSupport type(new PlainType(codec));
    if (type.register_type(participant_) != eprosima::fastrtps::types::ReturnCode_t::RETCODE_OK)
      fail("cannot register type " + std::string(codec.name));
    dds::Topic* created = participant_->create_topic(name, codec.name, dds::TOPIC_QOS_DEFAULT);
    if (created == nullptr) fail("cannot create topic " + name);
    const std::lock_guard peers_lock(peers_mutex_);
    own_.push_back({name, codec.name, name_, codec.hash(), epoch_});
    for (const Endpoint& other : others_) compare(own_.back(), other);
    return created;
  }
  /// For the user data of an endpoint of this topic.
  std::string user_data(const TopicRow& row, const TypeCodec& codec) const {
    return user_data_of({std::string(row.name), codec.name, name_, codec.hash(), epoch_});
  }
  /// The topic behind a filter. Delete it with `remove`.
  dds::ContentFilteredTopic* topic(const TopicRow& row, const TypeCodec& codec, AdmissionFilter& filter) {
    auto* filtered = filters_.topic(*participant_, topic(row, codec), filter);
    if (filtered == nullptr) fail("cannot create the filter of " + std::string(row.name));
    return filtered;
  }
  void remove(dds::ContentFilteredTopic* topic) { participant_->delete_contentfilteredtopic(topic); }
  std::uint64_t epoch() const { return epoch_; }
  std::vector<Peer> peers() const {
    const std::lock_guard lock(peers_mutex_);
    std::vector<Peer> peers;
    for (const auto& [guid, peer] : peers_) peers.push_back(peer);
    return peers;
  }
  bool find_peer(std::uint64_t epoch, Peer& out) const noexcept {
    const std::unique_lock lock(peers_mutex_, std::try_to_lock);
    if (!lock.owns_lock()) return false;
    for (const auto& [guid, peer] : peers_) {
      if (peer.epoch != epoch) continue;
      out = peer;
      return true;
    }
    return false;
  }
  void on_participant_discovery(dds::DomainParticipant*, rtps::ParticipantDiscoveryInfo&& found) override {
    const std::lock_guard lock(peers_mutex_);
    std::erase_if(peers_, [&](const auto& each) { return each.first == found.info.m_guid; });
    if (found.status == rtps::ParticipantDiscoveryInfo::REMOVED_PARTICIPANT ||
        found.status == rtps::ParticipantDiscoveryInfo::DROPPED_PARTICIPANT || peers_.size() == kMostPeers)
      return;
    const auto& data = found.info.m_userData.data_vec();
    const auto peer =
        peer_of(found.info.m_participantName.to_string(), {reinterpret_cast<const char*>(data.data()), data.size()});
    if (peer) peers_.emplace_back(found.info.m_guid, *peer);
  }
  void on_publisher_discovery(dds::DomainParticipant*, rtps::WriterDiscoveryInfo&& found) override {
    if (found.status == rtps::WriterDiscoveryInfo::DISCOVERED_WRITER) discovered(found.info);
  }
  void on_subscriber_discovery(dds::DomainParticipant*, rtps::ReaderDiscoveryInfo&& found) override {
    if (found.status == rtps::ReaderDiscoveryInfo::DISCOVERED_READER) discovered(found.info);
  }

  void onParticipantAuthentication(dds::DomainParticipant*, rtps::ParticipantAuthenticationInfo&& info) override {
    if (info.status != rtps::ParticipantAuthenticationInfo::UNAUTHORIZED_PARTICIPANT) return;
    const std::lock_guard lock(peers_mutex_);
    if (refused_.size() == kMostPeers || !refused_.insert(info.guid.guidPrefix).second) return;
    std::ostringstream guid;
    guid << info.guid.guidPrefix;
    std::fprintf(stderr, "%s: a process without a valid identity was refused (participant %s)\n", name_.c_str(),
                 guid.str().c_str());
  }
  /// Ends a message about an endpoint that DDS refused.
  std::string possible_reason() const {
    return role_.empty() ? "" : "; the permissions of the role " + role_ + " may forbid it";
  }
  const HostClocks& clocks() const { return clocks_; }

  dds::Publisher& publisher() { return *publisher_; }
  dds::Subscriber& subscriber() { return *subscriber_; }

 private:
  template <typename Proxy>
  void discovered(const Proxy& proxy) {
    const auto& data = proxy.m_qos.m_userData.data_vec();
    const auto other = endpoint_of(proxy.topicName().to_string(), proxy.typeName().to_string(),
                                   {reinterpret_cast<const char*>(data.data()), data.size()});
    if (!other) return;
    const std::lock_guard lock(peers_mutex_);
    // A module's endpoints of one topic are reported together.
    if (others_.size() == kMostEndpoints || std::find(others_.begin(), others_.end(), *other) != others_.end()) return;
    others_.push_back(*other);
    for (const Endpoint& own : own_) compare(own, *other);
  }
  void compare(const Endpoint& own, const Endpoint& other) const {
    if (own.topic != other.topic || (own.type == other.type && own.hash == other.hash)) return;
    std::fprintf(stderr,
                 "%s: topic %s: module %s has another definition of its type: %s %016llx, here %s %016llx; expected "
                 "programs of one version\n",
                 name_.c_str(), own.topic.c_str(), other.module.c_str(), other.type.c_str(),
                 static_cast<unsigned long long>(other.hash), own.type.c_str(),
                 static_cast<unsigned long long>(own.hash));
  }
  void exchange_clocks() {
    const TopicRow& row = topics::clock_beacon;
    const TypeCodec& codec = codec_of<ClockBeacon>(row.type);
    const std::string data = user_data(row, codec);
    dds::DataWriterQos write_qos = dds::DATAWRITER_QOS_DEFAULT;
    apply(write_qos, row);
    write_qos.user_data().data_vec({data.begin(), data.end()});
    dds::DataReaderQos read_qos = dds::DATAREADER_QOS_DEFAULT;
    apply(read_qos, row);
    read_qos.user_data().data_vec({data.begin(), data.end()});
    dds::Topic* beacons = topic(row, codec);
    dds::DataWriter* writer = publisher_->create_datawriter(beacons, write_qos);
    dds::DataReader* reader = subscriber_->create_datareader(beacons, read_qos);
    if (writer == nullptr || reader == nullptr) {
      close();
      fail("cannot create a writer and a reader of " + std::string(row.name) + possible_reason());
    }
    exchange_ = std::make_unique<ClockExchange>(clocks_, epoch_, writer);
    reader->set_listener(exchange_.get(), dds::StatusMask::data_available());
    beacon_reader_ = reader;
  }
  void close() {
    participant_->set_listener(nullptr);
    if (beacon_reader_ != nullptr) beacon_reader_->set_listener(nullptr);
    exchange_.reset();
    participant_->delete_contained_entities();
    dds::DomainParticipantFactory::get_instance()->delete_participant(participant_);
  }

  std::mutex mutex_;
  AdmissionFilters filters_;
  HostClocks clocks_;
  std::unique_ptr<ClockExchange> exchange_;  // only if the network leaves this host
  dds::DataReader* beacon_reader_ = nullptr;
  dds::DomainParticipant* participant_ = nullptr;
  dds::Publisher* publisher_ = nullptr;
  dds::Subscriber* subscriber_ = nullptr;
  std::string name_;
  std::string role_;  // empty if the domain is not secured
  std::uint64_t epoch_;
  mutable std::mutex peers_mutex_;
  std::set<rtps::GuidPrefix_t> refused_;  // participants without a valid identity
  std::vector<Endpoint> own_;             // one for each topic
  std::vector<Endpoint> others_;          // one for each topic of each other module
  std::vector<std::pair<rtps::GUID_t, Peer>> peers_;
};

class WriterImpl final : public dds::DataWriterListener {
 public:
  WriterImpl(std::shared_ptr<ParticipantImpl> participant, const TopicRow& row, const TypeCodec& codec, int strength)
      : participant_(std::move(participant)), last_matters_(row.rate_hz == 0 || row.name == topics::device_state.name) {
    dds::DataWriterQos qos = dds::DATAWRITER_QOS_DEFAULT;
    apply(qos, row);
    if (row.writers == Writers::strongest)
      qos.ownership_strength().value = static_cast<std::uint32_t>(std::max(strength, 0));
    qos.endpoint().history_memory_policy = memory_policy(codec);
    // Samples of many packets are sent by a separate thread, so the writing loop does not wait.
    qos.publish_mode().kind = codec.max_size() > 60000 ? dds::ASYNCHRONOUS_PUBLISH_MODE : dds::SYNCHRONOUS_PUBLISH_MODE;
    qos.reliability().max_blocking_time = milliseconds(1);
    const std::string user_data = participant_->user_data(row, codec);
    qos.user_data().data_vec({user_data.begin(), user_data.end()});
    writer_ = participant_->publisher().create_datawriter(participant_->topic(row, codec), qos, this,
                                                          dds::StatusMask::publication_matched());
    if (writer_ == nullptr)
      fail("cannot create a writer of " + std::string(row.name) + participant_->possible_reason());
  }
  ~WriterImpl() override {
    // The notice of departure uses another socket than the data. A reader that receives the notice first drops the last
    // sample.
    if (last_matters_ && readers() > 0)
      std::this_thread::sleep_until(last_write_.load(std::memory_order_relaxed) + kLastSampleTime);
    writer_->set_listener(nullptr);
    participant_->publisher().delete_datawriter(writer_);
  }

  void write(const void* message) noexcept {
    last_write_.store(std::chrono::steady_clock::now(), std::memory_order_relaxed);
    try {
      if (writer_->write(const_cast<void*>(message))) {
        written_.fetch_add(1, std::memory_order_relaxed);
        return;
      }
    } catch (...) {
    }
    failed_.fetch_add(1, std::memory_order_relaxed);
  }
  void set_strength(int strength) noexcept {
    try {
      dds::DataWriterQos qos = writer_->get_qos();
      qos.ownership_strength().value = static_cast<std::uint32_t>(std::max(strength, 0));
      writer_->set_qos(qos);
    } catch (...) {
    }
  }
  void on_publication_matched(dds::DataWriter*, const dds::PublicationMatchedStatus& status) override {
    readers_.store(status.current_count);
  }

  int readers() const { return readers_.load(); }
  WriterCounters counters() const { return {written_.load(), failed_.load()}; }

 private:
  std::shared_ptr<ParticipantImpl> participant_;
  /// Commands, descriptions and the zero command of a device. Another stream could as well have ended one sample
  /// earlier.
  bool last_matters_;
  dds::DataWriter* writer_ = nullptr;
  std::atomic<std::chrono::steady_clock::time_point> last_write_{};
  std::atomic<int> readers_ = 0;
  std::atomic<std::uint64_t> written_ = 0;
  std::atomic<std::uint64_t> failed_ = 0;
};

class ReaderImpl final : public dds::DataReaderListener {
 public:
  ReaderImpl(std::shared_ptr<ParticipantImpl> participant, const TopicRow& row, const TypeCodec& codec,
             const std::optional<HandKey>& only)
      : participant_(std::move(participant)),
        codec_(codec),
        has_lease_(row.liveliness_ms > 0),
        most_samples_(2 * row.max_instances * row.depth) {
    dds::DataReaderQos qos = dds::DATAREADER_QOS_DEFAULT;
    // Fast DDS 2.9 first puts a sample into the history and then checks the owner. It then removes the sample of a
    // weaker writer. Without extra depth, the weaker sample would push out an unread sample of the owner.
    TopicRow adjusted = row;
    if (row.writers == Writers::strongest) adjusted.depth = std::max(row.depth, kOwnersDepth);
    const bool has_key = codec.max_key_size() > 0;
    if (has_key) adjusted.max_instances = kHistoryInstances;
    apply(qos, adjusted);
    // The buffers may grow. Then a payload that is too long reaches our decoder, which refuses and counts it.
    const auto policy = memory_policy(codec);
    qos.endpoint().history_memory_policy =
        policy == rtps::PREALLOCATED_MEMORY_MODE ? rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE : policy;
    dds::StatusMask mask = dds::StatusMask::subscription_matched();
    mask << dds::StatusMask::liveliness_changed() << dds::StatusMask::requested_deadline_missed()
         << dds::StatusMask::sample_lost();
    dds::TopicDescription* topic = participant_->topic(row, codec);
    if (has_key) {
      filter_.emplace(codec, row, only, participant_->clocks());
      topic = filtered_ = participant_->topic(row, codec, *filter_);
    }
    const std::string user_data = participant_->user_data(row, codec);
    qos.user_data().data_vec({user_data.begin(), user_data.end()});
    reader_ = participant_->subscriber().create_datareader(topic, qos, this, mask);
    if (reader_ == nullptr && filtered_ != nullptr) participant_->remove(filtered_);
    if (reader_ == nullptr)
      fail("cannot create a reader of " + std::string(row.name) + participant_->possible_reason());
  }
  ~ReaderImpl() override {
    reader_->set_listener(nullptr);
    participant_->subscriber().delete_datareader(reader_);
    if (filtered_ != nullptr) participant_->remove(filtered_);
  }

  bool take_next(void* received, std::int64_t& source_time, const bool& well_formed, int& left) noexcept {
    try {
      dds::SampleInfo info;
      while (left-- > 0 &&
             reader_->take_next_sample(received, &info) == eprosima::fastrtps::types::ReturnCode_t::RETCODE_OK) {
        if (!info.valid_data) continue;  // state change of an instance, without content
        if (!well_formed) {
          refused_.fetch_add(1, std::memory_order_relaxed);
          continue;
        }
        participant_->clocks().to_local(codec_.stamp(received));
        received_.fetch_add(1, std::memory_order_relaxed);
        source_time = info.source_timestamp.to_ns();
        return true;
      }
    } catch (...) {
    }
    return false;
  }
  bool wait(std::chrono::nanoseconds timeout) noexcept {
    const auto ns = std::max<std::int64_t>(timeout.count(), 0);
    return reader_->wait_for_unread_message(
        Duration_t(static_cast<std::int32_t>(ns / 1000000000), static_cast<std::uint32_t>(ns % 1000000000)));
  }

  void on_subscription_matched(dds::DataReader*, const dds::SubscriptionMatchedStatus& status) override {
    writers_.store(status.current_count);
  }
  void on_liveliness_changed(dds::DataReader*, const eprosima::fastrtps::LivelinessChangedStatus& status) override {
    live_.store(status.alive_count);
  }
  void on_requested_deadline_missed(dds::DataReader*,
                                    const eprosima::fastrtps::RequestedDeadlineMissedStatus& status) override {
    deadline_missed_.store(static_cast<std::uint64_t>(status.total_count));
  }
  void on_sample_lost(dds::DataReader*, const dds::SampleLostStatus& status) override {
    lost_.store(static_cast<std::uint64_t>(status.total_count));
  }

  int most_samples() const { return most_samples_; }
  int writers() const { return writers_.load(); }
  int live_writers() const { return has_lease_ ? live_.load() : writers_.load(); }
  ReaderCounters counters() const {
    ReaderCounters counters{received_.load(), refused_.load(), lost_.load(), deadline_missed_.load()};
    if (filter_) filter_->count(counters);
    return counters;
  }

 private:
  std::shared_ptr<ParticipantImpl> participant_;
  const TypeCodec& codec_;
  bool has_lease_;
  int most_samples_;
  std::optional<AdmissionFilter> filter_;  // outlives the reader
  dds::ContentFilteredTopic* filtered_ = nullptr;
  dds::DataReader* reader_ = nullptr;
  std::atomic<int> writers_ = 0;
  std::atomic<int> live_ = 0;
  std::atomic<std::uint64_t> received_ = 0;
  std::atomic<std::uint64_t> refused_ = 0;
  std::atomic<std::uint64_t> lost_ = 0;
  std::atomic<std::uint64_t> deadline_missed_ = 0;
};

WriterEndpoint::WriterEndpoint(const Participant& participant, const TopicRow& topic, const TypeCodec& codec,
                               int strength)
    : impl_(std::make_unique<WriterImpl>(participant.impl(), topic, codec, strength)) {}
WriterEndpoint::~WriterEndpoint() = default;
WriterEndpoint::WriterEndpoint(WriterEndpoint&&) noexcept = default;
WriterEndpoint& WriterEndpoint::operator=(WriterEndpoint&&) noexcept = default;
void WriterEndpoint::write(const void* message) noexcept { impl_->write(message); }
void WriterEndpoint::set_strength(int strength) noexcept { impl_->set_strength(strength); }
int WriterEndpoint::reader_count() const noexcept { return impl_->readers(); }
WriterCounters WriterEndpoint::counters() const noexcept { return impl_->counters(); }

ReaderEndpoint::ReaderEndpoint(const Participant& participant, const TopicRow& topic, const TypeCodec& codec,
                               const std::optional<HandKey>& only)
    : impl_(std::make_unique<ReaderImpl>(participant.impl(), topic, codec, only)) {}
ReaderEndpoint::~ReaderEndpoint() = default;
ReaderEndpoint::ReaderEndpoint(ReaderEndpoint&&) noexcept = default;
ReaderEndpoint& ReaderEndpoint::operator=(ReaderEndpoint&&) noexcept = default;
bool ReaderEndpoint::take_next(void* received, const bool& well_formed, std::int64_t& source_time, int& left) noexcept {
  return impl_->take_next(received, source_time, well_formed, left);
}
int ReaderEndpoint::most_samples() const noexcept { return impl_->most_samples(); }
bool ReaderEndpoint::wait(std::chrono::nanoseconds timeout) noexcept { return impl_->wait(timeout); }
int ReaderEndpoint::writer_count() const noexcept { return impl_->writers(); }
int ReaderEndpoint::live_writer_count() const noexcept { return impl_->live_writers(); }
ReaderCounters ReaderEndpoint::counters() const noexcept { return impl_->counters(); }

}  // namespace detail

Participant::Participant(const std::string& name, int domain, const std::string& rig, const std::string& role,
                         const Network& network)
    : impl_(std::make_shared<detail::ParticipantImpl>(name, domain, rig, role, network)) {}
BoundedVector<HostClock, kMaxHosts> Participant::clocks() const noexcept { return impl_->clocks().hosts(); }
std::uint64_t Participant::epoch() const { return impl_->epoch(); }
std::vector<Peer> Participant::peers() const { return impl_->peers(); }
bool Participant::find_peer(std::uint64_t epoch, Peer& out) const noexcept { return impl_->find_peer(epoch, out); }

}  // namespace softhand::bus
