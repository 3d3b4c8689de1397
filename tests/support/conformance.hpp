// Drivers of haptic and tactile devices against the conformance kit of the SDK.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <stdexcept>
#include <string>
#include <thread>

#include "device/conformance.hpp"
#include "model/hand_model.hpp"

namespace softhand::testing {

inline const HandModel& conformance_hand() {
  static const HandModel model = load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json");
  return model;
}

inline std::string lines_of(const std::vector<std::string>& faults) {
  std::string text;
  for (const std::string& fault : faults) text += fault + "\n";
  return text;
}
/// `make` returns a new driver.
template <typename Input>
std::string faults_of(const std::function<std::shared_ptr<DeviceDriver<Input>>()>& make) {
  return lines_of(conformance_faults<Input>(make));
}
/// `make` returns a new driver that is connected to its device.
template <typename Input>
std::string faults_at_device(const std::function<DriverAtDevice<Input>()>& make) {
  return lines_of(conformance_faults_at_device<Input>(make));
}

/// Waits until a device that also tracks is there. Throws after five seconds.
template <typename Device>
void wait_for_device(Device& device) {
  conformance_detail::NoSink sink;
  const Nanoseconds start = now();
  while (device.poll(now(), sink), !device.state().connected) {
    if (now() - start > 5'000'000'000) throw std::runtime_error("the driver does not find its device");
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

}  // namespace softhand::testing
