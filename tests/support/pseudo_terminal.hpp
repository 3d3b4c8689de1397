// A serial device for tests: the device's end of a pseudo-terminal.
#pragma once

#include <fcntl.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>

#include <stdexcept>
#include <string>

namespace softhand::testing {

/// The driver opens `path`. What it writes comes out of `file`, and the other way round. Raw, and never blocks.
class PseudoTerminal {
 public:
  /// Throws std::runtime_error if the system has none.
  PseudoTerminal() : file_(posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)) {
    termios raw{};
    if (file_ < 0 || grantpt(file_) != 0 || unlockpt(file_) != 0 || tcgetattr(file_, &raw) != 0)
      throw std::runtime_error("no pseudo-terminal");
    path_ = ptsname(file_);
    // A terminal that no driver has opened yet would send the device's bytes back to it.
    cfmakeraw(&raw);
    tcsetattr(file_, TCSANOW, &raw);
  }
  ~PseudoTerminal() { close(file_); }
  PseudoTerminal(const PseudoTerminal&) = delete;
  PseudoTerminal& operator=(const PseudoTerminal&) = delete;
  int file() const { return file_; }
  const std::string& path() const { return path_; }

 private:
  int file_;
  std::string path_;
};

}  // namespace softhand::testing
