// softhand-haptic-log: a simulated force-feedback glove that writes down what it receives.
#include "haptics/log/haptic_log_driver.hpp"
#include "service/device_service.hpp"

int main(int argc, char** argv) {
  return softhand::run_device<softhand::HapticLogDriver>(argc, argv, softhand::bus::topics::bone_wrench, 0, "haptic-log");
}
