// Writes records to a file outside the real-time thread. The loop pushes plain values. A separate thread formats and
// writes them.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdio>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>

#include "runtime/off_loop.hpp"

namespace softhand {

/// Single producer. `push` never blocks. If the writer thread is too slow, records are dropped and counted.
template <typename Record>
class RecordLog {
 public:
  /// `format` appends one record as text, including the newline. It runs in the writer thread. `header` is written
  /// first. Throws std::runtime_error if the file cannot be opened.
  RecordLog(const std::string& path, std::size_t capacity, const std::string& header,
            std::function<void(const Record&, std::string&)> format)
      : RecordLog(path, std::fopen(path.c_str(), "w"), capacity, header, std::move(format)) {}
  /// The same for an open file, which this log closes. `name` is for the error if `file` is null.
  RecordLog(const std::string& name, std::FILE* file, std::size_t capacity, const std::string& header,
            std::function<void(const Record&, std::string&)> format)
      : file_(opened(name, file, header)),
        writer_(capacity, std::chrono::milliseconds(20), [this, format = std::move(format)](const Record& record) {
          text_.clear();
          format(record, text_);
          std::fwrite(text_.data(), 1, text_.size(), file_.file);
        }) {}

  bool push(const Record& record) {
    if (writer_.push(record)) return true;
    dropped_.fetch_add(1, std::memory_order_relaxed);
    return false;
  }
  std::uint64_t dropped() const { return dropped_.load(std::memory_order_relaxed); }

 private:
  struct OpenFile {
    std::FILE* file;
    ~OpenFile() { std::fclose(file); }
  };
  static std::FILE* opened(const std::string& name, std::FILE* file, const std::string& header) {
    if (file == nullptr) throw std::runtime_error(name + ": cannot be opened for writing");
    std::fputs(header.c_str(), file);
    return file;
  }

  OpenFile file_;
  std::string text_;
  std::atomic<std::uint64_t> dropped_{0};
  OffLoop<Record> writer_;  // last member, because its thread uses the others
};

}  // namespace softhand
