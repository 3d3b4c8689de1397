// Records topics to a file and replays them. The payload of a message is its CDR encoding as on the wire, and the
// schema is the IDL. Therefore any MCAP tool can read the file.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "bus/bus.hpp"
#include "runtime/record_file.hpp"

namespace softhand {

/// Returns the topic with a longer history, for a reader that must not lose messages between two polls. In DDS each
/// reader chooses its own history depth.
template <typename T>
bus::Topic<T> with_history(bus::Topic<T> topic, int depth) {
  if (topic.rate_hz > 0 && topic.depth < depth) topic.depth = depth;
  return topic;
}

struct TopicCount {
  std::uint64_t messages = 0;
  std::uint64_t lost = 0;     ///< as reported by DDS
  std::uint64_t refused = 0;  ///< malformed
};

/// Records every message of the chosen topics.
class TopicRecorder {
 public:
  /// `topics`: last parts of topic names, e.g. contacts; empty = all. Throws std::invalid_argument for an unknown topic
  /// and std::runtime_error if the file cannot be written.
  TopicRecorder(const bus::Participant& participant, const std::string& path, const std::vector<std::string>& topics);
  ~TopicRecorder();

  /// Writes the messages that arrived since the last call. At 1 kHz the calls must be at most 50 ms apart. Throws
  /// std::runtime_error if the disk is full.
  void poll();
  /// Writes the end of the file and closes it.
  void finish();
  std::map<std::string, TopicCount> counts() const;

 private:
  struct Lane;
  RecordWriter file_;
  std::vector<std::unique_ptr<Lane>> lanes_;
};

/// Publishes a recording again. Times in stamps and chains are shifted by one constant and scaled by the speed. Ages
/// and delays therefore equal those of the recording. The clock id is that of this host. Each writer gets a new epoch,
/// so that receivers see a restarted writer instead of old sequence numbers.
class TopicPlayer {
 public:
  /// Reads the whole file once. Throws std::runtime_error if it is not a recording of `softhand record`. Throws
  /// std::invalid_argument like TopicRecorder, and if the file has no message of the chosen topics.
  TopicPlayer(const bus::Participant& participant, const std::string& path, const std::vector<std::string>& topics,
              double speed);
  ~TopicPlayer();

  /// Publishes the messages that are due at `now`. The first call defines the start. Returns false at the end of the
  /// file.
  bool play(Nanoseconds now);
  /// Time at which the next message is due. Valid after the first call of `play`.
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
