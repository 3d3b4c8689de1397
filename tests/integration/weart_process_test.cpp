// softhand-tactile-weart with a simulated TouchDIVER: fingers, effects, power cycles, bad messages, the end.
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "support/device_process.hpp"
#include "support/press.hpp"
#include "tactile/weart/simulated_touchdiver.hpp"

namespace softhand::weart_process_test {
namespace {

using Effects = std::map<std::string, std::string>;

class WeartProcess : public testing::DeviceProcess<SkinTraction> {
 protected:
  WeartProcess() : DeviceProcess("tactile-weart") {}
  void start_driver(std::vector<std::string> settings = {}) {
    device_.emplace(0);
    settings.push_back("port=" + std::to_string(device_->port()));
    settings.emplace_back("full_scale_force=4");
    start(settings);
    ASSERT_TRUE(counts("connections", 1));
  }
  void touch(int finger, double newton, double slip = 0) {
    testing::press(input_, static_cast<Finger>(finger), newton, slip);
  }
  bool acts(const Effects& effects) {
    return push([&] { return device_->effects() == effects; });
  }
  // The distance from the wrist to the index tip.
  double reach() const {
    const Skeleton& hand = listener_.hands[1];
    return (to_vector(hand.joints[10].position) - to_vector(hand.joints[1].position)).norm();
  }

  std::optional<SimulatedTouchDiver> device_;
};

TEST_F(WeartProcess, AsksForTrackingAndFollowsFingers) {
  start_driver();
  ASSERT_TRUE(listener_.until([] {}, [&] { return device_->requests().size() == 4; }));
  const auto requests = device_->requests();
  EXPECT_EQ(requests[0], "StartFromClient:SdkLLCPP:2.0.0:TrackType1");
  EXPECT_EQ(requests[1].find(R"({"type":"MW_GET_STATUS","ts":)"), 0u);
  EXPECT_EQ(requests[2].find(R"({"type":"DEVICES_GET_STATUS","ts":)"), 0u);
  EXPECT_EQ(requests[3], "StartCalibration");

  const auto follows = [&](int index, bool is_open) {
    return listener_.until([&] { device_->send(weart_tracking(0, index, 0)); },
                           [&] { return listener_.count > 0 && (is_open ? reach() > 0.15 : reach() < 0.12); });
  };
  EXPECT_TRUE(follows(0, true));
  EXPECT_TRUE(follows(255, false));
  const Skeleton& hand = listener_.hands[1];
  EXPECT_EQ(hand.frame, 2u);
  EXPECT_EQ(hand.joints[1].flags, kJointValid | kJointInferred);
  EXPECT_EQ(hand.joints[10].flags, kJointValid | kJointTracked);
  EXPECT_EQ(hand.joints[20].flags, 0u);  // the ring finger is not measured

  // While the device calibrates, its curls are meaningless.
  device_->send("CalibrationStatus:1:1~");
  ASSERT_TRUE(counts("calibration", 1));
  const int before = listener_.count;
  for (int i = 0; i < 20; ++i) device_->send(weart_tracking(0, 0, 0));
  device_->send(R"({"type":"MW_STATUS","ts":1,"data":{"status":"CALIBRATION","statusCode":0}}~CalibrationStatus:1:2~)");
  ASSERT_TRUE(counts("calibration", 2));
  EXPECT_EQ(listener_.count, before);
  EXPECT_TRUE(follows(0, true));
}

TEST_F(WeartProcess, ActsOnTheSkin) {
  start_driver({"temperature=0.75", "texture=7", "full_scale_slip=0.1"});
  touch(1, 2);
  EXPECT_TRUE(acts({{"force:INDEX", "0.500000:0.000000:0.000000"}, {"temperature:INDEX", "0.750000"}}));
  touch(1, 0);
  touch(0, 40, 0.05);
  touch(3, 2);  // only a Pro has this point
  EXPECT_TRUE(acts({{"force:THUMB", "1.000000:0.000000:0.000000"},
                    {"temperature:THUMB", "0.750000"},
                    {"texture:THUMB", "7:0.500000:0.000000:0.250000:100.000000"}}));
  touch(0, 0);
  EXPECT_TRUE(acts({}));
}

TEST_F(WeartProcess, APro) {
  start_driver({"pro=true", "calibrate=false"});
  touch(4, 4);
  touch(5, 1);
  EXPECT_TRUE(acts({{"force:PALM", "0.250000:0.000000:0.000000"}, {"force:PINKY", "1.000000:0.000000:0.000000"}}));
  EXPECT_EQ(device_->requests().size(), 3u);
  const std::string bending =
      R"({"type":"TRACKING_BENDING_G2","ts":1,"data":{"handSide":"RIGHT","pinky":{"closure":1}}}~)";
  EXPECT_TRUE(listener_.until([&] { device_->send(bending); },
                              [&] { return listener_.hands[1].joints[25].flags == (kJointValid | kJointTracked); }));
}

TEST_F(WeartProcess, EveryEndIsZero) {
  start_driver();
  touch(1, 2);
  check_every_end([&] { return device_->effects().count("force:INDEX") == 1; },
                  [&] { return device_->effects().empty(); });
  EXPECT_TRUE(listener_.until([] {}, [&] { return device_->requests().back() == "StopFromClient"; }));
}

TEST_F(WeartProcess, IsAtZeroWhenAKilledDriverIsBack) {
  start_driver();
  touch(1, 2);
  check_restart_after_kill([&] { return device_->effects().count("force:INDEX") == 1; },
                           [&] { return device_->effects().empty(); },
                           [&] { start({"port=" + std::to_string(device_->port())}); });
}

TEST_F(WeartProcess, ConnectsAgainAfterPowerCycles) {
  start_driver();
  const int port = device_->port();
  touch(2, 4);
  for (int cycle = 1; cycle <= 2; ++cycle) {
    ASSERT_TRUE(listener_.until([&] { device_->send(weart_tracking(0, 0, 0)); },
                                [&] { return listener_.counter("health") == static_cast<double>(Health::live); }));
    device_.reset();
    ASSERT_TRUE(health(Health::lost));
    device_.emplace(port);
    ASSERT_TRUE(counts("reconnects", cycle));
    EXPECT_TRUE(acts({{"force:MIDDLE", "1.000000:0.000000:0.000000"}})) << cycle;
    EXPECT_EQ(device_->requests().at(0), "StartFromClient:SdkLLCPP:2.0.0:TrackType1");
  }
  device_.reset();
  ASSERT_TRUE(health(Health::lost));
  const testing::Process simulator("simulate-tactile-weart", {std::to_string(port)}, false);
  EXPECT_TRUE(health(Health::live));
}

// A middleware that ended while it calibrated says nothing about that calibration after its restart.
TEST_F(WeartProcess, FollowsFingersAfterACrashDuringTheCalibration) {
  start_driver();
  const int port = device_->port();
  device_->send("CalibrationStatus:1:1~");
  ASSERT_TRUE(counts("calibration", 1));
  device_.reset();
  ASSERT_TRUE(counts("connections", 0));
  device_.emplace(port);
  ASSERT_TRUE(counts("reconnects", 1));
  EXPECT_TRUE(listener_.until([&] { device_->send(weart_tracking(0, 0, 0)); }, [&] { return listener_.count > 0; }));
  EXPECT_TRUE(counts("calibration", 0));
}

TEST_F(WeartProcess, RefusesAndCountsBadMessages) {
  start_driver();
  const std::string good = weart_tracking(1, 2, 3);
  for (std::size_t i = 0; i < good.size(); i += 5) {  // split
    device_->send(good.substr(i, 5));
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  device_->send(good + good);                                      // joined
  device_->send(good.substr(0, good.size() - 1) + good);           // joined without an end
  device_->send("Tracking:TrackType1:1:2~{\"type\":~{}~" + good);  // truncated
  device_->send("Tracking:TrackType1:256:0:0:0:0:0:0:0~");
  device_->send(std::string(9000, 'A') + "~" + good);
  EXPECT_TRUE(counts("published", 5));
  EXPECT_TRUE(counts("refused_syntax", 2));
  EXPECT_TRUE(counts("refused_json", 1));
  EXPECT_TRUE(counts("refused_content", 1));
  EXPECT_TRUE(counts("refused_range", 1));
  EXPECT_TRUE(counts("refused_size", 1));
  device_->send(good.substr(0, 9));
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  device_.reset();
  EXPECT_TRUE(counts("refused_cut", 1));
}

TEST_F(WeartProcess, LatencyAdded) {
  start_driver();
  device_->send(weart_tracking(0, 0, 0));
  ASSERT_TRUE(listener_.until([] {}, [&] { return listener_.count > 0; }));
  testing::check_latency(listener_, "weart, TCP", [&] { device_->send(weart_tracking(9, 9, 9)); });
}

}  // namespace
}  // namespace softhand::weart_process_test
