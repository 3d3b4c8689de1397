#include "bus/peers.hpp"

#include <algorithm>
#include <cstdio>

namespace softhand::bus::detail {

static constexpr std::size_t kMostPeers = 256;  // anybody on the domain can invent participants

Peers::Peers() { peers_.reserve(kMostPeers); }

void Peers::set(const eprosima::fastrtps::rtps::GUID_t& guid, const std::optional<Peer>& peer) {
  const std::lock_guard lock(mutex_);
  std::erase_if(peers_, [&](const auto& each) { return each.first == guid; });
  if (peer && peers_.size() < kMostPeers) peers_.emplace_back(guid, *peer);
}

std::vector<Peer> Peers::all() const {
  const std::lock_guard lock(mutex_);
  std::vector<Peer> peers;
  for (const auto& [guid, peer] : peers_) peers.push_back(peer);
  return peers;
}

void Peers::note_second_writer(std::string_view topic, std::uint64_t epoch) noexcept {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock.owns_lock()) return;
  const std::string_view name = topic.substr(topic.rfind('/') + 1);
  const auto width = static_cast<int>(name.size());
  const auto found =
      std::find_if(peers_.begin(), peers_.end(), [epoch](const auto& each) { return each.second.epoch == epoch; });
  if (found != peers_.end()) {
    const Peer& peer = found->second;
    std::snprintf(second_writer_.data(), second_writer_.size(), "%.*s: %.40s, process %d on %.40s", width, name.data(),
                  peer.name.data(), peer.process_id, peer.host.data());
  } else {
    std::snprintf(second_writer_.data(), second_writer_.size(), "%.*s: unknown, epoch %016llx", width, name.data(),
                  static_cast<unsigned long long>(epoch));
  }
}

SecondWriterText Peers::second_writer() const noexcept {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  return lock.owns_lock() ? second_writer_ : SecondWriterText{};
}

}  // namespace softhand::bus::detail
