#include "bus/plain_type.hpp"

#include <fastrtps/utils/md5.h>

#include <cstring>

namespace softhand::bus::detail {

namespace rtps = eprosima::fastrtps::rtps;

KeyHash key_hash(std::span<const std::byte> key, bool as_md5) {
  KeyHash hash{};
  if (!as_md5 && key.size() <= hash.size()) {
    std::memcpy(hash.data(), key.data(), key.size());
    return hash;
  }
  std::array<std::byte, kMostKeyBytes> copy{};
  std::memcpy(copy.data(), key.data(), key.size());
  MD5 md5;
  md5.init();
  md5.update(reinterpret_cast<unsigned char*>(copy.data()), static_cast<unsigned int>(key.size()));
  md5.finalize();
  std::memcpy(hash.data(), md5.digest, hash.size());
  return hash;
}

PlainType::PlainType(const TypeCodec& codec) : codec_(codec) {
  m_typeSize = static_cast<std::uint32_t>(codec.max_size() + 3);  // the payload may be padded to a multiple of 4
  m_isGetKeyDefined = codec.max_key_size() > 0;
  setName(codec.name);
  // Cyclone and Fast disagree about type information. Without it, types match by name.
  auto_fill_type_information(false);
  auto_fill_type_object(false);
}

bool PlainType::serialize(void* message, rtps::SerializedPayload_t* payload) {
  const std::size_t size = codec_.encode(message, {reinterpret_cast<std::byte*>(payload->data), payload->max_size});
  payload->length = static_cast<std::uint32_t>(size);
  payload->encapsulation = CDR_LE;
  return size > 0;
}

bool PlainType::deserialize(rtps::SerializedPayload_t* payload, void* received) {
  codec_.decode({reinterpret_cast<const std::byte*>(payload->data), payload->length}, received);
  return true;  // `well_formed` in the sample reports errors; with false the sample would stay in the history
}

std::function<std::uint32_t()> PlainType::getSerializedSizeProvider(void* message) {
  return [this, message] { return static_cast<std::uint32_t>(codec_.size(message)); };
}

bool PlainType::getKey(void* message, rtps::InstanceHandle_t* handle, bool force_md5) {
  if (!m_isGetKeyDefined) return false;
  std::array<std::byte, kMostKeyBytes> key{};
  const std::size_t size = codec_.key(message, key);
  const KeyHash hash = key_hash(std::span(key).first(size), force_md5 || codec_.max_key_size() > 16);
  for (std::size_t i = 0; i < hash.size(); ++i) handle->value[i] = hash[i];
  return true;
}

}  // namespace softhand::bus::detail
