// The Haply driver in this process, with a simulated Inverse3.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <mutex>
#include <thread>

#include "haptics/haply/haply.hpp"
#include "haptics/haply/simulated_inverse3.hpp"
#include "support/conformance.hpp"

namespace softhand {
namespace {

class NoHands final : public TrackerSink {
 public:
  void hand(const Skeleton&) override {}
  void head(const HeadPose&) override {}
};

// Steps the driver at about 1 kHz.
void run(Haply& driver, int milliseconds) {
  NoHands hands;
  const std::array<double, 3> zero{};
  for (const Nanoseconds end = now() + milliseconds * Nanoseconds{1'000'000}; now() < end;) {
    driver.poll(now(), hands);
    driver.write(now(), zero);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

// The thread that sends was late: newer messages replaced those that waited, and the service never answers them.
TEST(HaplyDriver, KeepsItsRateAfterMessagesWereReplaced) {
  SimulatedInverse3 device(0, 0);
  HaplyOptions options;
  options.port = device.port();
  options.event_port = device.event_port();
  Haply driver(options, testing::conformance_hand());
  testing::wait_for_device(driver);
  NoHands hands;
  const std::array<double, 3> zero{};
  run(driver, 100);
  for (int stall = 0; stall < 20; ++stall) {
    // More messages at once than the thread takes one by one.
    const Nanoseconds time = now();
    for (int late = 0; late < 3; ++late) driver.write(time + late * 20'000'000, zero);
    std::this_thread::sleep_for(std::chrono::milliseconds(45));
    driver.poll(now(), hands);
  }
  run(driver, 100);
  const int before = device.messages();
  const Nanoseconds since = now();
  run(driver, 1000);
  const double rate = (device.messages() - before) / (1e-9 * static_cast<double>(now() - since));
  std::printf("haply: %.0f messages per second after the stalls\n", rate);
  EXPECT_GT(rate, 200);
}

// Messages to a service that stands still wait there, and each of them delays the forces after it.
TEST(HaplyDriver, DoesNotHurryAServiceThatStandsStill) {
  const SimulatedInverse3 device(0, 0);
  std::mutex stall;
  std::atomic<int> messages{0};
  SimulatedService service(0, {[&](const std::string&) { return device.report(true).dump(); },
                               [&](const std::string&) {
                                 const std::lock_guard lock(stall);
                                 ++messages;
                                 return device.report(false).dump();
                               },
                               {}});
  HaplyOptions options;
  options.port = service.port();
  options.event_port = 0;
  Haply driver(options, testing::conformance_hand());
  testing::wait_for_device(driver);
  run(driver, 100);
  std::unique_lock lock(stall);
  const int before = messages;
  run(driver, 300);
  lock.unlock();
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_LE(messages - before, 300 / 20 + 4);
}

}  // namespace
}  // namespace softhand
