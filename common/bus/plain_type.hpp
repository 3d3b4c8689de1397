// Our plain structs as a type of Fast DDS.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <functional>
#include <span>

#include "bus/bus.hpp"

namespace softhand::bus::detail {

/// The key of an instance on the wire: the encoded key itself, or its MD5 if it is longer than 16 bytes.
using KeyHash = std::array<std::uint8_t, 16>;
/// `key`: the encoded key, at most `kMostKeyBytes`. With `as_md5`, a short key is hashed too.
KeyHash key_hash(std::span<const std::byte> key, bool as_md5 = false);
inline constexpr std::size_t kMostKeyBytes = 80;

/// Lets Fast DDS send and receive our plain structs.
class PlainType final : public eprosima::fastdds::dds::TopicDataType {
 public:
  explicit PlainType(const TypeCodec& codec);
  bool serialize(void* message, eprosima::fastrtps::rtps::SerializedPayload_t* payload) override;
  bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* payload, void* received) override;
  std::function<std::uint32_t()> getSerializedSizeProvider(void* message) override;
  void* createData() override { return codec_.create_received(); }
  void deleteData(void* received) override { codec_.destroy_received(received); }
  bool getKey(void* message, eprosima::fastrtps::rtps::InstanceHandle_t* handle, bool force_md5) override;
  bool is_bounded() const override { return false; }  // with true, the readers' buffers could not grow, see ReaderImpl
  bool is_plain() const override { return false; }

 private:
  const TypeCodec& codec_;
};

}  // namespace softhand::bus::detail
