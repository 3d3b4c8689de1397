// Keeps the last minute of a loop's inputs in memory, and writes them to a file on request (docs/flight-recorder.md).
//
// The memory is a ring of segments. A segment begins with a snapshot of the loop, and all records after it follow in
// order. So each segment can be repeated without the others. The loop's thread adds records: it does not allocate, lock
// or call the kernel. A thread of ordinary priority writes files. Meanwhile the loop records into the other segments.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "messages/plain_bytes.hpp"
#include "runtime/flight_options.hpp"

namespace softhand {

/// Kinds of records. The numbers from `kFlightInput` on belong to the loop.
inline constexpr std::uint8_t kFlightSnapshot = 0;
inline constexpr std::uint8_t kFlightResult = 1;
inline constexpr std::uint8_t kFlightInput = 2;

inline constexpr const char* kFlightHeaderTopic = "softhand/flight/header";
inline constexpr const char* kFlightRecordTopic = "softhand/flight/records";

class FlightRecorder {
 public:
  struct Place {
    std::string module;  ///< begins the file names
    std::string folder;  ///< for the files; made when one is written. Empty: a folder of this user in that of temporary
                         ///< files
  };
  /// Allocates the memory and starts the writing thread. `header` is JSON text without the reason.
  FlightRecorder(const FlightOptions& options, Place place, std::string header);
  ~FlightRecorder();
  FlightRecorder(const FlightRecorder&) = delete;
  FlightRecorder& operator=(const FlightRecorder&) = delete;

  // From the loop's thread only.

  /// True if a segment should begin at `now`, and there is memory for it.
  bool is_due(Nanoseconds now) const;
  /// Begins a segment. `save(ByteWriter&)` writes the snapshot.
  template <typename Save>
  void begin_segment(Nanoseconds now, Save&& save) {
    start_segment(now);
    const bool continues = is_continued_;
    add(kFlightSnapshot, now, [&](ByteWriter& out) {
      out.write(continues);
      save(out);
    });
    is_continued_ = is_open_;
  }
  /// Adds a record. `fill(ByteWriter&)` writes it. Without an open segment nothing happens. If the segment is full, it
  /// ends before this record, and the next segment is due.
  template <typename Fill>
  void add(std::uint8_t kind, Nanoseconds now, Fill&& fill) {
    if (!is_open_) return;
    Segment& segment = segments_[current_];
    const std::span<std::byte> rest = std::span(segment.bytes).subspan(segment.used);
    if (rest.size() < kPrefix) return overflow();
    ByteWriter out(rest.subspan(kPrefix));
    fill(out);
    if (out.overflowed()) return overflow();
    put_prefix(rest, kind, now, out.size());
    segment.used += kPrefix + out.size();
  }
  /// Asks for a file of all that is in the memory now. Returns false if a file is being written, or if there is
  /// nothing. Real-time safe.
  bool request(std::string_view reason);
  /// The same for a fault. After a few files, and within a minute of the last one, nothing is written.
  void report(std::string_view reason, Nanoseconds now);
  /// Writes the last requested file, then one for `reason` if it is not empty. Call it after the loop has ended.
  void finish(std::string_view reason);
  std::uint64_t segments_begun() const { return begun_; }
  const std::string& folder() const { return place_.folder; }

 private:
  static constexpr std::size_t kPrefix = 13;  // size, kind, time
  struct Segment {
    std::vector<std::byte> bytes;
    std::size_t used = 0;
    Nanoseconds start = 0;
  };
  struct Part {
    std::size_t segment = 0;
    std::size_t used = 0;
  };

  std::size_t next() const { return (current_ + 1) % segments_.size(); }
  void overflow();
  void start_segment(Nanoseconds now);
  static void put_prefix(std::span<std::byte> to, std::uint8_t kind, Nanoseconds now, std::size_t size);
  void write_files();
  void write_file();

  Place place_;
  std::string header_;
  Nanoseconds period_;
  std::vector<Segment> segments_;
  std::size_t current_ = 0;
  std::uint64_t begun_ = 0;  // segments
  bool is_open_ = false;
  bool is_continued_ = false;  // the last segment has all records until now
  std::uint64_t reported_ = 0;
  Nanoseconds reported_at_ = 0;

  // The request. The loop's thread owns it while `is_writing_` is false, otherwise the writing thread.
  std::vector<Part> parts_;  // oldest first
  std::array<char, 200> reason_{};
  std::atomic<bool> is_writing_{false};

  std::uint64_t files_ = 0;
  std::atomic<bool> ends_{false};
  std::thread writer_;
};

}  // namespace softhand
