// Writes records to a file outside the real-time thread. The loop pushes plain values. A separate thread formats and
// writes them.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdio>
#include <functional>
#include <stdexcept>
#include <string>
#include <thread>
#include <type_traits>
#include <vector>

#include "runtime/scheduling.hpp"

namespace softhand {

/// Single producer. `push` never blocks. If the writer thread is too slow, records are dropped and counted.
template <typename Record>
class RecordLog {
  static_assert(std::is_trivially_copyable_v<Record>);

 public:
  /// `format` appends one record as text, including the newline. It runs in the writer thread. `header` is written
  /// first. Throws std::runtime_error if the file cannot be opened.
  RecordLog(const std::string& path, std::size_t capacity, const std::string& header,
            std::function<void(const Record&, std::string&)> format)
      : RecordLog(path, std::fopen(path.c_str(), "w"), capacity, header, std::move(format)) {}
  /// The same for an open file, which this log closes. `name` is for the error if `file` is null.
  RecordLog(const std::string& name, std::FILE* file, std::size_t capacity, const std::string& header,
            std::function<void(const Record&, std::string&)> format)
      : slots_(capacity), format_(std::move(format)), file_(file) {
    if (file_ == nullptr) throw std::runtime_error(name + ": cannot be opened for writing");
    std::fputs(header.c_str(), file_);
    thread_ = std::thread([this] {
      become_ordinary();
      run();
    });
  }
  ~RecordLog() {
    stop_.store(true, std::memory_order_release);
    thread_.join();
    std::fclose(file_);
  }
  RecordLog(const RecordLog&) = delete;
  RecordLog& operator=(const RecordLog&) = delete;

  bool push(const Record& record) {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_.load(std::memory_order_acquire) == slots_.size()) {
      dropped_.fetch_add(1, std::memory_order_relaxed);
      return false;
    }
    slots_[tail % slots_.size()] = record;
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }
  std::uint64_t dropped() const { return dropped_.load(std::memory_order_relaxed); }

 private:
  void drain() {
    std::size_t head = head_.load(std::memory_order_relaxed);
    const std::size_t tail = tail_.load(std::memory_order_acquire);
    for (; head != tail; ++head) {
      text_.clear();
      format_(slots_[head % slots_.size()], text_);
      std::fwrite(text_.data(), 1, text_.size(), file_);
      head_.store(head + 1, std::memory_order_release);
    }
  }
  void run() {
    while (!stop_.load(std::memory_order_acquire)) {
      drain();
      // The producer must not spend time on waking this thread, so this thread polls.
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    drain();
    std::fflush(file_);
  }

  std::vector<Record> slots_;
  std::function<void(const Record&, std::string&)> format_;
  std::FILE* file_;
  std::atomic<std::size_t> head_{0};
  std::atomic<std::size_t> tail_{0};
  std::atomic<std::uint64_t> dropped_{0};
  std::atomic<bool> stop_{false};
  std::string text_;
  std::thread thread_;
};

}  // namespace softhand
