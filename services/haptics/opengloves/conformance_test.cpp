// A glove with the OpenGloves protocol against the conformance kit.
#include "support/conformance.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <atomic>

#include "haptics/opengloves/opengloves.hpp"
#include "haptics/opengloves/simulated_glove.hpp"
#include "support/pseudo_terminal.hpp"

namespace softhand {
namespace {

// Sends bytes through a terminal of its own. The kernel passes bytes on in a thread that other programs can hold up,
// for longer than a driver has for going to zero.
class TerminalWitness {
 public:
  TerminalWitness() : driver_(open(terminal_.path().c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK)) {}
  ~TerminalWitness() { close(driver_); }
  TerminalWitness(const TerminalWitness&) = delete;
  TerminalWitness& operator=(const TerminalWitness&) = delete;
  // Call it every millisecond. Returns true if a byte, or this call, was later than 4 ms.
  bool watch() {
    char byte = 0;
    const auto at = std::chrono::steady_clock::now();
    const bool late = at - sent_ > std::chrono::milliseconds(4);
    if (read(terminal_.file(), &byte, 1) == 1 || !waits_) {
      waits_ = write(driver_, &byte, 1) == 1;
      sent_ = at;
    }
    return late;
  }

 private:
  testing::PseudoTerminal terminal_;
  int driver_;
  bool waits_ = false;
  std::chrono::steady_clock::time_point sent_ = std::chrono::steady_clock::now();
};

// A glove on a serial port. It sends 100 lines a second.
class SerialGlove {
 public:
  SerialGlove() : thread_([this] { run(); }) {}
  ~SerialGlove() {
    stop_ = true;
    thread_.join();
  }
  SerialGlove(const SerialGlove&) = delete;
  SerialGlove& operator=(const SerialGlove&) = delete;
  const std::string& path() const { return terminal_.path(); }
  bool is_free() const { return is_free_; }
  bool stood_still() const { return stood_still_; }

 private:
  void run() {
    const std::string line = glove_line({1000, 1000, 1000, 1000, 1000});
    std::string received;
    std::array<int, 5> forces{};
    TerminalWitness witness;
    for (int i = 0; !stop_; ++i) {
      if (witness.watch()) stood_still_ = true;
      if (i % 10 == 0 && write(terminal_.file(), line.data(), line.size()) < 0) continue;
      char bytes[512];
      for (ssize_t size; (size = read(terminal_.file(), bytes, sizeof bytes)) > 0;)
        received.append(bytes, static_cast<std::size_t>(size));
      for (std::size_t end; (end = received.find('\n')) != std::string::npos; received.erase(0, end + 1))
        read_forces(received.substr(0, end), forces);
      is_free_ = forces == std::array<int, 5>{};
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }

  testing::PseudoTerminal terminal_;
  std::atomic<bool> stop_{false}, is_free_{true}, stood_still_{false};
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
              return {driver, [glove] { return glove->is_free(); }, [glove] { return glove->stood_still(); }};
            }),
            "");
}

}  // namespace
}  // namespace softhand
