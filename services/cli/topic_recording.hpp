// Topics to a file and back. A message's payload in the file is its CDR bytes as on the wire, its schema the IDL: any
// MCAP tool can read it.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "bus/bus.hpp"
#include "runtime/record_file.hpp"

namespace softhand {

/// A topic's row with a longer history for a reader that must not lose what comes between two looks: history is the
/// reader's own affair in DDS.
template <typename T>
bus::Topic<T> with_history(bus::Topic<T> topic, int depth) {
  if (topic.rate_hz > 0 && topic.depth < depth) topic.depth = depth;
  return topic;
}

struct TopicCount {
  std::uint64_t messages = 0;
  std::uint64_t lost = 0;     ///< as far as DDS knows
  std::uint64_t refused = 0;  ///< malformed
};

/// Writes down every message of the chosen topics.
class TopicRecorder {
 public:
  /// `topics`: last parts of names, e.g. contacts; empty = all. Throws std::invalid_argument for a topic that does not
  /// exist, std::runtime_error where the file cannot be written.
  TopicRecorder(const bus::Participant& participant, const std::string& path, const std::vector<std::string>& topics);
  ~TopicRecorder();

  /// Writes what has come since the last call; at most 50 ms may pass between calls at 1 kHz. Throws std::runtime_error
  /// when the disk is full.
  void poll();
  /// Ends the file in good order.
  void finish();
  std::map<std::string, TopicCount> counts() const;

 private:
  struct Lane;
  RecordWriter file_;
  std::vector<std::unique_ptr<Lane>> lanes_;
};

/// Publishes a recording again. Times in stamps and chains move by one constant (and are stretched by the speed), so
/// that ages and delays are those of the recording; clock id is this host's; each writer's epoch is a new one, so that
/// receivers see a restarted writer and not old sequence numbers.
class TopicPlayer {
 public:
  /// Reads through the file first. Throws std::runtime_error where it is not a recording of ours, std::invalid_argument
  /// as TopicRecorder or when nothing in it is chosen.
  TopicPlayer(const bus::Participant& participant, const std::string& path, const std::vector<std::string>& topics,
              double speed);
  ~TopicPlayer();

  /// Publishes what is due at `now`, which counts from the first call. False when the file is at its end.
  bool play(Nanoseconds now);
  /// When the next message is due; meaningful after the first `play`.
  Nanoseconds next_due() const;
  bool truncated() const { return truncated_; }
  Nanoseconds duration() const { return last_time_ - first_time_; }
  std::map<std::string, TopicCount> counts() const;

 private:
  struct Lane;
  bool advance();
  Nanoseconds moved(Nanoseconds recorded) const;

  RecordReader file_;
  double speed_;
  std::map<std::string, std::unique_ptr<Lane>> lanes_;
  RecordedMessage next_;
  bool at_end_ = false;
  bool truncated_ = false;
  Nanoseconds first_time_ = 0;
  Nanoseconds last_time_ = 0;
  Nanoseconds start_ = 0;
  std::uint64_t epoch_;
  std::uint32_t clock_id_;
};

}  // namespace softhand
