// Which samples enter a reader.
#pragma once

#include <atomic>
#include <cstdint>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/topic/ContentFilteredTopic.hpp>
#include <fastdds/dds/topic/IContentFilter.hpp>
#include <fastdds/dds/topic/IContentFilterFactory.hpp>
#include <mutex>
#include <optional>
#include <string_view>
#include <vector>

#include "bus/bus.hpp"
#include "bus/host_clocks.hpp"
#include "bus/peers.hpp"
#include "bus/plain_type.hpp"
#include "messages/followed_writer.hpp"
#include "runtime/clock.hpp"

namespace softhand::bus::detail {

// The interfaces of Fast DDS have no virtual destructors. Nobody deletes through them.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wnon-virtual-dtor"

/// Decides which samples enter a reader, in the receiving threads and before the sample is stored. Malformed samples
/// stay outside, so that they do not displace others. Samples about other hands stay outside if the reader is about one
/// hand. Anybody on the domain can invent instances (users, module names). So a single writer gets at most
/// `TopicRow::max_instances` of them, and the reader has room for twice as many. A new instance takes the place of one
/// that rests. The filter refuses streams of hosts whose clock is not known. On topics with one writer it follows one
/// writer of each instance, and refuses stamps that are not usable. Fast DDS 2.9 does not tell a filter who wrote a
/// sample. So the epoch in the sample stands for the writer.
class AdmissionFilter final : public eprosima::fastdds::dds::IContentFilter {
 public:
  AdmissionFilter(const TypeCodec& codec, const TopicRow& row, const std::optional<HandKey>& only,
                  const HostClocks& clocks, Peers& peers);
  ~AdmissionFilter() { codec_.destroy_received(received_); }
  AdmissionFilter(const AdmissionFilter&) = delete;
  AdmissionFilter& operator=(const AdmissionFilter&) = delete;

  /// DDS calls it under the lock of the reader.
  bool evaluate(const SerializedPayload& payload, const FilterSampleInfo&, const GUID_t&) const override;
  /// Adds what the filter refused.
  void count(ReaderCounters& out) const;

 private:
  struct Admitted {
    KeyHash key;
    std::uint64_t writer;
    Nanoseconds last;
    FollowedWriter followed{};
  };

  // The place of the instance. Null if there is none.
  Admitted* place_of(const KeyHash& key, std::uint64_t writer, Nanoseconds time) const;

  const TypeCodec& codec_;
  std::string_view topic_;
  void* received_;
  std::size_t share_;
  bool has_one_writer_;
  bool is_stream_;
  const HostClocks& clocks_;
  Peers& peers_;
  std::uint32_t clock_id_;  // of this host
  std::optional<KeyHash> only_;
  mutable std::vector<Admitted> admitted_;
  mutable std::atomic<std::uint64_t> malformed_ = 0;
  mutable std::atomic<std::uint64_t> crowded_ = 0;
  mutable std::atomic<std::uint64_t> refused_stamp_ = 0;
  mutable std::atomic<std::uint64_t> second_writer_ = 0;
};

/// Makes the filters of a participant known to Fast DDS.
class AdmissionFilters final : public eprosima::fastdds::dds::IContentFilterFactory {
 public:
  static constexpr const char* kName = "softhand-filter";

  eprosima::fastdds::dds::ContentFilteredTopic* topic(eprosima::fastdds::dds::DomainParticipant& participant,
                                                      eprosima::fastdds::dds::Topic* topic, AdmissionFilter& filter);
  /// Called by `topic`. Writers do not apply the filters of readers (qos.cpp).
  ReturnCode_t create_content_filter(const char*, const char*, const eprosima::fastdds::dds::TopicDataType*,
                                     const char*, const ParameterSeq&,
                                     eprosima::fastdds::dds::IContentFilter*& filter) override;
  ReturnCode_t delete_content_filter(const char*, eprosima::fastdds::dds::IContentFilter*) override {
    return ReturnCode_t::RETCODE_OK;
  }

 private:
  std::mutex mutex_;
  AdmissionFilter* requested_ = nullptr;
  std::uint64_t count_ = 0;
};

#pragma GCC diagnostic pop

}  // namespace softhand::bus::detail
