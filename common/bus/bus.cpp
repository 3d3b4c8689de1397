#include "bus/bus.hpp"

#include <fastrtps/xmlparser/XMLProfileManager.h>

#include <algorithm>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cstdio>
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
#include <mutex>
#include <optional>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "bus/admission.hpp"
#include "bus/clock_exchange.hpp"
#include "bus/definitions.hpp"
#include "bus/host_clocks.hpp"
#include "bus/peers.hpp"
#include "bus/plain_type.hpp"
#include "bus/qos.hpp"
#include "bus/user_data.hpp"
#include "messages/age.hpp"
#include "runtime/clock.hpp"

namespace softhand::bus {
namespace {

namespace dds = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using eprosima::fastrtps::Duration_t;

/// Cyclone DDS cannot read the governance of a secured domain above this one.
constexpr int kMaxDomain = 230;
/// A writer lives at least this long after a last sample that matters. 20 ms were once too short on a machine with six
/// busy threads per core.
constexpr std::chrono::milliseconds kLastSampleTime{100};
constexpr int kOwnersDepth = 4;            ///< history depth of readers of exclusive topics
constexpr std::size_t kMostRefused = 256;  ///< anybody on the domain can invent participants
/// Largest number of instances in the history of a keyed reader. Fast DDS 2.9 never forgets an instance whose writer is
/// alive, not even one without samples, and refuses every new one when it has reached its limit. So this limit must be
/// out of reach. `AdmissionFilter` bounds what comes in.
constexpr int kHistoryInstances = 100000;

[[noreturn]] void fail(const std::string& what) { throw std::runtime_error("DDS: " + what); }

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

class ParticipantImpl final : public dds::DomainParticipantListener {
 public:
  ParticipantImpl(const std::string& name, int domain, const std::string& rig, const std::string& role,
                  const Network& network)
      : clocks_(clock_id(), network.options.clock == "synchronised"),
        name_(name),
        role_(network.security.empty() ? "" : role),
        epoch_(make_epoch()),
        definitions_(name) {
    // The factory is never destroyed. Its destructor has nothing to do when our participants are gone, but sleeps 100
    // ms. When a rig stops, that would be 100 ms for each process in turn.
    static auto* const factory = (new auto(dds::DomainParticipantFactory::get_shared_instance()))->get();

    dds::DomainParticipantQos qos = dds::PARTICIPANT_QOS_DEFAULT;
    if (network.profile.empty()) {
      apply_network(qos, network, domain, id_.emplace(network).value());
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
    participant_->register_content_filter_factory(AdmissionFilters::kName, &filters_);
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
    definitions_.add_own({name, codec.name, name_, codec.hash(), epoch_});
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
  void on_participant_discovery(dds::DomainParticipant*, rtps::ParticipantDiscoveryInfo&& found) override {
    const bool has_left = found.status == rtps::ParticipantDiscoveryInfo::REMOVED_PARTICIPANT ||
                          found.status == rtps::ParticipantDiscoveryInfo::DROPPED_PARTICIPANT;
    const auto& data = found.info.m_userData.data_vec();
    peers_.set(found.info.m_guid, has_left ? std::nullopt
                                           : peer_of(found.info.m_participantName.to_string(),
                                                     {reinterpret_cast<const char*>(data.data()), data.size()}));
  }
  void on_publisher_discovery(dds::DomainParticipant*, rtps::WriterDiscoveryInfo&& found) override {
    if (found.status == rtps::WriterDiscoveryInfo::DISCOVERED_WRITER) appeared(found.info);
    if (found.status == rtps::WriterDiscoveryInfo::REMOVED_WRITER) left(found.info);
  }
  void on_subscriber_discovery(dds::DomainParticipant*, rtps::ReaderDiscoveryInfo&& found) override {
    if (found.status == rtps::ReaderDiscoveryInfo::DISCOVERED_READER) appeared(found.info);
    if (found.status == rtps::ReaderDiscoveryInfo::REMOVED_READER) left(found.info);
  }

  void onParticipantAuthentication(dds::DomainParticipant*, rtps::ParticipantAuthenticationInfo&& info) override {
    if (info.status != rtps::ParticipantAuthenticationInfo::UNAUTHORIZED_PARTICIPANT) return;
    const std::lock_guard lock(refused_mutex_);
    if (refused_.size() == kMostRefused || !refused_.insert(info.guid.guidPrefix).second) return;
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
  Peers& peers() { return peers_; }

  dds::Publisher& publisher() { return *publisher_; }
  dds::Subscriber& subscriber() { return *subscriber_; }

 private:
  template <typename Proxy>
  static std::optional<Endpoint> endpoint_of_proxy(const Proxy& proxy) {
    const auto& data = proxy.m_qos.m_userData.data_vec();
    return endpoint_of(proxy.topicName().to_string(), proxy.typeName().to_string(),
                       {reinterpret_cast<const char*>(data.data()), data.size()});
  }
  template <typename Proxy>
  void appeared(const Proxy& proxy) {
    if (const auto endpoint = endpoint_of_proxy(proxy)) definitions_.add(*endpoint);
  }
  template <typename Proxy>
  void left(const Proxy& proxy) {
    if (const auto endpoint = endpoint_of_proxy(proxy)) definitions_.remove(*endpoint);
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
  std::optional<ParticipantId> id_;  // empty: the profile sets it
  Definitions definitions_;
  Peers peers_;
  std::mutex refused_mutex_;
  std::set<rtps::GuidPrefix_t> refused_;  // participants without a valid identity
};

class WriterImpl final : public dds::DataWriterListener {
 public:
  WriterImpl(std::shared_ptr<ParticipantImpl> participant, const TopicRow& row, const TypeCodec& codec, int strength)
      : participant_(std::move(participant)), last_matters_(row.rate_hz == 0 || row.last_matters) {
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
  bool last_matters_;  // another stream could as well have ended one sample earlier
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
        stays_readable_(row.durability == Durability::transient_local),
        lifespan_(1e-3 * row.lifespan_ms),
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
      filter_.emplace(codec, row, only, participant_->clocks(), participant_->peers());
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
        Stamp& stamp = codec_.stamp(received);
        const bool is_local = participant_->clocks().to_local(stamp);
        // Descriptions and messages of an unknown clock are of use without a time. A time of that clock would mislead.
        if (!is_local && stays_readable_) stamp.sample_time = 0;
        if (is_local && has_outlived(stamp)) {
          outlived_.fetch_add(1, std::memory_order_relaxed);
          continue;
        }
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
    counters.refused_stamp += outlived_.load();
    return counters;
  }

 private:
  /// Whether the sample is older than its topic allows, or from the future. `stamp` has times of this host's clock. A
  /// publish time of 0 is unknown.
  bool has_outlived(const Stamp& stamp) const {
    if (lifespan_ == 0 || stamp.publish_time == 0) return false;
    const std::optional<double> age = age_of(stamp.publish_time, now());
    return !age || *age > lifespan_;
  }

  std::shared_ptr<ParticipantImpl> participant_;
  const TypeCodec& codec_;
  bool has_lease_;
  bool stays_readable_;
  double lifespan_;  // s; 0: without end
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
  std::atomic<std::uint64_t> outlived_ = 0;
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
std::uint64_t Participant::refused_beacons() const noexcept { return impl_->clocks().refused(); }
std::uint64_t Participant::epoch() const { return impl_->epoch(); }
std::vector<Peer> Participant::peers() const { return impl_->peers().all(); }
SecondWriterText Participant::second_writer() const noexcept { return impl_->peers().second_writer(); }

}  // namespace softhand::bus
