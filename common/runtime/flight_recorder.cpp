#include "runtime/flight_recorder.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "runtime/own_folder.hpp"
#include "runtime/record_file.hpp"
#include "runtime/scheduling.hpp"

namespace softhand {
namespace {

constexpr std::uint64_t kMostReports = 5;              // files for faults, per process
constexpr Nanoseconds kReportPeriod = 60'000'000'000;  // between two such files
constexpr Nanoseconds kRetry = 1'000'000'000;          // from a segment that was full to the next one
constexpr auto kPoll = std::chrono::milliseconds(20);  // of the writing thread

}  // namespace

FlightRecorder::FlightRecorder(const FlightOptions& options, Place place, std::string header)
    : place_(std::move(place)),
      header_(std::move(header)),
      period_(static_cast<Nanoseconds>(options.snapshot_period * 1e9)) {
  // One segment more is under construction, and one more is free while a file is written.
  const auto count = static_cast<std::size_t>(std::ceil(options.seconds / options.snapshot_period)) + 2;
  segments_.resize(count);
  for (Segment& segment : segments_)
    segment.bytes.resize(static_cast<std::size_t>(options.megabytes) * 1'000'000 / count);
  current_ = count - 1;
  parts_.reserve(count);
  writer_ = std::thread([this] {
    become_ordinary();
    write_files();
  });
}

FlightRecorder::~FlightRecorder() { finish({}); }

bool FlightRecorder::is_due(Nanoseconds now) const {
  const Segment& segment = segments_[current_];
  const bool is_nearly_full = is_open_ && segment.used > segment.bytes.size() / 10 * 9;
  const Nanoseconds wait = is_open_ && !is_nearly_full ? period_ : std::min(period_, kRetry);
  if (begun_ > 0 && now - segment.start < wait) return false;
  if (!is_writing_.load(std::memory_order_acquire)) return true;
  return std::none_of(parts_.begin(), parts_.end(), [this](const Part& part) { return part.segment == next(); });
}

void FlightRecorder::start_segment(Nanoseconds now) {
  is_continued_ = is_continued_ && is_open_;
  current_ = next();
  segments_[current_].used = 0;
  segments_[current_].start = now;
  is_open_ = true;
  ++begun_;
}

void FlightRecorder::overflow() {
  is_open_ = false;
  is_continued_ = false;
}

void FlightRecorder::put_prefix(std::span<std::byte> to, std::uint8_t kind, Nanoseconds now, std::size_t size) {
  ByteWriter prefix(to.first(kPrefix));
  prefix.write(static_cast<std::uint32_t>(size));
  prefix.write(kind);
  prefix.write(now);
}

bool FlightRecorder::request(std::string_view reason) {
  if (begun_ == 0 || is_writing_.load(std::memory_order_acquire)) return false;
  // The segment after the current one is the oldest. The loop may need it while the file is written, so it is left out
  // if all segments are in use.
  parts_.clear();
  const std::size_t count = segments_.size();
  const std::size_t used = std::min<std::uint64_t>(begun_, count - 1);
  for (std::size_t back = used; back-- > 0;) {
    const std::size_t segment = (current_ + count - back) % count;
    parts_.push_back({segment, segments_[segment].used});
  }
  reason_ = {};
  std::copy_n(reason.begin(), std::min(reason.size(), reason_.size() - 1), reason_.begin());
  is_writing_.store(true, std::memory_order_release);
  return true;
}

void FlightRecorder::report(std::string_view reason, Nanoseconds now) {
  if (reported_ >= kMostReports || (reported_ > 0 && now - reported_at_ < kReportPeriod)) return;
  if (!request(reason)) return;
  ++reported_;
  reported_at_ = now;
}

void FlightRecorder::finish(std::string_view reason) {
  if (!writer_.joinable()) return;
  ends_.store(true, std::memory_order_release);
  writer_.join();
  if (!reason.empty() && request(reason)) write_file();
}

void FlightRecorder::write_files() {
  for (;;) {
    const bool ends = ends_.load(std::memory_order_acquire);
    if (is_writing_.load(std::memory_order_acquire)) write_file();
    if (ends) return;
    std::this_thread::sleep_for(kPoll);
  }
}

void FlightRecorder::write_file() {
  try {
    namespace fs = std::filesystem;
    fs::path folder = place_.folder;
    if (folder.empty()) {
      folder = fs::temp_directory_path() / ("softhand-" + std::to_string(getuid()));
      make_own_folder(folder.string());
      folder /= "flight";
    }
    fs::create_directories(folder);
    std::array<char, 32> when{};
    const std::time_t seconds = std::time(nullptr);
    std::tm utc{};
    gmtime_r(&seconds, &utc);
    std::strftime(when.data(), when.size(), "%Y%m%dT%H%M%SZ", &utc);
    const std::string name =
        place_.module + "-" + when.data() + "-" + std::to_string(getpid()) + "-" + std::to_string(++files_) + ".flight";
    const fs::path path = folder / name;
    // Readers of the folder see complete files only.
    const fs::path unfinished = path.string() + ".part";
    {
      RecordWriter file(unfinished.string(), RecordWriter::Existing::refuse);
      const std::uint16_t header_channel = file.add_channel({kFlightHeaderTopic, "json", "", "", ""});
      const std::uint16_t record_channel = file.add_channel({kFlightRecordTopic, "softhand-flight", "", "", ""});
      auto header = nlohmann::ordered_json::parse(header_);
      header["reason"] = reason_.data();
      // The reason of a message may be cut within a character, or be no text at all.
      const std::string text = header.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
      file.write(header_channel, 0, 0, 0, std::as_bytes(std::span(text)));
      std::uint32_t sequence = 0;
      std::vector<std::byte> payload;
      for (const Part& part : parts_) {
        ByteReader in(std::span<const std::byte>(segments_[part.segment].bytes).first(part.used));
        while (!in.rest().empty()) {
          const auto size = in.take<std::uint32_t>();
          payload.resize(1);
          payload[0] = static_cast<std::byte>(in.take<std::uint8_t>());
          const auto now = in.take<Nanoseconds>();
          const auto bytes = in.rest().first(size);
          payload.insert(payload.end(), bytes.begin(), bytes.end());
          in = ByteReader(in.rest().subspan(size));
          file.write(record_channel, ++sequence, now, now, payload);
        }
      }
      file.finish();
    }
    fs::rename(unfinished, path);
    std::fprintf(stderr, "softhand-%s: flight recorder: %s; wrote %s\n", place_.module.c_str(), reason_.data(),
                 path.c_str());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "softhand-%s: flight recorder: %s\n", place_.module.c_str(), error.what());
  }
  is_writing_.store(false, std::memory_order_release);
}

}  // namespace softhand
