// Recordings of topics in MCAP format (https://mcap.dev/spec), without chunks, compression and index. So every message
// is in the file as soon as `write` returns. A recording that was cut off by kill -9 or a full disk is readable up to
// its last whole message. The caller encodes the payloads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "messages/messages.hpp"

namespace softhand {

/// The data that a reader needs to decode the messages of one topic.
struct RecordChannel {
  std::string topic;             ///< e.g. softhand/v1/objects
  std::string message_encoding;  ///< of the payload, a well-known MCAP name, e.g. cdr
  std::string schema_name;       ///< type of the payload; empty = no schema
  std::string schema_encoding;   ///< e.g. omgidl
  std::string schema_text;
};

/// Each call writes through to the kernel. Errors throw std::runtime_error with file and reason.
class RecordWriter {
 public:
  enum class Existing { truncate, refuse };
  /// Creates the file. `refuse`: anything that has this name already is an error, also a link.
  explicit RecordWriter(const std::string& path, Existing existing = Existing::truncate);
  /// Calls `finish` but ignores its errors. Call `finish` first if errors matter.
  ~RecordWriter();
  RecordWriter(const RecordWriter&) = delete;
  RecordWriter& operator=(const RecordWriter&) = delete;

  /// Returns the channel number for `write`.
  std::uint16_t add_channel(const RecordChannel& channel);
  /// `log_time` is the time at which the recorder received the message. Both times count from 0.
  void write(std::uint16_t channel, std::uint32_t sequence, Nanoseconds log_time, Nanoseconds publish_time,
             std::span<const std::byte> payload);
  /// Writes the end of the file and closes it. After that, nothing can be written. Further calls do nothing.
  void finish();

 private:
  void put_record();
  void put_bytes(const void* bytes, std::size_t size);
  template <typename T>
  void append(T value);
  void append_text(const std::string& text);
  void begin_record(std::uint8_t opcode);

  std::string path_;
  int file_ = -1;
  std::uint16_t channel_count_ = 0;
  std::vector<std::byte> record_;  // the record under construction
};

struct RecordedMessage {
  std::uint16_t channel = 0;
  std::uint32_t sequence = 0;
  Nanoseconds log_time = 0;
  Nanoseconds publish_time = 0;
  std::vector<std::byte> payload;
};

class RecordReader {
 public:
  struct Schema {
    std::string name, encoding, text;
  };
  struct Channel {
    std::string topic, message_encoding;
    std::shared_ptr<const Schema> schema;  ///< never null. Shared: a file may have 65535 channels of a large schema
  };

  /// Throws std::runtime_error if the file cannot be read or is not MCAP.
  explicit RecordReader(const std::string& path);
  /// Reads the next message in file order. Returns false at the end. Throws std::runtime_error if a record is
  /// inconsistent, or if it is a chunk (our writer writes no chunks).
  bool next(RecordedMessage& message);
  /// After `next` returned false: true if the file was not finished.
  bool truncated() const { return truncated_; }
  /// Channels read so far, by number. The channel of a message is known when `next` returns the message.
  const std::map<std::uint16_t, Channel>& channels() const { return channels_; }

 private:
  [[noreturn]] void refuse(const std::string& reason) const;

  std::string path_;
  std::ifstream file_;
  std::uint64_t size_ = 0;
  std::uint64_t offset_ = 0;
  bool ended_ = false;
  bool truncated_ = false;
  // A channel without a schema has the number 0 in its place.
  std::map<std::uint16_t, std::shared_ptr<const Schema>> schemas_{{0, std::make_shared<const Schema>()}};
  std::map<std::uint16_t, Channel> channels_;
  std::vector<std::byte> record_;
};

}  // namespace softhand
