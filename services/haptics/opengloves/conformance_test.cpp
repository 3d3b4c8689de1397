// A glove with the OpenGloves protocol against the conformance kit.
#include "support/conformance.hpp"

#include <fcntl.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>

#include <atomic>

#include "haptics/opengloves/opengloves.hpp"
#include "haptics/opengloves/simulated_glove.hpp"

namespace softhand {
namespace {

// A glove on a serial port. It sends 100 lines a second.
class SerialGlove {
 public:
  SerialGlove() : terminal_(posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)) {
    grantpt(terminal_);
    unlockpt(terminal_);
    path_ = ptsname(terminal_);
    // A terminal that no driver has opened yet would send the glove's lines back to it.
    termios raw{};
    tcgetattr(terminal_, &raw);
    cfmakeraw(&raw);
    tcsetattr(terminal_, TCSANOW, &raw);
    thread_ = std::thread([this] { run(); });
  }
  ~SerialGlove() {
    stop_ = true;
    thread_.join();
    close(terminal_);
  }
  SerialGlove(const SerialGlove&) = delete;
  SerialGlove& operator=(const SerialGlove&) = delete;
  const std::string& path() const { return path_; }
  bool is_free() const { return is_free_; }

 private:
  void run() {
    const std::string line = glove_line({1000, 1000, 1000, 1000, 1000});
    std::string received;
    std::array<int, 5> forces{};
    for (int i = 0; !stop_; ++i) {
      if (i % 10 == 0 && write(terminal_, line.data(), line.size()) < 0) continue;
      char bytes[512];
      for (ssize_t size; (size = read(terminal_, bytes, sizeof bytes)) > 0;)
        received.append(bytes, static_cast<std::size_t>(size));
      for (std::size_t end; (end = received.find('\n')) != std::string::npos; received.erase(0, end + 1))
        read_forces(received.substr(0, end), forces);
      is_free_ = forces == std::array<int, 5>{};
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }

  int terminal_;
  std::string path_;
  std::atomic<bool> stop_{false}, is_free_{true};
  std::thread thread_;
};

TEST(Conformance, OpenGloves) {
  OpenGlovesOptions options;
  options.port = 0;
  EXPECT_EQ(testing::faults_of<BoneWrench>(
                [&] { return std::make_shared<OpenGloves>(options, testing::conformance_hand()); }),
            "");
}

TEST(ConformanceAtDevice, OpenGloves) {
  EXPECT_EQ(testing::faults_at_device<BoneWrench>([]() -> DriverAtDevice<BoneWrench> {
              const auto glove = std::make_shared<SerialGlove>();
              OpenGlovesOptions options;
              options.serial = glove->path();
              const auto driver = std::make_shared<OpenGloves>(options, testing::conformance_hand());
              testing::wait_for_device(*driver);
              return {driver, [glove] { return glove->is_free(); }};
            }),
            "");
}

}  // namespace
}  // namespace softhand
