#include "bus/admission.hpp"

#include <array>
#include <span>
#include <string>

#include "messages/age.hpp"
#include "messages/convert.hpp"

namespace softhand::bus::detail {

namespace dds = eprosima::fastdds::dds;

// An instance without a sample for this time makes room for another.
static constexpr double kInstanceRest = 1;  // s

AdmissionFilter::AdmissionFilter(const TypeCodec& codec, const TopicRow& row, const std::optional<HandKey>& only,
                                 const HostClocks& clocks, Peers& peers)
    : codec_(codec),
      topic_(row.name),
      received_(codec.create_received()),
      share_(static_cast<std::size_t>(row.max_instances)),
      has_one_writer_(row.writers == Writers::one),
      is_stream_(row.writers != Writers::any),
      clocks_(clocks),
      peers_(peers),
      clock_id_(clock_id()) {
  admitted_.reserve(2 * share_);
  if (only) {
    EncodeKey key;
    key(*only);
    only_ = key_hash(std::span(key.bytes).first(key.size));
  }
}

bool AdmissionFilter::evaluate(const SerializedPayload& payload, const FilterSampleInfo&, const GUID_t&) const {
  if (payload.length == 0) return false;  // an instance was disposed or unregistered; there is no content
  codec_.decode({reinterpret_cast<const std::byte*>(payload.data), payload.length}, received_);
  if (!codec_.is_well_formed(received_)) {
    malformed_.fetch_add(1, std::memory_order_relaxed);
    return false;
  }
  std::array<std::byte, kMostKeyBytes> bytes{};
  const std::size_t size = codec_.key(received_, bytes);
  const KeyHash key = key_hash(std::span(bytes).first(size));
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
    peers_.note_second_writer(topic_, stamp.epoch);
    second_writer_.fetch_add(1, std::memory_order_release);
    return false;
  }
  place->writer = stamp.epoch;
  place->last = time;
  return true;
}

void AdmissionFilter::count(ReaderCounters& out) const {
  out.refused += malformed_.load(std::memory_order_relaxed);
  out.crowded = crowded_.load(std::memory_order_relaxed);
  out.refused_stamp = refused_stamp_.load(std::memory_order_relaxed);
  out.second_writer = second_writer_.load(std::memory_order_acquire);
}

AdmissionFilter::Admitted* AdmissionFilter::place_of(const KeyHash& key, std::uint64_t writer, Nanoseconds time) const {
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

dds::ContentFilteredTopic* AdmissionFilters::topic(dds::DomainParticipant& participant, dds::Topic* topic,
                                                   AdmissionFilter& filter) {
  const std::lock_guard lock(mutex_);
  requested_ = &filter;
  return participant.create_contentfilteredtopic(topic->get_name() + "#" + std::to_string(++count_), topic, "filter",
                                                 {}, kName);
}

AdmissionFilters::ReturnCode_t AdmissionFilters::create_content_filter(const char*, const char*,
                                                                       const dds::TopicDataType*, const char*,
                                                                       const ParameterSeq&,
                                                                       dds::IContentFilter*& filter) {
  filter = requested_;
  return ReturnCode_t::RETCODE_OK;
}

}  // namespace softhand::bus::detail
