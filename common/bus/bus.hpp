// Publish and subscribe over DDS with plain structs. This header includes no DDS header.
//
// How a process uses it:
// 1. `bus::Participant participant("tracking");` joins the domain.
// 2. `bus::Reader tracked(participant, bus::topics::tracked_skeleton, HandKey{0, 1});` reads a topic.
// 3. `bus::Writer intermediate(participant, bus::topics::intermediate_skeleton);` writes a topic.
// 4. In the loop, `tracked.take_latest(skeleton)` takes the newest sample.
// 5. `if (intermediate.has_readers()) intermediate.write(skeleton);` writes only if somebody reads.
//
// The threads of the DDS layer inherit the scheduling of the thread that creates the Participant. They must be ordinary
// (runtime/scheduling.hpp). One thread at a time may use a Reader. Writers are thread-safe.
//
// A reader gives the stamps of other hosts the times of this host's clock.
//
// Constructors throw std::runtime_error if DDS refuses. `take_all` throws what its callback throws. All other members
// of Participant, Writer and Reader do not throw and do not allocate in our code.
//
// Writers and readers keep their participant alive.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bus/cdr.hpp"
#include "bus/network.hpp"
#include "bus/topics.hpp"

namespace softhand::bus {

/// SOFTHAND_DOMAIN, 0 when unset. Throws std::runtime_error unless it is a whole number in 0..230.
int domain_from_environment();

namespace detail {
class ParticipantImpl;
class WriterImpl;
class ReaderImpl;
}  // namespace detail

/// Another process in the domain that uses this library.
struct Peer {
  std::uint64_t epoch = 0;  ///< `Stamp::epoch` of its samples
  int process_id = 0;
  std::array<char, 64> name{};
  std::array<char, 64> host{};
  std::array<char, 64> rig{};  ///< name of the rig that it holds; empty: none
  std::uint32_t clock_id = 0;  ///< of its host
};

using SecondWriterText = decltype(LoopStatus::second_writer);

/// Membership of a process in a DDS domain. Create one per process.
class Participant {
 public:
  /// `name` appears in discovery tools. `rig` is the name of the rig that this process holds, for its peers. `role` is
  /// one of `kRoles`: the identity in a secured domain. Throws std::runtime_error if it cannot join the domain.
  explicit Participant(const std::string& name, int domain = domain_from_environment(), const std::string& rig = {},
                       const std::string& role = "client", const Network& network = network_from_environment());
  /// For `Stamp::epoch` of all that this process writes. Peers know the process by this number.
  std::uint64_t epoch() const;
  /// The other processes that are known now. New ones are found within 0.5 s.
  std::vector<Peer> peers() const;
  /// The last second writer of which a reader of this participant refused a sample: topic, process and host. The text
  /// stays when the process leaves. Empty if there was none, or while another thread uses the list of peers. Does not
  /// allocate or wait.
  SecondWriterText second_writer() const noexcept;
  /// The clocks of other hosts, without the newest beacons. Empty if the network does not leave this host. Does not
  /// allocate or wait.
  BoundedVector<HostClock, kMaxHosts> clocks() const noexcept;
  /// Clock beacons that were refused because the clocks of `kMaxHosts` other hosts are in use.
  std::uint64_t refused_beacons() const noexcept;
  const std::shared_ptr<detail::ParticipantImpl>& impl() const { return impl_; }

 private:
  std::shared_ptr<detail::ParticipantImpl> impl_;
};

struct WriterCounters {
  std::uint64_t written = 0;
  std::uint64_t failed = 0;  ///< refused by DDS, or a sequence's count exceeds its capacity
};

struct ReaderCounters {
  std::uint64_t received = 0;         ///< well-formed samples taken
  std::uint64_t refused = 0;          ///< malformed: wrong size or encoding, sequence or text beyond its bound
  std::uint64_t lost = 0;             ///< lost samples, as far as DDS knows
  std::uint64_t deadline_missed = 0;  ///< continues to count after the writer is gone
  std::uint64_t crowded = 0;          ///< about an instance for which there was no room
  /// From the future, from another host whose clock is not known, or older than `TopicRow::lifespan_ms`.
  std::uint64_t refused_stamp = 0;
  std::uint64_t second_writer = 0;  ///< of another writer than the followed one
};

namespace detail {

class WriterEndpoint {
 public:
  WriterEndpoint(const Participant& participant, const TopicRow& topic, const TypeCodec& codec, int strength);
  ~WriterEndpoint();
  WriterEndpoint(WriterEndpoint&&) noexcept;
  WriterEndpoint& operator=(WriterEndpoint&&) noexcept;
  void write(const void* message) noexcept;
  void set_strength(int strength) noexcept;
  int reader_count() const noexcept;
  WriterCounters counters() const noexcept;

 private:
  std::unique_ptr<WriterImpl> impl_;
};

class ReaderEndpoint {
 public:
  ReaderEndpoint(const Participant& participant, const TopicRow& topic, const TypeCodec& codec,
                 const std::optional<HandKey>& only);
  ~ReaderEndpoint();
  ReaderEndpoint(ReaderEndpoint&&) noexcept;
  ReaderEndpoint& operator=(ReaderEndpoint&&) noexcept;
  /// Takes the next well-formed sample into `received`. `well_formed` must be a member of `received`: it says whether
  /// the last sample was valid. Malformed samples are counted and skipped. Returns false if no well-formed sample is
  /// available, or if `left` samples were taken; `left` is reduced by their number. `source_time` orders samples of
  /// several instances.
  bool take_next(void* received, const bool& well_formed, std::int64_t& source_time, int& left) noexcept;
  /// Largest number of samples that one step takes. A flood must not hold it.
  int most_samples() const noexcept;
  bool wait(std::chrono::nanoseconds timeout) noexcept;
  int writer_count() const noexcept;
  int live_writer_count() const noexcept;
  ReaderCounters counters() const noexcept;

 private:
  std::unique_ptr<ReaderImpl> impl_;
};

template <typename T>
concept AboutAHand = requires(const T& message) {
  { message.hand } -> std::convertible_to<HandKey>;
};

}  // namespace detail

template <typename T>
class Writer {
 public:
  /// `strength` matters only on exclusive topics (tracked_skeleton): the writer with the highest strength owns the
  /// instance. Negative values count as 0.
  Writer(const Participant& participant, const Topic<T>& topic, int strength = 0)
      : endpoint_(participant, topic, codec_of<T>(topic.type), strength) {}

  /// Sends the message. On transient-local topics DDS also keeps it for late readers. Never waits for a reader.
  /// Failures are counted.
  void write(const T& message) noexcept { endpoint_.write(&message); }
  /// Changes the strength. Readers follow within milliseconds. Allocates: DDS announces the writer again.
  void set_strength(int strength) noexcept { endpoint_.set_strength(strength); }
  /// True while at least one reader is matched. Loops use it to skip outputs that nobody reads. Descriptions are
  /// written anyway, for late readers.
  bool has_readers() const noexcept { return reader_count() > 0; }
  int reader_count() const noexcept { return endpoint_.reader_count(); }
  WriterCounters counters() const noexcept { return endpoint_.counters(); }

 private:
  detail::WriterEndpoint endpoint_;
};

template <typename T>
class Reader {
 public:
  /// If `only` is given, samples about other hands are ignored. Otherwise the reader follows at most
  /// `TopicRow::max_instances` instances of one writer, and twice as many of all. A new instance takes the place of one
  /// that was silent for a second.
  Reader(const Participant& participant, const Topic<T>& topic,
         std::optional<HandKey> only = std::nullopt) requires detail::AboutAHand<T>
      : endpoint_(participant, topic, codec_of<T>(topic.type), only) {}
  Reader(const Participant& participant, const Topic<T>& topic) requires(!detail::AboutAHand<T>)
      : endpoint_(participant, topic, codec_of<T>(topic.type), std::nullopt) {}

  /// Copies the newest sample into `out` and drops the older ones. If no new sample has arrived, returns false and does
  /// not change `out`. Never waits. Takes at most 2 * max_instances * depth samples, so that a flood does not hold a
  /// loop.
  bool take_latest(T& out) noexcept {
    bool found = false;
    std::int64_t newest = 0;
    std::int64_t time = 0;
    int left = endpoint_.most_samples();
    while (endpoint_.take_next(scratch_.get(), scratch_->well_formed, time, left)) {
      if (found && time < newest) continue;
      newest = time;
      found = true;
      scratch_.swap(newest_);
    }
    if (found) out = newest_->value;
    return found;
  }

  /// Calls f(const T&) for each new sample and returns the number of calls. Samples of one instance come oldest first.
  /// Meant for topics with many instances and for messages. Takes at most as many as `take_latest`.
  template <typename F>
  std::size_t take_all(F&& f) {
    return take_some(endpoint_.most_samples(), std::forward<F>(f));
  }
  /// The same for at most `most` samples. The others stay for the next call, as far as the history keeps them.
  template <typename F>
  std::size_t take_some(int most, F&& f) {
    std::size_t count = 0;
    std::int64_t time = 0;
    int left = most;
    while (endpoint_.take_next(scratch_.get(), scratch_->well_formed, time, left)) {
      ++count;
      f(std::as_const(scratch_->value));
    }
    return count;
  }

  /// Waits until a sample is available. Returns false after `timeout`. The wake-up is 15-30 us slower than polling, so
  /// the 1 kHz loops do not use it.
  bool wait(std::chrono::nanoseconds timeout) noexcept { return endpoint_.wait(timeout); }
  /// Number of matched writers.
  int writer_count() const noexcept { return endpoint_.writer_count(); }
  /// Number of matched writers with a valid liveliness lease. If the topic has no lease: number of matched writers.
  int live_writer_count() const noexcept { return endpoint_.live_writer_count(); }
  ReaderCounters counters() const noexcept { return endpoint_.counters(); }

 private:
  detail::ReaderEndpoint endpoint_;
  std::unique_ptr<detail::Received<T>> scratch_ = std::make_unique<detail::Received<T>>();
  std::unique_ptr<detail::Received<T>> newest_ = std::make_unique<detail::Received<T>>();
};

}  // namespace softhand::bus
