// The other processes of the domain, and the name of the last one that disturbed a reader.
#pragma once

#include <fastdds/rtps/common/Guid.h>

#include <cstdint>
#include <mutex>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "bus/bus.hpp"

namespace softhand::bus::detail {

/// Thread-safe.
class Peers {
 public:
  Peers();
  /// A participant appeared, changed or left. Empty: it left, or it does not use this library.
  void set(const eprosima::fastrtps::rtps::GUID_t& guid, const std::optional<Peer>& peer);
  std::vector<Peer> all() const;

  /// A reader of `topic` refused a sample of a second writer with this epoch. Keeps the text, because the process may
  /// leave. Does not wait or allocate. If another thread uses the list, the next refused sample brings the text.
  void note_second_writer(std::string_view topic, std::uint64_t epoch) noexcept;
  /// See `Participant::second_writer`.
  SecondWriterText second_writer() const noexcept;

 private:
  mutable std::mutex mutex_;
  std::vector<std::pair<eprosima::fastrtps::rtps::GUID_t, Peer>> peers_;
  SecondWriterText second_writer_{};
};

}  // namespace softhand::bus::detail
