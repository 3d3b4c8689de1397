// softhand-tactile-log: a simulated tactile glove that writes down its contact events.
#include "service/device_service.hpp"
#include "tactile/log/tactile_log_driver.hpp"

int main(int argc, char** argv) {
  return softhand::run_device<softhand::TactileLogDriver>(argc, argv, softhand::bus::topics::contacts, 1, "tactile-log");
}
