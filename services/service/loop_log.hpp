// Log lines from inside a loop: a thread beside the loop writes them to stderr.
#pragma once

#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <string>
#include <utility>

#include "device/record_log.hpp"

namespace softhand {

class LoopLog {
 public:
  /// `program` begins each line.
  explicit LoopLog(std::string program)
      : log_("stderr", unbuffered(fdopen(dup(STDERR_FILENO), "w")), 64, "",
             [program = std::move(program)](const Line& line, std::string& text) {
               text += program + ": " + line.data() + "\n";
             }) {}

  /// Formats the line, cuts it to 399 bytes, and passes it on. Never waits. Lines beyond 64 waiting ones are dropped.
  template <typename... Parts>
  void line(fmt::format_string<Parts...> text, Parts&&... parts) {
    Line line{};
    fmt::format_to_n(line.data(), line.size() - 1, text, std::forward<Parts>(parts)...);
    log_.push(line);
  }

 private:
  using Line = std::array<char, 400>;
  static std::FILE* unbuffered(std::FILE* file) {
    if (file != nullptr) std::setvbuf(file, nullptr, _IONBF, 0);
    return file;
  }

  RecordLog<Line> log_;
};

}  // namespace softhand
