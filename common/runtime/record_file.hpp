// Recordings of topics: MCAP (https://mcap.dev/spec), without chunks, compression and index, so that every message is
// in the file as soon as `write` returns and a recording cut off by kill -9 or a full disk reads up to its last whole
// message. Payloads are the caller's bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "messages/messages.hpp"

namespace softhand {

/// What a reader needs to know to decode the messages of one topic.
struct RecordChannel {
  std::string topic;             ///< e.g. softhand/v1/objects
  std::string message_encoding;  ///< of the payload, a well-known MCAP name, e.g. cdr
  std::string schema_name;       ///< type of the payload; empty = no schema
  std::string schema_encoding;   ///< e.g. omgidl
  std::string schema_text;
  bool operator==(const RecordChannel&) const = default;
};

/// Each call writes through to the kernel. Every error throws std::runtime_error with file and reason.
class RecordWriter {
 public:
  /// Creates the file or empties the one that is there.
  explicit RecordWriter(const std::string& path);
  /// Finishes; an error is then lost, so call `finish` first where it matters.
  ~RecordWriter();
  RecordWriter(const RecordWriter&) = delete;
  RecordWriter& operator=(const RecordWriter&) = delete;

  /// The number by which `write` knows the channel.
  std::uint16_t add_channel(const RecordChannel& channel);
  /// `log_time` is when the recorder got the message; times count up from 0.
  void write(std::uint16_t channel, std::uint32_t sequence, Nanoseconds log_time, Nanoseconds publish_time,
             std::span<const std::byte> payload);
  /// Ends the file in good order. Nothing can be written afterwards; calling it again does nothing.
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
  std::vector<std::byte> record_;  // the one being put together
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
  /// Throws std::runtime_error when the file cannot be read or is not MCAP.
  explicit RecordReader(const std::string& path);
  /// The next message in the file's order; false at its end. Throws std::runtime_error where a record contradicts
  /// itself, or is a chunk (we write none).
  bool next(RecordedMessage& message);
  /// After `next` returned false: the file was not finished.
  bool truncated() const { return truncated_; }
  /// Channels met so far, by number: those of a message are known when `next` returns it.
  const std::map<std::uint16_t, RecordChannel>& channels() const { return channels_; }

 private:
  [[noreturn]] void refuse(const std::string& reason) const;

  std::string path_;
  std::ifstream file_;
  std::uint64_t size_ = 0;
  std::uint64_t offset_ = 0;
  bool ended_ = false;
  bool truncated_ = false;
  struct Schema {
    std::string name, encoding, text;
  };
  std::map<std::uint16_t, Schema> schemas_;
  std::map<std::uint16_t, RecordChannel> channels_;
  std::vector<std::byte> record_;
};

}  // namespace softhand
