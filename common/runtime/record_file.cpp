#include "runtime/record_file.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <limits>
#include <stdexcept>

namespace softhand {
namespace {

static_assert(std::endian::native == std::endian::little);  // MCAP's integers are little endian

constexpr std::array<unsigned char, 8> kMagic{0x89, 'M', 'C', 'A', 'P', 0x30, '\r', '\n'};
constexpr std::size_t kPrefix = 9;  // opcode and length of a record

enum Opcode : std::uint8_t {
  kHeader = 1,
  kFooter = 2,
  kSchema = 3,
  kChannel = 4,
  kMessage = 5,
  kChunk = 6,
  kDataEnd = 15
};

// Reads values from the content of a record. `good` becomes false if the content is too short.
struct Cursor {
  std::span<const std::byte> rest;
  bool good = true;

  template <typename T>
  T take() {
    T value{};
    if (rest.size() < sizeof(T)) {
      good = false;
      return value;
    }
    std::memcpy(&value, rest.data(), sizeof(T));
    rest = rest.subspan(sizeof(T));
    return value;
  }
  std::string take_text() {
    const auto size = take<std::uint32_t>();
    if (!good || rest.size() < size) {
      good = false;
      return {};
    }
    std::string text(reinterpret_cast<const char*>(rest.data()), size);
    rest = rest.subspan(size);
    return text;
  }
};

}  // namespace

RecordWriter::RecordWriter(const std::string& path, Existing existing)
    : path_(path),
      file_(open(path.c_str(),
                 O_WRONLY | O_CREAT | O_CLOEXEC | (existing == Existing::refuse ? O_EXCL | O_NOFOLLOW : O_TRUNC),
                 0644)) {
  if (file_ < 0) throw std::runtime_error(path_ + ": cannot be written: " + std::strerror(errno));
  put_bytes(kMagic.data(), kMagic.size());
  begin_record(kHeader);
  append_text("");  // no profile
  append_text("softhand");
  put_record();
}

RecordWriter::~RecordWriter() {
  try {
    finish();
  } catch (const std::runtime_error&) {
    // the content written so far is still readable
  }
}

std::uint16_t RecordWriter::add_channel(const RecordChannel& channel) {
  if (channel_count_ == std::numeric_limits<std::uint16_t>::max())
    throw std::runtime_error(path_ + ": too many channels");
  const auto id = static_cast<std::uint16_t>(channel_count_ + 1);  // schema id 0 means no schema
  if (!channel.schema_name.empty()) {
    begin_record(kSchema);
    append(id);
    append_text(channel.schema_name);
    append_text(channel.schema_encoding);
    append_text(channel.schema_text);
    put_record();
  }
  begin_record(kChannel);
  append(id);
  append(channel.schema_name.empty() ? std::uint16_t{0} : id);
  append_text(channel.topic);
  append_text(channel.message_encoding);
  append(std::uint32_t{0});  // no metadata
  put_record();
  return channel_count_ = id;
}

void RecordWriter::write(std::uint16_t channel, std::uint32_t sequence, Nanoseconds log_time, Nanoseconds publish_time,
                         std::span<const std::byte> payload) {
  if (channel == 0 || channel > channel_count_)
    throw std::runtime_error(path_ + ": unknown channel " + std::to_string(channel));
  begin_record(kMessage);
  append(channel);
  append(sequence);
  append(static_cast<std::uint64_t>(log_time));
  append(static_cast<std::uint64_t>(publish_time));
  record_.insert(record_.end(), payload.begin(), payload.end());
  put_record();
}

void RecordWriter::finish() {
  if (file_ < 0) return;
  try {
    begin_record(kDataEnd);
    append(std::uint32_t{0});  // no checksum
    put_record();
    begin_record(kFooter);
    append(std::uint64_t{0});  // no summary
    append(std::uint64_t{0});
    append(std::uint32_t{0});
    put_record();
    put_bytes(kMagic.data(), kMagic.size());
  } catch (...) {
    close(file_);
    file_ = -1;
    throw;
  }
  const int closed = close(file_);
  file_ = -1;
  if (closed != 0) throw std::runtime_error(path_ + ": cannot be closed: " + std::strerror(errno));
}

template <typename T>
void RecordWriter::append(T value) {
  std::array<std::byte, sizeof(T)> bytes;
  std::memcpy(bytes.data(), &value, sizeof(T));
  record_.insert(record_.end(), bytes.begin(), bytes.end());
}

void RecordWriter::append_text(const std::string& text) {
  append(static_cast<std::uint32_t>(text.size()));
  const auto bytes = std::as_bytes(std::span(text));
  record_.insert(record_.end(), bytes.begin(), bytes.end());
}

void RecordWriter::begin_record(std::uint8_t opcode) {
  if (file_ < 0) throw std::runtime_error(path_ + ": the recording is already finished");
  record_.assign(kPrefix, std::byte{0});
  record_[0] = std::byte{opcode};
}

void RecordWriter::put_record() {
  const std::uint64_t length = record_.size() - kPrefix;
  std::memcpy(record_.data() + 1, &length, sizeof length);
  put_bytes(record_.data(), record_.size());  // one call, so that a killed process leaves only whole records
}

void RecordWriter::put_bytes(const void* bytes, std::size_t size) {
  const char* next = static_cast<const char*>(bytes);
  while (size > 0) {
    const ssize_t written = ::write(file_, next, size);
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) {
      const std::string reason = std::strerror(errno);
      // The file may hold part of a record. A reader would take the next record for the rest of it, so close the file.
      close(file_);
      file_ = -1;
      throw std::runtime_error(path_ + ": cannot be written: " + reason);
    }
    next += written;
    size -= static_cast<std::size_t>(written);
  }
}

RecordReader::RecordReader(const std::string& path) : path_(path), file_(path, std::ios::binary | std::ios::ate) {
  if (!file_) throw std::runtime_error(path_ + ": cannot be read");
  const std::streamoff end = file_.tellg();
  file_.seekg(0);
  std::array<char, kMagic.size()> magic{};
  file_.read(magic.data(), magic.size());
  if (!file_ || std::memcmp(magic.data(), kMagic.data(), magic.size()) != 0)
    throw std::runtime_error(path_ + ": is not an MCAP file");
  size_ = static_cast<std::uint64_t>(end);
  offset_ = kMagic.size();
}

void RecordReader::refuse(const std::string& reason) const {
  throw std::runtime_error(path_ + ": record at byte " + std::to_string(offset_) + ": " + reason);
}

bool RecordReader::next(RecordedMessage& message) {
  while (!ended_) {
    std::array<std::byte, kPrefix> prefix{};
    std::uint64_t length = 0;
    if (size_ - offset_ >= kPrefix) {
      file_.read(reinterpret_cast<char*>(prefix.data()), kPrefix);
      std::memcpy(&length, prefix.data() + 1, sizeof length);
    }
    if (size_ - offset_ < kPrefix || length > size_ - offset_ - kPrefix) {
      ended_ = truncated_ = true;
      return false;
    }
    record_.resize(length);
    file_.read(reinterpret_cast<char*>(record_.data()), static_cast<std::streamsize>(length));
    if (!file_) refuse("cannot be read");
    Cursor cursor{record_};
    switch (static_cast<std::uint8_t>(prefix[0])) {
      case kSchema: {
        const auto id = cursor.take<std::uint16_t>();
        Schema schema;
        schema.name = cursor.take_text();
        schema.encoding = cursor.take_text();
        schema.text = cursor.take_text();
        if (!cursor.good || id == 0) refuse("broken schema");
        schemas_[id] = std::make_shared<const Schema>(std::move(schema));
        break;
      }
      case kChannel: {
        const auto id = cursor.take<std::uint16_t>();
        const auto schema_id = cursor.take<std::uint16_t>();
        Channel channel;
        channel.topic = cursor.take_text();
        channel.message_encoding = cursor.take_text();
        if (!cursor.good) refuse("broken channel");
        const auto schema = schemas_.find(schema_id);
        if (schema == schemas_.end()) refuse("channel of an unknown schema");
        channel.schema = schema->second;
        channels_[id] = std::move(channel);
        break;
      }
      case kMessage: {
        message.channel = cursor.take<std::uint16_t>();
        message.sequence = cursor.take<std::uint32_t>();
        message.log_time = static_cast<Nanoseconds>(cursor.take<std::uint64_t>());
        message.publish_time = static_cast<Nanoseconds>(cursor.take<std::uint64_t>());
        if (!cursor.good) refuse("broken message");
        if (channels_.count(message.channel) == 0) refuse("message of an unknown channel");
        message.payload.assign(cursor.rest.begin(), cursor.rest.end());
        offset_ += kPrefix + length;
        return true;
      }
      case kChunk:
        refuse("is a chunk; recordings with chunks are not supported");
      case kDataEnd:
        ended_ = true;
        break;
      default:
        break;  // indices, attachments and records of later MCAP versions
    }
    offset_ += kPrefix + length;
  }
  return false;
}

}  // namespace softhand
