// Quality of service of participants and endpoints.
#pragma once

#include <cstdint>
#include <fastdds/dds/domain/qos/DomainParticipantQos.hpp>
#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>
#include <string>

#include "bus/bus.hpp"
#include "bus/network.hpp"

namespace softhand::bus::detail {

inline eprosima::fastrtps::Duration_t milliseconds(int ms) {
  return {ms / 1000, static_cast<std::uint32_t>(ms % 1000) * 1000000u};
}

/// What docs/topics.md says about the topic.
void apply(eprosima::fastdds::dds::DataWriterQos& qos, const TopicRow& row);
void apply(eprosima::fastdds::dds::DataReaderQos& qos, const TopicRow& row);
/// Of the history of an endpoint.
eprosima::fastrtps::rtps::MemoryManagementPolicy_t memory_policy(const TypeCodec& codec);

/// A participant id, and with it a port number, that no other participant of this process has. A process with the same
/// name that was just killed most likely did not have it. Otherwise peers take the new process for the old one until
/// its lease ends, and do not answer for seconds. If another process has the id, Fast DDS takes the next free port.
class ParticipantId {
 public:
  /// Throws std::runtime_error if the process has too many participants.
  explicit ParticipantId(const Network& network);
  ~ParticipantId();
  ParticipantId(const ParticipantId&) = delete;
  ParticipantId& operator=(const ParticipantId&) = delete;
  std::int32_t value() const;

 private:
  std::uint32_t place_ = 0;  // in the range of ids
};

/// Sets id, transport and discovery of a participant. With multicast, throws std::runtime_error if another program
/// has the port through which processes find each other.
void apply_network(eprosima::fastdds::dds::DomainParticipantQos& qos, const Network& network, int domain,
                   std::int32_t participant_id);
/// Gives a participant the identity of a role. `folder`: the files of the secured domain.
void apply_security(eprosima::fastdds::dds::DomainParticipantQos& qos, const std::string& folder,
                    const std::string& role);

}  // namespace softhand::bus::detail
