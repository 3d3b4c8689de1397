// softhand-haptic-haply with a simulated Inverse3: hands, forces, the local model, power cycles, bad messages, safety.
#include <cmath>
#include <memory>
#include <optional>
#include <string>

#include "haptics/haply/simulated_inverse3.hpp"
#include "support/device_process.hpp"

namespace softhand {
namespace {

class HaplyProcess : public testing::GroundedProcess {
 protected:
  HaplyProcess() : GroundedProcess("haptic-haply") {}
  void open_device(const std::string& key = "vector", std::int64_t port = 0, std::int64_t event_port = 0) {
    device_.emplace(port, event_port, key);
  }
  void start_driver(std::vector<std::string> settings = {}) {
    settings.push_back("port=" + std::to_string(device_->port()));
    settings.push_back("event_port=" + std::to_string(device_->event_port()));
    start(settings);
    ASSERT_TRUE(health(Health::live));
  }
  // The last command, in the world: x right, y up, z to the user.
  Vec3 commanded() const {
    const auto force = device_->commanded();
    return {force[0], force[2], -force[1]};
  }
  bool feels(double x, double y, double z) {
    return push([&] {
      const Vec3 force = commanded();
      return std::abs(force[0] - x) + std::abs(force[1] - y) + std::abs(force[2] - z) < 1e-3;
    });
  }

  std::optional<SimulatedInverse3> device_;
};

TEST_F(HaplyProcess, TracksTheHeldBoneAndPushesIt) {
  open_device();
  device_->move_to({0.03, -0.2, 0.1});
  start_driver({"base_position=[0, 1, 0.5]"});
  const Skeleton& hand = listener_.hands[1];
  const auto tip = static_cast<std::size_t>(index_of(Joint::index_tip));
  const auto is_at = [&](const Vector3& place) {
    return listener_.until([] {}, [&] { return (to_vector(hand.joints[tip].position) - place).norm() < 1e-6; });
  };
  EXPECT_TRUE(is_at({0.03, 1.1, 0.7}));
  EXPECT_EQ(hand.joints[tip].flags, kJointValid | kJointTracked);
  EXPECT_EQ(hand.joints[1].flags, kJointValid | kJointInferred);
  device_->move_to({0.03, -0.2, 0.12});
  EXPECT_TRUE(is_at({0.03, 1.12, 0.7}));

  set_force(0.5, 1, -0.25);
  EXPECT_TRUE(feels(0.5, 1, -0.25));
  set_force(-30, 0, 0);
  bone(Body::thumb_distal).coupling_force = {1, 1, 1};  // it does not hold this bone
  EXPECT_TRUE(feels(-2, 0, 0));
  EXPECT_EQ(device_->mistakes(), 0);
  EXPECT_TRUE(counts("force_key_changes", 0));
  EXPECT_EQ(listener_.counter("refused_json") + listener_.counter("refused_content"), 0);
}

// A message is sent in each step as long as the service keeps up: silence would return the device to idle.
TEST_F(HaplyProcess, AsksForAReportInEachStep) {
  open_device();
  start_driver();
  const int before = device_->messages();
  const Nanoseconds since = now();
  // Nothing else happens that the driver could answer. On a loaded machine this may take seconds.
  constexpr int kMessages = 500;
  while (device_->messages() - before < kMessages && now() - since < 20'000'000'000)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  const int received = device_->messages() - before;
  std::printf("haply: %.0f messages per second\n", received / (1e-9 * static_cast<double>(now() - since)));
  EXPECT_GE(received, kMessages);
}

TEST_F(HaplyProcess, FindsTheKeyOfAForce) {
  for (const std::string key : {"values", "vector"}) {
    open_device(key);
    start_driver();
    set_force(0, 1, 0);
    EXPECT_TRUE(feels(0, 1, 0)) << key;
    EXPECT_TRUE(counts("force_key_changes", 0)) << key;
    driver_.reset();
  }
}

// A service that sends a session id but knows only the older key: the driver sees that forces have no effect.
TEST_F(HaplyProcess, ChangesAKeyWithoutEffect) {
  open_device("values");
  auto inventory = device_->report(true);
  inventory["session_id"] = 7;
  const std::string first = inventory.dump();
  SimulatedService events(0, {});
  std::mutex mutex;
  double force = 0;
  std::string key;
  SimulatedService service(0, {[&](const std::string&) { return first; },
                               [&](const std::string& message) {
                                 const auto devices = nlohmann::json::parse(message)["inverse3"];
                                 if (devices.empty()) return device_->report(false).dump();
                                 const auto command = devices[0]["commands"]["set_cursor_force"];
                                 const std::lock_guard lock(mutex);
                                 key = command.begin().key();
                                 force = key == "values" ? double(command["values"]["z"]) : 0;
                                 auto report = device_->report(false);
                                 report["inverse3"][0]["state"]["current_cursor_force"]["z"] = force;
                                 return report.dump();
                               },
                               {}});
  start({"port=" + std::to_string(service.port()), "event_port=" + std::to_string(events.port())});
  set_force(0, 1, 0);
  EXPECT_TRUE(push([&] {
    const std::lock_guard lock(mutex);
    return std::abs(force - 1) < 1e-3;
  }));
  EXPECT_TRUE(counts("force_key_changes", 1));
  const std::lock_guard lock(mutex);
  EXPECT_EQ(key, "values");
}

// Between two messages the loop evaluates the contact plane at the position that the device measures.
TEST_F(HaplyProcess, EvaluatesThePlaneAtTheMeasuredPosition) {
  open_device();
  start_driver({"stiffness=500", "damping=0", "slew=100000"});
  input_.simulated_valid = 1;
  bone().contact_normal = {0, 1, 0};
  bone().contact_stiffness = 200;
  bone().contact_gap = 0.002;
  ASSERT_TRUE(counts("planes", 0));
  std::this_thread::sleep_for(std::chrono::milliseconds(600));  // forces begin softly
  double felt = 0;
  for (int attempt = 0; attempt < 100 && std::abs(felt - 0.6) > 1e-3; ++attempt) {  // the machine may be busy
    device_->move_to({0, -0.1, 0.15});
    std::this_thread::sleep_for(std::chrono::milliseconds(60));
    write();  // one message, while the cursor is 2 mm above the plane
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_NEAR(commanded()[1], 0, 1e-3);
    device_->move_to({0, -0.1, 0.145});  // 3 mm into it
    const Nanoseconds since = now();
    while (now() - since < 20'000'000 && std::abs(felt - 0.6) > 1e-3) felt = commanded()[1];
  }
  EXPECT_NEAR(felt, 0.6, 1e-3);
  EXPECT_TRUE(counts("planes", 1));
  // The work of the cursor and a force is observed.
  set_force(0, 1, 0);
  bone().contact_gap = 0;
  double height = 0.15;
  EXPECT_TRUE(listener_.until(
      [&] {
        device_->move_to({0, -0.1, height -= 1e-5});
        write();
      },
      [&] { return listener_.status.passivity_energy != 0; }));
}

TEST_F(HaplyProcess, EveryEndIsZero) {
  open_device();
  start_driver();
  set_force(0, 1, 0);
  check_every_end([&] { return std::abs(commanded()[1] - 1) < 1e-3; }, [&] { return commanded() == Vec3{}; });
}

TEST_F(HaplyProcess, ConnectsAgainAfterPowerCycles) {
  open_device();
  const auto port = device_->port(), event_port = device_->event_port();
  start_driver();
  for (int cycle = 1; cycle <= 2; ++cycle) {
    device_.reset();
    ASSERT_TRUE(health(Health::lost));
    open_device("vector", port, event_port);
    ASSERT_TRUE(health(Health::live));
    set_force(0, 1, 0);
    EXPECT_TRUE(feels(0, 1, 0)) << cycle;
    EXPECT_TRUE(counts("reconnects", cycle));
  }
  // The service goes on, but the device is unplugged and comes back.
  device_->unplug(true);
  ASSERT_TRUE(health(Health::lost));
  device_->unplug(false);
  ASSERT_TRUE(health(Health::live));
  EXPECT_TRUE(feels(0, 1, 0));
  EXPECT_EQ(device_->mistakes(), 0);
}

TEST_F(HaplyProcess, FollowsItsSimulator) {
  open_device();
  const auto port = device_->port(), event_port = device_->event_port();
  start_driver();
  device_.reset();
  ASSERT_TRUE(health(Health::lost));
  const testing::Process simulator("simulate-haptic-haply", {std::to_string(port), std::to_string(event_port)}, false);
  ASSERT_TRUE(health(Health::live));
  const int before = listener_.count;
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.count > before + 100; }));
}

TEST_F(HaplyProcess, RefusesAndCountsBadMessages) {
  open_device();
  start_driver();
  const std::string good = device_->report(false).dump();
  device_->send(good.substr(0, good.size() / 2));  // truncated
  device_->send(good + good);                      // joined
  device_->send("[]");
  device_->send(R"({"inverse3":[{"device_id":"049D","state":{}}]})");
  device_->send(R"({"inverse3":[{"device_id":"04\"9D","state":{}}]})");
  device_->send(R"({"inverse3":[{"device_id":"049D","state":{"cursor_position":{"x":1e9,"y":0,"z":0}}}]})");
  EXPECT_TRUE(counts("refused_json", 3));
  EXPECT_TRUE(counts("refused_content", 2));
  EXPECT_TRUE(counts("refused_range", 1));
  device_->send(std::string(70000, ' '));
  EXPECT_TRUE(counts("refused_size", 1));
  EXPECT_TRUE(health(Health::live));
}

TEST_F(HaplyProcess, LetsGoAfterASafetyEvent) {
  open_device();
  start_driver();
  set_force(0, 1, 0);
  ASSERT_TRUE(feels(0, 1, 0));
  device_->send_event("device-safety-triggered", "stall_detected");
  EXPECT_TRUE(feels(0, 0, 0));
  EXPECT_TRUE(feels(0, 1, 0));  // a second later
  device_->send_event("device-safety-triggered", "ebrake_triggered");
  EXPECT_TRUE(feels(0, 0, 0));
  EXPECT_TRUE(counts("braked", 1));
  const Nanoseconds since = now();
  EXPECT_FALSE(push([&] { return commanded() != Vec3{} || now() - since > 2'000'000'000; }) && commanded() != Vec3{});
  device_->send_event("device-safety-triggered", "ebrake_released");
  EXPECT_TRUE(feels(0, 1, 0));
  EXPECT_TRUE(counts("safety_events", 3));
}

// Nobody says that the brake is off after the service came back. So forces stay zero until it is released.
TEST_F(HaplyProcess, StaysBrakedWhenTheServiceIsBack) {
  open_device();
  const auto port = device_->port(), event_port = device_->event_port();
  start_driver();
  set_force(0, 1, 0);
  ASSERT_TRUE(feels(0, 1, 0));
  device_->send_event("device-safety-triggered", "ebrake_triggered");
  ASSERT_TRUE(counts("braked", 1));
  device_.reset();
  ASSERT_TRUE(health(Health::lost));
  open_device("vector", port, event_port);
  ASSERT_TRUE(health(Health::live));
  const Nanoseconds since = now();
  bool pushed = false;
  push([&] {
    pushed = pushed || commanded() != Vec3{};
    return pushed || now() - since > 1'000'000'000;
  });
  EXPECT_FALSE(pushed);
  EXPECT_TRUE(counts("braked", 1));
  // The connection of events may come back after that of the reports.
  const Nanoseconds released = now();
  while (!counts("braked", 0) && now() - released < 30'000'000'000)
    device_->send_event("device-safety-triggered", "ebrake_released");
  EXPECT_TRUE(feels(0, 1, 0));
}

// A brake is heard while no report has the device, for example before the first one.
TEST_F(HaplyProcess, HearsTheBrakeOfAnUnpluggedDevice) {
  open_device();
  start_driver();
  device_->unplug(true);
  ASSERT_TRUE(health(Health::lost));
  device_->send_event("device-safety-triggered", "ebrake_triggered");
  EXPECT_TRUE(counts("braked", 1));
}

TEST_F(HaplyProcess, LatencyAdded) {
  open_device();
  start_driver();
  // The way of a message to a force at the service.
  std::vector<double> latencies;
  for (int i = 0; i < 400; ++i) {
    const double newton = i % 2 == 0 ? 0.1 : 0.2;
    set_force(0, newton, 0);
    const Nanoseconds sent = now();
    write();
    while (std::abs(commanded()[1] - newton) > 1e-6 && now() - sent < 30'000'000) std::this_thread::yield();
    if (std::abs(commanded()[1] - newton) < 1e-6) latencies.push_back(1e-6 * static_cast<double>(now() - sent));
    std::this_thread::sleep_for(std::chrono::milliseconds(8));
  }
  ASSERT_GE(latencies.size(), 100u);
  std::sort(latencies.begin(), latencies.end());
  std::printf("haply: wrench to service p50 %.2f ms, p99 %.2f ms (%zu messages)\n", latencies[latencies.size() / 2],
              latencies[latencies.size() * 99 / 100], latencies.size());
}

}  // namespace
}  // namespace softhand
