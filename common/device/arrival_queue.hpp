// Packets on their way from a thread that receives them to the loop that decodes them, and back.
#pragma once

#include <array>
#include <atomic>
#include <cstring>
#include <functional>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "device/latest_value.hpp"
#include "messages/messages.hpp"

namespace softhand {

/// A packet of a device: a datagram, a message, or a line of a stream without its end.
struct Arrival {
  std::string_view bytes;        ///< valid while the packet is taken
  Nanoseconds time = 0;          ///< receive time of its last byte
  std::uint64_t connection = 0;  ///< new for each connection; 0 = UDP
  bool binary = false;           ///< of a WebSocket message; false for all others
};

/// Turns a packet into the bytes that wait for the taker, in the thread that pushes. So a decoder that allocates does
/// not run in a loop. The bytes are valid until its next call. Empty: nothing waits.
using Translate = std::function<std::string_view(const Arrival&)>;

/// For packets that were translated to a value: its bytes, and the value in a packet.
template <typename T>
std::string_view packet_of(const T& value) {
  static_assert(std::is_trivially_copyable_v<T>);
  return {reinterpret_cast<const char*>(&value), sizeof value};
}
template <typename T>
T value_in(const Arrival& packet) {
  static_assert(std::is_trivially_copyable_v<T>);
  T value;
  std::memcpy(&value, packet.bytes.data(), sizeof value);
  return value;
}

/// One thread pushes and one thread takes. Neither waits, locks or allocates.
class ArrivalQueue {
 public:
  /// `largest`: bytes of a packet. `slots`: packets that can wait.
  explicit ArrivalQueue(std::size_t largest, std::size_t slots = 64)
      : largest_(largest), bytes_(slots * largest), slots_(slots) {}

  /// Call it before the first `push`.
  void translate(Translate translate) { translate_ = std::move(translate); }
  /// Copies the packet, or what it was translated to. A full queue drops it and counts it as passed over: the taker
  /// does not keep up.
  void push(Arrival packet) {
    if (translate_) packet.bytes = translate_(packet);
    if (translate_ && packet.bytes.empty()) return;
    if (!try_push(packet)) passed_over_.fetch_add(1, std::memory_order_relaxed);
  }
  /// Copies the packet as it is. Returns false if the queue is full or the packet too large.
  bool try_push(const Arrival& packet) {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_.load(std::memory_order_acquire) == slots_.size() || packet.bytes.size() > largest_) return false;
    char* place = bytes_.data() + tail % slots_.size() * largest_;
    std::memcpy(place, packet.bytes.data(), packet.bytes.size());
    slots_[tail % slots_.size()] = packet;
    slots_[tail % slots_.size()].bytes = {place, packet.bytes.size()};
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }
  /// Calls f(const Arrival&) for each waiting packet, oldest first.
  template <typename F>
  void take(F&& f) {
    std::size_t head = head_.load(std::memory_order_relaxed);
    // Packets that arrive meanwhile wait for the next call, so that a flood does not hold a loop.
    const std::size_t tail = tail_.load(std::memory_order_acquire);
    for (; head != tail; ++head) {
      f(static_cast<const Arrival&>(slots_[head % slots_.size()]));
      head_.store(head + 1, std::memory_order_release);
    }
  }
  std::uint64_t passed_over() const { return passed_over_.load(std::memory_order_relaxed); }

 private:
  std::size_t largest_;
  Translate translate_;
  std::vector<char> bytes_;
  std::vector<Arrival> slots_;
  std::atomic<std::size_t> head_{0}, tail_{0};
  std::atomic<std::uint64_t> passed_over_{0};
};

/// Packets on their way to a device. While the queue is full, the newest packet waits beside it: it may be the zero
/// after which nothing is sent. One thread pushes and one thread takes. Neither waits, locks or allocates.
class SendQueue {
 public:
  SendQueue(std::size_t largest, std::size_t slots)
      : largest_(largest), queue_(largest, slots), bytes_(newest_.size() * largest) {}

  /// Copies the packet. It may replace the one beside the queue.
  void push(const Arrival& packet) {
    if (packet.bytes.size() > largest_) {
      ++superseded_;
      return;
    }
    // While a packet waits beside the queue, no newer one may enter the queue: it would overtake.
    if (!slot_.is_offered() && queue_.try_push(packet)) return;
    const std::size_t at = slot_.to_fill();
    char* place = bytes_.data() + at * largest_;
    std::memcpy(place, packet.bytes.data(), packet.bytes.size());
    newest_[at] = packet;
    newest_[at].bytes = {place, packet.bytes.size()};
    if (slot_.offer()) ++superseded_;
  }
  /// Calls f(const Arrival&) for each waiting packet, oldest first.
  template <typename F>
  void take(F&& f) {
    // Asked before the queue is taken: then all older packets are in it.
    const bool is_beside = slot_.is_offered();
    queue_.take(f);
    if (is_beside) f(static_cast<const Arrival&>(newest_[slot_.take()]));
  }
  /// Packets that a newer one replaced, or that were too large.
  std::uint64_t superseded() const { return superseded_.load(std::memory_order_relaxed); }

 private:
  std::size_t largest_;
  ArrivalQueue queue_;
  std::array<Arrival, 3> newest_;
  std::vector<char> bytes_;  // of newest_
  LatestSlot slot_;
  std::atomic<std::uint64_t> superseded_{0};
};

}  // namespace softhand
